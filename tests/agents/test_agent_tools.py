"""The tools of agents: what they answer, what they refuse, and that no text they get is ever more
than text.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.hidden.hardware import draw_hardware
from ibrid_search.agents.logbook import Logbook
from ibrid_search.agents.mcp_server import open_logbook, serve
from ibrid_search.agents.tool import call_by_name, capped, complaint, listed
from ibrid_search.agents.workbench import Workbench
from ibrid_search.language_models.physics_in_words import physics_in_words
from ibrid_search.report.page import write_run_page
from ibrid_search.run.store import Store
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.time_slices import TimeSliceOver
from ibrid_search.step import Status, Step

import ibrid
from ibrid.analysis.models.prediction import predict
from ibrid.errors import IbridError
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.library import textbook_text
from ibrid.study import Study

NAIVE = textbook_text("naive")
BRIEF = FitSettings(restarts=0)
L_FILTER_WITH_PI = """\
def build(g):
    g.add("LFilter", "plant")
    g.add("PI_dq", "current")
    g.add("Negate_dq", "minus")
    g.add("ConstZero", "no_frequency")
    g.connect("v_DQ", "plant.v_in")
    g.connect("plant.i_g", "minus.in_")
    g.connect("minus.out", "current.in_")
    g.connect("current.out", "plant.u_r")
    g.connect("no_frequency.out", "plant.delta_omega")
    g.connect("plant.i_g", "i_DQ")
"""
UNWIRED = 'def build(g):\n    g.add("LCL", "plant")\n'
HOSTILE = (
    "",
    "../../etc/passwd",
    "/etc/passwd",
    "import os\nos.system('true')\n",
    "def f(g):\n    __import__('os').system('true')\n",
    "def f(g):\n    g.add('__import__', 'os')\n",
    "def f(g):\n    g.add('LCL', 'plant', L_F=open('x'))\n",
    "def f(g):\n" + "    g.add('Gain', 'g')\n" * 4_000,
    "(" * 100_000,
    "\x00",
    "def f(g):\n    g.add('LCL', '\ud800')\n",
)


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


@pytest.fixture(scope="module")
def few(sweep: Sweep) -> Sweep:
    """Four frequencies of one operating point: what is asked is how the tools answer."""
    return replace(sweep, points=tuple(coarse(sweep.points, 1, 4)))


@pytest.fixture(scope="module")
def bench(sweep: Sweep) -> Workbench:
    """Step 0: naive, step 1: a current loop, step 2: illegal."""
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    for program in (NAIVE, L_FILTER_WITH_PI, UNWIRED):
        ask(bench, "evaluate_program", program=program)
    return bench


def ask(bench: Workbench, tool: str, **arguments: object) -> dict:
    """The answer, which always is JSON of bounded length beside a program, which comes whole."""
    answer = call_by_name(bench.all, tool, arguments)
    rest = {key: value for key, value in answer.items() if key != "program"}
    assert len(json.dumps(rest, allow_nan=False, ensure_ascii=False)) <= 4_000
    return answer


@pytest.mark.slow
def test_an_evaluated_program_answers_with_its_error_and_where_it_lies(sweep: Sweep):
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    answer = ask(bench, "evaluate_program", program=NAIVE)
    record = ibrid.evaluate(ibrid.parse_program(NAIVE), sweep, restarts=0)
    assert (answer["step"], answer["status"]) == (0, "ok")
    assert answer["nrmse"] == pytest.approx(record.nrmse, rel=1e-5)  # shown with six digits
    assert answer["worst_parts"]


@pytest.mark.slow
def test_the_shares_of_all_parts_add_up_to_one_and_come_worst_first(sweep: Sweep, bench: Workbench):
    shares = [
        part["share"]
        for op in sweep.names
        for band in ("5-50", "50-500", "500-2000", "2000-5000")
        for part in ask(bench, "show_record", step=0, op=op, band=band)["worst_parts"]
    ]
    assert sum(shares) == pytest.approx(1.0, rel=1e-4)  # six digits each
    shown = [part["share"] for part in ask(bench, "show_record", step=0)["worst_parts"]]
    assert shown == sorted(shares, reverse=True)[: len(shown)]


@pytest.mark.slow
def test_the_error_of_a_part_is_that_of_the_record(sweep: Sweep, bench: Workbench):
    record = bench.steps.record(0)
    for part in ask(bench, "show_record", step=0)["worst_parts"]:
        expected = record.nrmse_by_part[part["op"]][part["band_hz"]][part["entry"]]
        assert part["error"] == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
def test_a_chosen_part_lists_its_frequencies_with_measurement_and_model(
    sweep: Sweep, bench: Workbench
):
    op = sweep.names[0]
    answer = ask(bench, "show_record", step=0, op=op, band="5-50", entry="qq")
    frequency = sweep.point(op).frequency
    assert [one["hz"] for one in answer["frequencies"]] == pytest.approx(
        frequency[frequency < 50], rel=1e-5
    )
    k = int(np.argmin(abs(frequency - answer["frequencies"][0]["hz"])))
    measured = sweep.point(op).admittance[k, 1, 1]
    assert answer["frequencies"][0]["measured"].startswith(f"{abs(measured):.4g} at ")


@pytest.mark.slow
def test_a_part_that_the_data_lack_is_named_with_the_known_ones(bench: Workbench):
    assert "known are: dd, dq, qd, qq" in ask(bench, "show_record", step=0, entry="xx")["error"]
    assert "operating point" in ask(bench, "show_record", step=0, op="p=7")["error"]


@pytest.mark.slow
def test_an_illegal_program_is_refused_with_every_violation_and_remedy(bench: Workbench):
    answer = ask(bench, "evaluate_program", program=UNWIRED)
    assert answer["status"] == "illegal"
    assert len(answer["violations"]) == 4  # three inputs and i_DQ
    assert all(
        "connect" in one["message"] or "add" in one["message"] for one in answer["violations"]
    )
    assert answer["violations"] == ask(bench, "check_grammar", program=UNWIRED)["violations"]


@pytest.mark.slow
def test_a_structure_met_before_is_not_evaluated_again(bench: Workbench):
    renamed = NAIVE.replace('"gain', '"k')
    answer = ask(bench, "evaluate_program", program=renamed)
    assert (answer["status"], answer["same_as"]) == ("duplicate", 0)
    assert answer["nrmse"] == ask(bench, "show_record", step=0)["nrmse"]
    assert ask(bench, "check_grammar", program=renamed)["met_before"] == "step 0"


@pytest.mark.slow
def test_the_step_that_a_program_was_made_from_is_kept_for_the_lineage(sweep: Sweep):
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    ask(bench, "evaluate_program", program=NAIVE)
    ask(bench, "evaluate_program", program=L_FILTER_WITH_PI, parent=0, note="a current\nloop")
    assert [(one.parent, one.note) for one in bench.logbook.steps] == [
        (None, ""),
        (0, "a current loop"),
    ]


@pytest.mark.slow
def test_another_seed_is_another_evaluation(bench: Workbench):
    assert ask(bench, "evaluate_program", program=NAIVE, settings={"seed": 1})["status"] == "ok"
    assert (
        ask(bench, "evaluate_program", program=NAIVE, settings={"seed": 1})["status"] == "duplicate"
    )


@pytest.mark.slow
def test_a_held_out_point_is_predicted_and_not_ranked_with_the_others(
    sweep: Sweep, bench: Workbench
):
    out = sweep.names[1]
    answer = ask(
        bench, "evaluate_program", program=L_FILTER_WITH_PI, settings={"holdout_op": [out]}
    )
    assert set(answer["holdout"]) == {out}
    assert answer["step"] not in [one["step"] for one in ask(bench, "list_best", count=20)["best"]]


@pytest.mark.slow
def test_the_best_come_first_and_unstable_ones_last(sweep: Sweep):
    logbook = Logbook(Study(sweep), fit=BRIEF)
    for program in (NAIVE, L_FILTER_WITH_PI):
        logbook.submit(program)
    errors = [one.record.nrmse or 0.0 for one in logbook.best(2)]
    assert errors == sorted(errors)
    first = logbook.best(1)[0].step
    logbook._steps[first] = replace(logbook.steps[first], stable=False)
    assert logbook.best(2)[-1].step == first


@pytest.mark.slow
def test_what_a_step_leaves_is_told_in_deviations_of_the_noise(sweep: Sweep):
    noisy = add_noise(sweep, 40, rng=np.random.default_rng(3))
    bench = Workbench(Logbook(Study(noisy), fit=BRIEF))
    ask(bench, "evaluate_program", program=NAIVE)
    ask(bench, "evaluate_program", program=textbook_text("gfl_pll_filter_exact"))
    wrong, right = (ask(bench, "show_residuals", step=step) for step in (0, 1))
    point, record = noisy.points[0], bench.steps.record(0)
    left = np.abs(record.response(point.op.name, point.frequency) - point.admittance) / (
        np.sqrt(2) * point.sigma
    )
    assert [row["dq"] for row in wrong["rows"]] == pytest.approx(left[:, 0, 1], abs=0.05)
    assert [row["hz"] for row in wrong["rows"]] == sorted(row["hz"] for row in wrong["rows"])
    assert wrong["stand_out"]
    assert wrong["next"] == "diagnose with step=0"
    assert right["stand_out"] == []  # the truth leaves noise
    assert (
        max(row["dd"] for row in right["rows"]) < 5
    )  # one in a million of |normal + j normal| / sqrt(2) beyond 3.7
    assert right["next"].endswith("finish with step=1")


@pytest.mark.slow
def test_all_steps_are_listed_with_their_parents_also_those_that_were_refused(sweep: Sweep):
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    for program, parent in ((NAIVE, None), (UNWIRED, None), (L_FILTER_WITH_PI, 0)):
        ask(
            bench,
            "evaluate_program",
            program=program,
            **({} if parent is None else {"parent": parent}),
        )
    answer = ask(bench, "list_steps")
    assert [(one["step"], one["status"], one.get("parent")) for one in answer["steps"]] == [
        (0, "ok", None),
        (1, "illegal", None),
        (2, "ok", 0),
    ]
    assert [one["step"] for one in ask(bench, "list_steps", after=1)["steps"]] == [2]
    assert {one["step"]: one["lineage"] for one in ask(bench, "list_best")["best"]} == {
        0: [0],
        2: [0, 2],
    }


@pytest.mark.slow
def test_a_held_out_point_is_predicted_by_a_tool_as_by_the_package(sweep: Sweep):
    out = sweep.names[1]
    bench = Workbench(Logbook(Study(sweep, holdout_op=out), fit=BRIEF))
    ask(bench, "evaluate_program", program=textbook_text("gfl_pll_filter_exact"))
    answer = ask(bench, "predict_point", step=0, op=out)
    assert answer["nrmse"] == pytest.approx(bench.steps.record(0).holdout[out], rel=1e-5)
    assert not answer["fitted"]
    elsewhere = ask(bench, "predict_point", step=0, op="p=0.5,q=0")
    expected = predict(bench.steps.record(0), "p=0.5,q=0", sweep.points[0].frequency).admittance[
        0, 1, 1
    ]
    assert elsewhere["rows"][0]["qq"].startswith(f"{abs(expected):.4g} at ")
    assert "nrmse" not in elsewhere
    assert "error" in ask(bench, "predict_point", step=0, op="nowhere")


@pytest.mark.slow
def test_an_answer_is_kept_in_the_run_with_its_reasons_and_what_speaks_against_it(
    sweep: Sweep, tmp_path: Path
):
    with open_logbook(Study(sweep), BRIEF, tmp_path, NAIVE) as logbook:
        bench = Workbench(logbook)
        ask(bench, "evaluate_program", program=NAIVE)
        ask(bench, "evaluate_program", program=L_FILTER_WITH_PI)
        assert "reasons" in ask(bench, "finish", step=0, reasons=" ")["error"]
        answer = ask(bench, "finish", step=0, reasons="it is the smaller one")
        assert any("step 1 is more plausible" in one for one in answer["doubts"])
        assert any("more than noise" in one for one in answer["doubts"])
    found = json.loads((tmp_path / "selection.json").read_text(encoding="utf-8"))
    assert (found["answer"], found["why"]) == (0, "it is the smaller one")
    assert ibrid.read_record(tmp_path / "best.json").modules == len(
        ibrid.textbook("naive").instances
    )
    page = write_run_page(tmp_path).read_text(encoding="utf-8")
    assert "It is the smaller one" in page or "it is the smaller one" in page


def test_the_data_are_put_into_words(sweep: Sweep):
    follows = " ".join(physics_in_words(ibrid.read_sweep(ibrid.benchmarks()["gfl_dc_link"])))
    assert (
        "active power does not depend on the size of the voltage" in follows
    )  # as its DC link's control does it
    assert "the angle has settled at 5 Hz" in follows
    assert "an inductance of 0.0778 pu" in follows
    forms = " ".join(physics_in_words(ibrid.read_sweep(ibrid.benchmarks()["gfm_vsm"])))
    assert "a voltage is held" in forms
    assert "the angle has not settled" in forms


def test_a_paper_task_refuses_extended_kinds(sweep: Sweep):
    bench = Workbench(
        Logbook(
            Study(sweep, vocabulary="paper", equilibrium="paper", parameters="per-op"), fit=BRIEF
        )
    )
    program = NAIVE.replace('g.add("Gain_dq", "gain")', 'g.add("Delay", "gain")')
    answer = ask(bench, "check_grammar", program=program)
    assert not answer["legal"]
    assert "Delay" in answer["violations"][0]["message"]
    assert "Delay" not in ask(bench, "describe_vocabulary")["kinds"]


@pytest.mark.slow
def test_the_data_are_shown_in_frequency_order_and_what_is_left_out_is_counted(
    sweep: Sweep, bench: Workbench
):
    point = sweep.points[0]
    answer = ask(bench, "show_data", op=point.op.name, view="Z")
    shown = [row["hz"] for row in answer["rows"]]
    assert shown == sorted(shown)
    assert len(shown) + answer["left_out_between"] == len(point.frequency)
    k = int(np.argmin(abs(point.frequency - shown[3])))
    impedance = -np.linalg.inv(point.admittance[k])
    assert answer["rows"][3]["dq"].startswith(f"{abs(impedance[0, 1]):.4g} at ")
    assert "nothing lies between" in ask(bench, "show_data", low=1e6)["error"]


def test_a_feedforward_through_a_sogi_is_seen_by_the_negative_sequence_and_said():
    sweep = draw_hardware(0, ["feedforward_band_pass:add:sogi"], points=2).sweep
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    answer = ask(bench, "show_data", view="sequence", low=40, high=400)
    seen = {
        row["hz"]: [float(cell.split()[0]) for name, cell in row.items() if name != "hz"]
        for row in answer["rows"]
    }
    near = min(seen, key=lambda hertz: abs(hertz - 2 * sweep.f0_hz))
    assert seen[near][1] > 2 * max(seen[min(seen)][1], seen[max(seen)][1])
    assert seen[near][1] > 2 * seen[near][0]
    assert set(answer["rows"][0]) == {
        "hz",
        f"positive, at {sweep.f0_hz + answer['rows'][0]['hz']:.4g} Hz",
        f"negative, at {sweep.f0_hz - answer['rows'][0]['hz']:.4g} Hz",
    }
    assert any("passes a SOGI band-pass" in sentence for sentence in answer["warnings"])


@pytest.mark.nightly
def test_shipped_diagrams_come_in_the_order_of_a_first_look(bench: Workbench):
    ranked = ask(bench, "list_diagrams")["ranked"]
    assert ranked[0]["name"] == "gfl_pll_filter_exact"  # what the benchmark is
    assert ranked[0]["error"] < 1e-6 < ranked[-1]["error"]
    for name in ("gfl", *(one["name"] for one in ranked[:3])):
        assert ask(bench, "read_diagram", name=name)["program"] == textbook_text(name)


@pytest.mark.nightly
def test_the_diagnosis_of_a_step_is_ranked_new_and_ready_to_be_evaluated(sweep: Sweep):
    bench = Workbench(Logbook(Study(sweep), fit=BRIEF))
    before = ask(bench, "evaluate_program", program=textbook_text("gfl_exact"))
    answer = ask(bench, "diagnose", step=0, count=3)
    assert len(answer["ranked"]) == 3
    assert (
        answer["ranked"][0]["error"] <= answer["ranked"][1]["error"] * 1.5
    )  # beside the error the size counts
    after = ask(bench, "evaluate_program", program=answer["program"], parent=0)
    assert after["nrmse"] <= 1.01 * answer["ranked"][0]["error"] < before["nrmse"]
    again = ask(bench, "diagnose", step=0, count=3)
    assert answer["ranked"][0]["edit"] not in {one["edit"] for one in again["ranked"]}


@pytest.mark.slow
def test_a_diagnosis_in_slices_ends_with_the_ranking_of_one_go_and_each_structure_once(few: Sweep):
    whole = Workbench(Logbook(Study(few), fit=BRIEF))
    ask(whole, "evaluate_program", program=NAIVE)
    expected = ask(whole, "diagnose", step=0, count=5)
    sliced = Workbench(
        Logbook(Study(replace(few, notes=("in slices",))), fit=BRIEF), answer_within=1e-9
    )
    ask(sliced, "evaluate_program", program=NAIVE)
    answers = [ask(sliced, "diagnose", step=0, count=5)]
    while "continue" in answers[-1]:
        assert "ranked" not in answers[-1]
        answers.append(ask(sliced, "diagnose", step=0, count=5))
    assert len(answers) > 5
    assert answers[-1] == expected
    hashes = [sliced.study.hash_of(look.edit.diagram) for look in sliced.insight.ranked(0, 20)]
    assert len(hashes) == len(set(hashes))


@pytest.mark.slow
def test_first_looks_in_slices_are_those_of_one_go(few: Sweep):
    whole = Workbench(Logbook(Study(few), fit=BRIEF))
    sliced = Workbench(
        Logbook(Study(replace(few, notes=("in slices",))), fit=BRIEF), answer_within=1e-9
    )
    for tool, arguments in (
        ("try_programs", {"programs": [NAIVE, L_FILTER_WITH_PI, UNWIRED]}),
        ("list_diagrams", {}),
    ):
        answers = [ask(sliced, tool, **arguments)]
        while "continue" in answers[-1]:
            answers.append(ask(sliced, tool, **arguments))
        assert len(answers) > 1
        assert answers[-1] == ask(whole, tool, **arguments)


@pytest.mark.slow
def test_an_edit_of_a_diagnosis_is_evaluated_without_a_word_of_its_program(few: Sweep):
    bench = Workbench(Logbook(Study(few), fit=BRIEF))
    ask(bench, "evaluate_program", program=NAIVE)
    ranked = ask(bench, "diagnose", step=0, count=2, place=2)
    answer = ask(bench, "evaluate_edit", step=0, place=2)
    assert answer["edit"] == ranked["ranked"][1]["edit"]
    assert bench.steps.steps[1].program.strip() == ranked["program"].strip()
    assert bench.steps.steps[1].parent == 0
    assert (
        "found place 3; take one of them" in ask(bench, "evaluate_edit", step=0, place=3)["error"]
    )
    unfinished = Workbench(
        Logbook(Study(replace(few, notes=("not diagnosed",))), fit=BRIEF), answer_within=1e-9
    )
    ask(unfinished, "evaluate_program", program=NAIVE)
    assert "call diagnose with step=0 first" in ask(unfinished, "evaluate_edit", step=0)["error"]


@pytest.mark.slow
def test_places_stay_those_of_the_diagnosis_that_was_told_while_its_edits_are_evaluated(few: Sweep):
    bench = Workbench(Logbook(Study(few), fit=BRIEF))
    ask(bench, "evaluate_program", program=NAIVE)
    told = ask(bench, "diagnose", step=0, count=3, place=0)
    assert told["errors_are"].startswith("NRMSE; ")  # `few` has no noise to weigh by
    assert told["step_screened"] == pytest.approx(told["step_error"], rel=0.05)  # of all data there
    assert "program" not in told
    assert "with the program" not in told["next"]
    evaluated = [ask(bench, "evaluate_edit", step=0, place=place) for place in (1, 2, 1)]
    assert [one["edit"] for one in evaluated] == [
        told["ranked"][place - 1]["edit"] for place in (1, 2, 1)
    ]
    assert evaluated[2]["same_as"] == 1


@pytest.mark.slow
def test_the_smaller_of_two_models_that_noise_explains_is_finished_without_a_doubt():
    clean = ibrid.read_sweep(ibrid.benchmarks()["gfl_l_filter"])
    noisy = add_noise(clean, 50.0, rng=np.random.default_rng(3))
    bench = Workbench(Logbook(Study(noisy), fit=BRIEF))
    small, large = (
        ask(bench, "evaluate_program", name=name) for name in ("gfl_l_filter", "gfl_two_degrees")
    )
    assert small["grade"] == large["grade"] == "explains"
    assert small["free_parameters"] < large["free_parameters"]
    assert ask(bench, "finish", step=small["step"], reasons="smaller")["doubts"] == []


def test_a_published_control_is_evaluated_by_its_name(few: Sweep):
    bench = Workbench(Logbook(Study(replace(few, notes=("by name",))), fit=BRIEF))
    by_name = ask(bench, "evaluate_program", name="naive")
    assert by_name["status"] == "ok"
    assert ask(bench, "evaluate_program", program=NAIVE)["same_as"] == by_name["step"]
    for wrong in ({}, {"program": NAIVE, "name": "naive"}):
        assert "give one" in ask(bench, "evaluate_program", **wrong)["error"]


@pytest.mark.slow
def test_a_slice_says_how_many_pairs_of_edits_are_left(few: Sweep):
    bench = Workbench(Logbook(Study(replace(few, notes=("pairs",))), fit=BRIEF))
    ask(bench, "evaluate_program", program=NAIVE)
    rankings, firsts = rankings_for(bench.study), bench.insight.ranked(0, 1)
    with rankings.screener.time_slice(0.0) as part, pytest.raises(TimeSliceOver):
        rankings._rank_pairs(firsts)
    assert part.remaining > 1


@pytest.mark.slow
def test_programs_are_looked_at_side_by_side_and_none_is_an_evaluation(bench: Workbench):
    steps = len(bench.logbook.steps)
    looks = ask(
        bench, "try_programs", programs=[textbook_text("gfl_pll_filter_exact"), NAIVE, UNWIRED]
    )["looks"]
    assert looks[0]["error"] < 1e-6 < looks[1]["error"]
    assert "check_grammar" in looks[2]["refused"]
    assert (
        ask(bench, "try_programs", programs=[NAIVE], parent=0)["looks"][0]["error"]
        < 1.01 * bench.steps.record(0).nrmse
    )
    assert "1 to 8" in ask(bench, "try_programs", programs=[])["error"]
    assert len(bench.logbook.steps) == steps


@pytest.mark.slow
def test_the_vocabulary_is_described_from_its_declarations(bench: Workbench):
    answer = ask(bench, "describe_vocabulary")
    assert {kind.name for kind in VOCABULARY} <= set(answer["kinds"].split(", "))
    in_a_line_each = ask(bench, "describe_vocabulary", part="kinds")["kinds"].splitlines()
    assert {kind.name for kind in VOCABULARY} <= {
        line.strip().split(":")[0] for line in in_a_line_each
    }
    in_full = "\n".join(ask(bench, "describe_vocabulary", kind="LCL")["lines"])
    assert all(name in in_full for name in ("L_F", "R_F", "C_F", "L_g", "R_g"))
    assert "did you mean Delay?" in ask(bench, "describe_vocabulary", kind="Dely")["error"]


@pytest.mark.slow
def test_steps_and_programs_are_compared(bench: Workbench):
    assert ask(bench, "compare", a=0, b=NAIVE)["same"]
    answer, errors = (
        ask(bench, "compare", a=0, b=1),
        [bench.steps.record(step).nrmse for step in (0, 1)],
    )
    assert not answer["same"]
    assert answer["first_then_second"]["nrmse"] == pytest.approx(errors, rel=1e-5)
    assert "current" in answer["only_b"]
    assert "not legal" in ask(bench, "compare", a=0, b=UNWIRED)["error"]


@pytest.mark.slow
@each_of("text", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_text_is_refused_by_every_tool_that_takes_a_program(bench: Workbench, text: str):
    assert ask(bench, "evaluate_program", program=text)["status"] in ("unreadable", "illegal")
    assert ask(bench, "check_grammar", program=text)["violations"]
    assert ask(bench, "compare", a=text, b=0)["error"]


@pytest.mark.slow
@each_of(
    ("tool", "arguments", "words"),
    [
        ("evaluate_program", {}, "takes a program or the name"),
        ("evaluate_program", {"program": 5}, "of type string, found 5"),
        ("evaluate_program", {"program": "x" * 5_000_000}, "at most 200000 characters"),
        ("evaluate_program", {"program": NAIVE, "settings": {"effort": "much"}}, "low"),
        (
            "evaluate_program",
            {"program": NAIVE, "settings": {"restart": 1}},
            "did you mean restarts?",
        ),
        (
            "evaluate_program",
            {"program": NAIVE, "settings": {"holdout_op": ["nowhere"]}},
            "no operating point",
        ),
        ("evaluate_program", {"program": NAIVE, "settings": {"holdout_op": [1]}}, "entry 1"),
        ("evaluate_program", {"program": NAIVE, "parent": 2}, "step 2 has no fit"),
        ("show_record", {"step": "../../etc/passwd"}, "of type integer"),
        ("show_record", {"step": True}, "of type integer"),
        ("show_record", {"step": 10**9}, "no step"),
        ("show_record", {"step": 2}, "has no fit"),
        ("list_best", {"count": -1}, "must lie within"),
        ("list_best", ["count"], "of type object"),
        ("list_bset", {}, "did you mean list_best"),
        ("x" * 1000, {}, "there is no tool"),
        (None, {}, "there is no tool"),
    ],
)
def test_a_wrong_call_is_answered_in_one_sentence(
    bench: Workbench, tool: object, arguments: object, words: str
):
    answer = call_by_name(bench.all, tool, arguments)
    assert list(answer) == ["error"]
    assert words in answer["error"]
    assert len(answer["error"]) < 400


@pytest.mark.slow
def test_every_tool_is_declared_with_a_schema_that_its_function_takes(bench: Workbench):
    for tool in bench.all:
        assert set(tool.required) <= set(tool.arguments)
        assert set(tool.arguments) <= set(tool.function.__code__.co_varnames)
        json.dumps(tool.schema)
        assert tool.name in listed(bench.all)


@pytest.mark.slow
def test_the_reading_tools_evaluate_nothing(bench: Workbench):
    names = {tool.name for tool in bench.reading}
    assert names == {tool.name for tool in bench.all} - {
        "evaluate_program",
        "evaluate_edit",
        "finish",
    }


def test_a_long_answer_is_cut_with_a_word_about_it():
    answer = capped({"list": list(range(10_000)), "text": "x" * 50_000}, 3_000)
    assert len(json.dumps(answer)) <= 3_000
    kept = len(answer["list"])
    assert answer["list"] == list(range(kept))  # nothing stands among the entries that is none
    assert answer["left_out"]["list"] == f"{10_000 - kept} of 10000"
    assert answer["left_out"]["text"] == f"{50_000 - len(answer['text'])} of 50000 characters"
    assert "more than" in capped({f"key {k}": k for k in range(1_000)}, 3_000)["error"]


def test_numbers_that_json_lacks_become_null():
    assert capped(
        {"a": float("nan"), "b": np.float64("inf"), "c": np.int64(3), "d": np.bool_(True)}
    ) == {
        "a": None,
        "b": None,
        "c": 3,
        "d": True,
    }


def test_an_unknown_option_is_refused_before_any_work(sweep: Sweep):
    with pytest.raises(IbridError, match="parameters must be one of"):
        Study(sweep, parameters="split")


@pytest.mark.parametrize(
    ("value", "schema"),
    [
        (1.5, {"type": "integer"}),
        ("a", {"enum": ["b"]}),
        (None, {"type": "string"}),
        (float("nan"), {"type": "number", "minimum": 0}),
    ],
)
def test_what_a_schema_excludes_is_complained_of(value: object, schema: dict):
    assert complaint(value, schema, "it")


@pytest.mark.slow
def test_a_sitting_in_a_folder_goes_on_where_the_last_one_ended(sweep: Sweep, tmp_path: Path):
    study = Study(sweep)
    for number, status in enumerate((Status.OK, Status.DUPLICATE)):
        with open_logbook(study, BRIEF, tmp_path / "run", NAIVE) as logbook:
            assert len(logbook.steps) == number
            assert logbook.submit(NAIVE).status is status
            best = logbook.best(1)[0].record.nrmse
            assert logbook.record(number).nrmse == best
    assert ibrid.read_record(tmp_path / "run" / "best.json").nrmse == best
    assert ibrid.parse_program((tmp_path / "run" / "best.py").read_text(encoding="utf-8"))


def test_an_evaluation_that_was_cut_off_is_lost_and_may_be_asked_for_again(
    sweep: Sweep, tmp_path: Path
):
    study = Study(sweep)
    with open_logbook(study, BRIEF, tmp_path, NAIVE) as logbook:
        logbook.submit(UNWIRED)
    with Store.open(tmp_path / "archive.sqlite") as store:
        store.propose(Step(1, program=NAIVE, hash=ibrid.structure_hash(ibrid.parse_program(NAIVE))))
    with open_logbook(study, BRIEF, tmp_path, NAIVE) as logbook:
        assert [one.status for one in logbook.steps] == [Status.ILLEGAL, Status.LOST]
        assert logbook.submit(NAIVE).status is Status.OK


def test_an_unforeseen_end_of_an_evaluation_does_not_spoil_the_next(
    sweep: Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with open_logbook(Study(sweep), BRIEF, tmp_path, NAIVE) as logbook:
        with monkeypatch.context() as patch:
            patch.setattr("ibrid_search.agents.logbook.evaluate", lambda *_, **__: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                logbook.submit(NAIVE)
        assert logbook.submit(NAIVE).status is Status.OK
        assert [one.status for one in logbook.steps] == [Status.LOST, Status.OK]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"equilibrium": "paper"}, "made with equilibrium = exact"),
        ({"sweep": None}, "made with data of other content"),
    ],
)
def test_a_folder_of_another_run_is_refused(sweep: Sweep, tmp_path: Path, change: dict, words: str):
    study = Study(sweep)
    with open_logbook(study, BRIEF, tmp_path, NAIVE):
        pass
    if "sweep" in change:
        change = {"sweep": sweep.only(sweep.names[:1])}
    with (
        pytest.raises(IbridError, match=words),
        open_logbook(replace(study, **change), BRIEF, tmp_path, NAIVE),
    ):
        pass


def test_a_place_that_is_no_folder_is_refused(sweep: Sweep, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(IbridError, match="is not a folder"),
        open_logbook(Study(sweep), BRIEF, tmp_path / "file", NAIVE),
    ):
        pass


def test_without_the_sdk_the_server_says_what_to_install(
    sweep: Sweep, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(IbridError, match=r"pip install 'ibrid\[mcp\]'"):
        serve(Study(sweep))
