"""From an edit to a candidate or a reason, cheap questions first; whatever an edit says, nothing of
it is carried out.
"""

from dataclasses import replace

import pytest
from collecting import each_of
from ibrid_search.edits import edit_between
from ibrid_search.evaluation.judging import Judgement, judge, judge_program
from ibrid_search.proposal import Proposal
from ibrid_search.screening.plausibility import refusal_reason
from ibrid_search.step import Status
from scripted_search import NAIVE, study

import ibrid
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.structure.compiling.canonical import structure_hash

GFL = ibrid.program_text(ibrid.textbook("gfl"))


def hash_of(text: str) -> str:
    return structure_hash(ibrid.parse_program(text), VOCABULARY)


def judged(edit: str, parent: str = NAIVE, known=lambda _: None, **changes) -> Judgement:
    return judge(Proposal(edit), parent, hash_of(parent), replace(study(), **changes), known)


def block(search: str, put: str) -> str:
    return f"<<<<<<< SEARCH\n{search}\n=======\n{put}\n>>>>>>> REPLACE\n"


GAIN = '    g.add("Gain_dq", "gain")'
WIRE = '    g.connect("gain.out", "plant.u_r")'


# one status after the other, in the order of the pipeline


def test_a_candidate_that_passes_waits_for_its_fit():
    verdict = judged(block(GAIN, '    g.add("PI_dq", "gain")'))
    assert (verdict.status, verdict.reason, verdict.same_as) == (Status.PENDING, "", None)
    assert verdict.hash == hash_of(NAIVE.replace("Gain_dq", "PI_dq"))
    assert ibrid.parse_program(verdict.program).instances[1].kind == "PI_dq"


def test_no_answer_says_what_the_proposer_says():
    verdict = judge(
        Proposal("", failure="the server is silent"), NAIVE, "", study(), lambda _: None
    )
    assert (verdict.status, verdict.reason) == (Status.NO_ANSWER, "the server is silent")


@pytest.mark.parametrize("edit", ["", "I would add a PLL.", "<<<<<<< SEARCH\nhalf a block"])
def test_without_a_block_there_is_no_edit(edit):
    assert judged(edit).status is Status.NO_EDIT


def test_a_block_that_does_not_match_names_the_nearest_line():
    verdict = judged(block('    g.add("Gain_dq", "gian")', ""))
    assert verdict.status is Status.NO_MATCH
    assert '"gain"' in verdict.reason


def test_a_block_that_matches_twice_names_the_lines():
    twice = NAIVE + '    g.add("Gain_dq", "other")\n' + WIRE + "\n"
    verdict = judge(Proposal(block(WIRE, "")), twice, "", study(), lambda _: None)
    assert verdict.status is Status.AMBIGUOUS
    assert "lines" in verdict.reason


def test_a_text_that_is_no_program_is_unreadable():
    verdict = judged(block(GAIN, "    while True: pass"))
    assert verdict.status is Status.UNREADABLE
    assert "line" in verdict.reason


def test_other_names_and_another_order_are_no_change():
    lines = NAIVE.splitlines()
    text = "\n".join([lines[0], *reversed(lines[1:])]).replace("gain", "factor") + "\n"
    verdict = judged(edit_between(NAIVE, text))
    assert (verdict.status, verdict.hash) == (Status.UNCHANGED, hash_of(NAIVE))


def test_a_structure_met_before_is_a_duplicate_of_that_step():
    known = {hash_of(GFL): 17}
    verdict = judged(edit_between(NAIVE, GFL), known=known.get)
    assert (verdict.status, verdict.same_as) == (Status.DUPLICATE, 17)
    assert "step 17" in verdict.reason


def test_a_breach_of_the_grammar_is_illegal_with_every_violation_and_its_remedy():
    verdict = judged(block(WIRE, ""))
    assert verdict.status is Status.ILLEGAL
    assert "plant.u_r" in verdict.reason
    assert "connect" in verdict.reason
    both = judged(block(WIRE, '    g.add("PI", "scalar")\n    g.connect("gain.out", "scalar.in_")'))
    assert "plant.u_r" in both.reason
    assert "scalar.in_" in both.reason


@pytest.mark.parametrize(
    ("line", "near"),
    [
        ('g.add("PI_qd", "gain")', "PI_dq"),
        ('g.add("Gain_dq", "gain", kp=1.0)', "k"),
        ('g.connect("gain.out", "plant.u")', "u_r"),
    ],
)
def test_a_word_that_does_not_exist_is_illegal_and_names_its_neighbour(line, near):
    verdict = judged(block(GAIN if "add" in line else WIRE, f"    {line}"))
    assert verdict.status is Status.ILLEGAL
    assert near in verdict.reason


def test_half_a_frame_is_implausible():
    text = NAIVE.replace(
        '    g.connect("plant.i_g", "i_DQ")',
        '    g.add("SRF_PLL", "pll")\n    g.add("Rot_i", "park")\n    g.connect("plant.e_q", '
        '"pll.e_q")\n'
        '    g.connect("pll.delta", "park.delta")\n    g.connect("plant.i_g", "park.i_dq")\n'
        '    g.connect("park.i_DQ", "i_DQ")',
    )
    verdict = judge_program(text, study())
    assert verdict.status is Status.IMPLAUSIBLE
    assert "Rot_v" in verdict.reason


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('g.connect("v_DQ", "plant.v_in")', 'g.add("ConstZero", "zero")', ""),
        ('g.add("JMul", "decoupling")', 'g.add("JMul", "decoupling", L=0.15)', "seconds"),
        ('g.add("JMul", "decoupling")', 'g.add("JMul", "decoupling", L="plant.L_F")', "omega_0"),
    ],
    ids=["nothing at v_in", "seconds", "shared with per unit"],
)
def test_a_slip_that_a_fit_would_hide_is_refused(old, new, word):
    text = GFL if "JMul" in old else NAIVE
    verdict = judge_program(text.replace(old, new), study())
    assert verdict.status in (Status.IMPLAUSIBLE, Status.ILLEGAL)
    assert verdict.status is Status.ILLEGAL or word in verdict.reason


def test_a_module_without_a_way_out_is_implausible():
    idle = NAIVE + '    g.add("Gain_dq", "idle")\n    g.connect("plant.i_g", "idle.in_")\n'
    verdict = judge_program(idle, study())
    assert verdict.status is Status.IMPLAUSIBLE
    assert "idle" in verdict.reason


def test_other_warnings_are_no_refusals():
    bound = GFL.replace('"Rot_i", "park_i"', '"Rot_i", "park_i", I0d=1.0')
    diagram = ibrid.parse_program(bound)
    warnings = ibrid.structure.compiling.check.warnings(diagram, VOCABULARY)
    assert warnings != ()
    assert refusal_reason(warnings) == ""
    assert judge_program(bound, study()).status is Status.PENDING


# the order of the questions


def test_what_the_hash_does_not_see_is_no_repetition():
    """Neither unchanged nor known, but wrong: a binding that the kind does not have, on a structure
    that is there.
    """
    wrong = NAIVE.replace('"gain")', '"gain", kp=1.0)')
    assert (
        judged(edit_between(NAIVE, wrong), known={hash_of(NAIVE): 0}.get).status is Status.ILLEGAL
    )
    assert (
        judged(edit_between(GFL, wrong), GFL, known={hash_of(NAIVE): 0}.get).status
        is Status.ILLEGAL
    )


def test_unchanged_comes_before_duplicate():
    verdict = judged(edit_between(NAIVE, NAIVE.replace("gain", "k")), known={hash_of(NAIVE): 0}.get)
    assert verdict.status is Status.UNCHANGED


def test_the_vocabulary_and_the_equilibrium_of_the_run_count():
    extended = edit_between(GFL, ibrid.program_text(ibrid.textbook("gfl_exact")))
    assert judged(extended, GFL).status is Status.PENDING
    verdict = judged(extended, GFL, vocabulary=PAPER_VOCABULARY, equilibrium="paper")
    assert verdict.status is Status.ILLEGAL
    assert "JMul_omega" in verdict.reason


# hostile answers


HOSTILE = [
    "__import__('os').system('touch /tmp/ibrid_was_here')",
    "exec(\"import os; os.mkdir('ibrid_was_here')\")",
    'g.add("Gain_dq", "gain", k=open("/etc/passwd").read())',
    'g.add("Gain_dq", "gain", k=1 if __import__("os") else 2)',
    'g.add("Gain_dq", "gain", **{"k": 1})',
    'g.add(*["Gain_dq", "gain"])',
    'g.add("Gain_dq", "gain", k=(lambda: 1)())',
    'g.add("Gain_dq", f"{1}")',
    'g.__class__.__init__.__globals__["os"]',
    "import os",
    "from pathlib import Path",
    "global g",
    "return g",
    "yield g",
    "@g.add\n    def inner(): pass",
    'g.add("Gain_dq", "gain"); import os',
    'g.add("Gain_dq", "gain", k=10**10**10)',
    'g.add("Gain_dq", "gain", k=' + "9" * 10_000 + ")",
    'g.add("Gain_dq", "gain", k=nan)',
    'g.add("Gain_dq", "' + "x" * 50_000 + '")',
    'g.add("Gain_dq", "gain\x00")',
    'g.add("Gain_dq", "../../etc/passwd")',
    'g.add("Gain_dq", "v_DQ")',
    "(" * 5_000 + ")" * 5_000,
    "-" * 20_000 + "1",
    'g.add("Gain_dq", "gain"' + ", k=1" * 1_000 + ")",
    "\ud800",
    "\x1b]0;owned\x07",
]


@pytest.mark.slow
@pytest.mark.parametrize("line", HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_edit_is_refused_and_nothing_is_carried_out(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    verdict = judged(block(GAIN, f"    {line}"))
    assert verdict.status in (Status.UNREADABLE, Status.ILLEGAL)
    assert 0 < len(verdict.reason) < 2_000
    assert list(tmp_path.iterdir()) == []


NO_PROGRAM = [
    "",
    "\n",
    "print(1)",
    "def f(g): pass",
    "class A: pass",
    "x" * 200_000,
    "\x00",
    "def f(g):\n" + '    g.add("Gain_dq", "a")\n' * 3_000,
]


@pytest.mark.slow
@each_of("text", NO_PROGRAM, ids=range(len(NO_PROGRAM)))
def test_a_whole_program_that_is_none_is_refused(text):
    verdict = judge_program(text, study())
    assert verdict.status in (Status.UNREADABLE, Status.ILLEGAL)
    assert verdict.reason


def test_a_thousand_connections_are_refused_before_anything_slow():
    text = NAIVE + '    g.connect("v_DQ", "gain.in_")\n' * 5_000
    assert judge_program(text, study()).status in (Status.UNREADABLE, Status.ILLEGAL)
