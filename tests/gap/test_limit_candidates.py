"""Which form of a missing limit explains records, from values 15 % off; the device is simulated
apart from the package.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ibrid_bench.events.cases import NAMES, EventCase, draw

from ibrid.gap.recordings.cessation import HOLD_TIME, RELEASE_TIME, release_times_from_hold
from ibrid.gap.recordings.event_misfit import EventDescent, event_parameter
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.refitting.model import Model
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.parts.catalogue import CATALOGUE, insertions


def raced(hidden: str, seed: int, noise_db: float, *, swept: bool) -> tuple[Model, EventCase]:
    """The best of a drawn device's model with each limit, and the case."""
    case = draw(hidden, seed, noise_db, swept=swept)
    question = build_event_problem(
        case.diagram, case.sweep, case.values, case.events, {"holdout_op": (case.held,)}
    )
    records = question.build_dataset(question.prior())
    given = records.fit_given(question.diagram)
    assert given is not None
    assert not given.is_adequate()
    limits = [one for one in records.insertions(given) if isinstance(one, LimitEdit)]
    fits = [one for one in (records.fit_edit(given, limit) for limit in limits) if one is not None]
    return min(fits, key=lambda one: one.cost()), case


@pytest.mark.nightly
def test_of_all_forms_the_limit_that_a_device_has_explains_its_records_with_its_value():
    best, case = raced("command_limit", 1, 60.0, swept=False)
    (place,), (told,) = best.edits, case.limits.values()
    assert best.is_adequate()
    assert isinstance(place, LimitEdit)
    assert (place.limit.id, place.limit.windup) == ("command_limit", told["windup"])
    assert abs(best.refit.values["command_limit.u_max"] / told["u_max"] - 1.0) < 1e-3


@pytest.mark.nightly
def test_a_cessation_is_found_with_its_hold_though_the_filter_rings_when_it_begins():
    best, case = raced("momentary_cessation", 1, 60.0, swept=True)
    (place,), (told,) = best.edits, case.limits.values()
    assert best.is_adequate()
    assert isinstance(place, LimitEdit)
    assert place.limit.id == "momentary_cessation"
    found = {
        name: best.refit.values[f"momentary_cessation.{name}"] / told[name]
        for name in ("v_block", "t_hold", "ramp")
    }
    assert all(abs(ratio - 1.0) < 5e-3 for ratio in found.values()), found


@pytest.mark.nightly
def test_forms_of_a_limit_set_out_where_the_sweep_alone_leads(monkeypatch):
    """From values 15 % off the sweep, which the limit does not touch, hides it behind a misfit of
    its own.
    """
    begun = []
    monkeypatch.setattr(
        "ibrid.gap.recordings.limit_fitter.screen_limits",
        lambda fitter, places, beside, origins, predict_first: (
            begun.append(origins[0]) or [None for _ in places]
        ),
    )
    case = draw("current_limit", 5, 40.0, swept=True)
    question = build_event_problem(
        case.diagram, case.sweep, case.values, case.events, {"holdout_op": (case.held,)}
    )
    records = question.build_dataset(question.prior())
    given = records.fit_given(question.diagram)
    assert given is not None
    assert not given.is_adequate()
    records.insertions(given)
    loops = {
        name: key for key, name in NAMES.items() if name in ("pll.kP_pll", "power.kI", "plant.C_F")
    }
    off = {name: begun[0][name] / case.numbers[key] for name, key in loops.items()}
    assert all(abs(ratio - 1.0) < 0.1 for ratio in off.values()), off


@pytest.mark.nightly
def test_an_edit_that_the_sweep_speaks_for_is_fitted_wherever_a_glance_at_the_records_puts_it(
    monkeypatch,
):
    few = replace(SCREENING, edit_entrants=1)
    monkeypatch.setattr("ibrid.gap.recordings.edit_fitter.SCREENING", few)
    case = draw("pll_filter", 3, None, swept=True)
    question = build_event_problem(
        case.diagram, case.sweep, case.values, case.events, {"holdout_op": (case.held,)}
    )
    records = question.build_dataset(question.prior(), CATALOGUE)
    given = records.fit_given(question.diagram)
    assert given is not None
    edits = insertions(given.diagram, records.kinds, CATALOGUE)
    filters = [records.fit_edit(given, one) for one in edits if one.effect == "pll_prefilter"]
    assert any(one is not None and one.is_adequate() for one in filters)


@pytest.mark.slow
def test_no_limit_is_tried_where_the_sweep_asks_for_an_edit_that_explains_all(monkeypatch):
    monkeypatch.setattr(
        "ibrid.gap.recordings.limit_fitter.screen_limits",
        lambda *_, **__: pytest.fail("a limit was tried"),
    )
    case = draw("damping", 1, 60.0, swept=True)
    question = build_event_problem(
        case.diagram, case.sweep, case.values, case.events, {"holdout_op": (case.held,)}
    )
    records = question.build_dataset(
        question.prior(), [one for one in CATALOGUE if one.id == "active_damping"]
    )
    given = records.fit_given(question.diagram)
    assert given is not None
    edits = records.insertions(given)
    assert edits
    assert not any(isinstance(one, LimitEdit) for one in edits)


def test_a_cessation_that_comes_twice_starts_where_the_current_sets_in_for_good():
    time = np.arange(1500) / 5000
    v, i = (
        np.where((time > 0.06) & (time < 0.16), 0.5, 1.0),
        np.where((time > 0.062) & (time < 0.25), 0.0, 0.8),
    )
    axes = [np.stack([one, np.zeros_like(one)], axis=1) for one in (v, i)]
    events = Events((EventRecord(OperatingPoint("dip", 0.8, 0.0, 1.0), time, *axes, 0.04),))
    behind, seen = release_times_from_hold(
        {"momentary_cessation.v_block": 0.7, HOLD_TIME: 0.02, "momentary_cessation.ramp": 9.0},
        events,
    )
    assert behind[event_parameter(RELEASE_TIME, "dip")] == pytest.approx(
        0.16 - 0.04 + 0.02, abs=1e-3
    )
    assert seen[event_parameter(RELEASE_TIME, "dip")] == pytest.approx(0.25 - 0.04, abs=1e-3)
    assert HOLD_TIME not in {**behind, **seen}


class Stepping(EventDescent):
    """A descent that stays where it is: on a step there is no slope."""

    def run(self, rounds: int, steps: int) -> "Stepping":
        return self


def test_a_number_at_which_the_model_jumps_is_looked_for_a_little_way_off_where_its_slope_ends():
    def start_descents(x: np.ndarray, number: int) -> list[Stepping]:
        costs = [2.0 if one[0] < 0.015 or one[1] else 0.5 for one in x]
        steps = [Stepping(misfit, one, cost) for one, cost in zip(x, costs, strict=True)]
        return sorted(steps, key=lambda step: step.cost)[:number]

    nowhere = SimpleNamespace(start_descents=lambda x, number: [])
    misfit: Any = SimpleNamespace(
        start_descents=start_descents,
        prediction=nowhere,
        parameter_prior=SimpleNamespace(reset_implausible=lambda x: x),
        count=1,
        is_discontinuous=np.array([True, False]),
        box=(np.full(2, -1.0), np.full(2, 1.0)),
    )
    descent = Stepping(misfit, np.zeros(2), 2.0)
    descent.restart_while_improving()
    assert descent.cost == 0.5
    assert descent.x.tolist() == [0.016, 0.0]
