"""Set points beside a recording, p_ref, q_ref, v_ref and f_ref, in the unit that their own names
say: per unit of the inverter's base, and Hz.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats.event_csv import TOLD
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.shapes.signed_names import unsigned
from ibrid.measurement.importing.timed.signal_names import counted_in, size_of, split_unit
from ibrid.measurement.importing.timed.voltage_kinds import kind_of_voltage

#: Above this a set point without a unit is not per unit.
_LARGEST_PU = 3.0
#: What a set point measures by its first letter, its plain unit, and one to name it with.
_USUAL = {
    "p": ("power", "W", "MW"),
    "q": ("power", "var", "Mvar"),
    "v": ("voltage", "V", "kV"),
    "f": ("frequency", "Hz", "Hz"),
}


@dataclass(frozen=True, eq=False)
class SetPoint:
    """What the device was told.

    `column` : its name in the table. `values` : (n,) per unit, of f_ref in Hz. `reading` : in which
    unit it was read.
    """

    column: str
    values: np.ndarray
    reading: str


def set_point_columns(names: Sequence[str]) -> dict[str, str]:
    """p_ref, q_ref, v_ref, f_ref -> the first column of that name, whatever its unit and sign."""
    columns: dict[str, str] = {}
    for name in names:
        role = split_unit(unsigned(name))[0].strip().lower()
        if role in TOLD:
            columns.setdefault(role, name)
    return columns


def set_points_of(
    table: ForeignTable,
    unit: str,
    header: Mapping[str, Any],
    f0_hz: float,
    whole: np.ndarray,
) -> dict[str, SetPoint]:
    """The set points in the rows that are whole; none that has gaps.

    unit : "si" where the recording is in V and A. header : s_base_va, v_base_v. A voltage in V is
    of the kind that its unit says, else its size at the beginning.

    Raises SweepError where the unit of one is not said, or what kind of voltage it is.
    """
    set_points: dict[str, SetPoint] = {}
    for role, name in set_point_columns(list(table.columns)).items():
        values = table.columns[name]
        if values.dtype.kind == "f" and np.isfinite(values[whole]).all():
            set_points[role] = _set_point(
                table.where, role, name, values[whole], unit, header, f0_hz
            )
    return set_points


def _set_point(
    where: str,
    role: str,
    name: str,
    values: np.ndarray,
    unit: str,
    header: Mapping[str, Any],
    f0_hz: float,
) -> SetPoint:
    _, written = split_unit(name)
    dimension, factor = size_of(written) or ("", 1.0)
    usual, plain, example = _USUAL[role[0]]
    values = values * factor
    largest = float(np.max(np.abs(values), initial=0.0))
    times = "" if factor == 1.0 else f" times {factor:g}"
    if usual == "frequency":
        if dimension == "per unit" and largest <= _LARGEST_PU:
            return SetPoint(name, values * f0_hz, f"per unit of {f0_hz:g} Hz")
        if dimension in ("", usual) and largest > _LARGEST_PU:
            return SetPoint(name, values, f"{plain}{times}")
    elif dimension == "per unit" or (dimension == "" and unit != "si"):
        if largest <= _LARGEST_PU:
            return SetPoint(name, values, "per unit")
        example = "pu" if unit != "si" else example
    elif dimension == usual and (
        base := header.get("v_base_v" if role == "v_ref" else "s_base_va")
    ):
        if role != "v_ref":
            return SetPoint(name, values / base, f"{plain}{times}")
        kind, one_volt = kind_of_voltage(
            values,
            counted_in(f"{written} {name}"),
            base,
            f"{where}: the set point {name}",
            "name its column v_ref ",
        )
        return SetPoint(name, values / one_volt, f"{plain}{times}, {kind}")
    elif unit != "si":
        example = "pu"
    found = f"{largest:g} {f'of {dimension}' if dimension else 'without a unit'}"
    raise SweepError(
        f"{where}: the set point {name} must have the unit of the recording; found up to "
        f"{found}, convert it or name its column {role} [{example}]."
    )
