"""How a device draws its delays, in a search: looked at once the error is not gross, and part of
every interval of the answer.
"""

from dataclasses import replace

import numpy as np
import pytest
from ibrid_search.proposal import Evaluated
from ibrid_search.screening.candidate_edits import list_delay_form_edits, list_effect_edits
from ibrid_search.screening.delay_form_intervals import widen_over_delay_forms
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.selection_criterion import estimate_noise_floor

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.parts.plant.delay_form import delay_forms
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study

MODEL = ibrid.textbook("gfl_delay")
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
    "delay.T_d": 1.5e-4,
}


def _measured(kind: str, highest: float) -> Sweep:
    """20 frequencies at two points, 60 dB, of the model with its delay as another kind."""
    device = parse_program(program_text(MODEL).replace('"Delay"', f'"{kind}"'), kind)
    frequency = np.geomspace(5.0, highest, 20)
    shipped = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    empty = np.tile(np.eye(2, dtype=complex), (len(frequency), 1, 1))
    points = tuple(
        replace(one, frequency=frequency, admittance=empty, sigma=None) for one in shipped.points
    )
    record = record_at(device, replace(shipped, points=points), VALUES)
    points = tuple(
        replace(one, admittance=record.response(one.op.name, frequency)) for one in points
    )
    return ibrid.add_noise(
        replace(shipped, points=points), noise_db=60.0, rng=np.random.default_rng(1)
    )


def _fitted(study: Study) -> Record:
    return ibrid.evaluate(MODEL, study, warm=dict.fromkeys(study.sweep.names, VALUES))


def test_forms_are_no_effects_and_each_is_one_edit():
    study = Study(_measured("Delay", 5e3))
    assert "delay_form" not in {one.source for one in list_effect_edits(MODEL, study)}
    assert {
        form
        for one in list_delay_form_edits(MODEL, study)
        for form in delay_forms(one.diagram, study.kinds)
    } == {*(f"pade-{order}" for order in range(1, 5)), "hold", "sampled"}


@pytest.fixture(scope="module")
def drawn() -> tuple[Study, Record]:
    """A device whose delay is a Pade form of order 1, and the model with an exact one fitted to
    it.
    """
    study = Study(_measured("Pade1_dq", 5e3))
    return study, _fitted(study)


@pytest.mark.nightly
def test_the_diagnosis_says_how_the_device_draws_its_delay(drawn):
    study, record = drawn
    (best,) = rankings_for(study).best_edits(Evaluated(0, MODEL, record), lambda diagram: True)
    assert best.edit.source == "delay_form"
    assert delay_forms(best.edit.diagram, study.kinds) == ("pade-1",)


@pytest.mark.slow
def test_an_answer_in_the_form_of_the_device_keeps_its_intervals(drawn):
    study, _ = drawn
    right = ibrid.evaluate(
        parse_program(program_text(MODEL).replace('"Delay"', '"Pade1_dq"'), "right"),
        study,
        warm=dict.fromkeys(study.sweep.names, VALUES),
    )
    assert (
        widen_over_delay_forms(right, study, estimate_noise_floor(study.fitted)).intervals
        == right.intervals
    )


@pytest.mark.slow
def test_where_forms_fit_alike_the_intervals_of_an_answer_hold_for_all():
    study = Study(_measured("Delay", 300.0))
    alone = _fitted(study)
    told = widen_over_delay_forms(alone, study, estimate_noise_floor(study.fitted))
    name = study.sweep.names[0]
    assert "exact, pade-" in told.identifiability[-1]
    for parameter, interval in alone.intervals[name].items():
        wide = told.intervals[name][parameter]
        assert wide is None or (wide[0] <= interval[0] and interval[1] <= wide[1])
    assert told.intervals[name] != alone.intervals[name]


@pytest.mark.slow
def test_an_answer_without_delays_is_left_as_it_is(drawn):
    study, record = drawn
    other = replace(record, program=program_text(ibrid.textbook("gfl_exact")))
    assert widen_over_delay_forms(other, study, estimate_noise_floor(study.fitted)) is other
