"""Cases with records of events: the device is simulated apart from the package, which must answer
as it does.
"""

from pathlib import Path

import numpy as np
import pytest
from ibrid_bench.events.__main__ import BEGIN, END, table_of
from ibrid_bench.events.cases import NAMES, TYPICAL, draw
from ibrid_bench.events.device import Device, linear, simulate
from ibrid_bench.events.families import draw_family
from ibrid_bench.events.recorder import Recorder, recorded
from ibrid_bench.ledger import Ledger

import ibrid
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.vocabulary import VOCABULARY, choose_vocabulary
from ibrid.playback.compare import EventModel, play
from ibrid.playback.recording import event_of


def test_the_true_diagram_explains_the_sweep_of_a_drawn_device_and_answers_its_records():
    case = draw("nothing", 1, None, swept=True)
    assert case.sweep is not None
    diagram = case.diagram
    assert ibrid.evaluate(diagram, case.sweep).nrmse < 1e-6  # the sweep's slopes are differences
    truth = {
        NAMES[name]: value for name, value in case.numbers.items() if NAMES.get(name) in case.values
    }
    played = play(EventModel(diagram, truth, (), VOCABULARY), case.events)
    errors = [one.nrmse for one in played.records]
    assert all(error is not None and 1e-5 < error < 3e-3 for error in errors), (
        errors
    )  # edges of five samples
    again = draw("nothing", 1, None, swept=True)
    assert all(
        np.array_equal(one.i, other.i)
        for one, other in zip(case.events.records, again.events.records, strict=True)
    )


def test_the_true_diagram_answers_a_device_whose_voltage_is_known_at_all_times():
    """At 100 kHz a spline leaves nothing of an edge of a millisecond open."""
    case = draw("nothing", 1, None, swept=False)
    diagram, time = case.diagram, np.arange(20000) / 1e5
    truth = {
        NAMES[name]: value for name, value in case.numbers.items() if NAMES.get(name) in case.values
    }
    wave = event_of("dip:0.6,at=0.05,for=0.08").voltage(time, 1.0)
    v = np.stack([np.real(wave), np.imag(wave)], axis=1)
    i = simulate(Device(case.numbers), (0.6, 0.1, 1.0), time, v)
    at_pcc = OperatingPoint("dip", float(i[0, 0]), float(-i[0, 1]), 1.0)
    events = Events((EventRecord(at_pcc, time, v, i, 0.049),), f0_hz=60.0)
    (played,) = play(EventModel(diagram, truth, (), VOCABULARY), events).records
    assert played.nrmse is not None
    assert played.nrmse < 1e-6


@pytest.mark.parametrize(
    "block", [{"delay": 150e-6}, {"k_damping": 0.2}, {"w_feedforward": 3000.0}, {"w_pll": 3000.0}]
)
def test_a_device_answers_small_steps_as_its_frequency_response_says(block: dict):
    """In the Laplace domain, along a line on which the step and its answer have died away at the
    end of the record.
    """
    numbers = {**TYPICAL, "w_pll": 0.0, "feedforward": 1.0, **block}
    device, point, time = Device(numbers), (0.6, 0.1, 1.0), np.arange(20000) / 1e5
    step, s = 1e-5, 120.0 + 2j * np.pi * np.array([20.0, 100.0, 400.0])
    v = np.stack([1.0 + step * np.exp(-(((time - 0.01) / 5e-4) ** 2)), np.zeros_like(time)], axis=1)
    i = simulate(device, point, time, v)
    decay = np.exp(-np.multiply.outer(s, time)) * (time[1] - time[0])
    answer, asked = decay @ (i - i[0]), decay @ (v - v[0])
    expected = linear(device, point).response(s / (2j * np.pi))[:, :, 0] * asked[:, :1]
    np.testing.assert_allclose(answer, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max())


def test_fixed_steps_are_wrong_by_the_square_of_the_step():
    numbers = {**TYPICAL, "w_pll": 0.0, "feedforward": 1.0}
    device, point = (
        Device(numbers, {"current_limit": {"i_max": 0.8, "mode": "magnitude"}}),
        (0.6, 0.1, 1.0),
    )
    errors = []
    for step in (2e-5, 1e-5):
        time = np.arange(round(0.12 / step)) * step
        v = np.stack(
            [1.0 - 0.3 * np.exp(-(((time - 0.05) / 0.01) ** 2)), np.zeros_like(time)], axis=1
        )
        exact = simulate(device, point, time, v)
        errors.append(
            np.linalg.norm(simulate(device, point, time, v, trapezoidal=True) - exact)
            / np.linalg.norm(exact - exact[0])
        )
    assert errors[0] < 0.02
    assert errors[1] < 0.4 * errors[0]  # a quarter, and a limit that is met between two steps


def test_a_program_of_fixed_steps_answers_small_steps_as_its_frequency_response_says():
    numbers = {**TYPICAL, "w_pll": 0.0, "feedforward": 1.0}
    device, point, step = Device(numbers), (0.6, 0.1, 1.0), 1e-4
    time = np.arange(2000) * step
    size, s = 1e-5, 120.0 + 2j * np.pi * np.array([100.0, 400.0, 1000.0])
    v = np.stack([1.0 + size * np.exp(-(((time - 0.01) / 5e-4) ** 2)), np.zeros_like(time)], axis=1)
    i = simulate(device, point, time, v, trapezoidal=True)
    decay = np.exp(-np.multiply.outer(s, time)) * step
    answer, asked = decay @ (i - i[0]), decay @ (v - v[0])
    expected = linear(device, point).response(s / (2j * np.pi), step)[:, :, 0] * asked[:, :1]
    np.testing.assert_allclose(answer, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(4))
def test_the_diagram_of_a_family_answers_its_recording(seed: int):
    case = draw_family("family_nothing", seed, None, swept=True)
    played = play(
        EventModel(case.diagram, dict(case.numbers), (), choose_vocabulary("extended")), case.events
    )
    errors = [one.nrmse for one in played.records]
    assert all(error is not None and error < 3e-3 for error in errors), errors
    assert case.sweep is not None
    assert case.sweep.power_node == (
        "pcc"
        if "plant.C_F" not in case.numbers and "gfl_plant.L_F" in case.numbers
        else "capacitor"
    )


def test_what_a_family_hides_is_not_in_its_model():
    case = draw_family("virtual_impedance", 0, None, swept=False)
    names = {one.name for one in case.diagram.instances}
    assert not names & {"virtual_reactance", "minus_drop"}
    assert "virtual_reactance.L" not in case.values


def test_a_recorder_filters_rounds_and_offsets_what_it_is_given():
    time = np.arange(20000) / 1e5
    wave = np.where(time < 0.1, 1.0, 0.5) + 0j
    plain, rounded, filtered = (
        recorded(one, {"dip": (time, wave, 0.7 * wave)}, 60.0, np.random.default_rng(0)).records[0]
        for one in (Recorder(5000.0), Recorder(5000.0, bits=12), Recorder(5000.0, filtered=True))
    )
    assert len(plain.time) == 999
    step = 2 * 2.0 / 2**12
    np.testing.assert_allclose(rounded.v / step, np.round(rounded.v / step), atol=1e-6)
    assert 0 < np.abs(rounded.i - plain.i).max() <= 2 * step  # its channels have twice the range
    moving = np.hypot(*(np.diff(filtered.v, axis=0)).T) > 1e-3
    assert moving.sum() > (np.hypot(*(np.diff(plain.v, axis=0)).T) > 1e-3).sum()
    np.testing.assert_allclose(filtered.v[-1], plain.v[-1], atol=1e-6)


def test_the_page_shows_what_was_measured():
    docs = Path(__file__).resolve().parents[2] / "docs"
    assert (
        f"{BEGIN}\n{table_of(Ledger(docs / 'measured' / 'events'))}\n{END}"
        in (docs / "events.md").read_text()
    )
