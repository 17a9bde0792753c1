"""On which axis the voltage at rest lies, as the lowest frequencies show it, whatever the side of q
and the sign of current.

Law (angle_law): turned by a small angle, the voltage takes the current at rest with it, Y(0) J v0 =
J i0. With v0 on d that is the second column of Y, |Yqq| = |p|/V^2, |Ydq| = |q|/V^2; with v0 on q
the first, |Ydd| = |p|/V^2, |Yqd| = |q|/V^2. The other column says what the magnitude of the voltage
does. Constant power makes both alike at rest, but an inverter follows an angle sooner than a
magnitude: the column that rests there while the other still moves is that of the angle.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrid.measurement.conventions.angle_law import column_at_rest
from ibrid.measurement.sweeps.noise import PointNoise
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Points up to this multiple of the lowest frequency of a window are extrapolated to zero, and so
#: many at least.
SPAN, FEWEST = 2.0, 3
#: Largest part of a column that moves where it rests, and how many times as much the other must
#: move.
RESTS, MOVES = 0.1, 3.0
#: Largest distance of the resting column from p and q, as a part of them: losses and another node
#: are in it.
AWAY = 0.3
#: Apparent power (per unit) from which on it is compared; Hz above which one operating point alone
#: may rest by chance.
LOADED, ALONE_HZ = 0.1, 4.0


@dataclass(frozen=True)
class RestingAxis:
    """`axis` : on which the voltage lies. `sign` : +1 where the current counts out of the inverter,
    if p is what it delivers.
    `side` : +1 where q leads d, if q is what it delivers, 0 where q is too small to tell.
    """

    axis: Literal["d", "q"]
    sign: int
    side: int


def resting_axis(sweep: Sweep, noise: Mapping[str, PointNoise]) -> RestingAxis | None:
    """What all operating points that say something show alike; None where none does, or they
    differ.
    """
    if len(sweep.points) == 1 and sweep.points[0].frequency[0] > ALONE_HZ:
        return None
    loaded = [point for point in sweep.points if np.hypot(point.op.p, point.op.q) >= LOADED]
    found = [_of_point(point, noise[point.op.name]) for point in loaded]
    known = [one for one in found if one is not None]
    if len(known) < len(found) or len({(one.axis, one.sign) for one in known}) != 1:
        return None
    sides = {one.side for one in known} - {0}
    if len(sides) > 1:
        return None
    return RestingAxis(known[0].axis, known[0].sign, sides.pop() if sides else 0)


def _of_point(point: PointSweep, noise: PointNoise) -> RestingAxis | None:
    """Where both columns rest at the lowest frequencies, a window goes up until one of them
    moves.
    """
    if point.op.p == 0:
        return None
    beginnings = np.flatnonzero(
        np.diff(np.floor(np.log(point.frequency) / np.log(SPAN)), prepend=-np.inf)
    )
    for first in beginnings:
        window = (point.frequency >= point.frequency[first]) & (
            point.frequency <= SPAN * point.frequency[first]
        )
        window[first : first + FEWEST] = (
            point.frequency[first : first + FEWEST] <= SPAN**2 * point.frequency[first]
        )
        if window.sum() < FEWEST:
            return None
        level = 0.0 if noise.relative is None else float(np.median(noise.relative[window]))
        columns = [_at_rest(point, window, column) for column in (0, 1)]
        moving = sorted(part for _, part in columns)
        if moving[0] > RESTS:
            return None
        if moving[1] > RESTS and moving[1] > MOVES * (moving[0] + level):
            return _resting(point, columns, level)
    return None


def _resting(
    point: PointSweep, columns: list[tuple[np.ndarray, float]], level: float
) -> RestingAxis | None:
    """The axis whose column rests, where that is at what p and q say."""
    axis: Literal["d", "q"] = "q" if columns[0][1] < columns[1][1] else "d"
    at_rest = columns[0][0] if axis == "q" else columns[1][0]
    active, reactive = (at_rest[0], -at_rest[1]) if axis == "q" else (at_rest[1], at_rest[0])
    power = np.array([point.op.p, point.op.q]) / point.op.v**2
    away = np.hypot(abs(active) - abs(power[0]), abs(reactive) - abs(power[1]))
    if away > AWAY * np.hypot(*power):
        return None
    sign = int(np.sign(active * power[0]))
    told = abs(power[1]) > 2 * away + 2 * level * np.hypot(*power)
    return RestingAxis(axis, sign, int(np.sign(reactive * power[1])) * sign if told else 0)


def _at_rest(point: PointSweep, window: np.ndarray, column: int) -> tuple[np.ndarray, float]:
    """A column of Y at zero frequency (2,), and the part of it that moves where a window begins."""
    frequency = point.frequency[window] / point.frequency[window][0]
    at_rest, moving, _ = column_at_rest(frequency, point.admittance[window][:, :, column])
    return at_rest, moving
