"""By which angle the measuring frame leads the voltage at rest, as the lowest frequencies show it
at each operating point.

Law (angle_law): turned by a small angle, the voltage takes the current at rest with it, Y(0) J v0 =
J i0, in any frame. With i0 = C v0 / V^2, C = [[p, q], [-q, p]], which commutes with rotations, and
v0 = V R(a) (1, 0) that is

    (Y(0) - C / V^2) u = 0,    u = R(a) (0, 1) = (sin a, cos a)

for any control of power, current or voltage: the null vector of what is left of Y once C / V^2 is
taken away tells a, but for half a turn, which changes nothing. It has to rest there while all other
directions may still move.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ibrid.measurement.conventions.conversions import Q_MIRROR
from ibrid.measurement.conventions.rotation import half_turn
from ibrid.measurement.conventions.tail import signs_of_tail
from ibrid.measurement.conventions.units_of_entries import units_of_entries
from ibrid.measurement.sweeps.noise import PointNoise
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep

#: Points up to this multiple of the lowest frequency are extrapolated to zero, and so many at
#: least.
SPAN, FEWEST = 2.0, 3
#: Largest part of p + jq by which the law is missed, or that still moves, at the angle that is
#: read; and least ratio of the same a quarter turn away: a device that answers alike on both axes
#: has no direction.
MISSED, DIRECTED = 0.2, 4.0
#: Power (per unit) that passive branches beside the device may hide: a frame must turn p + jq by
#: more than this.
OUTSIDE = 0.4
#: rad by which the operating points of one frame may differ beyond doubt: losses and another node
#: of p and q are in it.
ALIKE = 0.05
#: Apparent power (per unit) from which on p and q tell an angle; Hz above which one operating point
#: alone may rest by chance.
LOADED, ALONE_HZ = 0.1, 4.0

Label = Callable[[OperatingPoint], OperatingPoint]
#: Ways in which p and q are written wrongly.
MISTAKES: tuple[Label, ...] = (
    lambda op: replace(op, p=-op.p),
    lambda op: replace(op, q=-op.q),
    lambda op: replace(op, p=op.q, q=op.p),
)


@dataclass(frozen=True)
class FrameReading:
    """`angle` : rad, in (-pi/2, pi/2], by which the frame leads the voltage.

    `doubt` : rad, noise and what has not settled.
    """

    op: OperatingPoint
    angle: float
    doubt: float

    @property
    def power(self) -> float:
        """Per unit, by how much p + jq of a device at constant power seems another in a frame
        turned so, beyond doubt.
        """
        return (
            2
            * float(np.hypot(self.op.p, self.op.q))
            * max(np.sin(abs(self.angle)) - self.doubt, 0.0)
        )


@dataclass(frozen=True)
class TurnedFrame:
    """`angles` : rad, one of all operating points, or one each in their order.

    `doubt` : rad. `sign` : -1 where the current counts into the inverter. `side` : -1 where q lags
    d. `twin` : the current the other way and a quarter turn more show the same, as at constant
    power, where the highest frequencies do not tell the current.
    """

    angles: tuple[float, ...]
    doubt: float
    sign: int
    side: int
    twin: bool


def turned_frame(sweep: Sweep, noise: Mapping[str, PointNoise]) -> TurnedFrame | None:
    """The frame that all operating points show, turned by more than branches beside the device seem
    to turn it; else None.

    One angle of all points comes before an angle for each, which labels p and q that are exchanged
    or reversed look like: where such mistakes explain as much, None. The highest frequencies, which
    no frame changes, tell the direction of the current and the side of q; where they do not, what
    is declared comes first.
    """
    alone = len(sweep.points) == 1 and sweep.points[0].frequency[0] > ALONE_HZ
    if alone or units_of_entries(sweep):
        return None
    tails = [
        set(signs) - {0}
        for signs in zip(*(signs_of_tail(one, sweep.f0_hz) for one in sweep.points), strict=True)
    ]
    signs, sides = (tuple(seen) if len(seen) == 1 else (1, -1) for seen in tails)
    read = {way: _readings(sweep, noise, *way) for way in product(signs, sides)}
    for (sign, side), readings in read.items():
        common = common_angle(readings) if readings else None
        if common is None:
            continue
        turned = max(replace(common, op=one.op).power for one in readings) > OUTSIDE
        if not turned or _relabelled(sweep, noise, sign, sides[0]):
            return None
        twin = sign > 0 and bool(read.get((-1, side)))
        return TurnedFrame((common.angle,), common.doubt, sign, side, twin)
    for (sign, side), readings in read.items():
        turned = [one for one in readings if one.power > OUTSIDE / 4]
        if len(readings) < len(sweep.points) or 2 * len(turned) <= len(readings):
            continue
        if max(one.power for one in turned) < OUTSIDE or _relabelled(sweep, noise, sign, sides[0]):
            return None
        doubt = max(one.doubt for one in readings)
        twin = sign > 0 and bool(read.get((-1, side)))
        return TurnedFrame(tuple(one.angle for one in readings), doubt, sign, side, twin)
    return None


def _readings(
    sweep: Sweep,
    noise: Mapping[str, PointNoise],
    sign: int,
    side: int,
    label: Label = lambda op: op,
) -> list[FrameReading]:
    """Those of the loaded points as they read with another direction of the current, side of q, or
    label; none where one of them says nothing.
    """
    readings = []
    for point in sweep.points:
        if np.hypot(point.op.p, point.op.q) < LOADED:
            continue
        mirror = Q_MIRROR if side < 0 else np.eye(2)
        matrix = sign * (mirror @ point.admittance @ mirror)
        readings.append(
            frame_reading(point.frequency, matrix, label(point.op), noise[point.op.name])
        )
    known = [reading for reading in readings if reading is not None]
    return known if len(known) == len(readings) else []


def _relabelled(sweep: Sweep, noise: Mapping[str, PointNoise], sign: int, side: int) -> bool:
    """True where p and q exchanged or one of them reversed, in some labels, leave no angle at any
    point.
    """
    ways = [_readings(sweep, noise, sign, side, label) for label in (lambda op: op, *MISTAKES)]
    straight = [
        {one.op.name for one in readings if abs(one.angle) < ALIKE + one.doubt} for readings in ways
    ]
    return set().union(*straight) >= {one.op.name for one in ways[0]}


def frame_reading(
    frequency: np.ndarray, admittance: np.ndarray, op: OperatingPoint, noise: PointNoise
) -> FrameReading | None:
    """The reading at one operating point; None where nothing rests at the lowest frequencies on p
    and q, or everything does.

    frequency : (K,) Hz, ascending. admittance : (K, 2, 2) per unit.
    """
    lowest = frequency <= SPAN * frequency[0]
    lowest[:FEWEST] = frequency[:FEWEST] <= SPAN**2 * frequency[0]
    apparent = float(np.hypot(op.p, op.q))
    if lowest.sum() < FEWEST or not apparent:
        return None
    ratio = frequency[lowest] / frequency[0]
    values = admittance[lowest] * op.v**2
    basis = np.stack([np.ones_like(ratio), ratio**2], axis=1)
    (at_rest, bend), *_ = np.linalg.lstsq(basis, np.real(values).reshape(-1, 4), rcond=None)
    slope = np.linalg.lstsq(ratio[:, None], np.imag(values).reshape(-1, 4), rcond=None)[0][0]
    rotated = at_rest.reshape(2, 2) - np.array([[op.p, op.q], [-op.q, op.p]])
    missed = np.concatenate([rotated, bend.reshape(2, 2), slope.reshape(2, 2)])
    _, (most, least), directions = np.linalg.svd(missed)
    level = 0.0
    if noise.relative is not None:
        absolute = noise.relative[lowest] * np.linalg.norm(values, axis=(1, 2))
        level = 2 * float(np.median(absolute)) / np.sqrt(len(ratio))
    if least > MISSED * apparent + level or most < DIRECTED * least or most < DIRECTED * level:
        return None
    sine, cosine = directions[1]
    angle = float(np.arctan(sine / cosine)) if cosine else np.pi / 2
    return FrameReading(op, angle, float(least + level) / float(most))


def common_angle(readings: Sequence[FrameReading]) -> FrameReading | None:
    """The angle on which all readings agree, with the label of the first; None where they differ.

    Readings half a turn apart are the same, so that their mean is taken of doubled angles.
    """
    weights = np.array([1 / (ALIKE + one.doubt) ** 2 for one in readings])
    angle = float(np.angle((weights * np.exp([2j * one.angle for one in readings])).sum())) / 2
    if any(abs(half_turn(one.angle - angle)) > ALIKE + one.doubt for one in readings):
        return None
    return FrameReading(readings[0].op, angle, max(one.doubt for one in readings))
