"""What a model makes of a voltage that is not known exactly: against playback, and against
covariances that are drawn.
"""

from dataclasses import replace

import numpy as np
import pytest

import ibrid
from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.playback.between_samples import (
    RecordNoise,
    Shared,
    free_answers,
    noise_alone,
    noise_and_sampling,
    open_voltage,
)
from ibrid.playback.player import Player

VALUES = {
    "plant.L_F": 0.15,
    "plant.R_F": 0.02,
    "plant.C_F": 0.066,
    "plant.L_g": 0.15,
    "plant.R_g": 0.02,
    "pll.kP_pll": 60.0,
    "pll.kI_pll": 1400.0,
    "power.kP": 0.02,
    "power.kI": 20.0,
    "current.kP": 0.5,
    "current.kI": 15.0,
    "decoupling.L": 0.15,
}
RATE, COUNT = 5000.0, 300


def at_rest(v: np.ndarray) -> EventRecord:
    """A record of a voltage (n, 2) about 1; its current is not asked."""
    time = np.arange(len(v)) / RATE
    return EventRecord(
        OperatingPoint("rest", 0.6, 0.1, 1.0), time, v, np.tile([0.6, -0.1], (len(v), 1)), time[40]
    )


def player() -> Player:
    return Player(ibrid.textbook("gfl_exact"), VOCABULARY)


def told(
    record: EventRecord,
    current: np.ndarray,
    between: np.ndarray,
    *,
    pulses: bool = True,
    waves: np.ndarray | None = None,
) -> RecordNoise:
    """Of errors between samples, by pulses that are played or by those of the model at rest."""
    voltage, count = open_voltage(between, np.zeros(len(record.time))), len(record.time)
    played = (
        player().pulse_responses(record, VALUES, voltage.intervals, 1e-4)
        if pulses and len(voltage.intervals)
        else None
    )
    matrices = player().matrices(record, VALUES)
    waves = np.zeros((2 * count, 0)) if waves is None else waves
    return noise_and_sampling(
        current, matrices, 1 / RATE, voltage, played, waves, np.zeros((2 * count, 0)), 0.3
    )


@pytest.mark.slow
def test_a_pulse_of_one_interval_is_the_difference_of_two_playbacks() -> None:
    """Sixteen times as many samples hold the bump that lies between two of the recorder's."""
    fine, place, size = 16, 100, 1e-4
    time = np.arange(COUNT * fine) / (RATE * fine)
    s = np.clip(time * RATE - place, 0, 1)
    v = np.stack([1 + size * np.sqrt(30.0) * s * (1 - s), np.zeros_like(s)], axis=1)
    answers = []
    for wave in (v, np.tile([1.0, 0.0], (len(time), 1))):
        record = EventRecord(
            OperatingPoint("rest", 0.6, 0.1, 1.0), time, wave, np.zeros_like(wave), time[40]
        )
        answers.append(player().play(record, [VALUES])[0].current[::fine])
    record = at_rest(np.tile([1.0, 0.0], (COUNT, 1)))
    between = np.zeros((COUNT - 1, 2))
    between[place, 0] = size
    noise = told(record, np.full(COUNT, 1e-9), between, pulses=False)
    moved = np.sum((answers[0] - answers[1]) ** 2)
    told_by_pulses = told(record, np.full(COUNT, 1e-9), between)
    for one in (noise, told_by_pulses):  # one interval alone has none to turn in
        left = np.sum(one.expected**2) - 2 * COUNT * 1e-18
        np.testing.assert_allclose(
            left, moved / 9, rtol=2e-2
        )  # of a spline, which rounds the ends of the bump


def test_a_free_answer_is_what_the_matrices_say() -> None:
    matrices = player().matrices(at_rest(np.tile([1.0, 0.0], (COUNT, 1))), VALUES)
    a, _, c, _ = matrices
    values, vectors = np.linalg.eig(a)
    k = int(np.argmax(np.abs(values.imag)))
    mode = vectors[:, k]
    (real,) = free_answers(matrices, 1 / RATE, 50, np.real(mode)[None])
    expected = np.real(
        np.exp(np.multiply.outer(np.arange(50) / RATE, values[k]))[:, None] * (c @ mode)
    )
    np.testing.assert_allclose(real, expected, atol=1e-9 * np.abs(expected).max())


def test_whitened_errors_are_white() -> None:
    """r = e + W a has the covariance I + W W^T; what is left of it has I."""
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((30, 4)) @ np.diag([10.0, 3.0, 1.0, 0.1])
    shared = Shared(columns)
    root = shared.whitened(np.eye(30))
    covariance = root.T @ (np.eye(30) + columns @ columns.T) @ root
    np.testing.assert_allclose(covariance, np.eye(30), atol=1e-10)
    np.testing.assert_allclose(
        shared.logarithm, np.linalg.slogdet(np.eye(30) + columns @ columns.T)[1], rtol=1e-10
    )


def test_of_a_voltage_that_is_known_the_noise_is_that_of_the_current() -> None:
    current = np.full(COUNT, 1e-3)
    record = at_rest(np.tile([1.0, 0.0], (COUNT, 1)))
    alone = noise_alone(current)
    told_noise = told(record, current, np.zeros((COUNT - 1, 2)))
    np.testing.assert_allclose(told_noise.sigma, alone.sigma, rtol=1e-12)
    error = np.random.default_rng(1).standard_normal((1, COUNT, 2))
    np.testing.assert_allclose(told_noise.whitened(error), alone.whitened(error), rtol=1e-12)
    assert told_noise.logarithm == alone.logarithm == 0.0


def test_what_is_correlated_counts_as_often_as_it_is_independent() -> None:
    """One unknown number at one edge: residuals of all samples, and the numbers that count are
    few.
    """
    record = at_rest(np.tile([1.0, 0.0], (COUNT, 1)))
    between = np.zeros((COUNT - 1, 2))
    between[100, 0] = 0.1
    noise = told(record, np.full(COUNT, 1e-6), between)
    assert noise.independent[:101].sum() == 2 * 101  # nothing happened before
    assert noise.independent[102:].sum() < 20


def test_what_channels_leave_is_expected_too() -> None:
    """An offset that stands in every sample."""
    record = at_rest(np.tile([1.0, 0.0], (COUNT, 1)))
    wave = np.tile([3e-3, 4e-3], COUNT)[:, None]
    noise = told(record, np.full(COUNT, 1e-6), np.zeros((COUNT - 1, 2)), waves=wave)
    np.testing.assert_allclose(noise.expected, np.tile([3e-3, 4e-3], (COUNT, 1)), rtol=1e-6)


def test_a_spline_through_every_second_sample_errs_as_is_told() -> None:
    """The playback of a smooth edge at half of the rate differs from that at the full one by what
    is expected of half.
    """
    from ibrid.measurement.recordings.between_samples import error_between

    time = np.arange(1200) / 20000
    edge = (1 - np.cos(np.pi * np.clip((time - 0.0201) / 1.5e-3, 0, 1))) / 2
    v = np.stack([1 - 0.4 * edge, np.zeros_like(edge)], axis=1)
    whole = EventRecord(OperatingPoint("dip", 0.6, 0.1, 1.0), time, v, np.zeros_like(v), 0.02)
    thin = EventRecord(
        OperatingPoint("dip", 0.6, 0.1, 1.0), time[::4], v[::4], np.zeros_like(v[::4]), 0.02
    )
    apart = (
        player().play(thin, [VALUES])[0].current - player().play(whole, [VALUES])[0].current[::4]
    )
    count = len(thin.time)
    noise = told(thin, np.full(count, 1e-9), error_between(thin))
    ratio = np.sqrt((noise.expected**2).sum() / (apart**2).sum())
    assert 0.5 < ratio < 10, ratio


def test_predictions_look_at_fewer_samples_behind_one_low_pass():
    """What a linear device answers to the low-passed voltage is the low-passed answer; white noise
    shrinks as its filter says.
    """
    time = np.arange(8000) / 20e3
    wave = np.stack(
        [1.0 + 0.1 * np.sin(2 * np.pi * 200 * time), 0.1 * np.cos(2 * np.pi * 90 * time)], axis=1
    )
    record = EventRecord(OperatingPoint("a", 0.5, 0.0, 1.0), time, wave, 3.0 * wave, 0.05)
    fewer, left = record.every_kth(2)
    assert len(fewer.time) == 4000
    np.testing.assert_allclose(fewer.i, 3.0 * fewer.v, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(fewer.v[100:-100], wave[::2][100:-100], atol=1e-4)
    noise = np.random.default_rng(0).standard_normal((8000, 2))
    noisy, _ = replace(record, i=noise).every_kth(2)
    assert np.std(noisy.i) == pytest.approx(left, rel=0.05)
