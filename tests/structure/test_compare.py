"""Two diagrams matched up to naming, after canonical rewriting."""

import json
from itertools import pairwise

import numpy as np
import pytest
from collecting import each_of
from hypothesis import given, settings
from hypothesis import strategies as st
from random_diagrams import random_legal_diagram, renamed_and_reordered

from ibrid.modules import VOCABULARY
from ibrid.structure import (
    Diagram,
    compare,
    format_comparison,
    parameter_table,
    parse_program,
    program_text,
    textbook,
    textbook_names,
    textbook_text,
    violations,
    wire,
)
from ibrid.structure.comparison.simplify import simplified

seeds = st.integers(0, 2**32 - 1)


def changed(name: str, *changes: tuple[str, str], more: tuple[str, ...] = ()) -> Diagram:
    """A textbook diagram with replaced text and more lines."""
    text = textbook_text(name)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    diagram = parse_program(text + "".join(f"    {line}\n" for line in more))
    assert violations(diagram) == ()
    return diagram


@pytest.mark.slow
@each_of("name", textbook_names())
def test_a_diagram_is_the_same_as_itself_under_other_names(name):
    diagram = textbook(name)
    comparison = compare(diagram, renamed_and_reordered(diagram, np.random.default_rng(5)))
    assert comparison.same
    assert comparison.only_first == comparison.only_second == ()


@pytest.mark.slow
@settings(max_examples=80)
@given(seeds)
def test_random_diagrams_are_the_same_as_themselves_under_other_names(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    assert compare(diagram, renamed_and_reordered(diagram, rng)).same


@pytest.mark.slow
@settings(max_examples=60)
@given(seeds, seeds)
def test_exchanging_the_diagrams_exchanges_precision_and_recall(seed, other_seed):
    first = random_legal_diagram(np.random.default_rng(seed), most_modules=20)
    second = random_legal_diagram(np.random.default_rng(other_seed), most_modules=20)
    there, back = compare(first, second), compare(second, first)
    for one, other in ((there.modules, back.modules), (there.connections, back.connections)):
        assert (one.precision, one.recall, one.f1) == (other.recall, other.precision, other.f1)
    assert 0 <= there.connections.f1 <= 1
    assert there.modules.first == len(there.matched) + len(there.only_first)


EQUIVALENT = {
    "a minus behind the PI instead of before it": (
        ('"power.p", "minus_p.in_"', '"power.p", "p_loop.in_"'),
        ('"minus_p.out", "p_loop.in_"', '"p_loop.out", "minus_p.in_"'),
        ('"p_loop.out", "i_ref.in_d"', '"minus_p.out", "i_ref.in_d"'),
    ),
    "a minus behind the measured power that turns both of its uses": (
        ('"plant.i_g", "power.i"', '"minus_g.out", "power.i"'),
        (
            'g.add("Negate", "minus_p")',
            'g.add("Negate", "minus_q")\n    g.add("Negate_dq", "minus_g")',
        ),
        ('"power.p", "minus_p.in_"', '"power.p", "p_loop.in_"'),
        ('g.connect("minus_p.out", "p_loop.in_")', 'g.connect("plant.i_g", "minus_g.in_")'),
        (
            '"power.q", "q_loop.in_"',
            '"power.q", "minus_q.in_")\n    g.connect("minus_q.out", "q_loop.in_"',
        ),
    ),
    "a fixed gain of minus one for the minus": (
        ('"Negate_dq", "minus_i"', '"Gain_dq", "minus_i", k=-1.0'),
    ),
    "one PI on the pair for two with shared gains": (
        ('    g.add("PI", "p_loop", kP="power.kP", kI="power.kI")\n', ""),
        ('"PI", "q_loop", kP="power.kP", kI="power.kI"', '"PI_dq", "power_loop"'),
        ('"minus_p.out", "p_loop.in_"', '"minus_p.out", "i_ref.in_d"'),
        ('    g.connect("p_loop.out", "i_ref.in_d")\n', ""),
        ('"power.q", "q_loop.in_"', '"power.q", "i_ref.in_q"'),
        ('    g.connect("q_loop.out", "i_ref.in_q")\n', ""),
        (
            '"i_ref.out", "current.in_"',
            '"i_ref.out", "power_loop.in_")\n    g.connect("power_loop.out", "current.in_"',
        ),
    ),
    "two PIs with the same fixed gains on the axes of the current": (
        (
            'g.add("PI_dq", "current")',
            'g.add("PI", "cd", kP=0.4, kI=15)\n    g.add("PI", "cq", kP=0.4, kI=15)\n    '
            'g.add("SliceD", "sd")\n'
            '    g.add("SliceQ", "sq")\n    g.add("PackDQ", "u")\n    g.add("Gain_dq", "sum", '
            "k=1)\n"
            '    g.connect("sum.out", "sd.in_")\n    g.connect("sum.out", "sq.in_")\n'
            '    g.connect("sd.out", "cd.in_")\n'
            '    g.connect("sq.out", "cq.in_")\n    g.connect("cd.out", "u.in_d")\n    '
            'g.connect("cq.out", "u.in_q")',
        ),
        ('"current.in_"', '"sum.in_"'),
        ('"current.out"', '"u.out"'),
    ),
    "the q component sliced from e": (
        ('g.add("SRF_PLL", "pll")', 'g.add("SRF_PLL", "pll")\n    g.add("SliceQ", "q_axis")'),
        (
            '"plant.e_q", "pll.e_q"',
            '"plant.e", "q_axis.in_")\n    g.connect("q_axis.out", "pll.e_q"',
        ),
    ),
    "the converter current as capacitor plus grid current": (
        (
            '"plant.i_ti", "minus_i.in_"',
            '"plant.i_g", "minus_i.in_")\n    g.connect("plant.i_C", "minus_i.in_"',
        ),
    ),
    "a second rotation with the same inputs": (
        ('g.add("Rot_v", "park_v")', 'g.add("Rot_v", "park_v")\n    g.add("Rot_v", "park_w")'),
        ('"park_v.v_dq", "plant.v_in"', '"park_w.v_dq", "plant.v_in"'),
        ('"v_DQ", "park_v.v_DQ"', '"v_DQ", "park_w.v_DQ")\n    g.connect("v_DQ", "park_v.v_DQ"'),
        (
            '"pll.delta", "park_v.delta"',
            '"pll.delta", "park_w.delta")\n    g.connect("pll.delta", "park_v.delta"',
        ),
    ),
    "a free gain before the current control": (
        (
            'g.add("PI_dq", "current")',
            'g.add("PI_dq", "current")\n    g.add("Gain_dq", "scale")\n'
            '    g.add("Gain_dq", "sum", k=1)',
        ),
        ('"current.in_"', '"sum.in_"'),
        (
            'g.connect("plant.e", "plant.u_r")',
            'g.connect("plant.e", "plant.u_r")\n'
            '    g.connect("sum.out", "scale.in_")\n    g.connect("scale.out", "current.in_")',
        ),
    ),
    "a PLL drawn as a PI and an integrator": (
        (
            'g.add("SRF_PLL", "pll")',
            'g.add("PI", "regulator")\n    g.add("Integrator", "angle")\n'
            '    g.connect("regulator.out", "angle.in_")',
        ),
        ('"plant.e_q", "pll.e_q"', '"plant.e_q", "regulator.in_"'),
        ('"pll.delta", "park_v.delta"', '"angle.out", "park_v.delta"'),
        ('"pll.delta", "park_i.delta"', '"angle.out", "park_i.delta"'),
        ('"pll.delta_omega", "plant.delta_omega"', '"regulator.out", "plant.delta_omega"'),
    ),
    "names of parameters": (("power.kP", "k"), ("power.kI", "l")),
    "values of parameters": (('"LCL", "plant"', '"LCL", "plant", L_F=0.15'),),
}


@pytest.mark.slow
@each_of("case", EQUIVALENT)
def test_another_drawing_of_the_same_controller_is_the_same(case):
    comparison = compare(changed("gfl", *EQUIVALENT[case]), textbook("gfl"))
    assert comparison.same, format_comparison(comparison)
    assert compare(textbook("gfl"), changed("gfl", *EQUIVALENT[case])).same


ADDED = {
    "double negation": (
        'g.add("Negate_dq", "a")',
        'g.add("Negate_dq", "b")',
        'g.connect("a.out", "b.in_")',
        'g.connect("plant.e", "a.in_")',
        'g.add("Gain_dq", "half", k=0.5)',
        'g.connect("b.out", "half.in_")',
        'g.connect("half.out", "plant.u_r")',
    ),
    "a zero source": ('g.add("ConstZero", "zero")', 'g.connect("zero.out", "plant.delta_omega")'),
    "modules without a path to the terminals": (
        'g.add("PI_dq", "x")',
        'g.connect("plant.e", "x.in_")',
    ),
    "modules that nothing reaches": (
        'g.add("ConstZero", "zero")',
        'g.add("PI", "x")',
        'g.connect("zero.out", "x.in_")',
        'g.connect("x.out", "i_ref.in_d")',
    ),
    "two wires that cancel": (
        'g.add("Negate_dq", "a")',
        'g.add("Gain_dq", "b", k=1)',
        'g.connect("v_DQ", "a.in_")',
        'g.connect("v_DQ", "b.in_")',
        'g.connect("a.out", "plant.u_r")',
        'g.connect("b.out", "plant.u_r")',
    ),
}


@pytest.mark.parametrize("case", ADDED)
def test_what_does_nothing_is_not_counted(case):
    comparison = compare(changed("gfl", more=ADDED[case]), textbook("gfl"))
    assert comparison.same, format_comparison(comparison)


def in_row(*kinds: str) -> Diagram:
    """The naive program with scalar modules in a row between two axes."""
    lines = ['g.add("SliceD", "d")', 'g.add("PackDQ", "p")', 'g.connect("v_DQ", "d.in_")']
    source = "d.out"
    for number, kind in enumerate(kinds):
        lines += [f'g.add("{kind}", "x{number}")', f'g.connect("{source}", "x{number}.in_")']
        source = f"x{number}.out"
    lines += [
        f'g.connect("{source}", "p.in_d")',
        'g.connect("no_frequency.out", "p.in_q")',
        'g.connect("p.out", "plant.u_r")',
    ]
    return changed("naive", more=tuple(lines))


def test_linear_blocks_in_a_row_have_no_order():
    assert compare(in_row("LPF1", "PI", "Notch"), in_row("Notch", "LPF1", "PI")).same
    assert compare(in_row("Gain", "LPF1", "PI"), in_row("PI", "LPF1")).same
    assert not compare(in_row("LPF1", "PI", "Notch"), in_row("LPF1", "PI")).same


def test_the_idle_axis_of_a_block_on_the_pair_is_left_out():
    pair = changed(
        "naive",
        more=(
            'g.add("PackDQ", "p")',
            'g.add("SliceQ", "q")',
            'g.add("LPF1_dq", "f")',
            'g.connect("q.out", "p.in_d")',
            'g.connect("no_frequency.out", "p.in_q")',
            'g.connect("v_DQ", "f.in_")',
            'g.connect("f.out", "q.in_")',
            'g.connect("p.out", "plant.u_r")',
        ),
    )
    axis = changed(
        "naive",
        more=(
            'g.add("PackDQ", "p")',
            'g.add("SliceQ", "q")',
            'g.add("LPF1", "f")',
            'g.connect("q.out", "f.in_")',
            'g.connect("f.out", "p.in_d")',
            'g.connect("no_frequency.out", "p.in_q")',
            'g.connect("v_DQ", "q.in_")',
            'g.connect("p.out", "plant.u_r")',
        ),
    )
    assert compare(pair, axis).same


def test_a_sign_that_does_not_cancel_is_a_different_connection():
    positive = changed(
        "gfl",
        ('"minus_i.out", "current.in_"', '"double.out", "current.in_"'),
        more=('g.add("Negate_dq", "double")', 'g.connect("minus_i.out", "double.in_")'),
    )
    comparison = compare(positive, textbook("gfl"))
    assert comparison.modules.f1 == 1.0
    assert comparison.connections.common == comparison.connections.second - 1
    assert not comparison.same


def test_power_loops_with_gains_of_their_own_are_not_one_block():
    found = changed("gfl", ('"q_loop", kP="power.kP", kI="power.kI"', '"q_loop"'))
    comparison = compare(found, textbook("gfl"))
    assert not comparison.same
    assert comparison.only_second == ("p_loop+q_loop",)
    assert set(comparison.only_first) == {"p_loop", "q_loop"}


def test_a_missing_filter_lowers_recall_alone():
    comparison = compare(textbook("gfl"), textbook("gfl_pll_filter"))
    assert comparison.modules.precision == 1.0
    assert comparison.modules.recall == 8 / 9
    assert comparison.only_second == ("pll_filter",)
    # the wire from e to the PLL became two, of which neither is the old one
    assert (
        comparison.connections.common,
        comparison.connections.first,
        comparison.connections.second,
    ) == (17, 18, 19)


def test_the_naive_start_shares_the_plant_and_the_terminals_with_an_l_filter_inverter_only():
    comparison = compare(textbook("naive"), textbook("gfl_l_filter"))
    assert comparison.matched == (("plant", "plant"),)
    assert comparison.connections.common == 0


def test_the_json_has_the_fields_of_its_schema():
    found = compare(textbook("gfl"), textbook("gfl_pll_filter")).to_json()
    assert list(found) == [
        "schema",
        "modules",
        "connections",
        "matched",
        "only_first",
        "only_second",
        "same",
    ]
    assert found["schema"] == "ibrid.compare/1"
    assert list(found["modules"]) == list(found["connections"]) == ["precision", "recall", "f1"]
    assert ["pll", "pll"] in found["matched"]
    assert found["same"] is False
    assert json.loads(json.dumps(found)) == found


def test_the_terminal_text_names_what_is_not_shared():
    text = format_comparison(compare(textbook("gfl"), textbook("gfl_pll_filter")))
    assert "only in the second: pll_filter" in text
    assert "current = current" in text
    assert text.endswith("different structures")
    assert format_comparison(compare(textbook("gfl"), textbook("gfl"))).endswith(
        "the same structure"
    )


@pytest.mark.slow
def test_many_alike_blocks_are_matched_in_place():
    lines = ['g.add("Gain_dq", "sum", k=1)', 'g.connect("sum.out", "plant.u_r")']
    for number in range(9):  # 9! pairings are too many to try
        lines += [f'g.add("Gain_dq", "a{number}")', f'g.connect("v_DQ", "a{number}.in_")']
        lines += [f'g.add("Gain_dq", "b{j}{number}")' for j in range(number % 3)]
        chain = [f"a{number}", *(f"b{j}{number}" for j in range(number % 3))]
        lines += [f'g.connect("{one}.out", "{other}.in_")' for one, other in pairwise(chain)]
        lines += [f'g.connect("{one}.out", "sum.in_")' for one in chain]
    diagram = changed("naive", more=tuple(lines))
    assert compare(diagram, renamed_and_reordered(diagram, np.random.default_rng(0))).same
    without = parse_program(
        program_text(diagram)
        .replace('    g.connect("b11.out", "sum.in_")\n', "")
        .replace('    g.connect("b02.out", "sum.in_")\n', "")
    )
    comparison = compare(without, renamed_and_reordered(diagram, np.random.default_rng(0)))
    assert comparison.connections.common >= comparison.connections.first - 3


# --- rewriting keeps the transfer function ---


def response(blocks, links, s) -> np.ndarray:
    """i_DQ over v_DQ of blocks {key: (H, inputs, outputs)} joined by weighted links; 2 x 2
    complex.
    """
    outputs, inputs, size_out, size_in = {}, {}, 2, 2
    outputs["v_DQ", "v_DQ"], inputs["i_DQ", "i_DQ"] = slice(0, 2), slice(0, 2)
    for key, (_, ports_in, ports_out) in blocks.items():
        for port, width in ports_out.items():
            outputs[key, port] = slice(size_out, size_out + width)
            size_out += width
        for port, width in ports_in.items():
            inputs[key, port] = slice(size_in, size_in + width)
            size_in += width
    through, joined = np.zeros((size_out, size_in), complex), np.zeros((size_in, size_out))
    for key, (law, ports_in, ports_out) in blocks.items():
        matrix, top = law(s), 0
        for port, width in ports_out.items():
            left = 0
            for entry, breadth in ports_in.items():
                through[outputs[key, port], inputs[key, entry]] = matrix[
                    top : top + width, left : left + breadth
                ]
                left += breadth
            top += width
    for (source, output, target, port), weight in links.items():
        joined[inputs[target, port], outputs[source, output]] += weight
    drive = np.zeros((size_out, 2))
    drive[:2] = np.eye(2)
    return (joined @ np.linalg.solve(np.eye(size_out) - through @ joined, drive))[:2]


def law_of(kind, parameters):
    points = {
        port: (0.9 + 0.1 * index, 0.2 - 0.3 * index)
        for index, port in enumerate(kind.equilibrium_ports)
    }
    arguments = {**parameters, **kind.context(377.0, (0.8, 0.6), points)}
    a, b, c, d = (np.array(rows, dtype=float) for rows in kind.state_space(**arguments))
    lag = parameters[kind.delay] if kind.delay else 0.0

    def at(s):
        if not kind.states:
            return d * np.exp(-s * lag)
        return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d

    return at


@pytest.mark.slow
@settings(max_examples=120)
@given(seeds)
def test_rewriting_keeps_the_terminal_response(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: one.typical * rng.uniform(0.5, 1.5) for one in table.free}
    rewritten = simplified(diagram)
    kept = {value for block in rewritten.blocks.values() for _, value in block.parameters}
    counted = {name for block in rewritten.blocks.values() for name in block.names}
    for name in counted:  # a gain that went into another block is one there
        bound = table.bound.get((name, "k"))
        if isinstance(bound, str) and bound not in kept:
            values[bound] = 1.0

    def number(bound):
        return values[bound] if isinstance(bound, str) else bound

    before = {}
    for name, kind in wiring.kinds.items():
        parameters = {one: number(table.of(name, one)) for one in kind.parameters}
        ports = [
            {port: signal.width for port, signal in side.items()}
            for side in (kind.inputs, kind.outputs)
        ]
        before[name] = (law_of(kind, parameters), *ports)
    wires = {}
    for target, sources in wiring.sources.items():
        to = ("i_DQ", "i_DQ") if target == "i_DQ" else tuple(target.split("."))
        for source in sources:
            start = ("v_DQ", "v_DQ") if source == "v_DQ" else tuple(source.split("."))
            wires[(*start, *to)] = np.eye(
                2 if to[0] == "i_DQ" else wiring.kinds[to[0]].inputs[to[1]].width
            )

    kinds = {kind.name: kind for kind in VOCABULARY}
    after = {}
    names = {0: "v_DQ", 1: "i_DQ"}
    for key, block in rewritten.blocks.items():
        if block.outer:
            continue
        parameters = {one: number(value) for one, value in block.parameters}
        if block.kind in kinds:
            law = law_of(kinds[block.kind], parameters)
        else:  # equal scalar blocks on both axes, of a kind that has no form of its own for them
            scalar = law_of(kinds[block.kind.removesuffix("_dq")], parameters)
            law = lambda s, scalar=scalar: np.kron(scalar(s), np.eye(2))  # noqa: E731
        after[key] = (law, block.inputs, block.outputs)
    links = {
        (names.get(a, a), b, names.get(c, c), d): weight
        for (a, b, c, d), weight in rewritten.links.items()
    }

    for frequency in (3.0, 47.0, 800.0):
        expected = response(before, wires, 2j * np.pi * frequency)
        found = response(after, links, 2j * np.pi * frequency)
        # two solutions of systems of up to 60 equations in double precision, whose loops may be
        # ill-conditioned
        assert np.abs(found - expected).max() <= 1e-6 * max(1e-3, np.abs(expected).max())
