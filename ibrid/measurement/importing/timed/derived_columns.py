"""Columns that others make: the third current of three wires, line voltages from two others, and
the voltage behind three rms values.

Laws: i_a + i_b + i_c = 0 without a neutral wire; v_ab + v_bc + v_ca = 0 always.
"""

from collections.abc import Mapping, Set
from dataclasses import replace

import numpy as np

from ibrid.errors import some
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.families import Column, columns_taken

_CURRENTS, _LINES = ("ia", "ib", "ic"), ("vab", "vbc", "vca")
#: Line voltages counted the other way, and what they are the negative of.
_REVERSED = {"vba": "vab", "vcb": "vbc", "vac": "vca"}
_UNITS = {"voltage": " [V]", "current": " [A]", "per unit": " [pu]"}


def complete_a_recording(roles: Set[str]) -> bool:
    """Whether columns of these roles are a recording with those that can be derived of them."""
    lines = {_REVERSED.get(role, role) for role in roles} & {*_LINES}
    voltages = len(lines) >= 2 or {"va", "vb", "vc"} <= roles
    currents = len(roles & {*_CURRENTS}) >= 2
    return voltages and (currents or {"p", "q"} <= roles)


def with_derived_columns(table: ForeignTable, told: Mapping[str, str]) -> ForeignTable:
    """The table, with columns behind its own for what a recording needs and others make; a remark
    says which.

    told : role -> number or name of a channel, as `--channels` says.
    """
    names = list(table.columns)
    taken = columns_taken(names, told, table.where)
    columns = {
        role: column
        for role, column in taken.items()
        if role in (*_CURRENTS, *_LINES, *_REVERSED)
        and table.columns[names[column.place]].dtype.kind == "f"
    }
    values = {
        role: table.columns[names[column.place]] * column.signal.factor
        for role, column in columns.items()
    }
    lines = _line_voltages(values)
    voltages: dict[str, np.ndarray] = {}
    currents: dict[str, np.ndarray] = {}
    if len(lines) >= 2 and not {"va", "vb", "vc"} <= taken.keys():
        beside_powers = {"p", "q"} <= taken.keys() and not {"v", "v_mag"} & taken.keys()
        if beside_powers and not any(map(_changes_sign, lines.values())):
            voltages = _rms_voltage(lines, columns)
        elif not {"vab", "vbc"} <= taken.keys():
            voltages = _two_lines(lines, columns)
    present = [role for role in _CURRENTS if role in values]
    if len(present) == 2 and (len(lines) >= 2 or {"va", "vb", "vc"} <= taken.keys()):
        (lacking,) = set(_CURRENTS) - set(present)
        name = f"{lacking}{_unit_of(columns, present)}"
        currents = {name: -values[present[0]] - values[present[1]]}
    sources = [*_LINES, *_REVERSED] if voltages else []
    sources += present if currents else []
    made_of = [names[columns[role].place] for role in sources if role in columns]
    derived = {**voltages, **currents}
    derived = {name: value for name, value in derived.items() if name not in table.columns}
    if not derived:
        return table
    remark = f"for three wires: {', '.join(derived)} from {some(made_of, 5)}"
    return replace(
        table,
        columns={**table.columns, **derived},
        remarks=(*table.remarks, remark),
        made_of=table.made_of | {*made_of},
    )


def _line_voltages(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """vab, vbc, vca as far as they are there, in one direction."""
    forward = {role: values[role] for role in _LINES if role in values}
    backward = {
        role: -values[reverse]
        for reverse, role in _REVERSED.items()
        if reverse in values and role not in values
    }
    return {**forward, **backward}


def _two_lines(
    lines: Mapping[str, np.ndarray], columns: Mapping[str, Column]
) -> dict[str, np.ndarray]:
    """vab and vbc."""
    unit = _unit_of(columns, [*_LINES, *_REVERSED])
    third = -np.sum(list(lines.values()), axis=0)
    whole = {role: lines.get(role, third) for role in ("vab", "vbc")}
    return {f"{role}{unit}": value for role, value in whole.items() if role not in columns}


def _changes_sign(values: np.ndarray) -> bool:
    """Whether values are instantaneous, not root mean squares."""
    return bool(np.nanmin(values) < 0 < np.nanmax(values))


def _rms_voltage(
    lines: Mapping[str, np.ndarray], columns: Mapping[str, Column]
) -> dict[str, np.ndarray]:
    """The mean of rms values between the phases."""
    sizes = np.abs(np.array(list(lines.values())))
    return {f"V_LL{_unit_of(columns, [*_LINES, *_REVERSED])}": sizes.mean(axis=0)}


def _unit_of(columns: Mapping[str, Column], roles: list[str]) -> str:
    """The plain unit of the first of the roles that is there, in brackets."""
    dimension = next(columns[role].signal.dimension for role in roles if role in columns)
    return _UNITS.get(dimension, "")
