"""How a sweep of a device was written: rightly, or with the current, an axis, a base, a label or
the frame confused.
"""

from dataclasses import dataclass, replace
from math import cos, sin
from typing import Literal

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

_MIRROR = np.diag([1.0, -1.0])


@dataclass(frozen=True)
class Measurement:
    """What the numbers are, while the file says: current out, q leading, per unit, in the frame of
    the PCC voltage.

    current : "in": counted into the inverter. q_axis : "lags" d. factor : of the admittance, a
    wrong base.
    frame_angle : rad; Y' = R(a) Y R(-a), R(a) = cos a I - sin a J, the frame leads that of the PCC
    voltage by a.
    swapped : the first two operating points carry each other's p and q. power_factor : of all p and
    q, such as a peak taken as rms.
    """

    current: Literal["out", "in"] = "out"
    q_axis: Literal["leads", "lags"] = "leads"
    factor: float = 1.0
    frame_angle: float = 0.0
    swapped: bool = False
    power_factor: float = 1.0

    def of(self, sweep: Sweep) -> Sweep:
        """The sweep as it was written; IbridError where labels cannot be swapped."""
        points = tuple(
            replace(point, admittance=self._matrix(point.admittance), op=self._label(point.op))
            for point in sweep.points
        )
        return replace(sweep, points=_swapped(points) if self.swapped else points)

    def _label(self, op: OperatingPoint) -> OperatingPoint:
        if self.power_factor == 1.0:
            return op
        p, q = self.power_factor * op.p, self.power_factor * op.q
        return OperatingPoint(f"p={p:.3g},q={q:.3g}", p, q, op.v)

    def _matrix(self, Y: np.ndarray) -> np.ndarray:
        c, s = cos(self.frame_angle), sin(self.frame_angle)
        rotation = np.array([[c, s], [-s, c]])
        turned = rotation @ Y @ rotation.T
        if self.q_axis == "lags":
            turned = _MIRROR @ turned @ _MIRROR
        return turned * (self.factor if self.current == "out" else -self.factor)


def _swapped(points: tuple[PointSweep, ...]) -> tuple[PointSweep, ...]:
    if len(points) < 2:
        raise IbridError("swapped operating points must be at least two; give points=2 or more.")
    first, second, *rest = points
    return replace(first, op=second.op), replace(second, op=first.op), *rest
