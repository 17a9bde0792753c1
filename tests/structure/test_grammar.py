"""The grammar: every breach with its line, a stable reason and what would mend it; and what is only
doubtful.
"""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from hypothesis import given, settings
from hypothesis import strategies as st
from random_diagrams import random_legal_diagram

from ibrid.errors import DiagramError
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY, ModuleKind, Range
from ibrid.signals import Signal
from ibrid.structure import (
    Diagram,
    parse_program,
    require_legal,
    steady_order,
    structure_hash,
    textbook,
    textbook_text,
    unknown_equilibria,
    violations,
    warnings,
    wire,
)
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.grammar_rules.algebraic_loops import LARGEST_LOOP, TIGHTEST_LOOP
from ibrid.structure.grammar_rules.grammar import (
    HIGHEST_ORDER,
    MOST_CONNECTIONS,
    MOST_FREE,
    MOST_MODULES,
)

SKELETON = textbook_text(
    "naive"
).splitlines()  # def, docstring, 3 modules on lines 3 to 5, 5 connections on 6 to 10


def skeleton(*lines: str, without: str = "") -> Diagram:
    """The naive program, less the lines that hold `without`, with more lines from line 11 on (10 or
    9 if one went).
    """
    kept = [line for line in SKELETON if not without or without not in line]
    return parse_program("\n".join([*kept, *(f"    {line}" for line in lines)]) + "\n")


def only(diagram: Diagram, **options):
    """The single violation of a diagram."""
    found = violations(diagram, **options)
    assert len(found) == 1, [str(one) for one in found]
    return found[0]


def test_a_legal_diagram_has_no_violations():
    assert violations(skeleton()) == ()
    require_legal(skeleton())


def test_a_violation_reads_as_its_line_and_a_sentence():
    found = only(skeleton('g.add("Gian", "x")'))
    assert str(found) == (
        "line 11: the vocabulary has no kind 'Gian' (module x); one of your own comes with --kinds "
        "FILE.py; "
        "did you mean Gain or Gain_dq?"
    )
    assert (found.line, found.reason) == (11, "unknown_kind")


def test_violations_of_a_diagram_made_in_python_have_no_line():
    diagram = skeleton()
    diagram.add("Gain_dq", "idle")
    found = only(diagram)
    assert found.line is None
    assert str(found).startswith("nothing drives idle.in_")


BREACHES = [
    # lines added to the naive program, line removed from it, reason, line, words of the sentence
    ('g.add("PI_d", "x")', "", "unknown_kind", 11, ("PI_d", "PI_dq")),
    (
        'g.add("ConstZero", "gain")',
        "",
        "duplicate_name",
        11,
        ("gain", "first in line 4", "name of its own"),
    ),
    ('g.add("ConstZero", "x", k=2)', "", "binding", 11, ("no parameter 'k'", "remove")),
    (
        'g.connect("plant.i_g", "plant.u_R")',
        "",
        "unknown_port",
        11,
        ("plant (LFilter)", "u_R", "u_r"),
    ),
    ('g.connect("plant.ig", "plant.u_r")', "", "unknown_port", 11, ("'ig'", "i_g")),
    (
        'g.connect("no_frequency.out", "no_frequency.in_")',
        "",
        "unknown_port",
        11,
        ("no inputs", "remove"),
    ),
    ('g.connect("plant", "plant.u_r")', "", "unknown_port", 11, ("write plant.port", "i_g")),
    ('g.connect("v_dq", "plant.u_r")', "", "unknown_port", 11, ("'v_dq' is no port", "v_DQ")),
    (
        'g.connect("plnt.i_g", "plant.u_r")',
        "",
        "unknown_module",
        11,
        ("plnt", "did you mean plant"),
    ),
    (
        'g.connect("gain.in_", "plant.u_r")',
        "",
        "direction",
        11,
        ("is an input", "an output of gain is out"),
    ),
    (
        'g.connect("v_DQ", "gain.out")',
        "",
        "direction",
        11,
        ("is an output", "an input of gain is in_"),
    ),
    (
        'g.connect("v_DQ", "no_frequency.out")',
        "",
        "direction",
        11,
        ("is an output", "ConstZero has no input"),
    ),
    ('g.connect("i_DQ", "plant.u_r")', "", "direction", 11, ("i_DQ", "only be a target")),
    ('g.connect("gain.out", "v_DQ")', "", "direction", 11, ("v_DQ", "only be a source")),
    (
        'g.connect("plant.e_q", "plant.u_r")',
        "",
        "signal_kind",
        11,
        ("scalar", "dq_vec", "delta_omega"),
    ),
    ('g.connect("plant.e_q", "gain.in_")', "", "signal_kind", 11, ("no input of gain", "PackDQ")),
    ('g.connect("plant.e", "plant.delta_omega")', "", "signal_kind", 11, ("u_r, v_in",)),
    ('g.connect("plant.e_q", "i_DQ")', "", "signal_kind", 11, ("no input of i_DQ", "PackDQ")),
    (
        'g.connect("v_DQ", "gain.in_")',
        "",
        "repeated_connection",
        11,
        ("first in line 7", "gain of 2"),
    ),
    (
        "",
        'connect("v_DQ", "gain',
        "undriven_input",
        4,
        ("gain.in_ [dq_vec]", "v_DQ, plant.i_g, plant.e"),
    ),
    (
        "",
        'connect("no_freq',
        "undriven_input",
        3,
        ("plant.delta_omega [scalar]", "no_frequency.out", "ConstZero"),
    ),
    ("", 'connect("plant.i_g"', "no_terminal_current", None, ("i_DQ", "plant.i_g", "Rot_i")),
]


@each_of(("line", "without", "reason", "where", "said"), BREACHES)
def test_a_breach_is_named_with_its_line_and_a_remedy(line, without, reason, where, said):
    found = only(skeleton(*([line] if line else []), without=without))
    assert (found.reason, found.line) == (reason, where)
    for word in said:
        assert word in found.message


def test_an_extended_kind_under_the_paper_vocabulary_is_called_extended():
    found = violations(textbook("gfl_delay"), "paper")
    assert {one.reason for one in found} == {"unknown_kind"}
    assert all("extended" in one.message for one in found)


def test_an_unknown_kind_does_not_lead_to_further_complaints_about_its_ports():
    diagram = skeleton(
        'g.add("Filter", "x")', 'g.connect("gain.out", "x.input")', 'g.connect("x.o", "plant.u_r")'
    )
    assert only(diagram).reason == "unknown_kind"


def test_several_breaches_come_by_line():
    diagram = skeleton(
        'g.connect("plant.ig", "plant.u_r")', 'g.add("Gian", "x")', 'g.connect("a.b", "c.d")'
    )
    assert [one.line for one in violations(diagram)] == [11, 12, 13, 13]


def test_no_plant_and_two_plants_are_refused():
    none = parse_program('def f(g):\n    g.connect("v_DQ", "i_DQ")\n')
    assert only(none).reason == "no_plant"
    assert "LCL or LFilter" in only(none).message
    drive = [
        f'g.connect("{source}", "p2.{port}")'
        for source, port in (("v_DQ", "u_r"), ("v_DQ", "v_in"))
    ]
    two = skeleton('g.add("LCL", "p2")', *drive, 'g.connect("no_frequency.out", "p2.delta_omega")')
    assert (only(two).reason, only(two).line) == ("several_plants", 11)
    assert "beside plant" in only(two).message


def filters(number: int, kind: str = "LPF1_dq") -> Diagram:
    lines = []
    for index in range(number):
        lines += [f'g.add("{kind}", "f{index}")', f'g.connect("v_DQ", "f{index}.in_")']
    return skeleton(*lines)


@pytest.mark.parametrize("kind", ["LPF1_dq", "Delay", "ZOH_dq"])
def test_the_order_may_reach_its_bound_and_no_more(kind):
    allowed = (
        HIGHEST_ORDER - 2
    ) // 2  # the L filter has two states; a delay or a hold counts as two
    assert violations(filters(allowed, kind)) == ()
    found = only(filters(allowed + 1, kind))
    assert found.reason == "order"
    assert "the order is 32, above 30; leave out some of " in found.message


@each_of(
    ("plant", "reason", "words"),
    [
        ("L_F=0.15", None, ()),
        ("L_F=(0.05, 0.5)", None, ()),
        ("L_F=0", "box", ("plant.L_F", "[0.0001, 1] pu")),
        ("R_F=-0.01", "box", ("plant.R_F", "let it free")),
        ("L_F=2", "box", ("plant parameter",)),
        ("L_F=(1e-5, 0.5)", "box", ("must lie within", "[0.0001, 1] pu")),
        ("L_F=(2, 3)", "box", ("must lie within",)),
        ("L_G=0.1", "binding", ("L_G", "L_F")),
        ("E0d=1.0", "binding", ("E0d",)),
        ("I0d=1.0", None, ()),  # a parameter of the paper's mode, computed in this one
    ],
)
def test_plant_parameters_stay_within_their_box(plant, reason, words):
    text = textbook_text("naive").replace('"LFilter", "plant"', f'"LFilter", "plant", {plant}')
    found = violations(parse_program(text))
    assert [one.reason for one in found] == ([reason] if reason else [])
    for one in found:
        assert one.line == 3
        assert all(word in one.message for word in words)


@pytest.mark.parametrize("binding", ["k=-3.0", "k=0", "k=1e6"])
def test_a_fixed_gain_may_carry_a_sign_and_leave_its_box(binding):
    assert (
        violations(
            parse_program(textbook_text("naive").replace('"gain")\n', f'"gain", {binding})\n', 1))
        )
        == ()
    )


@pytest.mark.parametrize("value", ["0", "-5.0"])
def test_a_number_that_the_law_divides_by_lies_above_zero(value):
    diagram = skeleton(f'g.add("LPF1", "f", omega_c={value})', 'g.connect("plant.e_q", "f.in_")')
    assert only(diagram).reason == "box"
    assert "above zero" in only(diagram).message


def test_shared_names_need_boxes_that_overlap():
    lines = ['g.add("LPF1", "a", omega_c=(1, 10))', 'g.add("LPF1", "b", omega_c="a.omega_c")']
    drive = [
        'g.connect("plant.e_q", "a.in_")',
        'g.connect("plant.e_q", "b.in_")',
        'g.connect("plant.e_q", "c.in_")',
    ]
    assert violations(skeleton(*lines, *drive[:2])) == ()
    third = 'g.add("Pade1", "c", T_d="a.omega_c")'
    found = only(skeleton(*lines, third, *drive))
    assert (found.reason, found.line) == ("shared_box", 13)
    assert "do not overlap" in found.message


def test_paper_names_are_parameters_in_paper_mode_only():
    text = textbook_text("gfl").replace('"LCL", "plant"', '"LCL", "plant", E0d=0.2')
    assert violations(parse_program(text)) == ()
    (found,) = violations(parse_program(text), equilibrium="paper")
    assert found.reason == "box"


def test_size_is_bounded_before_anything_else_is_looked_at():
    diagram = Diagram()
    for number in range(MOST_MODULES + 1):
        diagram.add("Nothing", f"m{number}")
    for _ in range(MOST_CONNECTIONS + 1):
        diagram.connect("a.b", "c.d")
    found = violations(diagram)
    assert [one.reason for one in found] == ["size", "size"]
    assert "more than 200" in found[0].message


def loop(*kinds: str) -> Diagram:
    """The naive program with modules in a ring, driven by the gain, driving the plant; "KIND
    binding" each.
    """
    lines = []
    for number, words in enumerate(kinds):
        kind, *bindings = words.split()
        lines.append(f'g.add("{kind}", "x{number}"{"".join(f", {one}" for one in bindings)})')
    lines += [
        f'g.connect("x{number}.out", "x{(number + 1) % len(kinds)}.in_")'
        for number in range(len(kinds))
    ]
    return skeleton(*lines, 'g.connect("gain.out", "x0.in_")', 'g.connect("x0.out", "plant.u_r")')


@pytest.mark.parametrize("kind", ["Gain_dq k=0.1", "PI_dq kP=0.1,kI=1.0", "Delay T_d=1e-4"])
def test_what_direct_terms_join_round_a_loop_is_bounded(kind):
    """The whole table of programs that want all time and memory is tried by `make attack`."""
    filters = "LPF1_dq omega_c=100.0"
    allowed = LARGEST_LOOP if kind[0] == "G" else 10  # within the bound of the order
    assert violations(loop(*[kind] * allowed)) == ()
    assert (
        violations(loop(*["Gain_dq k=0.1"] * LARGEST_LOOP, filters, "Gain_dq k=0.1")) == ()
    )  # a filter breaks it
    gains = ["Gain_dq k=0.1"] * (LARGEST_LOOP + 1 - allowed)
    found = only(loop(*[kind] * allowed, *gains))
    assert found.reason == "algebraic_loop"
    assert f"join {LARGEST_LOOP + 1} modules round a loop" in found.message


def test_how_tightly_direct_terms_join_modules_is_bounded():
    def meshed(number: int) -> Diagram:
        diagram = loop(*["Gain_dq k=0.1"] * number)
        for step in range(2, number):
            for index in range(number):
                diagram.connect(f"x{index}.out", f"x{(index + step) % number}.in_")
        return diagram

    assert 8 * 7 <= TIGHTEST_LOOP < 9 * 8
    assert violations(meshed(8)) == ()
    assert "9 modules round a loop, in 72 pairs" in only(meshed(9)).message


def test_free_parameters_are_bounded():
    kinds = ["Gain_dq", "LPF1_dq omega_c=100.0"] + ["Gain_dq"] * (MOST_FREE // 3)
    assert violations(loop(*kinds)) == ()
    wide = skeleton(
        *(f'g.add("Gain_dq", "y{number}")' for number in range(MOST_FREE)),
        *(f'g.connect("v_DQ", "y{number}.in_")' for number in range(MOST_FREE)),
        *(f'g.connect("y{number}.out", "plant.u_r")' for number in range(MOST_FREE)),
    )
    assert "free parameters, more than 100" in only(wide).message


def test_a_loop_of_direct_terms_with_a_gain_of_one_is_refused():
    found = only(loop("Negate_dq", "Gain_dq k=-0.5", "Gain_dq k=2.0"))
    assert (found.reason, found.line) == ("algebraic_loop", 16)
    assert "x0 -> x1 -> x2 -> x0" in found.message
    assert "Delay" in found.message


@pytest.mark.parametrize(
    "kinds",
    [
        ("Negate_dq", "Gain_dq k=0.5"),
        ("Gain_dq", "Gain_dq"),
        ("Gain_dq k=1e6", "Gain_dq k=1e6"),
        ("PI_dq", "Negate_dq"),
        ("JMul", "JMul"),
        ("Negate_dq", "Negate_dq", "LPF1_dq"),
        ("Negate_dq", "Negate_dq", "Delay"),
    ],
)
def test_a_loop_that_can_be_solved_is_legal(kinds):
    diagram = loop(*kinds)
    assert violations(diagram) == ()
    broken = {"LPF1_dq", "Delay"} & set(kinds)
    assert bool(compile_diagram(diagram).algebraic_loops) == (not broken)


def test_a_module_driven_by_itself_is_a_loop():
    diagram = skeleton(
        'g.add("Gain_dq", "x", k=1)',
        'g.connect("x.out", "x.in_")',
        'g.connect("x.out", "plant.u_r")',
    )
    assert "x -> x" in only(diagram).message


def test_gains_that_share_a_name_can_cancel_at_every_value():
    same = skeleton(
        'g.add("Gain_dq", "a")',
        'g.add("Gain_dq", "b", k="a.k")',
        'g.add("Negate_dq", "n")',
        'g.add("Gain_dq", "c", k=1)',
        'g.connect("c.out", "a.in_")',
        'g.connect("c.out", "n.in_")',
        'g.connect("n.out", "b.in_")',
        'g.connect("a.out", "c.in_")',
        'g.connect("b.out", "c.in_")',
        'g.connect("c.out", "c.in_")',
        'g.connect("c.out", "plant.u_r")',
    )
    assert only(same).reason == "algebraic_loop"


def test_the_operating_point_behind_an_integrator_is_refused_under_exact_alone():
    text = textbook_text("gfl").replace(
        'g.connect("plant.i_g", "power.i")', 'g.connect("current.out", "power.i")'
    )
    found = only(parse_program(text))
    assert (found.reason, found.line) == ("equilibrium", 10)
    assert "power (PQ_calc) needs the operating point at power.i" in found.message
    assert "behind the integrator of current (PI_dq)" in found.message
    assert "plant" in found.message
    assert violations(parse_program(text), equilibrium="paper") == ()


def test_the_operating_point_is_carried_through_sums_static_modules_filters_and_delays():
    lines = [
        'g.add("LPF1_dq", "f")',
        'g.add("Delay", "d")',
        'g.add("SliceD", "sd")',
        'g.add("SliceQ", "sq")',
        'g.add("PackDQ", "pack")',
        'g.add("JMul", "j")',
        'g.add("PQ_calc", "power")',
        'g.add("PI_dq", "pi")',
        'g.connect("plant.i_g", "f.in_")',
        'g.connect("f.out", "d.in_")',
        'g.connect("d.out", "sd.in_")',
        'g.connect("d.out", "sq.in_")',
        'g.connect("sd.out", "pack.in_d")',
        'g.connect("sq.out", "pack.in_q")',
        'g.connect("pack.out", "j.in_")',
        'g.connect("j.out", "power.e")',
        'g.connect("plant.e", "power.e")',
        'g.connect("pack.out", "power.i")',
        'g.connect("plant.e", "pi.in_")',
    ]
    diagram = skeleton(*lines)
    steady = steady_order(wire(diagram, VOCABULARY))
    assert [name for name in steady.order if name in ("f", "d", "sd", "pack", "j")] == [
        "f",
        "d",
        "sd",
        "pack",
        "j",
    ]
    assert {"j.out", "plant.e", "v_DQ", "no_frequency.out"} <= steady.known
    assert not {"pi.out", "power.p"} & steady.known
    assert violations(diagram) == ()


def test_products_and_loops_have_no_operating_point_either():
    lines = [
        'g.add("PQ_calc", "a")',
        'g.add("PQ_calc", "b")',
        'g.add("PackDQ", "pack")',
        'g.add("LPF1_dq", "ring")',
        'g.connect("plant.e", "a.e")',
        'g.connect("plant.i_g", "a.i")',
        'g.connect("a.p", "pack.in_d")',
        'g.connect("a.q", "pack.in_q")',
        'g.connect("pack.out", "b.e")',
        'g.connect("ring.out", "ring.in_")',
        'g.connect("v_DQ", "ring.in_")',
        'g.connect("ring.out", "b.i")',
    ]
    diagram = skeleton(*lines)
    assert unknown_equilibria(wire(diagram, VOCABULARY)) == (("b", "e"), ("b", "i"))
    product, ring = violations(diagram)
    assert "the product in a (PQ_calc)" in product.message
    assert "runs round a loop" in ring.message


def test_unknown_options_are_refused_with_near_names():
    with pytest.raises(DiagramError, match="exact"):
        violations(skeleton(), equilibrium="exakt")
    with pytest.raises(DiagramError, match="extended"):
        violations(skeleton(), "extendet")


def test_requiring_a_legal_diagram_joins_the_sentences():
    with pytest.raises(DiagramError, match=r"line 11: .*; line 12: "):
        require_legal(skeleton('g.add("Gian", "x")', 'g.add("Gian", "y")'))


def test_a_kind_of_ones_own_is_checked_like_the_others():
    def clamp(k):
        return [], [], [[], []], [[k, 0], [0, k]]

    mine = ModuleKind(
        name="Mine",
        family="static",
        law="out = k in_",
        inputs={"in_": Signal.DQ_VEC},
        outputs={"out": Signal.DQ_VEC},
        states=(),
        parameters={"k": Range(-1, 1, 0.5, "1", "gain")},
        state_space=clamp,
        reference="this test",
    )
    diagram = skeleton('g.add("Mine", "x", k=0.5)', 'g.connect("v_DQ", "x.in_")')
    assert only(diagram).reason == "unknown_kind"
    assert violations(diagram, (*VOCABULARY, mine)) == ()
    assert structure_hash(diagram, (*VOCABULARY, mine)) != structure_hash(skeleton())


DOUBTFUL = [
    (
        (
            'g.add("Rot_v", "r")',
            'g.connect("v_DQ", "r.v_DQ")',
            'g.connect("no_frequency.out", "r.delta")',
            'g.connect("r.v_dq", "plant.u_r")',
        ),
        "one_rotation",
        11,
        "add a Rot_i",
    ),
    (('g.add("Gain_dq", "x")', 'g.connect("v_DQ", "x.in_")'), "idle_module", 11, "no path to i_DQ"),
    (
        (
            'g.add("JMul", "x", L=0.15)',
            'g.connect("plant.i_g", "x.in_")',
            'g.connect("x.out", "plant.u_r")',
        ),
        "coupling_unit",
        11,
        "56.5 per unit",
    ),
    (
        (
            'g.add("JMul", "x", L="plant.L_F")',
            'g.connect("plant.i_g", "x.in_")',
            'g.connect("x.out", "plant.u_r")',
        ),
        "coupling_unit",
        11,
        "JMul_omega",
    ),
    (
        (
            'g.add("PI_dq", "x", kP="y.kI")',
            'g.add("PI_dq", "y")',
            'g.connect("plant.i_g", "x.in_")',
            'g.connect("x.out", "y.in_")',
            'g.connect("y.out", "plant.u_r")',
        ),
        "shared_unit",
        11,
        "[1/s]",
    ),
    (
        (
            'g.add("PI_dq", "x", kP=2)',
            'g.add("PI_dq", "y", kP="x.kP")',
            'g.connect("plant.i_g", "x.in_")',
            'g.connect("x.out", "y.in_")',
            'g.connect("y.out", "plant.u_r")',
        ),
        "shared_with_fixed",
        12,
        "fixed to 2",
    ),
]


@pytest.mark.parametrize(("lines", "reason", "line", "words"), DOUBTFUL)
def test_a_doubtful_habit_is_a_warning(lines, reason, line, words):
    diagram = skeleton(*lines)
    assert violations(diagram) == ()
    (found,) = warnings(diagram)
    assert (found.reason, found.line) == (reason, line)
    assert words in found.message


def test_a_terminal_voltage_that_drives_nothing_is_a_warning():
    diagram = parse_program(
        textbook_text("naive")
        .replace('connect("v_DQ", "plant', 'connect("gain.out", "plant')
        .replace('connect("v_DQ", "gain', 'connect("plant.i_g", "gain')
    )
    assert [one.reason for one in warnings(diagram)] == ["voltage_unused"]


def test_a_binding_of_the_operating_point_is_ignored_with_a_warning():
    text = textbook_text("gfl").replace(
        '"Rot_i", "park_i"', '"Rot_i", "park_i", I0d="current_level"'
    )
    (found,) = warnings(parse_program(text))
    assert found.reason == "ignored_binding"
    assert warnings(parse_program(text), equilibrium="paper") == ()


def test_an_illegal_diagram_has_violations_rather_than_warnings():
    assert warnings(skeleton('g.add("JMul", "x", L=0.15)')) == ()


@pytest.mark.slow
@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1))
def test_random_legal_diagrams_stay_legal_in_any_order_of_lines(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    other = Diagram()
    for index in rng.permutation(len(diagram.instances)):
        one = diagram.instances[index]
        other.add(one.kind, one.name, **one.bindings)
    for index in rng.permutation(len(diagram.connections)):
        other.connect(diagram.connections[index].source, diagram.connections[index].target)
    assert violations(other) == ()


@pytest.mark.slow
@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1))
def test_leaving_out_one_connection_names_what_it_drove(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    left_out = diagram.connections[int(rng.integers(len(diagram.connections)))]
    other = Diagram()
    for one in diagram.instances:
        other.add(one.kind, one.name, **one.bindings)
    for one in diagram.connections:
        if one != left_out:
            other.connect(one.source, one.target)
    if any(one.target == left_out.target for one in other.connections):
        return
    assert any(left_out.target in one.message for one in violations(other))


def test_the_paper_vocabulary_has_23_kinds_and_none_that_is_extended():
    assert len(PAPER_VOCABULARY) == 23
    assert not any(kind.extended for kind in PAPER_VOCABULARY)
    assert violations(textbook("gfl"), PAPER_VOCABULARY) == ()


def test_a_plant_of_another_family_name_is_not_a_plant():
    disguised = tuple(
        replace(kind, family="static") if kind.name == "LFilter" else kind for kind in VOCABULARY
    )
    assert only(skeleton(), vocabulary=disguised).reason == "no_plant"


def test_a_loop_that_is_singular_without_reactive_current_is_refused_in_paper_mode_alone():
    diagram = Diagram("power_on_itself")
    for kind, name in (
        ("LFilter", "plant"),
        ("ConstZero", "zero"),
        ("JMul_omega", "coupling"),
        ("SliceD", "axis"),
        ("Gain", "unit"),
    ):
        diagram.add(kind, name, **({"k": 1.0} if name == "unit" else {}))
    for source, target in (
        ("v_DQ", "plant.v_in"),
        ("v_DQ", "plant.u_r"),
        ("zero.out", "plant.delta_omega"),
        ("plant.i_g", "coupling.in_"),
        ("coupling.out", "axis.in_"),
        ("axis.out", "unit.in_"),
        ("unit.out", "unit.in_"),
        ("unit.out", "coupling.delta_omega"),
        ("plant.i_g", "i_DQ"),
    ):
        diagram.connect(source, target)
    # I - F = [[1 - 1, -a], [-1, 1]] with a = -(L / omega_0) i_q: its determinant -a vanishes with
    # i_q
    reasons = {
        mode: [one.reason for one in violations(diagram, equilibrium=mode)]
        for mode in ("exact", "paper")
    }
    assert reasons == {"exact": [], "paper": ["algebraic_loop"]}
