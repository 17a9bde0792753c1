"""The steady state as v_d, v_q, i_d and i_q, in columns or beside the table: p = v_d i_d + v_q i_q,
q = v_q i_d - v_d i_q.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.signal_names import ColumnSignal, signal_of
from ibrid.measurement.importing.told import numbers_beside

_FOUR = ("vd", "vq", "id", "iq")
#: How names say that a number is that of the steady state.
_AT_REST = re.compile(r"_?(0|ss|op|eq|rest|steady)(?=\W|$)")


def with_rest(table: ForeignTable, said: Mapping[str, Any]) -> ForeignTable:
    """The table with columns p, q and v in place of the four, where it has them and says no p and
    q.

    said : what the user says; the current and the side of q are counted so, else out of the device
    and leading.
    """
    roles = {meaning_of(name).role for name in table.columns}
    if (
        {"p", "q"} <= roles
        or said.get("p") is not None
        or said.get("q") is not None
        or said.get("op")
    ):
        return table
    found = _columns(table) or _beside(table)
    if found is None:
        return table
    numbers, signals, used = found
    v, i = numbers["vd"] + 1j * numbers["vq"], numbers["id"] + 1j * numbers["iq"]
    if str(said.get("q_axis") or "") == "lags":
        v, i = np.conj(v), np.conj(i)
    power = v * np.conj(i) * (-1.0 if str(said.get("current") or "") == "in" else 1.0)
    absolute = signals["vd"].dimension == "voltage" and signals["id"].dimension == "current"
    unit, size = (" [VA]", 1.5) if absolute else ("", 1.0)
    volts = np.abs(v) * (np.sqrt(1.5) if absolute else 1.0)
    kept = {name: column for name, column in table.columns.items() if name not in used}
    columns = {**kept, f"p{unit}": size * power.real, f"q{unit}": size * power.imag}
    columns[f"v{' [V]' if absolute else ''}"] = volts
    words = "p, q and v from v_d, v_q, i_d and i_q at rest" + ", peak values of a phase" * absolute
    return replace(table, columns=columns, remarks=(*table.remarks, words))


_Found = tuple[dict[str, np.ndarray], dict[str, ColumnSignal], tuple[str, ...]]


def _columns(table: ForeignTable) -> _Found | None:
    """The four as columns of numbers."""
    roles = {
        name: signal_of(_AT_REST.sub("", name))
        for name, column in table.columns.items()
        if column.dtype.kind == "f"
    }
    places = {signal.role: name for name, signal in reversed(roles.items())}
    if not {*_FOUR} <= places.keys():
        return None
    numbers = {role: table.columns[places[role]] * roles[places[role]].factor for role in _FOUR}
    return (
        numbers,
        {role: roles[places[role]] for role in _FOUR},
        tuple(places[role] for role in _FOUR),
    )


def _beside(table: ForeignTable) -> _Found | None:
    """The four as single numbers beside the table, for each of its rows."""
    told = numbers_beside("", table.notes)
    signals = {name: signal_of(_AT_REST.sub("", name), unit) for name, (_, unit) in told.items()}
    places = {signal.role: name for name, signal in reversed(signals.items())}
    if not {*_FOUR} <= places.keys():
        return None
    rows = len(table.line)
    numbers = {
        role: np.full(rows, told[places[role]][0] * signals[places[role]].factor) for role in _FOUR
    }
    return numbers, {role: signals[places[role]] for role in _FOUR}, ()
