"""Records of programs of fixed steps: against the laws integrated by the trapezoidal rule apart
from the package.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.events.cases import NAMES, TYPICAL
from ibrid_bench.events.device import OMEGA, Device, linear, simulate

import ibrid
from ibrid.errors import SweepError
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.gap.workflow import find_gap
from ibrid.measurement.formats.event_csv import event_csv, parse_event_csv, write_events
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.event_rest import record_from_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.fixed_steps import as_of_the_device, in_fixed_steps, step_of
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.playback.limits import LIMITS
from ibrid.playback.player import Player
from ibrid.playback.recording import event_of
from ibrid.report.pages.page import measured_events

NUMBERS = {**TYPICAL, "w_pll": 0.0, "feedforward": 1.0}
POINT, F0_HZ = (0.6, 0.1, 1.0), OMEGA / (2 * np.pi)
VALUES = {
    NAMES[name]: value for name, value in NUMBERS.items() if name in NAMES and name != "w_pll"
}


def recorded(
    word: str,
    step: float,
    *,
    trapezoidal: bool,
    limits: Mapping[str, Any] | None = None,
    length: float = 0.15,
) -> EventRecord:
    time = np.arange(round(length / step)) * step
    shape = event_of(f"{word},at=0.05,rise=0.001").voltage(time, 1.0)
    v = np.stack([np.real(shape), np.imag(shape)], axis=1)
    i = simulate(Device(NUMBERS, limits or {}), POINT, time, v, trapezoidal=trapezoidal)
    return record_from_rest(word, time, v @ [1, 1j], i @ [1, 1j], F0_HZ)


def error(player: Player, record: EventRecord, values: dict[str, float]) -> float:
    left = player.play(record, [values])[0].current - record.i
    return float(np.linalg.norm(left) / np.linalg.norm(record.i - record.i_rest))


@pytest.mark.parametrize("step", [2e-5, 5e-5, 1e-4])
def test_the_right_model_answers_a_program_in_its_own_steps_exactly(step: float) -> None:
    record = recorded("dip:0.5", step, trapezoidal=True)
    player = Player(ibrid.textbook("gfl_exact"), VOCABULARY)
    assert error(player, replace(record, stepped=True), VALUES) < 1e-6
    assert error(player, record, VALUES) > 1e-4 * (step / 2e-5) ** 2


@pytest.mark.parametrize(("windup", "at_most"), [(True, 1e-6), (False, 2e-4)])
def test_a_limit_that_is_met_in_a_program_is_met_in_the_same_step(
    windup: bool, at_most: float
) -> None:
    """Where an integrator stops within a step, its equation has no solution, and two iterations may
    end differently.
    """
    limit = next(
        one
        for one in LIMITS
        if (one.id, one.mode, one.windup) == ("current_limit", "magnitude", windup)
    )
    limits = {"current_limit": {"i_max": 0.75, "mode": "magnitude", "windup": windup}}
    record = replace(recorded("dip:0.5", 5e-5, trapezoidal=True, limits=limits), stepped=True)
    player = Player(ibrid.textbook("gfl_exact"), VOCABULARY, (limit,))
    assert error(player, record, {**VALUES, "current_limit.i_max": 0.75}) < at_most
    assert error(player, record, {**VALUES, "current_limit.i_max": 0.76}) > 1e-3


def test_sets_that_are_played_together_answer_as_each_alone() -> None:
    record = replace(recorded("phase:10", 5e-5, trapezoidal=True), stepped=True)
    player = Player(ibrid.textbook("gfl_exact"), VOCABULARY)
    sets = [
        VALUES,
        {**VALUES, "pll.kP_pll": 80.0},
        {**VALUES, "plant.L_F": 0.3},
        VALUES,
        {**VALUES, "current.kP": 0.4},
    ]
    together = [one.current for one in player.play(record, sets)]
    for values, current in zip(sets, together, strict=True):
        np.testing.assert_allclose(current, player.play(record, [values])[0].current, atol=1e-9)


def test_a_sweep_of_a_program_is_that_of_the_device_at_other_frequencies() -> None:
    frequency, step = np.geomspace(5.0, 4000.0, 12), 5e-5
    device = linear(Device(NUMBERS), POINT)
    of_the_program = device.response(frequency, step)
    sweep = Sweep((PointSweep(OperatingPoint("rest", *POINT), frequency, of_the_program),))
    (point,) = as_of_the_device(sweep, step).points
    np.testing.assert_allclose(device.response(point.frequency), of_the_program, rtol=1e-9)
    assert np.interp(2000.0, frequency, point.frequency) > 2030.0


def test_samples_are_steps_where_the_file_says_so_and_only_where_they_can_be() -> None:
    events = Events((recorded("dip:0.5", 5e-5, trapezoidal=True),), f0_hz=F0_HZ)
    assert step_of(events) == pytest.approx(5e-5)
    stepped = in_fixed_steps(events)
    text = event_csv(stepped)
    assert "# solver: trapezoidal" in text
    assert parse_event_csv(text.splitlines(), "a.csv", {})["dip:0.5"].stepped
    assert not parse_event_csv(event_csv(events).splitlines(), "a.csv", {})["dip:0.5"].stepped
    assert not parse_event_csv(text.splitlines(), "a.csv", {"solver": "continuous"})[
        "dip:0.5"
    ].stepped
    record = events.records[0]
    moved = record.time + 2e-6 * np.sin(np.arange(len(record.time)))
    uneven = Events((replace(record, time=moved),), f0_hz=F0_HZ)
    noisy = Events(
        (
            replace(
                record, i=record.i + 1e-3 * np.random.default_rng(0).standard_normal(record.i.shape)
            ),
        )
    )
    slow = Events((recorded("dip:0.5", 5e-4, trapezoidal=False),), f0_hz=F0_HZ)
    assert step_of(uneven) is step_of(noisy) is step_of(slow) is None
    with pytest.raises(SweepError, match=r"solver: trapezoidal .* uneven times"):
        parse_event_csv(event_csv(in_fixed_steps(uneven)).splitlines(), "a.csv", {})


@pytest.mark.parametrize("trapezoidal", [True, False])
def test_a_gap_finds_out_whether_its_records_are_steps(trapezoidal: bool, tmp_path: Path) -> None:
    """Nominal values are 10 % off, and nothing is hidden.

    The page of the answer reads the file again, which does not say it.
    """
    records = tuple(
        recorded(word, 5e-5, trapezoidal=trapezoidal, length=0.12)
        for word in ("dip:0.6", "phase:8", "dip:0.5")
    )
    write_events(Events(records, f0_hz=F0_HZ), tmp_path / "dips.csv")
    values = {
        name: value * (1.1 if k % 2 else 0.9) for k, (name, value) in enumerate(VALUES.items())
    }
    events = read_events(tmp_path / "dips.csv")
    model = ibrid.textbook("gfl_exact")
    gap = find_gap(model, None, values, events=events, holdout_op="dip:0.5", progress="silent")
    assert ("the steps of a program" in gap.sentence) is trapezoidal
    assert gap.verdict in ("no-gap", "parameters-only")
    held_out = gap.after["holdout"]
    assert held_out is not None
    assert held_out < (1e-6 if trapezoidal else 1e-3)
    shown, doubt = measured_events(gap.repaired, None)
    assert shown is not None
    assert (shown.solver, doubt) == ("trapezoidal" if trapezoidal else None, "")


def test_a_fit_to_a_program_and_its_sweep_is_exact_where_the_file_says_so() -> None:
    step, frequency = 5e-5, np.geomspace(5.0, 2000.0, 16)
    records = tuple(
        recorded(word, step, trapezoidal=True, length=0.12) for word in ("dip:0.6", "phase:8")
    )
    response = linear(Device(NUMBERS), POINT).response(frequency, step)
    sweep = Sweep(
        (PointSweep(records[0].rest, frequency, response),), f0_hz=F0_HZ, power_node="pcc"
    )
    events = in_fixed_steps(Events(records, f0_hz=F0_HZ))
    error = evaluate_events(ibrid.textbook("gfl_exact"), events, sweep).nrmse
    assert error is not None
    assert error < 1e-6
