"""Delays that the device approximates or holds where the model is exact: nothing that does not
exist is named for it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.gap.results.files import gap_json
from ibrid.gap.results.gap import Gap
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE, insertions
from ibrid.parts.plant.delay_form import DELAY_FORM, delay_forms
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

MODEL = ibrid.textbook("gfl_delay")
KINDS = {
    "exact": "Delay",
    "hold": "ZOH_dq",
    **{f"pade-{order}": f"Pade{order}_dq" for order in range(1, 5)},
}
FORMS = (*KINDS, "sampled")
#: Few effects, so that a test is short; all of them could stand for what a form does.
FEW = tuple(
    one
    for one in CATALOGUE
    if one.id
    in (
        "control_delay",
        "voltage_feedforward_filter",
        "command_filter",
        "zero_order_hold",
        "delay_form",
    )
)
HZ = 2 * np.pi
VALUES = {
    "plant.L_F": 0.15,
    "plant.R_F": 0.005,
    "plant.C_F": 0.066,
    "plant.L_g": 0.15,
    "plant.R_g": 0.01,
    "pll.kP_pll": 60.0,
    "pll.kI_pll": 1400.0,
    "power.kP": 0.02,
    "power.kI": 20.0,
    "current.kP": 0.5,
    "current.kI": 15.0,
    "decoupling.L": 0.15,
    "e_filter.omega_c": 800 * HZ,
    "delay.T_d": 1.5e-4,
    "delay.T_s": 3e-4,
    "hold.T_s": 1e-4,
}


def _device(form: str, *, filtered: bool = True) -> Diagram:
    """The model with a filtered feedforward of the voltage, its delay in a form."""
    text = program_text(MODEL)
    if filtered:
        text = text.replace('g.add("Delay"', 'g.add("LPF1_dq", "e_filter")\n    g.add("Delay"')
        behind = 'g.connect("plant.e", "e_filter.in_")\n    g.connect("e_filter.out", "delay.in_")'
        text = text.replace('g.connect("plant.e", "delay.in_")', behind)
    if form == "sampled":
        both = 'g.add("Delay", "delay", T_d="hold.T_s")\n    g.add("ZOH_dq", "hold")'
        text = text.replace('g.add("Delay", "delay")', both)
        behind = 'g.connect("delay.out", "hold.in_")\n    g.connect("hold.out", "plant.u_r")'
        text = text.replace('g.connect("delay.out", "plant.u_r")', behind)
    else:
        text = text.replace('g.add("Delay", "delay")', f'g.add("{KINDS[form]}", "delay")')
    return parse_program(text, form)


def _measured(
    form: str, highest: float = 5e3, *, filtered: bool = True, noise_db: float | None = None
) -> Sweep:
    """The device with its delay in a form."""
    return _swept(_device(form, filtered=filtered), VALUES, highest, noise_db)


def _swept(
    device: Diagram,
    values: Mapping[str, float],
    highest: float = 5e3,
    noise_db: float | None = None,
) -> Sweep:
    """28 frequencies of a device at two operating points."""
    frequency = np.geomspace(5.0, highest, 28)
    shipped = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    empty = np.tile(np.eye(2, dtype=complex), (len(frequency), 1, 1))
    points = [
        replace(one, frequency=frequency, admittance=empty, sigma=None) for one in shipped.points
    ]
    sweep = replace(shipped, points=tuple(points))
    record = record_at(device, sweep, values)
    points = [replace(one, admittance=record.response(one.op.name, frequency)) for one in points]
    sweep = replace(sweep, points=tuple(points))
    return (
        sweep
        if noise_db is None
        else ibrid.add_noise(sweep, noise_db=noise_db, rng=np.random.default_rng(3))
    )


def _nominal(diagram: Diagram = MODEL) -> dict[str, float]:
    """Values that are 5 to 10 % off."""
    names = {one.name for one in parameter_table(wire(diagram, VOCABULARY), "exact").free}
    return {
        name: value * (1.1 if name < "plant" else 0.95)
        for name, value in VALUES.items()
        if name in names
    }


def _gap(sweep: Sweep, model: Diagram = MODEL) -> Gap:
    return ibrid.find_gap(model, sweep, _nominal(model), catalogue=FEW, progress="silent")


def _within(interval: tuple[float, float | None, float | None], truth: float) -> bool:
    _, low, high = interval
    return low is not None and high is not None and low <= truth <= high


# the forms themselves


@pytest.mark.parametrize("form", FORMS)
def test_a_delay_is_known_by_its_form(form):
    assert delay_forms(_device(form), VOCABULARY) == (form,)


@pytest.mark.parametrize("form", FORMS)
def test_from_every_form_each_other_is_one_edit_away(form):
    edits = insertions(_device(form), VOCABULARY, (DELAY_FORM,))
    found = {
        delay_forms(one.diagram, VOCABULARY): structure_hash(one.diagram, VOCABULARY)
        for one in edits
    }
    assert found == {
        (other,): structure_hash(_device(other), VOCABULARY) for other in FORMS if other != form
    }
    assert all(one.form and one.change == "replace" for one in edits)


def test_a_diagram_without_a_delay_has_no_form():
    gfl = ibrid.textbook("gfl")
    assert delay_forms(gfl, VOCABULARY) == insertions(gfl, VOCABULARY, (DELAY_FORM,)) == ()


# what a gap makes of them


@pytest.mark.slow
@pytest.mark.parametrize(
    "form",
    [
        "exact",
        pytest.param("pade-1", marks=pytest.mark.nightly),
        pytest.param("hold", marks=pytest.mark.nightly),
    ],
)
def test_a_hidden_filter_keeps_its_corner_whatever_the_form_of_the_delay(form):
    gap = _gap(_measured(form))
    named = {one.id: one for one in gap.effects}
    assert gap.verdict == "named"
    assert [*named] == ["voltage_feedforward_filter", *(["delay_form"] if form != "exact" else [])]
    assert _within(
        named["voltage_feedforward_filter"].parameters["feedforward_filter.omega_c"], 800 * HZ
    )
    if form != "exact":
        evidence: Mapping[str, object] = named["delay_form"].evidence
        assert (evidence["form"], evidence["forms"]) == (form, [form])
        assert delay_forms(gap.diagram, VOCABULARY) == (form,)


@pytest.mark.nightly
@pytest.mark.parametrize("form", ["exact", "pade-1", "pade-2"])
def test_with_noise_nothing_that_does_not_exist_is_named(form):
    gap = _gap(_measured(form, noise_db=50.0))
    named = {one.id: one for one in gap.effects}
    assert {*named} <= {"voltage_feedforward_filter", *({"delay_form"} if form != "exact" else ())}
    low, high = named["voltage_feedforward_filter"].parameters["feedforward_filter.omega_c"][1:]
    assert 0.95 * (low or np.inf) < 800 * HZ < 1.05 * (high or 0.0)  # 95 % intervals, one draw


@pytest.mark.slow
def test_a_form_alone_is_a_convention_and_no_effect():
    gap = _gap(_measured("pade-2", filtered=False))
    assert (gap.verdict, [one.id for one in gap.effects]) == ("data-convention", ["delay_form"])
    assert gap.sentence.startswith(
        "The device approximates its delay by a Pade form of order 2, where the model has it "
        "exact; nothing else is missing"
    )
    (effect,) = gap_json(gap)["effects"]
    assert (effect["id"], effect["change"], effect["evidence"]["form"]) == (
        "delay_form",
        "replace",
        "pade-2",
    )


@pytest.mark.slow
def test_where_the_forms_look_alike_the_intervals_hold_for_all_of_them():
    sweep = _measured("exact", 1e3, filtered=False, noise_db=50.0)
    gap = _gap(sweep)
    assert gap.verdict in ("no-gap", "parameters-only")
    (told,) = [step for step in gap.steps if "in which form the device has its delays" in step]
    assert "exact, pade-2, pade-3, pade-4" in told
    points = [replace(one, sigma=gap.sweep.point(one.op.name).sigma) for one in sweep.points]
    alone = record_at(
        MODEL, replace(sweep, points=tuple(points)), next(iter(gap.repaired.parameters.values()))
    )
    widths = []
    for record in (alone, gap.repaired):
        interval = next(iter(record.intervals.values()))["delay.T_d"]
        widths.append(np.inf if interval is None else interval[1] - interval[0])
    assert widths[0] < widths[1]


@pytest.mark.slow
def test_a_delay_that_is_missing_is_found_in_the_form_of_the_device():
    gap = _gap(_measured("pade-1", filtered=False), ibrid.textbook("gfl_exact"))
    assert [one.id for one in gap.effects] == ["control_delay", "delay_form"]
    assert gap.verdict == "named"
    assert _within(gap.effects[0].parameters["delay.T_d"], VALUES["delay.T_d"])


@pytest.mark.nightly
def test_a_lag_in_the_place_of_the_delay_is_told_of_the_given_model():
    lag = program_text(MODEL).replace('g.add("Delay", "delay")', 'g.add("LPF1_dq", "delay")')
    gap = _gap(_swept(parse_program(lag), {**VALUES, "delay.omega_c": 1 / VALUES["delay.T_d"]}))
    assert {(one.id, one.change) for one in gap.effects} == {
        ("command_filter", "add"),
        ("control_delay", "remove"),
    }
    assert gap.verdict == "named"
    assert "hold" not in gap.sentence
