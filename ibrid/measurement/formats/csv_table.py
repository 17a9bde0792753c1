"""The rows of a sweep CSV as arrays: read in blocks, and row by row where one of a block is
unusual, for its sentence.
"""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.foreign_text import cell_meant
from ibrid.measurement.conventions.header import number_of
from ibrid.measurement.formats.csv_columns import OPTIONAL, Columns
from ibrid.measurement.formats.grouping import rows_of_each
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: Rows that are read at once.
_BLOCK = 4096
#: Characters of a name that are read at once.
_LONGEST_NAME = 200


@dataclass(frozen=True, eq=False)
class Table:
    """Rows as read, in the file's convention; NaN where a cell is empty.

    line : (n,) int, in the file. op : names of the operating points. point : (n, 3) p, q, v. repeat
    : (n,).
    frequency : (n,) Hz. matrix : (n, 2, 2) complex. sigma : (n, 0), (n, 1) or (n, 4). amplitude :
    (n,).
    """

    line: np.ndarray
    op: np.ndarray
    point: np.ndarray
    repeat: np.ndarray
    frequency: np.ndarray
    matrix: np.ndarray
    sigma: np.ndarray
    amplitude: np.ndarray

    def at(self, rows: np.ndarray) -> "Table":
        """Some of the rows."""
        return Table(**{name: value[rows] for name, value in vars(self).items()})

    def grouped(self, keys: np.ndarray) -> list["Table"]:
        """Rows with the same key, in order of appearance."""
        return [self.at(rows) for rows in rows_of_each(keys.tolist()).values()]

    def __len__(self) -> int:
        return len(self.line)


def read_table(numbers: Sequence[int], lines: Sequence[str], columns: Columns, path: Path) -> Table:
    """The rows of lines with their numbers; SweepError names file and line of the first that is
    none.
    """
    blocks = []
    for start in range(0, len(lines), _BLOCK):
        some = lines[start : start + _BLOCK]
        rows = _rows(some, columns)
        if rows is None:
            rows = np.array(
                [
                    _row(number, fields_of(number, line, path), columns, path)
                    for number, line in zip(numbers[start : start + _BLOCK], some, strict=True)
                ],
                dtype=_row_type(columns, object),
            )
        blocks.append({name: rows[name] for name in columns.place})
    cells = {name: np.concatenate([block[name] for block in blocks]) for name in columns.place}
    empty, zero = np.full(len(lines), np.nan), np.zeros(len(lines))
    v = cells.get("v", empty)
    matrix = np.empty((len(lines), 4), dtype=complex)
    for k, (real, imaginary) in enumerate(
        columns.matrix
    ):  # not by a sum, which would lose the sign of a zero
        matrix[:, k].real, matrix[:, k].imag = cells[real], cells[imaginary]
    return Table(
        line=np.array(numbers),
        op=cells["op"],
        point=np.column_stack([cells["p"], cells["q"], np.where(np.isnan(v), 1.0, v)]),
        repeat=np.nan_to_num(cells.get("repeat", zero)),
        frequency=cells["freq_hz"],
        matrix=matrix.reshape(-1, 2, 2),
        sigma=np.stack([cells[name] for name in columns.sigma], axis=-1)
        if columns.sigma
        else np.empty((len(lines), 0)),
        amplitude=cells.get("amplitude", empty),
    )


def comments_and_body(lines: Sequence[str]) -> tuple[list[tuple[int, str]], list[int]]:
    """Comment lines with their numbers, without the mark, and the numbers of the others that are
    not empty.
    """
    comments = [
        (number, line.lstrip()[1:])
        for number, line in enumerate(lines, 1)
        if line.lstrip().startswith("#")
    ]
    hidden = {number for number, _ in comments}
    return comments, [
        number for number, line in enumerate(lines, 1) if number not in hidden and line.strip()
    ]


def require_body(body: Sequence[int], where: str, *, rows: bool = False) -> None:
    """Raise SweepError unless there is a line of column names, and `rows` below it."""
    if not body:
        raise SweepError(
            f"{where} must hold a line of column names and rows of numbers; found only comments."
        )
    if rows and len(body) == 1:
        raise SweepError(
            f"{where} must hold rows of numbers; found only the column names in line {body[0]}."
        )


def require_cells(fields: Sequence[str], count: int, where: str) -> None:
    """Raise SweepError unless a row has a cell for each column."""
    if len(fields) != count:
        hint = "decimal commas?" if len(fields) > count else "is the line cut off?"
        raise SweepError(
            f"{where} must have {count} values, one per column; found {len(fields)}, {hint}"
        )


def fields_of(number: int, line: str, path: Path) -> list[str]:
    """The cells of a line; SweepError where its quotes do not close."""
    if '"' not in line:
        return [cell_meant(field.strip()) for field in line.split(",")]
    try:
        return [cell_meant(field.strip()) for field in next(csv.reader([line], strict=True))]
    except csv.Error as reason:
        raise SweepError(
            f"{path} line {number} must be comma-separated values; {reason}, check quotes."
        ) from reason


def _rows(lines: Sequence[str], columns: Columns) -> np.ndarray | None:
    """Many rows at once, by column name; None where one might be refused."""
    if not all(map(_plainly_quoted, lines)):
        return None
    empty: dict[int | str, Callable[[str], Any]] = {
        columns.place[name]: _or_nan
        for name in (*OPTIONAL, *columns.sigma)
        if name in columns.place
    }
    for converters in (None, empty):  # a function for each cell takes its time
        try:
            rows = np.loadtxt(
                lines,
                _row_type(columns, f"U{_LONGEST_NAME}"),
                None,
                ",",
                converters,
                ndmin=1,
                quotechar='"',
                encoding=None,
            )
        except ValueError:
            continue
        rows = rows.astype(_row_type(columns, object))
        rows["op"] = [cell_meant(name.strip()) for name in rows["op"]]
        return (
            rows
            if len(rows) == len(lines) and _plausible(rows, columns, converters is not None)
            else None
        )
    return None


def _row_type(columns: Columns, name: object) -> np.dtype:
    return np.dtype([(column, name if column == "op" else float) for column in columns.place])


def _plainly_quoted(line: str) -> bool:
    """Whether nothing but the first cell stands in quotes, so that NumPy and Python read the
    same.
    """
    return '"' not in line or (line[0] == '"' and line.count('"') == 2 and line.find('",', 1) > 0)


def _or_nan(cell: str) -> float:
    value = float(cell) if cell and not cell.isspace() else np.nan
    if "_" in cell or (
        np.isnan(value) and cell.strip()
    ):  # a number to Python, and one that is none
        raise ValueError
    return value


def _plausible(rows: np.ndarray, columns: Columns, gaps: bool) -> bool:
    """Whether `_row` would take every row; gaps : optional cells may be empty."""
    needed = [
        name
        for name in columns.place
        if name != "op" and not (gaps and name in (*OPTIONAL, *columns.sigma))
    ]
    positive = [rows[name] for name in ("freq_hz", "v", *columns.sigma) if name in columns.place]
    if any(not np.isfinite(rows[name]).all() for name in needed) or any(
        (values <= 0).any() for values in positive
    ):
        return False
    if any(np.isinf(rows[name]).any() for name in columns.place if name != "op"):
        return False
    if "repeat" in columns.place and (np.nan_to_num(rows["repeat"]) % 1 != 0).any():
        return False
    try:
        for name in set(rows["op"]):
            OperatingPoint(name, 0.0, 0.0)
            if len(name) >= _LONGEST_NAME:
                return False
    except SweepError:
        return False
    return True


def _row(number: int, fields: list[str], columns: Columns, path: Path) -> tuple:
    where = f"{path} line {number}"
    require_cells(fields, columns.count, where)

    def cell(name: str) -> float:
        return number_of(fields[columns.place[name]], f"{where}: {name}")

    def optional(name: str) -> float:
        return cell(name) if name in columns.place and fields[columns.place[name]] else np.nan

    frequency = cell("freq_hz")
    if frequency <= 0:
        raise SweepError(
            f"{where}: freq_hz must be positive; found {frequency:g}, leave that row out."
        )
    repeat = optional("repeat")
    if repeat % 1 > 0:
        raise SweepError(f"{where}: repeat must be a whole number; found {repeat:g}.")
    sigma = {name: optional(name) for name in columns.sigma}
    if any(value <= 0 for value in sigma.values()):
        raise SweepError(
            f"{where}: sigma must be positive; leave the cell empty where the noise is unknown."
        )
    p, q, v = cell("p"), cell("q"), optional("v")
    try:
        op = OperatingPoint(fields[columns.place["op"]], p, q, 1.0 if np.isnan(v) else v)
    except SweepError as reason:
        raise SweepError(f"{where}: {reason}") from reason
    known = {"op": op.name, "freq_hz": frequency, "repeat": repeat, "p": p, "q": q, "v": v, **sigma}
    known |= {part: cell(part) for pair in columns.matrix for part in pair}
    known["amplitude"] = optional("amplitude")
    return tuple(known[name] for name in columns.place)
