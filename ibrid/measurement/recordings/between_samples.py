"""How far the voltage between two samples may lie from the cubic spline through all of them, and
what its noise adds.

Nobody measured it there. But every second sample can be left out and predicted by the spline
through the others, and the same of every fourth: errors h and q. An error that falls with the order
p of the interval, q = 2^p h, leaves h / 2^p = h^2 / q between samples that are all used, whatever p
is: it is 4 where the voltage is smooth, 2 at the kinks of a raised cosine, 1 at those of a ramp, 0
at a jump. Drawn edges of four shapes, of a tenth of an interval to twenty, have errors of a quarter
to all of that, rms.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.recordings.voltage_noise import smoothed

#: Samples either side over which errors are averaged: those of a spline at a jump ring for about as
#: long.
AROUND = 6
#: Factor by which errors fall from every second sample to all, at least and at most: that of a
#: jump, and of a smooth wave.
FALLS = (1.5, 16.0)
#: Part of its error that a cubic spline has a sample further on, 2 - sqrt(3).
RINGS = 0.268
#: Samples of a run of equal values that lasts, and the largest difference, per unit, of what is
#: equal in another frame.
LASTING, SAME = 16, 1e-12
#: Draws of the voltage's noise, whose effect on the smoothed voltage is averaged.
DRAWS = 4


def error_between(record: EventRecord) -> np.ndarray:
    """(N - 1, 2) rms error of the reconstructed voltage in each interval between samples, d and q,
    per unit.
    """
    if len(record.time) < 24 or record.stepped:
        return np.zeros((len(record.time) - 1, 2))
    v = record.voltage(record.time)
    half, quarter = (_around(_left_out(record.time, v, apart) ** 2) for apart in (2, 4))
    half, quarter = np.sqrt(half), np.sqrt(quarter)
    falls = np.clip(quarter / np.maximum(half, 1e-300), *FALLS)
    error = half / falls
    for k in range(1, len(error)):  # a spline rings on, either way
        error[k] = np.maximum(error[k], RINGS * error[k - 1])
    for k in range(len(error) - 2, -1, -1):
        error[k] = np.maximum(error[k], RINGS * error[k + 1])
    return np.maximum(error[1:], error[:-1])


def noise_left(record: EventRecord) -> np.ndarray:
    """(N,) standard deviation that the voltage's noise leaves in each component of the smoothed
    voltage, per unit.

    The difference that as much noise again makes: smoothing keeps it where the voltage moves.
    """
    noise, rounding = record.voltage_noise, record.voltage_step / np.sqrt(12.0)
    if noise <= rounding:  # of values that stand still it is one error, and no noise
        return np.where(np.any(standing(record.v), axis=0), 0.0, rounding)
    rng, squares = np.random.default_rng(0), np.zeros(len(record.time))
    still = record.voltage(record.time)
    for _ in range(DRAWS):
        noisier = record.v + noise * rng.standard_normal(record.v.shape)
        moved = smoothed(record.time, noisier, record.rest_end, record.f0_hz) - still
        squares += 0.5 * (moved**2).sum(axis=1) / DRAWS
    return np.sqrt(_around(squares[:, None])[:, 0])


def standing(wave: np.ndarray) -> np.ndarray:
    """Masks (R, N) of the runs of equal values (N, 2) that last, the longest first."""
    moves = np.abs(np.diff(wave, axis=0)).max(axis=1) > SAME
    begins = np.concatenate([[0], np.flatnonzero(moves) + 1])
    lengths = np.diff(np.append(begins, len(wave)))
    longest = [k for k in np.argsort(-lengths, kind="stable") if lengths[k] >= LASTING]
    places = np.arange(len(wave))
    return np.array(
        [(places >= begins[k]) & (places < begins[k] + lengths[k]) for k in longest]
    ).reshape(-1, len(wave))


def _left_out(time: np.ndarray, v: np.ndarray, apart: int) -> np.ndarray:
    """(N, 2) error at samples that lie in the middle between those that a spline has, of so many
    apart; 0 at the ends.
    """
    errors = np.zeros_like(v)
    for first in range(apart):
        middle = np.arange(first + apart // 2, len(time) - apart // 2, apart)
        predicted = CubicSpline(time[first::apart], v[first::apart])(time[middle])
        errors[middle] = predicted - v[middle]
    return errors


def _around(squares: np.ndarray) -> np.ndarray:
    """Means over the samples around each."""
    window = np.ones(2 * AROUND + 1) / (2 * AROUND + 1)
    return np.stack([np.convolve(column, window, mode="same") for column in squares.T], axis=1)
