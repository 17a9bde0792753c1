"""Long tables: a row for each entry of the matrix, whose row and column are numbers or axes in
columns of their own.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.importing.column_words import letters_of, meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable

_INDEX = "(id|idx|index|no|nr|axis)?"
_UNIT = re.compile("units?|einheit|unite|unidad|单位")
_ROW = f"(row|r|i|irow|zeile|ligne|fila|行|output|out|response|current|to){_INDEX}"
_COLUMN = f"(column|col|c|j|jcol|spalte|colonne|columna|列|input|in|perturbation|injected|voltage|from){_INDEX}"
_AXES = {"d": "d", "q": "q", "vd": "d", "vq": "q", "id": "d", "iq": "q", "p": "p", "n": "n"}
#: Words of the names of a measured answer, and of one of another method beside it.
_MEASURED = re.compile("identified|measured|estimated|scan|gemessen|mesure|medid|测量")
_OTHER = re.compile(
    "linear|analytic|model|theor|reference|ref|exact|calculated|fit|simul|expected|理论"
)


def with_entries(table: ForeignTable) -> ForeignTable:
    """The table with a column `entry` in place of those of row and column; of several methods
    beside each other the measured one.

    Raises SweepError where two methods are there and no name says which was measured.
    """
    row, column = (_called(table, pattern) for pattern in (_ROW, _COLUMN))
    if (
        row is None
        or column is None
        or any(meaning_of(name).role == "entry" for name in table.columns)
    ):
        return table
    rows, columns = (_axes(table.columns[name]) for name in (row, column))
    if rows is None or columns is None:
        return table
    entries = np.array(
        [first + second for first, second in zip(rows, columns, strict=True)], dtype=object
    )
    others = {name: value for name, value in table.columns.items() if name not in (row, column)}
    idle = [name for name, value in others.items() if _tells_nothing(name, value)]
    kept = {name: value for name, value in others.items() if name not in idle}
    kept, remarks = _of_one_method(kept, table.where)
    remarks = (*remarks, *([f"not used: {some(idle, 8)}"] if idle else []))
    words = f"the entry of each row: {row} and {column}"
    return replace(
        table, columns={**kept, "entry": entries}, remarks=(*table.remarks, words, *remarks)
    )


def matrix_and_unit(table: ForeignTable, labels: str) -> tuple[str, str, str]:
    """Y or Z, "" where the entries of a long table do not say it; the unit in a column of its own,
    "" without one; and the name of that column.

    labels : the column of entries, with cells such as Ydd. Raises SweepError for both letters, and
    for several units.
    """
    cells = [str(cell).strip() for cell in table.columns[labels].tolist()]
    letters = {cell[:1].upper() for cell in cells} & {"Y", "Z"}
    if len(letters) > 1:
        raise SweepError(
            f"{table.where}: {labels} must name entries of one matrix; found some of Y and some of "
            "Z, leave out those of one."
        )
    called = next((name for name in table.columns if _UNIT.fullmatch(letters_of(name))), "")
    units = {str(cell).strip() for cell in table.columns[called].tolist()} if called else set()
    if len(units) > 1:
        raise SweepError(
            f"{table.where}: {called} must be one unit for all entries; found {some(units, 4)}, "
            "convert the rows."
        )
    unit = units.pop() if units else ""
    return (letters.pop() if letters else ""), unit, called


def _tells_nothing(name: str, values: np.ndarray) -> bool:
    """Whether a column is a number or yes and no of each entry, whose name says nothing known and
    no part of a number.
    """
    known = any(meaning_of(word).role for word in (name, *re.split(r"[\W_]+", name)) if word)
    words = {*map(str, values.tolist())} if values.dtype.kind == "O" else set()
    return not known and (
        values.dtype.kind == "f"
        or {word.lower() for word in words} <= {"true", "false", "yes", "no"}
    )


def _called(table: ForeignTable, pattern: str) -> str | None:
    names = [name for name in table.columns if re.fullmatch(pattern, letters_of(name))]
    return names[0] if len(names) == 1 else None


def _axes(values: np.ndarray) -> list[str] | None:
    """d or q of each row, from 0 and 1, 1 and 2, or the names of axes; None for anything else."""
    cells = values.tolist()
    if values.dtype.kind == "f":
        known = {*cells}
        begin = 0 if known == {0.0, 1.0} else 1 if known == {1.0, 2.0} else None
        return None if begin is None else ["dq"[int(cell) - begin] for cell in cells]
    names = [_AXES.get(letters_of(str(cell)), "") for cell in cells]
    return names if all(names) else None


def _of_one_method(
    columns: dict[str, np.ndarray], where: str
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """The columns of the measured answer, called re, im, mag or phase, and what of others is left
    out.
    """
    parts: dict[str, list[str]] = {}
    for name in columns:
        words = [word for word in re.split(r"[\W_]+", name) if word]
        for word in words[1:]:
            if (part := meaning_of(word).role) in ("re", "im", "mag", "phase"):
                parts.setdefault(part, []).append(name)
                break
    doubled = [name for names in parts.values() if len(names) > 1 for name in names]
    if not doubled and not parts:
        return columns, ()
    chosen = {part: _measured(names, where) for part, names in parts.items()}
    dropped = [name for names in parts.values() for name in names if name not in chosen.values()]
    short = {name: f"{part}{_unit_of(name)}" for part, name in chosen.items()}
    whole = {"re", "im"} <= chosen.keys()  # magnitude and phase say the same again
    again = [name for part, name in chosen.items() if whole and part not in ("re", "im")]
    kept = {
        short.get(name, name): value
        for name, value in columns.items()
        if name not in (*dropped, *again)
    }
    said = (
        [f"of the methods beside each other {chosen.get('re', chosen.get('mag'))} is taken"]
        if dropped
        else []
    )
    return kept, (
        *said,
        *([f"not used: {some([*dropped, *again], 8)}"] if dropped or again else []),
    )


def _measured(names: Sequence[str], where: str) -> str:
    """The one that a measurement gave."""
    if len(names) == 1:
        return names[0]
    for kept in (
        [name for name in names if _MEASURED.search(name.lower())],
        [n for n in names if not _OTHER.search(n.lower())],
    ):
        if len(kept) == 1:
            return kept[0]
    raise SweepError(
        f"{where} must hold one answer of each entry; found {some(names, 4)}, leave the columns of "
        "one method out, or call one "
        "measured_.."
    )


def _unit_of(name: str) -> str:
    unit = meaning_of(name).unit or ("deg" if re.search("deg|grad", name.lower()) else "")
    return f" [{unit}]" if unit else ""
