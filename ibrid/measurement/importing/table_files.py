"""The tables in a file: text with any separator, workbooks, Parquet, MATLAB, HDF5, NPZ and JSON;
models as their response.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.foreign_data import json_in
from ibrid.measurement.formats.bundle import stem_of, suffix_of
from ibrid.measurement.formats.files import decoded, read_bytes, require_short_lines
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.binary import foreign_binary as binary
from ibrid.measurement.importing.binary.hdf5_file import hdf5_arrays
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_table import (
    ForeignTable,
    array_table,
    data_rows,
    rows_table,
    text_table,
)
from ibrid.measurement.importing.models.matlab_objects import refuse_objects
from ibrid.measurement.importing.models.state_spaces import state_space_tables
from ibrid.measurement.importing.numbers.number_format import UNSAID, NumberFormat
from ibrid.measurement.importing.numbers.percent import scaled_once, shown_beside_names
from ibrid.measurement.importing.shapes.parts_of_text import blocks_of, labview_named

_HDF5 = b"\x89HDF"
#: Lists in lists, of JSON.
_NESTED = re.compile(rb"\[\s*+\[")
#: How a file begins, or how its name ends: what reads it, and what it must be.
_MAKES = {
    _HDF5: (hdf5_arrays, "an HDF5 file"),
    ".mat": (binary.mat_arrays, "a MAT file"),
    ".npz": (binary.npz_arrays, "an NPZ file of plain arrays"),
    ".json": (binary.json_cells, "a list of records or lists of numbers by name"),
    b"PAR1": (binary.parquet_cells, "a Parquet file"),
    b"PK\3\4": (binary.workbook_cells, "a workbook (xlsx, xls, ods)"),
    b"\xd0\xcf\x11\xe0": (binary.workbook_cells, "a workbook (xlsx, xls, ods)"),
}
#: The format of a trace above it, and by its first letter the unit.
_FORMAT = re.compile(r'^"?FORMAT:\s*"?([^"\n]+?)"?\s*$', re.MULTILINE)
_OF_FORMATS = {**dict.fromkeys("ZRX", "ohm"), **dict.fromkeys("YGB", "S"), "T": "deg"}
#: Lines of a table as text.
MOST_LINES = 500_000


def read_tables(
    path: Path, at: np.ndarray | None = None, form: NumberFormat = UNSAID
) -> list[ForeignTable]:
    """The tables of a file: one, but for a workbook with several sheets. SweepError says why there
    is none.

    at : Hz at which a model is sampled, where somebody says. form : how numbers are written.
    """
    content, whole = read_bytes(path), stem_of(path)
    if not content.strip():
        raise SweepError(f"{path} must hold a sweep or records of events; found an empty file.")
    begin = _HDF5 if _HDF5 in (content[:4], content[512:516]) else content[:4]
    where, made = (
        str(path),
        _MAKES.get(_HDF5 if begin == _HDF5 else suffix_of(path)) or _MAKES.get(begin),
    )
    if made is None:
        blocks = blocks_of(labview_named(_lines_of(content, where)))
        tables = [
            text_table(lines, where, f"{whole} {k + 1}" if k else whole, form, before)
            for k, (before, lines) in enumerate(blocks)
        ]
        return traces_joined(tables)
    if made[0] is binary.json_cells and (
        models := state_space_tables(json_model(content), where, whole, at)
    ):
        return models
    if made[0] is binary.json_cells and _NESTED.search(content):
        stacks = guarded(binary.json_stacks, content, f"{where} must be {made[1]}")
        if stacks:
            return _of_arrays(stacks, where, whole, False, form)
    sheets = guarded(made[0], content, f"{where} must be {made[1]}")
    if made[0].__name__.endswith("_arrays"):
        refuse_objects(sheets, where)
        if models := state_space_tables(sheets, where, whole, at):
            return models
        of_matlab = made[0] is binary.mat_arrays or content.startswith(b"MATLAB")
        return _of_arrays(sheets, where, whole, of_matlab, form)
    remarks = tuple(sheets.pop(binary.HIDDEN, np.zeros(0, dtype=str)).tolist())
    percent = {
        name: {*map(tuple, sheets.pop(binary.PERCENT + name, np.zeros((0, 2), int)).tolist())}
        for name in [*sheets]
        if not name.startswith(binary.PERCENT)
    }
    sheets = {name: one for name, one in sheets.items() if not name.startswith(binary.PERCENT)}
    held = {
        name: [(n, [*map(str, row)]) for n, row in enumerate(cells.tolist(), 1)]
        for name, cells in sheets.items()
    }
    comma = form.mark == ","
    held = {name: rows for name, rows in held.items() if data_rows(rows, comma)}
    if not held:
        raise SweepError(
            f"{where} must hold rows of numbers; found none in {', '.join([*sheets, *remarks])}."
        )
    several, book, tables = len(held) > 1, made[0] is binary.workbook_cells, []
    for name, rows in held.items():
        before = "cell " if several else f"sheet {name}, cell "
        first = min(k for _, cells in rows for k, cell in enumerate(cells) if cell)
        rows = shown_beside_names(rows, percent[name])
        rows = [(number, cells[first:]) for number, cells in rows]
        called = (
            [before + _letters(k) for k in range(first, first + len(rows[0][1]))] if book else []
        )
        place, stem = (f"{where} sheet {name}", name) if several else (where, whole)
        table = rows_table(rows, [], place, stem, comma, form, called=called, alike=False)
        places = [first + called.index(cell) for cell in table.cells.values()]
        table = scaled_once(table, percent[name], places)
        tables.append(replace(table, book=whole * several, remarks=(*remarks, *table.remarks)))
    return tables


def traces_joined(tables: list[ForeignTable]) -> list[ForeignTable]:
    """The traces of an impedance analyser, whose format stands above each (`FORMAT: |Z|`), side by
    side; other tables as they are.
    """
    formats = [[*{*_FORMAT.findall("\n".join(table.notes))}] for table in tables]
    columns: dict[str, np.ndarray] = {}
    for table, form in zip(tables, formats, strict=True):
        name, *parts = table.columns
        held = [table.columns[part] for part in parts]
        if len(form) != 1 or not 1 <= len(parts) <= 2 or {one.dtype.kind for one in held} != {"f"}:
            return tables
        grid = table.columns[name]
        if not np.array_equal(columns.setdefault(name, grid), grid):
            return tables
        unit = _OF_FORMATS.get(form[0].strip("|")[:1].upper(), "")
        names = [f"{form[0]} [{unit}]" if unit else form[0]]
        if len(held) == 2 and held[1].any():
            names = ["G [S]", "B [S]"] if unit == "S" else ["R [ohm]", "X [ohm]"]
        if columns.keys() & {*names}:
            return tables
        columns |= dict(zip(names, held, strict=False))
    return [replace(tables[0], columns=columns)]


def json_model(content: bytes) -> dict[str, np.ndarray]:
    """A, B, C, D and what stands beside them in JSON, as arrays; empty where there is no A, or it
    is no JSON.
    """
    if b'"A"' not in content or b'"D"' not in content:
        return {}
    try:
        held = json_in(content)
        point = held.get("operating_point") or {}
        plain = {**held, **{"op" if key == "name" else key: value for key, value in point.items()}}
        arrays = {
            str(name): np.asarray(value)
            for name, value in plain.items()
            if isinstance(value, list | str | int | float)
        }
    except (ValueError, AttributeError):
        return {}
    return {name: value for name, value in arrays.items() if value.dtype.kind in "iufU"}


def _letters(column: int) -> str:
    """How a workbook calls a column: A .. Z, AA .."""
    more, last = divmod(column, 26)
    return (_letters(more - 1) if more else "") + chr(ord("A") + last)


def _of_arrays(
    arrays: dict[str, np.ndarray], where: str, stem: str, of_matlab: bool, form: NumberFormat
) -> list[ForeignTable]:
    """A table for each element of a structure array, or for each of several groups with arrays of
    the same names, with what stands beside them; else one.
    """
    elements = dict.fromkeys(re.findall(r"^.*?\(\d+\)(?=\.)", "\n".join(arrays), re.MULTILINE))
    elements = list(elements) or _groups_alike(arrays) or [""]
    tables = []
    for element in elements:
        others = tuple(f"{other}." for other in elements if other != element)
        own = {
            n.removeprefix(f"{element}."): v
            for n, v in arrays.items()
            if n.startswith(f"{element}.") or not n.startswith(others)
        }
        place, named = f"{where} {element}".strip(), f"{stem}_{element}".strip("_")
        table = array_table(own, place, named, of_matlab=of_matlab, form=form)
        tables.append(replace(table, op=_op_of(own) if len(elements) > 1 else ""))
    several = len({table.op for table in tables}) == len(tables)
    return tables if several else [replace(table, op="") for table in tables]


def _op_of(arrays: dict[str, np.ndarray]) -> str:
    """The name of the operating point among arrays of an element; "" where there is none."""
    texts = {n.rpartition(".")[2]: str(v.ravel()[0]) for n, v in arrays.items() if v.size == 1}
    return next((text for name, text in texts.items() if meaning_of(name).role == "op"), "")


def _groups_alike(arrays: dict[str, np.ndarray]) -> list[str]:
    """Paths of groups of which each has frequencies and other arrays, by the same names; none where
    there is but one.
    """
    held: dict[str, set[str]] = {}
    for path, value in arrays.items():
        group, _, name = path.rpartition(".")
        if group and value.dtype.kind in "iufc" and value.size > 1:
            held.setdefault(group, set()).add(name)
    names = list(held.values())
    alike = len(held) > 1 and len(names[0]) > 1 and all(one == names[0] for one in names)
    is_sweep = alike and any(meaning_of(name).role in ("freq", "omega") for name in names[0])
    return list(held) if is_sweep else []


def _lines_of(content: bytes, where: str) -> list[str]:
    text = decoded(content)
    if "\0" in text:
        raise SweepError(
            f"{where} must be a table as text, a workbook, Parquet, MAT or HDF5; found other bytes."
        )
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    require_short_lines(lines, where)
    if len(lines) > MOST_LINES:
        raise SweepError(
            f"{where} must have at most {MOST_LINES:,} lines; found {len(lines):,}, keep every "
            "tenth row, or one record."
        )
    return lines
