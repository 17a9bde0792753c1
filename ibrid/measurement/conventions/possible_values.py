"""Steady states that no device has: p, q, v or i so far from 1 per unit that the base, or a unit,
was meant otherwise.

Factors between kinds of one quantity (sqrt 2, sqrt 3, 3/2: peak, line, Park) are labels, which are
doubted with a warning and found by fits. Beyond them are those of a prefix (VA for kVA, V for kV, A
for kA: a thousand, a million for impedances) and of per cent: they are refused, here alone, of
sweeps as of recordings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.errors import ImpossibleValueError
from ibrid.measurement.conventions.exchanged_quantity import may_be_exchanged
from ibrid.measurement.sweeps.quantities import engineering
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep

#: Per unit: of a device on a base ten times too small, and of a voltage sqrt 3 sqrt 2 times too
#: high, they are within.
LARGEST_POWER, SMALLEST_VOLTAGE, LARGEST_VOLTAGE = 10.0, 0.01, 3.0
#: Currents and voltages that a recording may exceed in a twentieth of its samples: surges and cells
#: that are spoilt.
LARGEST_CURRENT, LARGEST_SURGE, _SELDOM = 20.0, 5.0, 0.95
#: |Y| max(1, f / f0) in per unit: its median lies below; its largest value above for any device
#: that delivers `_LOADED`, or whose filter shows.
LARGEST_ADMITTANCE, SMALLEST_ADMITTANCE, _LOADED = 300.0, 0.02, 0.1
#: Hz from which on a filter shows in any device; part of Y(0) by which the lowest frequency may be
#: away from rest.
_SHOWS_FILTER_HZ, _SETTLED = 300.0, 0.3
#: Powers of devices per unit, for what was meant; and the middle of what their admittances are.
_USUAL_POWER, _USUAL_ADMITTANCE = (0.003, 2.0), 4.0
_IN_SI = (
    "the columns are probably in V and A, or in kV and kA: say unit: si with s_base_va and v_base_v"
)


@dataclass(frozen=True)
class Base:
    """Apparent power in VA and voltage between phases in V, rms, of one per unit; None: not
    known.
    """

    power: float | None
    voltage: float | None


def require_possible(op: OperatingPoint, base: Base, place: str, *, recorded: bool = False) -> None:
    """ImpossibleValueError, with what was probably meant, unless p, q and v of a steady state can
    be those of a device.

    place : how the sentence begins. recorded : whether they are the rest of a recording, whose
    current counts too.
    """
    power = abs(complex(op.p, op.q))
    doubts = []
    if not SMALLEST_VOLTAGE <= op.v <= LARGEST_VOLTAGE:
        doubts.append(
            f"the voltage must be {SMALLEST_VOLTAGE:g} to {LARGEST_VOLTAGE:g} per unit; found "
            f"{op.v:.4g}"
            f"{_absolute(op.v, base.voltage, 'V')}, {_meant_voltage(op.v, base.voltage, recorded)}"
        )
    if power > LARGEST_POWER:
        doubts.append(
            f"|p + jq| must be at most {LARGEST_POWER:g} per unit of the device; found {power:.4g}"
            f"{_absolute(power, base.power, 'VA')}, {_meant_power(power, base.power, recorded)}"
        )
    elif power / op.v > LARGEST_CURRENT and not doubts:
        kinds = ", A in place of kA" if recorded else ""
        doubts.append(
            f"the current |p + jq| / v must be at most {LARGEST_CURRENT:g} per unit at rest; found "
            f"{power / op.v:.4g}{kinds}, or "
            "v_base_v in kV, s_base_va in kVA or MVA?"
        )
    if doubts:
        raise ImpossibleValueError(f"{place} {'; and '.join(doubts)}.")


def require_possible_samples(v: np.ndarray, i: np.ndarray, name: str, base: Base) -> None:
    """ImpossibleValueError unless the samples of a recording can be those of a device, but for a
    twentieth of them.

    v, i : (n, 2) or (n,) complex, per unit.
    """
    sizes = [float(np.quantile(_size(one), _SELDOM)) for one in (v, i)]
    if sizes[0] > LARGEST_SURGE:
        raise ImpossibleValueError(
            f"record {name}: the voltage must be at most {LARGEST_SURGE:g} per unit in nearly all "
            f"samples; found {sizes[0]:.4g}"
            f"{_absolute(sizes[0], base.voltage, 'V')}, "
            f"{_meant_voltage(sizes[0], base.voltage, True)}."
        )
    if sizes[1] > LARGEST_CURRENT:
        raise ImpossibleValueError(
            f"record {name}: the current must be at most {LARGEST_CURRENT:g} per unit in nearly "
            "all samples; found "
            f"{sizes[1]:.4g}, {_meant_power(sizes[1], base.power, True)}."
        )


def require_possible_admittances(
    points: Sequence[PointSweep], f0_hz: float, base: Base, unit: str, where: str
) -> None:
    """ImpossibleValueError unless admittances that were brought to per unit by a base can be those
    of a device.
    """
    sizes = [
        np.linalg.norm(point.admittance, axis=(1, 2))
        / np.sqrt(2)
        * np.maximum(1, point.frequency / f0_hz)
        for point in points
    ]
    loaded = any(abs(complex(point.op.p, point.op.q)) >= _LOADED for point in points)
    high = any(point.frequency.max() >= _SHOWS_FILTER_HZ for point in points)
    rest = max(_current_at_rest(point) for point in points)
    what, typical = "|Y| max(1, f / f0)", float(np.median([np.median(size) for size in sizes]))
    if rest > LARGEST_CURRENT:
        what, typical = "the current at rest, which the lowest frequencies show,", rest
        limit = f"at most {LARGEST_CURRENT:g}"
    elif all(np.median(size) > LARGEST_ADMITTANCE for size in sizes):
        limit = f"at most {LARGEST_ADMITTANCE:g} in the median"
    elif (loaded or high) and all(size.max() < SMALLEST_ADMITTANCE for size in sizes):
        limit = f"above {SMALLEST_ADMITTANCE:g}"
    else:
        return
    raise ImpossibleValueError(
        f"{where}: {what} must be {limit} per unit of a device; found {typical:.2g} on a base of "
        f"{_spoken(base)}, "
        f"{_meant_base(typical, base)}{_meant_quantity(points, f0_hz, base, unit)}."
    )


def _meant_quantity(points: Sequence[PointSweep], f0_hz: float, base: Base, unit: str) -> str:
    """That the other quantity may stand in the columns, where its sizes would be usual."""
    if not may_be_exchanged(points, f0_hz, (base.voltage or 0.0) ** 2 / (base.power or 1.0)):
        return ""
    if unit == "S":
        return "; or the columns hold impedances: name them Zdd .., with unit: ohm"
    return "; or the columns hold admittances: name them Ydd .., with unit: S"


def _current_at_rest(point: PointSweep) -> float:
    """|p + jq| / v that the lowest frequency shows where it is at rest, 0 where it is not.

    Law of a device that controls p and q: Y(0) = -[[p, -q], [-q, -p]] / v^2, in any frame real,
    symmetric and without trace.
    """
    lowest = point.admittance[np.argmin(point.frequency)]
    across = (lowest[0, 1] + lowest[1, 0]).real / 2
    along = (lowest[1, 1] - lowest[0, 0]).real / 2
    law = np.array([[-along, across], [across, along]])
    settled = np.linalg.norm(lowest - law) <= _SETTLED * np.linalg.norm(law)
    return float(np.hypot(along, across) * point.op.v) if settled else 0.0


def _size(values: np.ndarray) -> np.ndarray:
    return np.abs(values) if values.ndim == 1 else np.hypot(*values.T)


def _absolute(value: float, base: float | None, unit: str) -> str:
    return (
        ""
        if base is None
        else f" ({engineering(value * base, unit)} on a base of {engineering(base, unit)})"
    )


def _meant_power(power: float, base: float | None, recorded: bool) -> str:
    """What makes a power a thousand times, or times to the power of two or three, too large."""
    if base is None and recorded:
        return _IN_SI
    low, high = _USUAL_POWER
    factor = next((size for size in (1e3, 1e6, 1e9) if low <= power / size <= high), None)
    if base is None:
        percents = " or in per cent" if low <= power / 100 <= high else ""
        return (
            f"p and q are probably in kW or W{percents}, or on another base: divide them by the "
            "rated power"
        )
    if factor:
        meant = (
            f"the base is probably {engineering(base * factor, 'VA')} (s_base_va is in VA, not in "
            "kVA or MVA)"
        )
        return meant + ", or A in place of kA" * recorded
    kinds = ", A in place of kA" if recorded else ", p and q in W in place of kW"
    return f"is s_base_va in kVA or MVA, not in VA{kinds}?"


def _meant_voltage(v: float, base: float | None, recorded: bool) -> str:
    if base is None and recorded:
        return _IN_SI
    factor = next((size for size in (1e3, 1e-3, 1e6, 1e-6) if 0.2 <= v / size <= 2), None)
    if factor is None:
        return "is v_base_v in V, between phases, and v in the same unit?"
    kinds = "V and its base in kV" if factor > 1 else "kV and its base in V"
    said = (
        ""
        if base is None
        else f": the base is probably {engineering(base * factor, 'V')}, or v is in another unit"
    )
    return f"v is probably in {kinds}{said} (v_base_v is in V)"


def _meant_base(typical: float, base: Base) -> str:
    """Prefixes of power and voltage with which the admittances are nearest to the usual, on a base
    that devices have.
    """
    nearest, meant = np.inf, base
    for power in (1.0, 1e3, 1e6, 1e-3, 1e-6):
        for voltage in (1.0, 1e3, 1e-3):
            other = Base((base.power or 0.0) * power, (base.voltage or 0.0) * voltage)
            away = abs(np.log(typical * voltage**2 / power / _USUAL_ADMITTANCE))
            if _is_of_a_device(other) and away < nearest - 1e-9:
                nearest, meant = away, other
    likely = (
        "the unit is probably another"
        if meant == base
        else f"the base is probably {_spoken(meant)}, or the unit is another"
    )
    return f"{likely} (S read for mS, s_base_va in VA, v_base_v in V between phases)"


def _is_of_a_device(base: Base) -> bool:
    """Whether power, voltage and their current are those of anything between an appliance and a
    power station.
    """
    power, voltage = base.power or 0.0, base.voltage or 0.0
    return 50 <= power <= 1e10 and 40 <= voltage <= 1.2e6 and 0.5 <= power / voltage <= 2e5


def _spoken(base: Base) -> str:
    return f"{engineering(base.power or 0.0, 'VA')}, {engineering(base.voltage or 0.0, 'V')}"
