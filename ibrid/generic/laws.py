"""Pieces of which the blocks of generic models are made, as machine code: lags, dead bands,
integrators that do not wind up, tables.
"""

import numpy as np

from ibrid.fit.just_in_time import njit

#: Shortest time constant, s; a lag of none is one of that.
SHORTEST = 1e-3


@njit(cache=True)
def clip(x: float, low: float, high: float) -> float:
    """x within low and high; high where they cross."""
    return min(max(x, low), high)


@njit(cache=True)
def lag_rate(target: float, x: float, seconds: float) -> float:
    """dx/dt of a lag, (target - x) / T."""
    return (target - x) / max(seconds, SHORTEST)


@njit(cache=True)
def beyond_dead_band(x: float, low: float, high: float) -> float:
    """What x exceeds of a band about zero, low <= 0 <= high."""
    if x > high:
        return x - high
    if x < low:
        return x - low
    return 0.0


@njit(cache=True)
def integral_rate(
    error: float, gain: float, proportional: float, x: float, low: float, high: float
) -> float:
    """dx/dt of a PI whose output is kp e + x: none where a limit is reached and it would go on."""
    output = proportional * error + x
    rate = gain * error
    if (output >= high and rate > 0.0) or (output <= low and rate < 0.0):
        return 0.0
    return rate


@njit(cache=True)
def limit_of_table(v: float, points: np.ndarray, most: float) -> float:
    """A current limit of the voltage (VDL) of points (8,): v1, i1 to v4, i4; `most` where all are
    zero.
    """
    if points[6] == 0.0 and points[7] == 0.0 and points[0] == 0.0 and points[1] == 0.0:
        return most
    if v <= points[0]:
        return points[1]
    for k in range(3):
        v_low, v_high = points[2 * k], points[2 * k + 2]
        if v_low <= v <= v_high and v_high > v_low:
            part = (v - v_low) / (v_high - v_low)
            return points[2 * k + 1] + part * (points[2 * k + 3] - points[2 * k + 1])
    return points[7]
