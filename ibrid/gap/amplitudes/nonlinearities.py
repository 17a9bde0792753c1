"""Memoryless nonlinearities at a port, and their describing functions.

The describing function is the first harmonic of the response to b + A sin, over A (Gelb & Vander
Velde, Multiple-Input Describing Functions, 1968). Those of memoryless nonlinearities are real and
do not depend on frequency: at a port they depend on the amplitude there alone, which distinguishes
a limit or a dead zone from a filter.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: (deviation (..., r, n) of the input, operating value (..., r, 1), threshold) -> deviation of the
#: output (..., r, n), and its derivative by the input (..., r, r, n).
Law = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]
Numbers = float | np.ndarray

#: Bisection steps for the bias of a limit.
BISECTIONS = 60
#: Amplitudes and squared magnitudes that stand for zero.
TINY = 1e-300


@dataclass(frozen=True)
class Nonlinearity:
    """A memoryless nonlinearity with one threshold.

    Parameters
    ----------
    name, parameter : str
        Of the nonlinearity, and of its threshold.
    law : Law
        Output for an input that moves about its operating value.
    gain : callable
        Describing function: (amplitude, threshold) -> N; of a limit the second argument is the room
        between operating value and threshold.
    is_limit : bool
        Whether the operating value must stay below the threshold, which then counts from there.
    gain_rises : bool
        Whether the gain grows with the amplitude.
    axis : int or None
        The one that is limited, 0 for d and 1 for q; None for all, or the magnitude.
    """

    name: str
    parameter: str
    law: Law
    gain: Callable[[Numbers, Numbers], np.ndarray]
    is_limit: bool = False
    gain_rises: bool = False
    axis: int | None = None

    def limited_magnitude(self, steady: np.ndarray) -> np.ndarray:
        """Return what of an operating value (..., r) is limited: magnitude or one axis, (...)."""
        if self.axis is None:
            return np.linalg.norm(steady, axis=-1)
        return np.abs(steady[..., self.axis])

    def direction(self, steady: np.ndarray) -> np.ndarray:
        """Return unit vectors (..., r) along which it acts at operating values (..., r).

        Along the operating value for a limit of the magnitude; else along the axis.
        """
        if self.is_limit and self.axis is None:
            return steady / np.linalg.norm(steady, axis=-1, keepdims=True)
        return np.broadcast_to(np.eye(steady.shape[-1])[self.axis or 0], steady.shape)


def _apply_dead_zone(
    x: np.ndarray, steady: np.ndarray, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return x less what a saturation at +-width passes, and the derivative."""
    y = np.maximum(x - width, 0.0) + np.minimum(x + width, 0.0)
    return y, _diagonal_derivative(np.abs(x) > width)


def _apply_saturation(
    x: np.ndarray, steady: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return x clipped to +-limit, and the derivative."""
    return np.clip(x, -limit, limit), _diagonal_derivative(np.abs(x) < limit)


def _apply_magnitude_limit(
    x: np.ndarray, steady: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the deviation after the dq vector is scaled to a magnitude of `limit` at most."""
    vector = steady + x
    d = vector[..., 0, :]
    q = vector[..., 1, :]
    square = np.maximum(d**2 + q**2, TINY)
    factor = limit / np.sqrt(square)
    is_within = factor >= 1.0
    factor = np.where(is_within, 1.0, factor)
    # the derivative loses the direction in which the vector points
    loss = np.where(is_within, 0.0, factor / square)
    derivative = np.empty((*vector.shape[:-2], 2, 2, vector.shape[-1]))
    derivative[..., 0, 0, :] = factor - loss * d**2
    derivative[..., 1, 1, :] = factor - loss * q**2
    derivative[..., 0, 1, :] = derivative[..., 1, 0, :] = -loss * d * q
    return vector * factor[..., None, :] - steady, derivative


def _axis_limit(axis: int) -> Law:
    """Return the law that clips one axis of a dq vector to +-limit."""

    def apply(x: np.ndarray, steady: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
        vector = steady + x
        is_within = np.ones(vector.shape, dtype=bool)
        is_within[..., axis, :] = np.abs(vector[..., axis, :]) < limit
        limited = vector.copy()
        limited[..., axis, :] = np.clip(vector[..., axis, :], -limit, limit)
        return limited - steady, _diagonal_derivative(is_within)

    return apply


def _diagonal_derivative(passes: np.ndarray) -> np.ndarray:
    """Return the derivative (..., r, r, n) of a law that passes each axis or not, (..., r, n)."""
    return np.eye(passes.shape[-2])[..., None] * passes[..., None, :]


def saturation_gain(amplitude: Numbers, limit: Numbers) -> np.ndarray:
    """Return the describing function of y = clip(x, -limit, limit).

    Law: N = 2/pi (asin k + k sqrt(1 - k^2)) with k = limit/A, 1 at most.
    """
    positive = np.maximum(np.asarray(amplitude, dtype=float), TINY)
    k = np.minimum(np.asarray(limit, dtype=float) / positive, 1.0)
    return 2.0 / np.pi * (np.arcsin(k) + k * np.sqrt(1.0 - k**2))


def dead_zone_gain(amplitude: Numbers, width: Numbers) -> np.ndarray:
    """Return the describing function of a dead zone: 1 less that of a saturation at its width.

    0 up to the width, and towards 1 for large amplitudes.
    """
    return 1.0 - saturation_gain(amplitude, width)


def one_sided_limit(
    amplitude: Numbers, limit: Numbers, bias: Numbers = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the describing function and the mean of y = min(b + A sin, limit).

    Law: with k = (limit - b)/A within +-1, N = 1/2 + (asin k + k sqrt(1 - k^2))/pi, and the mean is
    b - A (sqrt(1 - k^2) - k acos k)/pi: a limit near the operating current lowers the mean, which
    the loops in front of it restore by raising the bias.
    """
    positive = np.maximum(np.asarray(amplitude, dtype=float), TINY)
    k = np.clip((np.asarray(limit, dtype=float) - bias) / positive, -1.0, 1.0)
    root = np.sqrt(1.0 - k**2)
    mean = np.where(k > -1.0, bias - positive / np.pi * (root - k * np.arccos(k)), limit)
    return 0.5 + (np.arcsin(k) + k * root) / np.pi, mean


def held_limit_gain(amplitude: Numbers, room: Numbers) -> np.ndarray:
    """Return the describing function of a one-sided limit whose mean integrating loops hold.

    The bias that does so is found by bisection. Towards large amplitudes the gain falls to 0: the
    signal is at the limit most of the time.

    Parameters
    ----------
    amplitude : float or ndarray
        In front of the limit.
    room : float or ndarray
        Between the mean and the limit.
    """
    amplitude, room = np.broadcast_arrays(
        np.asarray(amplitude, dtype=float), np.asarray(room, dtype=float)
    )
    low = np.zeros(amplitude.shape)
    high = np.maximum(amplitude, 0.0) + room
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        is_too_low = one_sided_limit(amplitude, room, middle)[1] < 0.0
        low = np.where(is_too_low, middle, low)
        high = np.where(is_too_low, high, middle)
    return one_sided_limit(amplitude, room, (low + high) / 2)[0]


DEAD_ZONE = Nonlinearity("dead zone", "width", _apply_dead_zone, dead_zone_gain, gain_rises=True)
SATURATION = Nonlinearity("saturation", "limit", _apply_saturation, saturation_gain)
MAGNITUDE_LIMIT = Nonlinearity(
    "limit of the magnitude", "limit", _apply_magnitude_limit, held_limit_gain, is_limit=True
)
D_LIMIT = Nonlinearity(
    "limit of the d axis", "limit_d", _axis_limit(0), held_limit_gain, is_limit=True, axis=0
)
Q_LIMIT = Nonlinearity(
    "limit of the q axis", "limit_q", _axis_limit(1), held_limit_gain, is_limit=True, axis=1
)
