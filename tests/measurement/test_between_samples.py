"""How far the voltage between samples is from its spline: edges of known shape, whose error is
computed, and estimated.
"""

import numpy as np
import pytest

from ibrid.measurement.recordings.between_samples import error_between, noise_left
from ibrid.measurement.recordings.event_samples import _step
from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: Edges from 0 before 0 to 1 behind 1.
EDGES = {
    "raised cosine": lambda s: (1 - np.cos(np.pi * np.clip(s, 0, 1))) / 2,
    "ramp": lambda s: np.clip(s, 0, 1),
    "smooth": lambda s: (
        np.clip(s, 0, 1) ** 3 * (10 - 15 * np.clip(s, 0, 1) + 6 * np.clip(s, 0, 1) ** 2)
    ),
    "relaxation": lambda s: np.where(s > 0, 1 - np.exp(-3 * np.clip(s, 0, None)), 0),
}


def record_of(v_d: np.ndarray, rest_end: float = 20.0, f0_hz: float = 0.0) -> EventRecord:
    """With a sample a second."""
    time = np.arange(float(len(v_d)))
    v = np.stack([v_d, np.zeros(len(v_d))], axis=1)
    return EventRecord(
        OperatingPoint("edge", 0.5, 0.0, 1.0), time, v, np.ones_like(v), rest_end, f0_hz=f0_hz
    )


@pytest.mark.slow
@pytest.mark.parametrize("shape", EDGES)
@pytest.mark.parametrize("rise", [0.1, 1.0, 5.0, 20.0])
def test_the_error_of_a_spline_is_estimated_within_a_factor(shape: str, rise: float) -> None:
    rng, within = np.random.default_rng(0), (np.arange(40) + 0.5) / 40
    true, told = [], []
    for begin in 40 + rng.uniform(0, 8, 30):
        record = record_of(1 - 0.5 * EDGES[shape]((np.arange(96.0) - begin) / rise))
        between = (np.arange(95.0)[:, None] + within).ravel()
        error = record.voltage(between)[:, 0] - (1 - 0.5 * EDGES[shape]((between - begin) / rise))
        true.append((error**2).sum() / 40)
        told.append((error_between(record)[:, 0] ** 2).sum())
    ratio = np.sqrt(np.mean(told) / np.mean(true))
    assert 0.9 < ratio < 4.5, (
        ratio
    )  # never below, and at most four times what it is: a fifth of an order


def test_a_voltage_that_rests_is_known_between_its_samples() -> None:
    assert not error_between(record_of(np.ones(60))).any()


def test_a_record_too_short_to_leave_samples_out_has_no_error_to_tell() -> None:
    assert error_between(record_of(np.linspace(1.0, 0.5, 20))).shape == (19, 2)
    assert not error_between(record_of(np.linspace(1.0, 0.5, 20))).any()


def test_rounded_values_are_wrong_by_a_part_of_their_step() -> None:
    """One number is no noise; what it does is played (`ibrid.gap.recordings.systematic_errors`)."""
    v = np.ones((60, 2))
    v[30:, 0] = 1.0 + 0.12 * np.arange(30)
    rounded = EventRecord(
        OperatingPoint("edge", 0.5, 0.0, 1.0),
        np.arange(60.0),
        v,
        np.ones((60, 2)),
        20.0,
        voltage_step=0.12,
    )
    np.testing.assert_allclose(noise_left(rounded)[32:], 0.12 / np.sqrt(12), rtol=1e-12)
    np.testing.assert_array_equal(noise_left(rounded)[:30], 0.0)


def test_the_step_of_a_rounded_file_is_read_and_a_voltage_of_two_levels_has_none() -> None:
    wave = 0.8 + 0.1 * np.sin(np.arange(400) / 7)
    assert _step(np.round(wave * 1024) / 1024) == pytest.approx(1 / 1024)
    assert _step(wave) == 0.0
    few = np.array(
        [
            0.9110,
            0.9113,
            0.9166,
            0.9230,
            0.9367,
            0.9470,
            0.9640,
            0.9743,
            0.9880,
            0.9944,
            0.9996,
            1.0,
        ]
    )
    assert _step(np.append(np.round(few * 2**14) / 2**14, 0.0).round(9)) == pytest.approx(2.0**-14)
    assert _step(few + 1e-4 * np.sin(np.arange(12))) == 0.0
    assert _step(np.where(np.arange(400) < 100, 1.0, 0.9)) == 0.0


def test_noise_stays_where_the_voltage_moves_and_goes_where_it_rests() -> None:
    rng, time = np.random.default_rng(1), np.arange(600) / 5000
    v = np.where(time < 0.08, 1.0, 0.5)[:, None] * [1.0, 0.0] + 1e-3 * rng.standard_normal((600, 2))
    record = EventRecord(
        OperatingPoint("dip", 0.5, 0.0, 1.0), time, v, np.ones_like(v), 0.06, f0_hz=60.0
    )
    left = noise_left(record)
    assert left[395:405].min() > 0.4e-3  # of 1e-3
    assert np.median(left[:300]) < 0.3e-3
