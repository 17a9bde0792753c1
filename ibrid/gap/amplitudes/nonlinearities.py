"""Memoryless nonlinearities of a port: what leaves it when a signal moves about its operating
value.

Their describing functions, the first harmonic of what they make of b + A sin over A, are real and
know no frequency: at a port they depend on the amplitude there alone, which is how a limit or a
dead zone is told from a filter.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: (deviation (..., r, n), value at rest (..., r, 1), threshold) -> deviation behind, and its slopes
#: (..., r, r, n).
Law = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]
Numbers = float | np.ndarray


@dataclass(frozen=True)
class Shape:
    """`name`, `parameter` : of the nonlinearity and its threshold.

    `law` : what it does. `gain` : its describing function, (amplitude, threshold or room) -> N.
    `limits` : True for a limit that the value at rest must not reach, so that its threshold counts
    from there. `rises` : True where the gain grows with the amplitude. `axis` : the one that is
    limited.
    """

    name: str
    parameter: str
    law: Law
    gain: Callable[[Numbers, Numbers], np.ndarray]
    limits: bool = False
    rises: bool = False
    axis: int | None = None

    def rest_size(self, rest: np.ndarray) -> np.ndarray:
        """What of a value at rest (..., r) a limit has to leave room for, (...)."""
        return np.linalg.norm(rest, axis=-1) if self.axis is None else np.abs(rest[..., self.axis])

    def along(self, rest: np.ndarray) -> np.ndarray:
        """Unit vectors (..., r): of the axis that is limited, of the value at rest, or of a
        scalar.
        """
        if self.limits and self.axis is None:
            return rest / np.linalg.norm(rest, axis=-1, keepdims=True)
        return np.broadcast_to(np.eye(rest.shape[-1])[self.axis or 0], rest.shape)


def _dead_zone(x: np.ndarray, rest: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    y = np.maximum(x - width, 0.0) + np.minimum(x + width, 0.0)
    return y, _diagonal_slopes(np.abs(x) > width)


def _saturation(x: np.ndarray, rest: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    return np.clip(x, -limit, limit), _diagonal_slopes(np.abs(x) < limit)


def _magnitude_limit(
    x: np.ndarray, rest: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    whole = rest + x
    d, q = whole[..., 0, :], whole[..., 1, :]
    square = np.maximum(d**2 + q**2, 1e-300)
    factor = limit / np.sqrt(square)
    within = factor >= 1.0
    factor = np.where(within, 1.0, factor)
    along = np.where(
        within, 0.0, factor / square
    )  # what is lost of the direction in which the signal points
    slope = np.empty((*whole.shape[:-2], 2, 2, whole.shape[-1]))
    slope[..., 0, 0, :], slope[..., 1, 1, :] = factor - along * d**2, factor - along * q**2
    slope[..., 0, 1, :] = slope[..., 1, 0, :] = -along * d * q
    return whole * factor[..., None, :] - rest, slope


def _axis_limit(axis: int) -> Law:
    def law(x: np.ndarray, rest: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
        whole = rest + x
        inside = np.ones(whole.shape, dtype=bool)
        inside[..., axis, :] = np.abs(whole[..., axis, :]) < limit
        y = whole.copy()
        y[..., axis, :] = np.clip(whole[..., axis, :], -limit, limit)
        return y - rest, _diagonal_slopes(inside)

    return law


def _diagonal_slopes(open_: np.ndarray) -> np.ndarray:
    """Slopes of a law that acts on each axis by itself, (..., r, r, n)."""
    return np.eye(open_.shape[-2])[..., None] * open_[..., None, :]


def saturation_gain(amplitude: Numbers, limit: Numbers) -> np.ndarray:
    """Of y = clip(x, -limit, limit): N = 2/pi (asin k + k sqrt(1 - k^2)) with k = limit/A up to 1,
    which it is below.
    """
    k = np.minimum(
        np.asarray(limit, dtype=float) / np.maximum(np.asarray(amplitude, dtype=float), 1e-300), 1.0
    )
    return 2.0 / np.pi * (np.arcsin(k) + k * np.sqrt(1.0 - k**2))


def dead_zone_gain(amplitude: Numbers, width: Numbers) -> np.ndarray:
    """Of y = x less what a saturation at +-width lets through: N = 1 - its gain; 0 up to the width,
    towards 1 beyond.
    """
    return 1.0 - saturation_gain(amplitude, width)


def one_sided_limit(
    amplitude: Numbers, limit: Numbers, bias: Numbers = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Of y = min(b + A sin, limit): gain of the first harmonic, and the mean of y.

    Law: with k = (limit - b)/A within +-1, N = 1/2 + (asin k + k sqrt(1 - k^2))/pi, and the mean is
    b - A (sqrt(1 - k^2) - k acos k)/pi: a limit near the operating current lowers the mean, which
    the loops in front of it bring back by raising the bias.
    """
    size = np.maximum(np.asarray(amplitude, dtype=float), 1e-300)
    k = np.clip((np.asarray(limit, dtype=float) - bias) / size, -1.0, 1.0)
    root = np.sqrt(1.0 - k**2)
    mean = np.where(k > -1.0, bias - size / np.pi * (root - k * np.arccos(k)), limit)
    return 0.5 + (np.arcsin(k) + k * root) / np.pi, mean


def held_limit_gain(amplitude: Numbers, room: Numbers) -> np.ndarray:
    """Gain of a one-sided limit at `room` above a mean that integrating loops hold: the bias is
    solved for by bisection.

    The amplitude is that in front of the limit. Towards large amplitudes the gain falls to 0: the
    signal touches the mean from above most of the time.
    """
    amplitude, room = np.broadcast_arrays(
        np.asarray(amplitude, dtype=float), np.asarray(room, dtype=float)
    )
    low, high = np.zeros(amplitude.shape), np.maximum(amplitude, 0.0) + room
    for _ in range(60):
        middle = (low + high) / 2
        short = one_sided_limit(amplitude, room, middle)[1] < 0.0
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return one_sided_limit(amplitude, room, (low + high) / 2)[0]


DEAD_ZONE = Shape("dead zone", "width", _dead_zone, dead_zone_gain, rises=True)
SATURATION = Shape("saturation", "limit", _saturation, saturation_gain)
MAGNITUDE_LIMIT = Shape(
    "limit of the magnitude", "limit", _magnitude_limit, held_limit_gain, limits=True
)
D_LIMIT = Shape(
    "limit of the d axis", "limit_d", _axis_limit(0), held_limit_gain, limits=True, axis=0
)
Q_LIMIT = Shape(
    "limit of the q axis", "limit_q", _axis_limit(1), held_limit_gain, limits=True, axis=1
)
