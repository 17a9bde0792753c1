"""Frequencies in Hz that stand where rad/s are declared, and the reverse: as the ends of their grid
and the inductance high up show them.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ibrid.measurement.conventions.frequency_base import (
    OF_GRIDS,
    REACH,
    frequency_reading,
)
from ibrid.measurement.importing.frequency_unit import is_round
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: How far the plain quotient of the cross and the direct terms may be from f0, as a part of it,
#: before the laws of a filter are fitted.
_FIRST_LOOK = 0.4
_TURN = 2 * np.pi
_HERTZ = "convert freq_hz to Hz (in import --map freq=COLUMN[rad/s])"
_RADIANS = "multiply freq_hz by 2 pi (in import --map freq=COLUMN[Hz])"


def angular_frequencies(sweep: Sweep) -> Iterator[str]:
    """A sentence where the frequencies of every operating point are too large or too small by 2 pi.

    Laws: grids of Hz begin and end at round numbers (those of rad/s do too, so that the reverse
    says nothing), and an inductance turns d and q at f0 (`frequency_base`).
    """
    ends = np.array([[point.frequency[0], point.frequency[-1]] for point in sweep.points])
    hertz = ends / _TURN
    if (ends[:, 0] != ends[:, 1]).all() and is_round(hertz).all() and not is_round(ends).any():
        low, high = hertz[0]
        yield (
            f"the frequencies look like rad/s: divided by 2 pi they run from {low:.3g} to "
            f"{high:.3g}, round numbers, "
            f"as they stand from {ends[0, 0]:.6g} to {ends[0, 1]:.6g}; {_HERTZ}."
        )
        return
    for factor, words, remedy in (
        (1 / _TURN, "rad/s, taken as Hz: divided by 2 pi", _HERTZ),
        (_TURN, "Hz, taken as rad/s: times 2 pi", _RADIANS),
    ):
        nominal = _nominal_shown(sweep, factor)
        if nominal is not None:
            yield (
                f"the frequencies look like {words} the impedance high up turns as that of a "
                f"filter at f0 = {nominal:g} Hz, as they stand at {nominal / factor:.3g} Hz; "
                f"{remedy}. A decoupling of a part of its inductance without delay would look "
                "alike."
            )


def _nominal_shown(sweep: Sweep, factor: float) -> float | None:
    """The declared f0, or that of a grid, where all frequencies times `factor` show it."""
    for nominal in dict.fromkeys((sweep.f0_hz, *OF_GRIDS)):
        if not all(_may_show(point, factor, nominal) for point in sweep.points):
            continue
        if all(_shows(point, factor, nominal) for point in sweep.points):
            return nominal
    return None


def _shows(point: PointSweep, factor: float, nominal: float) -> bool:
    """Whether the laws of a filter read the nominal frequency there."""
    other = replace(point, frequency=point.frequency * factor, larger=())
    reading = frequency_reading(other, estimate_point(other))
    return reading is not None and reading.sure and reading.is_near(nominal)


def _may_show(point: PointSweep, factor: float, nominal: float) -> bool:
    """Whether the plain quotient f |Zqd - Zdq| / |Zdd + Zqq| of the highest frequencies is near."""
    frequency = point.frequency * factor
    high = frequency >= max(frequency[-1] / 2, REACH / 2)
    if frequency[-1] < REACH or (np.abs(np.linalg.det(point.admittance[high])) == 0).any():
        return False
    impedance = np.linalg.inv(point.admittance[high])
    across = np.abs(impedance[:, 1, 0] - impedance[:, 0, 1])
    along = np.abs(impedance[:, 0, 0] + impedance[:, 1, 1])
    shown = float(np.median(frequency[high] * across / np.maximum(along, np.finfo(float).tiny)))
    return abs(shown / nominal - 1) < _FIRST_LOOK
