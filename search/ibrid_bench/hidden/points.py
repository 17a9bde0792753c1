"""The operating points at which hidden devices are swept."""

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: p, q by the number of operating points.
_POINTS = {
    1: ((1.0, 0.3),),
    2: ((1.0, 0.3), (1.0, -0.3)),
    4: ((1.0, 0.3), (0.9, -0.3), (0.5, 0.0), (0.2, 0.4)),
}
_SPREAD = 0.05


def operating_points(count: int, rng: np.random.Generator) -> tuple[OperatingPoint, ...]:
    """1, 2 or 4 of them; with more than one, p and q vary by up to 0.05 per unit from case to
    case.
    """
    if count not in _POINTS:
        raise IbridError(f"a case has 1, 2 or 4 operating points; found {count}.")
    spread = _SPREAD if count > 1 else 0.0
    return tuple(
        _named(*(np.array(one) + rng.uniform(-spread, spread, 2))) for one in _POINTS[count]
    )


def _named(p: float, q: float) -> OperatingPoint:
    p, q = round(float(p), 2), round(float(q), 2)
    return OperatingPoint(f"p={p:g},q={q:g}", p, q)


HELD_OUT = _named(0.6, 0.1)
