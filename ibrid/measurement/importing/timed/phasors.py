"""Phasors and root mean squares as voltage and current in dq, per unit: v = V exp(j theta), i =
conj((p + j q) / v).

Which kind of voltage a size in V is (line to line, of a phase, its peak) its value at the beginning
tells beside the base.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.timed.families import SignalFamily
from ibrid.measurement.importing.timed.voltage_kinds import kind_of_voltage
from ibrid.measurement.recordings.phasors import angle_of_frequency, current_of_powers

#: p and q above this are in no per unit.
_LARGEST_PU = 3.0
#: Angles without a unit up to this, 2 pi, may be in radians.
_TURN = 6.2832
_A = np.exp(2j * np.pi / 3)


@dataclass(frozen=True, eq=False)
class Phasors:
    """(n,) complex voltage and current, d + j q per unit, current as it is counted there; and what
    was assumed.
    """

    v: np.ndarray
    i: np.ndarray
    remarks: tuple[str, ...]


def phasors_of(
    family: SignalFamily,
    part: dict[str, np.ndarray],
    time: np.ndarray,
    unit: str,
    f0_hz: float,
    base: tuple[float | None, float | None],
    where: str,
) -> Phasors:
    """The phasors of a record.

    part : role -> (n,) in V, A, W, degrees and Hz, or per unit. unit : "si" for V, A and W, else
    per unit.

    Raises SweepError where the voltage fits no kind beside the base, or angles without a unit may
    be in radians or in degrees.
    """
    part, remarks = _in_degrees(part, family, where)
    beside = (
        "t",
        "record",
        "sigma",
        "f",
        *(["v_ang"] if family.kind in ("powers", "currents") else []),
    )
    needed = [role for role in family.columns if role not in beside]
    if family.kind == "phasors":
        v, i = (_positive([_polar(part, f"{letter}{phase}") for phase in "abc"]) for letter in "vi")
    elif family.kind == "phasor":
        v, i = (part[needed[k]] * np.exp(1j * np.deg2rad(part[needed[k + 1]])) for k in (0, 2))
    else:
        v, i = part[needed[0]] * np.exp(1j * _angle(part, time, f0_hz)), None
    if i is None and "v_ang" not in part and "f" not in part:
        remarks.append(
            "no column is taken for the angle of the voltage: its frequency is taken as nominal"
        )
    one_volt, one_ampere = 1.0, 1.0
    if unit == "si":
        column = family.columns[needed[0]]
        kind, one_volt = kind_of_voltage(
            v,
            column.signal.counted,
            float(base[1] or 1.0),
            f"{where}: the voltage",
            f"--channels {needed[0]}={column.place + 1}",
        )
        remarks.append(f"the voltage is {kind}, as its size shows beside the base")
        currents = [role for role in needed if role[0] == "i" and not role.endswith("_ang")]
        peak = _is_peak(family, currents, "peak" in kind)
        one_ampere = (
            float(base[0] or 1.0)
            / (np.sqrt(3) * float(base[1] or 1.0))
            * (np.sqrt(2) if peak else 1.0)
        )
        if i is not None or family.kind == "currents":
            remarks.append(f"currents taken as {'peak' if peak else 'rms'}")
    v = v / one_volt
    if i is not None:
        return Phasors(v, i / one_ampere, tuple(remarks))
    if family.kind == "powers":
        p, q = (_powers(part[role], role, unit, base, where) for role in needed[1:])
        i = current_of_powers(p, q, np.abs(v)) * np.exp(1j * np.angle(v))
        return Phasors(v, i, tuple(remarks))
    active, reactive = (part[role] / one_ampere for role in needed[1:])
    remarks.append("the reactive current has the sign of the reactive power")
    i = (active - 1j * reactive) * np.exp(1j * np.angle(v))
    return Phasors(v, i, tuple(remarks))


def _in_degrees(
    part: dict[str, np.ndarray], family: SignalFamily, where: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """The columns with all angles in degrees, and what was assumed.

    Those of three phases lie 120 degrees apart, so that their size tells; SweepError where that of
    others does not.
    """
    unsaid = [
        role
        for role, column in family.columns.items()
        if role.endswith("_ang") and not column.signal.dimension
    ]
    largest = max((float(np.max(np.abs(part[role]), initial=0.0)) for role in unsaid), default=0.0)
    if not 0.0 < largest <= _TURN:
        return part, []
    if family.kind == "phasors":
        remark = f"angles up to {largest:.4g} of three phases are taken in radians"
        return part | {role: np.rad2deg(part[role]) for role in unsaid}, [remark]
    places = [(role, family.columns[role].place + 1) for role in unsaid]
    degrees, radians = (
        "--channels " + ",".join(f"{role}={place}[{unit}]" for role, place in places)
        for unit in ("deg", "rad")
    )
    raise SweepError(
        f"{where}: angles up to {largest:.4g} may be in degrees or in radians; say it: {degrees} "
        f"or {radians}."
    )


def _is_peak(family: SignalFamily, currents: list[str], as_voltage: bool) -> bool:
    """Whether currents are peak values, as their unit or name says and else as the voltage."""
    counted = {word for role in currents for word in family.columns[role].signal.counted}
    return "peak" in counted or (as_voltage and "rms" not in counted)


def _polar(part: dict[str, np.ndarray], name: str) -> np.ndarray:
    return part[f"{name}_mag"] * np.exp(1j * np.deg2rad(part[f"{name}_ang"]))


def _positive(phases: list[np.ndarray]) -> np.ndarray:
    """The positive sequence of three phasors."""
    return (phases[0] + _A * phases[1] + _A**2 * phases[2]) / 3


def _angle(part: dict[str, np.ndarray], time: np.ndarray, f0_hz: float) -> np.ndarray:
    """(n,) rad, of the voltage against the nominal frequency: a column of it, or the integral of
    one of frequencies.
    """
    if "v_ang" in part:
        return np.deg2rad(part["v_ang"])
    if "f" not in part:
        return np.zeros(len(time))
    away = part["f"] - (f0_hz if np.median(part["f"]) > _LARGEST_PU else 1.0)
    away = away * (1.0 if np.median(part["f"]) > _LARGEST_PU else f0_hz)
    return angle_of_frequency(away, time)


def _powers(
    values: np.ndarray, role: str, unit: str, base: tuple[float | None, float | None], where: str
) -> np.ndarray:
    """p or q per unit."""
    if unit == "si":
        return values / float(base[0] or 1.0)
    largest = float(np.max(np.abs(values), initial=0.0))
    if largest > _LARGEST_PU:
        raise SweepError(
            f"{where}: {role} must be per unit or have a unit; found up to {largest:g}, say it: "
            f"--channels {role}=3[MW], with "
            "--base."
        )
    return values
