"""A copy of a kind that ships, under another name, is treated as the kind: every kind, in the
smallest diagram that has it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.fit.settings import FitSettings
from ibrid.gap.ports.ports import ports
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.parts import FAMILIES, Edit, insertions, views_of
from ibrid.report.block_diagrams.block_graph import block_graph
from ibrid.structure.comparison.compare import compare
from ibrid.structure.comparison.simplify import simplified
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.diagram import Diagram, Instance
from ibrid.structure.diagrams.library import textbook, textbook_names
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.frames import put_into_frame, put_into_grid_frame
from ibrid.structure.editing.roles import roles
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire


def in_place(name: str, kind: str) -> Callable[[Edit], object]:
    """The kind in a module's place, under its name."""
    return lambda draft: draft.rename(draft.replace(name, kind, "other"), name)


#: Kinds that no textbook uses: a textbook, and what puts one in.
PUT_IN: dict[str, tuple[str, Callable[[Edit], object]]] = {
    "SliceD": ("gfl_dc_link", in_place("e_size", "SliceD")),
    "SliceQ": (
        "gfl",
        lambda draft: draft.drive("pll.e_q", draft.after("plant.e", "SliceQ", "e_q")),
    ),
    "Pade1": ("gfl", lambda draft: draft.insert_before("pll.e_q", "Pade1", "pll_delay")),
    "Pade1_dq": ("gfl", lambda draft: draft.insert_before("plant.u_r", "Pade1_dq", "delay")),
    "Pade2_dq": ("gfl", lambda draft: draft.insert_before("plant.u_r", "Pade2_dq", "delay")),
    "Pade3_dq": ("gfl", lambda draft: draft.insert_before("plant.u_r", "Pade3_dq", "delay")),
    "Pade4_dq": ("gfl", lambda draft: draft.insert_before("plant.u_r", "Pade4_dq", "delay")),
    "Notch": ("gfl", lambda draft: draft.insert_before("pll.e_q", "Notch", "pll_notch")),
    "LCL_R": ("gfl", in_place("plant", "LCL_R")),
    "LCL_RC": ("gfl", in_place("plant", "LCL_RC")),
    "LLFilter": ("gfl_l_filter", in_place("plant", "LLFilter")),
    "Shunt_RC": (
        "gfl",
        lambda draft: draft.chain("v_DQ", f"{draft.add('Shunt_RC', 'shunt')}.v", "shunt.i", "i_DQ"),
    ),
    "DeadTime": (
        "gfl",
        lambda draft: draft.chain(
            "plant.i_ti", f"{draft.add('DeadTime', 'loss')}.i", "loss.out", "plant.u_r"
        ),
    ),
    "Turn": ("gfl", lambda draft: draft.insert_before("plant.u_r", "Turn", "turn")),
    "ZOH_dq": ("gfl", lambda draft: draft.insert_before("plant.u_r", "ZOH_dq", "hold")),
    "SOGI_dq": ("gfl", lambda draft: draft.insert("plant.e", ["plant.u_r"], "SOGI_dq", "sogi")),
    "DSOGI_dq": (
        "gfl",
        lambda draft: draft.drive(
            "pll.e_q", draft.after(draft.after("plant.e", "DSOGI_dq", "dsogi"), "SliceQ", "e_q")
        ),
    ),
    "DDSRF_dq": (
        "gfl",
        lambda draft: draft.drive(
            "pll.e_q", draft.after(draft.after("plant.e", "DDSRF_dq", "ddsrf"), "SliceQ", "e_q")
        ),
    ),
    "Resonant_dq": (
        "gfl",
        lambda draft: (
            [
                draft.connect(
                    source, f"{draft.add('Resonant_dq', 'resonant') if first else 'resonant'}.in_"
                )
                for first, source in zip((True, False), draft.sources("current.in_"), strict=False)
            ]
            and draft.connect("resonant.out", "plant.u_r")
        ),
    ),
    "PI_negative_dq": (
        "gfl",
        lambda draft: (
            draft.chain(f"{draft.add('PI_negative_dq', 'negative')}.out", "plant.u_r")
            or draft.gather("negative.in_", *draft.sources("current.in_"))
        ),
    ),
    "Ref_pq": (
        "gfl",
        lambda draft: draft.chain(
            "plant.e",
            f"{draft.add('Ref_pq', 'powers')}.v",
            "plant.i_ti",
            "powers.i",
            "powers.out",
            "current.in_",
        ),
    ),
    "LCL_trap": ("gfl", in_place("plant", "LCL_trap")),
    "LCL_saturated": ("gfl", in_place("plant", "LCL_saturated")),
    "SRF_PLL_P": ("gfl", in_place("pll", "SRF_PLL_P")),
    "SRF_PLL_ref": ("gfl", in_place("pll", "SRF_PLL_ref")),
    "SOGI_fixed": (
        "gfl",
        lambda draft: draft.connect(
            "pll.delta_omega",
            f"{draft.insert('plant.e', ['plant.u_r'], 'SOGI_fixed', 'sogi')}.delta_omega",
        ),
    ),
    "DSOGI_fixed": (
        "gfl",
        lambda draft: draft.connect(
            "pll.delta_omega",
            f"{draft.insert('plant.e', ['plant.u_r'], 'DSOGI_fixed', 'sogi')}.delta_omega",
        ),
    ),
}


@cache
def user_of(kind: str) -> Diagram:
    """A legal diagram with the kind: the smallest textbook, else one that gets it."""
    using = [textbook(name) for name in textbook_names()]
    using = [each for each in using if any(one.kind == kind for one in each.instances)]
    if using:
        return min(using, key=lambda each: len(each.instances))
    name, change = PUT_IN[kind]
    draft = Edit(textbook(name), VOCABULARY)
    change(draft)
    assert not examine(draft.diagram(), VOCABULARY)[0]
    return draft.diagram()


def copied(kind: ModuleKind) -> tuple[Diagram, Diagram, Vocabulary]:
    """A diagram, the same with a copy of a kind in its place, and a vocabulary for both."""
    diagram = user_of(kind.name)
    other = Diagram(diagram.name)
    renamed = [
        Instance(f"My{one.kind}" if one.kind == kind.name else one.kind, one.name, one.bindings)
        for one in diagram.instances
    ]
    other.extend(renamed, diagram.connections)
    return diagram, other, (*VOCABULARY, replace(kind, name=f"My{kind.name}"))


@pytest.mark.slow
@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_is_seen_as_the_kind(kind):
    diagram, other, kinds = copied(kind)
    assert roles(other, kinds) == roles(diagram, kinds)
    told, expected = (
        [[one.message for one in part] for part in examine(one, kinds)] for one in (other, diagram)
    )
    assert [
        [message.replace(f"My{kind.name}", kind.name) for message in part] for part in told
    ] == expected


@pytest.mark.slow
@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_is_simplified_as_the_kind(kind):
    diagram, other, kinds = copied(kind)
    one, same = simplified(diagram, kinds), simplified(other, kinds)
    assert sorted(sorted(block.names) for block in one.blocks.values()) == sorted(
        sorted(block.names) for block in same.blocks.values()
    )
    ends = [
        sorted(
            (
                sorted(drawing.blocks[key[0]].names),
                key[1],
                sorted(drawing.blocks[key[2]].names),
                key[3],
            )
            for key in drawing.links
        )
        for drawing in (one, same)
    ]
    assert ends[0] == ends[1]
    own = compare(other, other, kinds)
    assert own.same
    assert own.connections == compare(diagram, diagram, kinds).connections


@pytest.mark.nightly
@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_has_the_places_of_the_kind(kind):
    diagram, other, kinds = copied(kind)
    assert [port.name for port in ports(other, kinds)] == [
        port.name for port in ports(diagram, kinds)
    ]


@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_is_drawn_as_the_kind(kind):
    diagram, other, kinds = copied(kind)
    given, same = block_graph(diagram, kinds), block_graph(other, kinds)
    assert same.nets == given.nets
    assert [replace(node, kind=node.kind.removeprefix("My")) for node in same.nodes] == [
        *given.nodes
    ]


@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_is_put_into_a_frame_and_out_of_it_as_the_kind(kind):
    def wires(diagram: Diagram, kinds: Vocabulary) -> list[list[tuple[str, str]]]:
        into, out = (Draft(diagram, kinds) for _ in range(2))
        into.add("Integrator", "frequency")
        into.add("Integrator", "angle")
        put_into_frame(into, "plant", "frequency.out", "angle.out")
        put_into_grid_frame(out)
        return [into.wires, out.wires]

    diagram, other, kinds = copied(kind)
    assert wires(other, kinds) == wires(diagram, kinds)


def edits(diagram: Diagram, kinds: Vocabulary) -> list[tuple]:
    """What the gap may insert, with how strong it usually is, and what the search may try."""
    found = [
        (one.effect, one.change, [*one.parameters.items()]) for one in insertions(diagram, kinds)
    ]
    for view in views_of(diagram, kinds):
        for family, move in ((one, move) for one in FAMILIES for move in one.moves(view)):
            found.append((family.name, move.note.replace(" My", " "), move.weight))
    return sorted(found, key=str)


@pytest.mark.nightly
@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_gets_the_edits_of_the_kind(kind):
    diagram, other, kinds = copied(kind)
    assert edits(other, kinds) == usual_edits(program_text(diagram))


@cache
def usual_edits(program: str) -> list[tuple]:
    """Of a diagram of shipped kinds."""
    return edits(parse_program(program), VOCABULARY)


#: One descent from the values that are given: random starts depend on the names of kinds, by which
#: a structure is known.
DESCENT = FitSettings(
    starts=1,
    kept=1,
    halving=(),
    kept_misfit=1,
    restarts=0,
    hops=0,
    warm=1,
    warm_kept=1,
    ipopt_iterations=0,
    iterations=60,
)
RESTING = OperatingPoint("rest", 0.7, 0.2)
FREQUENCY = np.geomspace(2.0, 2000.0, 12)


@cache
def measured(program: str) -> tuple[dict[str, float], Sweep, ibrid.Record]:
    """Values somewhat off the typical ones, what would be measured, and a fit of that."""
    diagram = parse_program(program)
    free = parameter_table(wire(diagram, VOCABULARY), "exact").free
    values = {
        one.name: one.typical * factor
        for one, factor in zip(free, cycle((0.9, 0.8, 0.95)), strict=False)
    }
    sweep = Sweep(
        (PointSweep(RESTING, FREQUENCY, np.ones((12, 2, 2), complex)),), 50.0, source="a copy"
    )
    response = record_at(diagram, sweep, values).response("rest", FREQUENCY)
    sweep = replace(sweep, points=(PointSweep(RESTING, FREQUENCY, response),))
    return values, sweep, fitted(diagram, sweep, values, VOCABULARY)


def fitted(
    diagram: Diagram, sweep: Sweep, values: dict[str, float], kinds: Vocabulary
) -> ibrid.Record:
    """From near some values."""
    start = {
        name: value * factor
        for (name, value), factor in zip(values.items(), cycle((1.02, 0.95)), strict=False)
    }
    return ibrid.evaluate(diagram, sweep, vocabulary=kinds, settings=DESCENT, warm={"rest": start})


@pytest.mark.nightly
@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_is_fitted_as_the_kind(kind):
    diagram, other, kinds = copied(kind)
    values, sweep, given = measured(program_text(diagram))
    there = record_at(other, sweep, values, vocabulary=kinds).response("rest", FREQUENCY)
    assert there == pytest.approx(sweep.points[0].admittance, rel=1e-9, abs=1e-12)
    same = fitted(other, sweep, values, kinds)
    assert same.nrmse == pytest.approx(given.nrmse, rel=1e-3, abs=1e-6)
    assert same.parameters["rest"] == pytest.approx(given.parameters["rest"], rel=1e-3)


def test_every_kind_is_in_the_diagram_that_is_made_for_it():
    for kind in VOCABULARY:
        assert kind.name in {one.kind for one in user_of(kind.name).instances}
