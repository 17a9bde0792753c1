"""Matrices with further ports, a DC side or other terminals: the device's own 2x2 block with the
others at constant voltage.

The block of an admittance is that at once. That of an impedance is with no current in the others:
the whole is inverted first.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.column_words import letters_of, unit_of, without_unit
from ibrid.measurement.importing.foreign_table import ForeignTable

_PORT = "(?:dc|d|q)[1-9]?|x[3-8]"
_PART = "re|real|im|imag"
_NAMED = re.compile(
    f"(?P<before>{_PART})?(?P<letter>[yz])(?P<row>{_PORT})(?P<column>{_PORT})(?P<behind>{_PART}|r|i)?"
)


@dataclass(frozen=True)
class _Entry:
    """An entry of the matrix: its letter and the names of its columns, real part first; one of
    complex numbers.
    """

    letter: str
    names: tuple[str, ...]


def own_block(table: ForeignTable) -> ForeignTable:
    """The table with the entries dd .. qq of one AC terminal alone, where it has those of further
    ports; what is lost is said.

    Raises SweepError where an impedance lacks entries of the whole matrix.
    """
    entries = _entries(table)
    ports = list(dict.fromkeys(port for pair in entries for port in pair))
    own = _terminal(ports)
    others = [port for port in ports if port not in own]
    if not own or not others or any((row, column) not in entries for row in own for column in own):
        return table
    letter = entries[own[0], own[0]].letter
    used = {name for entry in entries.values() for name in entry.names}
    columns = {name: column for name, column in table.columns.items() if name not in used}
    if letter == "y":
        block = [[_value(table, entries[row, column]) for column in own] for row in own]
        how = "with the voltage there constant"
    else:
        _require_one_unit(table, entries)
        block = _inverted(table, entries, ports, own)
        how = "with the voltage there constant, from the inverse of the whole impedance"
    unit = _unit(table, entries[own[0], own[0]])
    for r, c in np.ndindex(2, 2):
        columns[f"Y{'dq'[r]}{'dq'[c]}{unit}"] = block[r][c]
    words = (
        f"the matrix has further ports ({', '.join(others)}): the block of {own[0]} and {own[1]} "
        f"is taken, {how}; what they "
        "answer is lost"
    )
    return replace(table, columns=columns, remarks=(*table.remarks, words))


def _entries(table: ForeignTable) -> dict[tuple[str, str], _Entry]:
    """(row, column) -> the entry, of columns called Ydd_re .. Ydcdc_im or by complex numbers."""
    parts_of: dict[tuple[str, str], dict[str, str]] = {}
    letters: dict[tuple[str, str], str] = {}
    for name, column in table.columns.items():
        matched = _NAMED.fullmatch(letters_of(without_unit(name)[0]))
        if matched is None or column.dtype.kind not in "fc":
            continue
        pair = matched["row"], matched["column"]
        part = (matched["before"] or matched["behind"] or "")[:1]
        parts_of.setdefault(pair, {})[part] = name
        letters[pair] = matched["letter"]
    entries = {}
    for pair, parts in parts_of.items():
        if {"r", "i"} <= parts.keys():
            entries[pair] = _Entry(letters[pair], (parts["r"], parts["i"]))
        elif "" in parts and table.columns[parts[""]].dtype.kind == "c":
            entries[pair] = _Entry(letters[pair], (parts[""],))
    return entries


def _terminal(ports: Sequence[str]) -> tuple[str, ...]:
    """d and q of the first AC terminal; empty where there is none."""
    for port in ports:
        if port.startswith("d") and not port.startswith("dc") and f"q{port[1:]}" in ports:
            return port, f"q{port[1:]}"
    return ()


def _require_one_unit(table: ForeignTable, entries: Mapping[tuple[str, str], _Entry]) -> None:
    """SweepError where entries of an impedance that is inverted have different units."""
    units = {without_unit(name)[1] for entry in entries.values() for name in entry.names}
    if len(units) > 1:
        found = ", ".join(sorted(unit or "none" for unit in units))
        raise SweepError(
            f"{table.where}: all entries of an impedance with further ports must have one unit, "
            f"since the whole is inverted; found {found}, write them in ohm or per unit."
        )


def _value(table: ForeignTable, entry: _Entry) -> np.ndarray:
    first, *second = (table.columns[name] for name in entry.names)
    return first + 1j * second[0] if second else first.astype(complex)


def _inverted(
    table: ForeignTable,
    entries: Mapping[tuple[str, str], _Entry],
    ports: Sequence[str],
    own: Sequence[str],
) -> np.ndarray:
    """(2, 2, K) the own block of the inverse."""
    lacking = [
        f"Z{row}{column}" for row in ports for column in ports if (row, column) not in entries
    ]
    if lacking:
        raise SweepError(
            f"{table.where}: an impedance with further ports must have all {len(ports) ** 2} "
            "entries, of which the block at "
            f"constant voltage of the others is made; {lacking[0]} is missing, export the whole "
            "matrix."
        )
    whole = np.array([[_value(table, entries[row, column]) for column in ports] for row in ports])
    try:
        inverse = np.linalg.inv(np.moveaxis(whole, -1, 0))
    except np.linalg.LinAlgError:
        raise SweepError(
            f"{table.where}: the impedance of all ports is singular; scan admittances."
        ) from None
    places = [ports.index(port) for port in own]
    _, size = unit_of(without_unit(entries[own[0], own[0]].names[0])[1]) or ("", 1.0)
    return np.moveaxis(inverse[:, places][:, :, places], 0, -1) / size


def _unit(table: ForeignTable, entry: _Entry) -> str:
    """The unit of the block, as it stands for an admittance, and 1 / ohm of an impedance."""
    written = without_unit(entry.names[0])[1]
    if entry.letter == "y" or not written:
        return f" [{written}]" if written else ""
    known = unit_of(written)
    return (
        " [S]"
        if known and known[0] == "impedance"
        else " [pu]"
        if known and known[0] == "per unit"
        else ""
    )
