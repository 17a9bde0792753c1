"""The four entries of a matrix that stand apart, in rows or in files of their own, side by side."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.importing.column_map import (
    FREQUENCIES,
    OF_ONE_ENTRY,
    Source,
    parse_map_of_entry,
)
from ibrid.measurement.importing.column_words import (
    Meaning,
    entry_named,
    letters_of,
    meaning_of,
    without_unit,
)
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.shapes.long_tables import matrix_and_unit
from ibrid.measurement.sweeps.quantities import percent

#: Parts of a number, of whatever entry.
_GENERIC = ("re", "im", "mag", "phase")
#: Words of a column that is the magnitude where a phase stands beside it.
_WHOLE = {"impedance": "Z", "admittance": "Y", "z": "Z", "y": "Y"}

#: Real and imaginary part as impedance spectroscopy writes them: Z', -Z'' (b), Z".
_PRIMED = re.compile(r"""\s*[-−–]?\s*([YZyz])\s*('{1,2}|")(?!')""")

#: The name of an entry anywhere in that of a file: 2024_Zdd_NF.
_WITHIN = re.compile(
    r"(?<![a-z0-9])[yz]?[_\- ]?(dd|dq|qd|qq|pp|pn|np|nn|[12]{2})(?![a-z0-9])", re.IGNORECASE
)
#: Name without the entry, workbook and folder of the files of one operating point.
_Group = tuple[str, str, Path]
#: How far R and X may be from |Z| and its angle beside them, as a part.
_ROUNDED = 0.02
#: What the units of an angle measure.
_OF_ANGLES = ("angle", "angle in radians")
_PRIMES = {"'": "re", "''": "im", '"': "im"}


def widened(table: ForeignTable) -> ForeignTable:
    """A table with one row for each entry, which a column names, as one with four entries in a
    row.
    """
    meanings = {name: meaning_of(name) for name in table.columns}
    labels = next((name for name, one in meanings.items() if one.role == "entry"), None)
    generic = {name: one for name, one in meanings.items() if one.role in _GENERIC}
    if labels is None:
        return table
    entries = [entry_named(str(cell)) for cell in table.columns[labels].tolist()]
    value = generic or {
        name: one
        for name, one in meanings.items()
        if not one.role and table.columns[name].dtype.kind == "c"
    }
    if not value or not all(entries):
        return table
    letter, unit, column_of_units = matrix_and_unit(table, labels)
    letter = letter or next((one.letter for one in value.values() if one.letter), "")
    idle = (labels, column_of_units)
    others = [name for name in table.columns if name not in idle and name not in value]
    keys = list(zip(*(table.columns[name].tolist() for name in others), strict=True))
    rows = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    places, labelled = np.array([rows[key] for key in keys]), np.array(entries)
    if len({*zip(places.tolist(), entries, strict=True)}) < len(keys):
        raise SweepError(
            f"{table.where} must hold each entry once in a row of its kind; number repeats in a "
            "column repeat."
        )
    columns: dict[str, np.ndarray] = {}
    for entry in dict.fromkeys(entries):
        for name, meaning in value.items():
            column = np.full(len(rows), np.nan, dtype=table.columns[name].dtype)
            column[places[labelled == entry]] = table.columns[name][labelled == entry]
            measured = (
                meaning if meaning.unit or meaning.role == "phase" else replace(meaning, unit=unit)
            )
            columns[_entry_column(entry, name, measured, letter)] = column
    first = [keys.index(key) for key in rows]
    columns = {name: table.columns[name][first] for name in others} | columns
    return replace(table, columns=columns, line=table.line[first])


def named_as_entry(stem: str) -> bool:
    """Whether the name of a file is that of one entry; 11 .. 22 within it may be of a date."""
    within = (said[0] for said in _WITHIN.finditer(stem))
    return bool(entry_named(stem)) or not all(letters_of(said).isdigit() for said in within)


def entries_last(tables: Sequence[ForeignTable]) -> list[ForeignTable]:
    """The tables, of four files whose names differ by their entry alone each with that at its
    end.
    """
    apart: dict[str, dict[str, ForeignTable]] = {}
    for table in tables:
        if entry_named(table.stem) or _holds_matrix(table):
            continue
        for said in _WITHIN.finditer(table.stem):
            rest = f"{table.stem[: said.start()]}{table.stem[said.end() :]}".strip("_- ")
            apart.setdefault(rest, {})[said[0]] = replace(table, stem=f"{rest}_{said[0]}")
    fours = [held for held in apart.values() if len({*map(entry_named, held)}) == len(held) == 4]
    moved = {one.where: one for held in fours for one in held.values()}
    return [moved.get(table.where, table) for table in tables]


def are_entries_apart(tables: Sequence[ForeignTable]) -> bool:
    """Whether four tables or more have one entry each by their names."""
    return len({entry_named(table.stem) for table in tables if not _holds_matrix(table)} - {""}) > 3


def without_others(tables: Sequence[ForeignTable]) -> list[ForeignTable]:
    """The tables without those beside files of one entry each that hold no matrix; what these say
    of p, q and v is a note of the operating point to which they belong.
    """
    if not are_entries_apart(tables):
        return list(tables)
    groups = dict.fromkeys(_group_of(table) for table in tables if entry_named(table.stem))
    notes: dict[_Group | None, tuple[str, ...]] = {}
    kept, remarks = [], []
    for table in tables:
        meanings = {name: meaning_of(name) for name in table.columns}
        if entry_named(table.stem) or {"matrix", *_GENERIC} & {m.role for m in meanings.values()}:
            kept.append(table)
            continue
        group = _group_beside(table, [*groups])
        said = [name for name, one in meanings.items() if one.role in ("p", "q", "v")]
        said = said if len(table.line) == 1 and group else []
        words = [f"{meanings[n].role}: {table.columns[n][0]} {meanings[n].unit}" for n in said]
        notes[group] = (*notes.get(group, ()), *words, *table.notes)
        but = f", but for {', '.join(said)}" if said else ""
        remarks.append(f"{table.where} holds no entry of a matrix: not used{but}")
    notes.pop(None, None)
    return [
        replace(
            one,
            notes=(*one.notes, *notes.get(_group_of(one), ())),
            remarks=(*one.remarks, *remarks),
        )
        for one in kept
    ]


def _holds_matrix(table: ForeignTable) -> bool:
    return any(meaning_of(name).role == "matrix" for name in table.columns)


def _group_of(table: ForeignTable) -> _Group:
    """What the files of one operating point share: their name without the entry, workbook and
    folder.
    """
    key = re.sub(r"[_\-\s]*[YyZz]?[_\-\s]*[dqpn12]{2}\W*$", "", table.stem)
    return key, table.book, Path(table.where).parent


def _group_beside(table: ForeignTable, groups: Sequence[_Group]) -> _Group | None:
    """The operating point to which a file beside the entries belongs: the only one, of all or of
    those in its folder or workbook, or the only one whose name its own holds; None where that is
    not sure.
    """
    _, *place = _group_of(table)
    in_place = [group for group in groups if [*group[1:]] == place]
    words = {*_words(table.stem)}
    called = [group for group in groups if group[0] and {*_words(group[0])} <= words]
    return next((one[0] for one in (groups, in_place, called) if len(one) == 1), None)


def _words(stem: str) -> list[str]:
    return re.findall(r"[^\W_]+", stem)


def _with_one_reading(table: ForeignTable) -> ForeignTable:
    """The table without magnitude and phase where real and imaginary part stand beside them.

    Raises SweepError where they are another number.
    """
    named = {one.role: name for name in table.columns if (one := meaning_of(name)).role in _GENERIC}
    if len(named) < len(_GENERIC):
        return table
    real_unit, imaginary_unit, size, angle = (meaning_of(named[part]) for part in _GENERIC)
    real, imaginary, magnitude, phase = (table.columns[named[part]] for part in _GENERIC)
    is_alike = real_unit.dimension == imaginary_unit.dimension == size.dimension
    if is_alike and angle.dimension in _OF_ANGLES and phase.any():
        turns = phase if angle.dimension == "angle in radians" else np.deg2rad(phase)
        turns = -turns if named["phase"][0] in "-−–" else turns
        number = real_unit.factor * real + 1j * imaginary_unit.factor * imaginary
        away = np.abs(number - size.factor * magnitude * np.exp(1j * turns))
        if (wrong := away > _ROUNDED * np.abs(number)).any():
            row, columns = int(np.argmax(wrong)), list(table.columns)
            place = {part: f"#{columns.index(name) + 1}" for part, name in named.items()}
            raise SweepError(
                f"{table.place(row, named['re'])} and {named['im']} must be the number of which "
                f"{named['mag']} and {named['phase']} are magnitude and phase; found "
                f"{percent(away[row] / np.abs(number[row]))} between them, say which are right: "
                f"--map Z={place['re']}+j{place['im']} or Z={place['mag']}@{place['phase']}."
            )
    idle = {named["mag"], named["phase"]}
    return replace(table, columns={n: one for n, one in table.columns.items() if n not in idle})


def joined_entries(tables: Sequence[ForeignTable], maps: Iterable[str] = ()) -> list[ForeignTable]:
    """Files with one entry each, told by the end of their names (scan_Ydd.csv .. scan_Yqq.csv), as
    one table.

    maps : of which `Z=MAG[dB]@PHASE[deg]` names the columns in each file.
    """
    maps = tuple(maps)
    joined: list[ForeignTable] = []
    groups: dict[_Group, list[tuple[str, ForeignTable]]] = {}
    for table in tables:
        entry = entry_named(table.stem)
        mapped = parse_map_of_entry(maps, table.columns) if entry else {}
        table = _with_parts_named(table, mapped)
        if not mapped.keys() & {*OF_ONE_ENTRY}:
            table = _with_one_reading(_with_parts_called(table))
        generic = [name for name in table.columns if meaning_of(name).role in _GENERIC]
        if not entry or not generic or _holds_matrix(table):
            joined.append(table)
            continue
        groups.setdefault(_group_of(table), []).append((entry, table))
    if len(joined) == len(tables) > 1 and all(
        entry_named(one.stem) and not _holds_matrix(one) for one in tables
    ):
        raise SweepError(
            f"{tables[0].where} and the others are files with one entry each by their "
            f"names, whose columns are not known; found {some(tables[0].columns, 12)}, say which: "
            "--map freq=#1[Hz],Z=#2+j#3 (real and imaginary part) or Z=#2[dB]@#3[deg] (magnitude "
            "and phase; Y=.. of admittances)."
        )
    for (key, book, folder), members in groups.items():
        grids = {
            n: column
            for n, column in members[0][1].columns.items()
            if meaning_of(n).role in FREQUENCIES
        }
        columns = dict(grids)
        for entry, table in members:
            for name, grid in grids.items():
                own = table.columns.get(name)
                if own is None or own.shape != grid.shape or not np.allclose(own, grid):
                    raise SweepError(
                        f"{table.where} must have the frequencies of {members[0][1].where}; found "
                        "others."
                    )
            letter = re.search(r"([YyZz])[_\-\s]*[dqpn12]{2}\W*$", table.stem)
            for name in _of_the_entry(table, grids):
                own = _entry_column(
                    entry, name, meaning_of(name), letter[1].upper() if letter else ""
                )
                if own in columns:
                    words = (
                        f"name alike what belongs to one operating point: OP1_{entry}, OP2_{entry}"
                    )
                    raise SweepError(
                        f"{table.where} must not hold {own} again, found in {members[0][1].where}; "
                        f"{words}."
                    )
                columns[own] = table.columns[name]
        where = some((table.where for _, table in members), 1)
        joined.append(
            replace(members[0][1], where=where, stem=key or book or folder.name, columns=columns)
        )
    return joined


def _of_the_entry(table: ForeignTable, grids: Collection[str]) -> list[str]:
    """Columns of a file with one entry that are its parts, or say the operating point; indices,
    times and voltages beside them are of the measurement alone.
    """
    roles = {name: meaning_of(name).role for name in table.columns if name not in grids}
    return [name for name, role in roles.items() if role]


def _with_parts_called(table: ForeignTable) -> ForeignTable:
    """The table whose columns Z' and Z'', which may stand with (a) and (b) behind them, are called
    real and imaginary part, and whose Impedance, or Admittance, beside a phase a magnitude.
    """
    meanings = {name: meaning_of(name) for name in table.columns}
    roles = {one.role for one in meanings.values()}
    of_phase = "phase" in roles and "mag" not in roles
    named = {}
    for name, meaning in meanings.items():
        primed = _PRIMED.match(name)
        whole = _WHOLE.get(letters_of(without_unit(name)[0]).removesuffix("data"))
        unit = f" [{meaning.unit}]" if meaning.unit else ""
        if primed:
            named[name] = f"{primed[1].upper()}_{_PRIMES[primed[2]]}{unit}"
        elif whole and of_phase and not meaning.role:
            named[name] = f"{whole}_mag{unit}"
    if len({called[2:4] for called in named.values()}) < len(named):
        return table
    columns = {named.get(name, name): column for name, column in table.columns.items()}
    return replace(table, columns=columns)


def _with_parts_named(table: ForeignTable, mapped: Mapping[str, Source]) -> ForeignTable:
    """The table whose two columns of an entry, and frequencies, are called what they are said to
    be.
    """
    named = {}
    for letter, source in mapped.items():
        if letter in FREQUENCIES:
            unit = source.unit or meaning_of(source.columns[0]).unit
            named[source.columns[0]] = f"{letter} [{unit}]" if unit else letter
            continue
        if not source.joined:
            raise SweepError(
                f"{table.where}: --map {letter}=.. must name two columns, "
                f"{letter}=MAG[dB]@PHASE[deg] or {letter}=RE+jIM; found one."
            )
        parts, units = {
            "@": (("mag", "phase"), (source.unit, source.angle)),
            "j": (("re", "im"), (source.unit, source.imaginary or source.unit)),
        }[source.joined]
        for column, part, said in zip(source.columns, parts, units, strict=True):
            unit = said or meaning_of(column).unit
            named[column] = f"{letter}_{part} [{unit}]" if unit else f"{letter}_{part}"
    other = {one for role in mapped for one in (FREQUENCIES if role in FREQUENCIES else _GENERIC)}
    columns = {
        named.get(name, name): column
        for name, column in table.columns.items()
        if name in named or meaning_of(name).role not in other
    }
    return replace(table, columns=columns)


def _entry_column(entry: str, name: str, meaning: Meaning, letter: str = "") -> str:
    unit = f" [{meaning.unit}]" if meaning.unit else ""
    return (
        f"{meaning.letter or letter}{entry}_{meaning.role}{unit}"
        if meaning.role
        else f"{letter}{entry}{unit}"
    )
