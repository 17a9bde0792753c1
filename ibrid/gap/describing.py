"""Describing functions: the first harmonic that a memoryless nonlinearity makes of b + A sin, over A.

All are real and know no frequency: at a port they depend on the amplitude there alone, which is how a limit or a dead zone
is told from a filter.
"""

import numpy as np

Numbers = float | np.ndarray


def saturation_gain(amplitude: Numbers, limit: Numbers) -> np.ndarray:
    """Of y = clip(x, -limit, limit): N = 2/pi (asin k + k sqrt(1 - k^2)) with k = limit/A up to 1, which it is below."""
    k = _ratio(limit, amplitude)
    return 2.0 / np.pi * (np.arcsin(k) + k * np.sqrt(1.0 - k**2))


def dead_zone_gain(amplitude: Numbers, width: Numbers) -> np.ndarray:
    """Of y = x less what a saturation at +-width lets through: N = 1 - its gain; 0 up to the width, towards 1 beyond."""
    return 1.0 - saturation_gain(amplitude, width)


def one_sided_limit(amplitude: Numbers, limit: Numbers, bias: Numbers = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Of y = min(b + A sin, limit): gain of the first harmonic, and the mean of y.

    Law: with k = (limit - b)/A within +-1, N = 1/2 + (asin k + k sqrt(1 - k^2))/pi, and the mean is
    b - A (sqrt(1 - k^2) - k acos k)/pi: a limit near the operating current lowers the mean, which the loops in front of it
    bring back by raising the bias.
    """
    size = np.maximum(np.asarray(amplitude, dtype=float), 1e-300)
    k = np.clip((np.asarray(limit, dtype=float) - bias) / size, -1.0, 1.0)
    root = np.sqrt(1.0 - k**2)
    mean = np.where(k > -1.0, bias - size / np.pi * (root - k * np.arccos(k)), limit)
    return 0.5 + (np.arcsin(k) + k * root) / np.pi, mean


def held_limit_gain(amplitude: Numbers, room: Numbers) -> np.ndarray:
    """Gain of a one-sided limit at `room` above a mean that integrating loops hold: the bias is solved for by bisection.

    The amplitude is that in front of the limit. Towards large amplitudes the gain falls to 0: the signal touches the mean
    from above most of the time.
    """
    amplitude, room = np.broadcast_arrays(np.asarray(amplitude, dtype=float), np.asarray(room, dtype=float))
    low, high = np.zeros(amplitude.shape), np.maximum(amplitude, 0.0) + room
    for _ in range(60):
        middle = (low + high) / 2
        short = one_sided_limit(amplitude, room, middle)[1] < 0.0
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return one_sided_limit(amplitude, room, (low + high) / 2)[0]


def _ratio(threshold: Numbers, amplitude: Numbers) -> np.ndarray:
    size = np.maximum(np.asarray(amplitude, dtype=float), 1e-300)
    return np.minimum(np.asarray(threshold, dtype=float) / size, 1.0)
