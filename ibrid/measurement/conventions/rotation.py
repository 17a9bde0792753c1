"""A measuring frame that leads that of the voltage at rest: Y' = R(a) Y R(-a), R(a) = [[cos a, sin
a], [-sin a, cos a]].
"""

from dataclasses import replace

import numpy as np

from ibrid.measurement.sweeps.sweep import PointSweep


def rotation(angle: float) -> np.ndarray:
    """R(a), from the grid's frame into one that leads it by `angle` (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def half_turn(angle: float) -> float:
    """An angle of a frame (rad) in [-pi/2, pi/2): half a turn changes no admittance."""
    return float((angle + np.pi / 2) % np.pi - np.pi / 2)


def propagate(left: np.ndarray, sigma: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Standard deviation of L N R per real and imaginary part, for independent circular errors N
    with `sigma`.
    """
    with np.errstate(all="ignore"):
        return np.sqrt(np.abs(left) ** 2 @ sigma**2 @ np.abs(right) ** 2)


def straightened(point: PointSweep, angle: float) -> PointSweep:
    """A point that was measured in a frame that leads by `angle` (rad), in the frame of the voltage
    at rest.
    """
    if angle == 0.0:
        return point
    turn = rotation(-angle)
    return replace(
        point,
        admittance=turn @ point.admittance @ turn.T,
        sigma=None if point.sigma is None else propagate(turn, point.sigma, turn.T),
        repeats=None if point.repeats is None else turn @ point.repeats @ turn.T,
        larger=tuple(straightened(one, angle) for one in point.larger),
    )
