"""Impedances that stand where admittances are declared, and the reverse.

Read the wrong way round an admittance per unit is its inverse, from ohm and S that times Z_base^2:
it rises high up where a filter's falls, as that of a capacitor would.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.measurement.conventions.tail import inductive_tail
from ibrid.measurement.sweeps.sweep import PointSweep

#: Susceptance per unit from which on no filter has such a capacitor; the published ones of LC
#: filters have 0.01 to 0.15.
LARGEST_CAPACITOR = 0.25
#: |Y| per unit that every device shows somewhere below a tenth of its highest frequency.
_LEAST = 0.1
#: Inductances of filters per unit, as an exchanged reading may have them.
_INDUCTANCES = (0.01, 1.2)
#: The median of |Y| max(1, f / f0) of devices, per unit; in the published parameter sets 1 to 33.
_USUAL = (0.3, 100.0)


@dataclass(frozen=True)
class ExchangedQuantity:
    """What rises like a capacitor at the terminal.

    susceptance : per unit, as it is declared. inductance : per unit, as an impedance; None where
    it is that of no filter. unit : of the impedance, "ohm" or "pu".
    possible : whether a device with such a capacitor would have these numbers too.
    """

    susceptance: float
    inductance: float | None
    unit: str
    possible: bool


def exchanged_quantity(
    points: Sequence[PointSweep], f0_hz: float, z_base: float | None
) -> ExchangedQuantity | None:
    """What the highest frequencies of all operating points show; None where one falls, or follows
    no law.

    z_base : ohm, None where it is not known.
    """
    susceptances = []
    for point in points:
        inverse = _inverse(point)
        tail = None if inverse is None else inductive_tail(inverse, f0_hz, largest=np.inf)
        if tail is None:
            return None
        susceptances.append(tail.reactance)
    susceptance = float(np.median(susceptances))
    readings = {"pu": susceptance} if z_base is None else {"ohm": susceptance / z_base**2}
    readings.setdefault("pu", susceptance)
    low, high = _INDUCTANCES
    unit, inductance = next(
        ((unit, x) for unit, x in readings.items() if low <= x <= high),
        (next(iter(readings)), None),
    )
    weak = all(_largest_below_a_tenth(point) < _LEAST for point in points)
    return ExchangedQuantity(
        susceptance, inductance, unit, susceptance <= LARGEST_CAPACITOR and not weak
    )


def may_be_exchanged(points: Sequence[PointSweep], f0_hz: float, z_base: float) -> bool:
    """Whether sizes that no device has would be usual ones as the other quantity in ohm or S."""
    sizes = []
    for point in points:
        inverse = _inverse(point)
        if inverse is None:
            return False
        size = np.linalg.norm(inverse.admittance, axis=(1, 2)) / np.sqrt(2) * z_base**2
        sizes.append(np.median(size * np.maximum(1, point.frequency / f0_hz)))
    return all(_USUAL[0] <= size <= _USUAL[1] for size in sizes)


def _inverse(point: PointSweep) -> PointSweep | None:
    if (np.abs(np.linalg.det(point.admittance)) == 0).any():
        return None
    return PointSweep(point.op, point.frequency, np.linalg.inv(point.admittance))


def _largest_below_a_tenth(point: PointSweep) -> float:
    low = point.frequency <= point.frequency[-1] / 10
    size = np.linalg.norm(point.admittance[low], axis=(1, 2)) / np.sqrt(2)
    return float(size.max(initial=0.0)) if low.any() else np.inf
