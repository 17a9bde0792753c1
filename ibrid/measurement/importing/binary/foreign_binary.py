"""What the guarded process makes of binary files of other programs: arrays by name, cells as
text.
"""

import io
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ibrid.errors import some
from ibrid.foreign_data import json_in
from ibrid.measurement.importing.binary.comtrade_cfg import plain_cfg
from ibrid.measurement.importing.binary.hidden_rows import hidden_rows
from ibrid.measurement.importing.binary.percent_cells import percent_cells
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.models.matlab_objects import CLASSES, classes_among

#: Under which it stands among the sheets what is hidden in a workbook, in words.
HIDDEN = "\0hidden"
#: Behind which, with the name of a sheet, it stands among them which cells are shown in percent.
PERCENT = "\0percent "
#: Empty rows in turn behind which a cell is no part of a table.
FAR_BELOW = 1_000


def workbook_cells(content: bytes) -> dict[str, np.ndarray]:
    """Every sheet of xlsx, xls or ods that is shown and not empty as text, by name; what is hidden,
    and what is shown in percent.
    """
    calamine = package("python_calamine")
    book = calamine.CalamineWorkbook.from_filelike(io.BytesIO(content))
    shown = [
        one.name for one in book.sheets_metadata if one.visible == calamine.SheetVisibleEnum.Visible
    ]
    hidden = [f"sheet {name} is hidden: left out" for name in book.sheet_names if name not in shown]
    for name, rows in hidden_rows(content).items():
        if name in shown:
            hidden.append(
                f"sheet {name} has hidden rows, which are read like the others: {some(rows)}"
            )
    sheets = {name: _as_text(_held(name, book.get_sheet_by_name(name))) for name in shown}
    percent = {PERCENT + name: places for name, places in percent_cells(content).items()}
    return {name: cells for name, cells in sheets.items() if cells.size} | {
        **percent,
        HIDDEN: np.array(hidden, dtype=str),
    }


def _held(name: str, sheet: Any) -> list:
    """The rows of a sheet from cell A1 on; ValueError where a cell stands far below all others."""
    rows, last = [], 0
    before = [""] * (sheet.start[1] if sheet.start else 0)
    for number, row in enumerate(sheet.iter_rows(), 1):
        if any(cell not in ("", None) for cell in row):
            if last and number - last > FAR_BELOW:
                raise ValueError(
                    f"sheet {name} ends in row {last}, but row {number} holds a cell; delete the "
                    "rows between"
                )
            last = number
        elif number - last > FAR_BELOW:
            continue
        rows.append([*before, *row])
    return rows[:last]


def parquet_cells(content: bytes) -> dict[str, np.ndarray]:
    """The names and the rows of a table, as text; a unit among the metadata of a column goes into
    its name.
    """
    table = package("pyarrow.parquet").read_table(io.BytesIO(content))
    rows = list(zip(*(table.column(name).to_pylist() for name in table.column_names), strict=True))
    return {"table": _as_text([[_named(field) for field in table.schema], *rows])}


def _named(field: Any) -> str:
    said = {key.decode(errors="replace"): value for key, value in (field.metadata or {}).items()}
    return with_unit(
        field.name,
        next((str(plain_text(value)) for key, value in said.items() if is_unit(key)), ""),
    )


def is_unit(key: str) -> bool:
    """Whether an attribute of an array or a column is its unit."""
    return key.lower().strip("_") in ("unit", "units")


def with_unit(name: str, unit: str) -> str:
    """The name of a column with its unit, as `meaning_of` reads it; netCDF calls what has none
    1.
    """
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def plain_text(value: Any) -> np.ndarray:
    """A single text, also as bytes, or a number."""
    return np.asarray(value.decode(errors="replace") if isinstance(value, bytes) else value)


def mat_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Every array of numbers or text of a MAT file up to version 7, also in structures and cells,
    by its path.
    """
    from scipy.io import loadmat

    held = loadmat(io.BytesIO(content), struct_as_record=True)
    classes = {CLASSES: np.array(found, dtype=str)} if (found := classes_among(held)) else {}
    plain = {
        name: value
        for name, value in held.items()
        if type(value).__name__ not in ("MatlabOpaque", "MatlabObject")
    }
    return dict(leaves(plain)) | classes


def npz_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Every array of an NPZ file, by its name. Raises ValueError for a member that is none."""
    try:
        held = dict(np.load(io.BytesIO(content), allow_pickle=False))
    except (ValueError, SyntaxError) as error:
        raise ValueError(
            "the header of an array is damaged" if "malformed" in str(error) else str(error)
        ) from None
    if strange := [name for name, one in held.items() if not isinstance(one, np.ndarray)]:
        raise ValueError(f"{strange[0]} in it is no array of NumPy")
    return {
        name: np.char.decode(one, errors="replace") if one.dtype.kind == "S" else one
        for name, one in held.items()
    }


def _with_parts_apart(columns: dict[str, Any]) -> dict[str, Any]:
    """Columns of complex numbers, written [re, im] or {"re": .., "im": ..}, as columns of parts."""
    apart: dict[str, Any] = {}
    for name, column in columns.items():
        cells = column if isinstance(column, list) else []
        if cells and all(isinstance(cell, list) and len(cell) == 2 for cell in cells):
            for part, place in (("re", 0), ("im", 1)):
                apart[f"{name}_{part}"] = [cell[place] for cell in cells]
        elif cells and all(isinstance(cell, dict) and len(cell) == 2 for cell in cells):
            parts = list(cells[0])
            if any(cell.keys() != cells[0].keys() for cell in cells):
                raise ValueError(f"{name[:40]!r} must hold objects with the same two names")
            for part in parts:
                apart[f"{name}_{part}"] = [cell[part] for cell in cells]
        else:
            apart[name] = column
    return apart


def json_cells(content: bytes) -> dict[str, np.ndarray]:
    """Records, or lists by name with single numbers beside them, as a table with names, as text;
    objects of such lists as a table each, by their name.

    Every name of any record is a column, with empty cells where a record lacks it. An object of
    single values, such as {"meta": {"f0_hz": 60}}, becomes lines of comments above.
    """
    held = _points_by_name(json_in(content))
    if isinstance(held, list):
        return {"table": _as_text(_rows_of_lists(_of_records(held)))}
    if not isinstance(held, dict):
        raise ValueError("it is a single value")
    tables = {name: one for name, one in held.items() if _is_table(one)}
    beside = {name: one for name, one in held.items() if name not in tables}
    if not tables:
        return {"table": _as_text(_with_comments(held))}
    if any(isinstance(one, list) for one in beside.values()):
        raise ValueError(f"it holds lists beside {min(tables)[:40]!r}, which is a table of its own")
    return {name: _as_text(_with_comments({**beside, **one})) for name, one in tables.items()}


def json_stacks(content: bytes) -> dict[str, np.ndarray]:
    """Arrays by their paths, where one of them is a matrix at each frequency in nested lists; else
    none. Operating points in a list are elements, as of a structure array.
    """
    arrays = {}
    for path, value in _by_path(_parts_joined(json_in(content))):
        try:
            array = np.asarray(value)
            array = array.astype(float) if array.dtype.kind == "O" else array
        except (ValueError, TypeError):
            raise ValueError(f"{path[:40]!r} must hold numbers in lists of one length") from None
        if array.ndim == 4 and array.shape[-1] == 2:
            array = array[..., 0] + 1j * array[..., 1]
        arrays[path] = array
    return arrays if any(array.ndim == 3 for array in arrays.values()) else {}


def _parts_joined(held: Any) -> Any:
    """Complex numbers in place of {"re": 1, "im": 2}, and lists by name in place of records at one
    frequency each.
    """
    if isinstance(held, list):
        held = [_parts_joined(one) for one in held]
        rows = bool(held) and all(isinstance(one, dict) for one in held)
        return _turned(held) if rows and _is_row(held[0]) else held
    if not isinstance(held, dict):
        return held
    held = {name: _parts_joined(one) for name, one in held.items()}
    numbers = {meaning_of(name).role: one for name, one in held.items() if _is_number(one)}
    if len(held) == 2 and numbers.keys() == {"re", "im"}:
        return complex(numbers["re"], numbers["im"])
    return held


def _turned(records: list[Any]) -> dict[str, Any]:
    """Lists by name, at any depth, of records with the same names."""
    columns = {name: [one.get(name) for one in records] for name in records[0]}
    return {
        name: _turned(column) if all(isinstance(one, dict) for one in column) else column
        for name, column in columns.items()
    }


def _by_path(held: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values and lists with their paths: Y_dd_re of {"Y": {"dd": {"re": [..]}}}, data.freq of
    {"data": {"freq": [..]}}, op(1).p of {"op": [{"p": 1}]}.
    """
    if isinstance(held, dict):
        for name, value in held.items():
            known = isinstance(value, dict) and any(meaning_of(f"{name}_{n}").role for n in value)
            mark = "" if not isinstance(value, dict) else "_" if known else "."
            yield from _by_path(value, path + name + mark)
    elif isinstance(held, list) and held and all(isinstance(one, dict) for one in held):
        for number, one in enumerate(held, 1):
            yield from _by_path(one, f"{path}({number}).")
    else:
        yield path, held


def _points_by_name(held: Any) -> Any:
    """Tables that stand in a list, alone or under one name, by their own names or numbers."""
    if isinstance(held, dict):
        lists = [one for one in held.values() if isinstance(one, list)]
        beside = {name: one for name, one in held.items() if not isinstance(one, list)}
        points = lists[0] if len(lists) == 1 else []
    else:
        beside, points = {}, held if isinstance(held, list) else []
    if not points or not all(_is_table(one) for one in points):
        rows = len(points) > 1 and all(isinstance(one, dict) for one in points)
        return {**beside, **_of_records(points)} if rows else held
    named = {}
    for number, one in enumerate(points, 1):
        name = str(one.get("name") or one.get("op") or f"point_{number}")
        named[f"{name}_{number}" if name in named else name] = one
    return {**beside, **named}


def _is_table(value: Any) -> bool:
    """Whether an object holds lists of its own, more than the two parts of an entry."""
    if not isinstance(value, dict):
        return False
    if _is_row(value):
        return False
    return sum(isinstance(one, list | dict) for one in _lists_within("", value).values()) > 2


def _is_row(value: dict[str, Any]) -> bool:
    """Whether an object is what was measured at one frequency."""
    return any(_is_number(value[key]) for key in value if _is_frequency(key))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _with_comments(held: dict[str, Any]) -> list[Any]:
    """Rows of lists by name, below a line for each value of an object that holds no list."""
    lists: dict[str, Any] = {}
    comments = []
    for name, value in held.items():
        if not isinstance(value, dict):
            lists[name] = value
        elif inner := _lists_within(name, value):
            lists |= inner
        else:
            comments += _comments_of(value)
    return [*comments, *_rows_of_lists(lists)]


def _comments_of(held: dict[str, Any]) -> list[list[str]]:
    """A line for each value of an object, and of the objects in it."""
    lines: list[list[str]] = []
    for key, value in held.items():
        lines += _comments_of(value) if isinstance(value, dict) else [[f"# {key}: {value}"]]
    return lines


def _is_frequency(name: str) -> bool:
    return meaning_of(name).role in ("freq", "omega")


def _lists_within(name: str, value: dict[str, Any]) -> dict[str, Any]:
    """The parts of an object that holds lists at any depth, Y_dd_re of {"dd": {"re": [..]}}, else
    nothing; those of one with frequencies, which wraps a sweep, under their own names.
    """
    known = any(meaning_of(f"{name}_{key}").role or not meaning_of(key).role for key in value)
    before = f"{name}_" if known and not any(map(_is_frequency, value)) else ""
    parts: dict[str, Any] = {}
    for key, part in value.items():
        inner = _lists_within(before + key, part) if isinstance(part, dict) else {}
        parts |= inner or {before + key: part}
    return parts if any(isinstance(part, list) for part in parts.values()) else {}


def _rows_of_lists(held: dict[str, Any]) -> list[Any]:
    """The names, then a row for each place of the lists, with single values in all of them."""
    columns = _with_parts_apart(held)
    for name, column in columns.items():
        cells = column if isinstance(column, list) else [column]
        if any(isinstance(cell, list | dict) for cell in cells):
            raise ValueError(
                f"{name[:40]!r} must hold numbers or texts, found lists or objects in it"
            )
    lengths = {len(column) for column in columns.values() if isinstance(column, list)}
    if len(lengths) != 1:
        several = " and ".join(map(str, sorted(lengths)[:3]))
        raise ValueError(
            f"it holds lists of {several} cells, must be equally long"
            if lengths
            else "it holds no list"
        )
    count = lengths.pop()
    rows = zip(
        *(column if isinstance(column, list) else [column] * count for column in columns.values()),
        strict=True,
    )
    return [list(columns), *rows]


def _of_records(records: list[Any]) -> dict[str, list[Any]]:
    """Columns by name; ValueError for what is no record."""
    for number, record in enumerate(records, 1):
        if not isinstance(record, dict):
            raise ValueError(
                f"element {number} of its list must be an object with names, found another value"
            )
    names = dict.fromkeys(name for record in records for name in record)
    return {name: [record.get(name) for record in records] for name in names}


#: A number that as text might be one of thousands; a zero more, and it is none.
_THREE_DECIMALS = re.compile(r"-?[1-9]\d{0,2}\.\d{3}")
#: A sample that is missing in COMTRADE text.
_MISSING = "99999"
#: Units as words.
_WORD = re.compile(r"\s*(k|m|)(?:(v)olts?|(a)mp(?:ere)?s?)\s*", re.I)


def comtrade_arrays(content: bytes) -> dict[str, np.ndarray]:
    """The analog channels of a COMTRADE record: eight bytes with the length of the configuration,
    it, the samples.

    time (n,) s; value (channels, n) with their factors and offsets applied, NaN where missing; low
    and high (channels,), the ends of their range; skew (channels,) s; ratio (channels,), what turns
    them to primary values, NaN where that is not said; name, unit, phase; frequency. stamp (n,),
    the times that stand beside text samples, in units of their own; empty where there
    are none. lost, beyond, left_out : how many samples are announced and not there, are not
    announced and read, or neither.
    """
    length = int.from_bytes(content[:8], "big")
    head, data = content[8 : 8 + length], content[8 + length :]
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = head.decode("cp1252", errors="replace")
    plain = plain_cfg(text, data)
    record = package("comtrade", "comtrade").Comtrade(
        ignore_warnings=True, use_numpy_arrays=True, use_double_precision=True
    )
    samples = _cells_stripped(data) if "\nASCII\n" in plain.text else data
    record.read(plain.text, samples)
    channels = record.cfg.analog_channels
    value = np.array(record.analog, dtype=float)
    value[np.abs(value) > 1e30] = np.nan  # how FLOAT32 says that a sample is missing
    return {
        "stamp": _stamps(samples) if isinstance(samples, str) else np.zeros(0),
        "time": np.asarray(record.time, dtype=float),
        "value": value,
        "low": np.array([one.a * one.cmin + one.b for one in channels]),
        "high": np.array([one.a * one.cmax + one.b for one in channels]),
        "factor": np.array([[one.a, one.b] for one in channels], dtype=float).reshape(-1, 2),
        "skew": np.array([one.skew * 1e-6 for one in channels]),
        "ratio": np.array(
            [
                c.primary / (c.secondary or np.nan) or np.nan if c.pors == "S" else 1.0
                for c in channels
            ]
        ),
        "name": np.array([one.name for one in channels], dtype=str),
        "unit": np.array([_WORD.sub(r"\1\2\3", one.uu) for one in channels], dtype=str),
        "phase": np.array([one.ph for one in channels], dtype=str),
        "frequency": np.array(record.frequency),
        "lost": np.array(plain.missing),
        "beyond": np.array(plain.beyond),
        "left_out": np.array(plain.left_out),
    }


def _cells_stripped(data: bytes) -> str:
    """Samples as text without blank lines and padding, an empty cell as the mark of a missing
    one.
    """
    lines = data.decode("latin-1").replace("\x1a", "").splitlines()
    rows = [[cell.strip() for cell in line.split(",")] for line in lines if line.strip(" ,\t\0")]
    return "\n".join(",".join([*row[:2], *(cell or _MISSING for cell in row[2:])]) for row in rows)


def _stamps(samples: str) -> np.ndarray:
    """The second column; empty where a row has none."""
    cells = [line.split(",")[1:2] for line in samples.splitlines()]
    whole = all(cell and cell[0].lstrip("-").isdigit() for cell in cells)
    return np.array([float(cell[0]) for cell in cells]) if whole else np.zeros(0)


def leaves(values: Mapping[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """The arrays of numbers and texts in arrays by name, structures and cells of MATLAB among
    them.
    """
    for name, value in values.items():
        array = np.asarray(value)
        matrix = _of_cells(array)
        if matrix is not None:
            yield name, matrix
        elif array.dtype.names or array.dtype.kind == "O":
            for k, element in enumerate(array.ravel(order="F"), 1):
                in_cell = array.dtype.kind == "O" and not getattr(
                    getattr(element, "dtype", None), "names", None
                )
                place = name if array.size == 1 else f"{name}{{{k}}}" if in_cell else f"{name}({k})"
                inner = {f"{place}.{key}": element[key] for key in array.dtype.names or ()} or {
                    place: element
                }
                yield from leaves(
                    {key: item for key, item in inner.items() if isinstance(item, np.ndarray)}
                )
        elif not name.startswith("__") and array.dtype.kind in "biufcU":
            yield name, array


def _of_cells(cells: np.ndarray) -> np.ndarray | None:
    """The cell array {Ydd, Ydq; Yqd, Yqq} with K numbers in each, or K cells of 2 x 2, as (2, 2,
    K); None for any other.
    """
    inner = [
        one for one in cells.ravel() if isinstance(one, np.ndarray) and one.dtype.kind in "biufc"
    ]
    if cells.dtype.kind != "O" or cells.size < 2 or len(inner) < cells.size:
        return None
    if cells.size == max(cells.shape) and {one.shape for one in inner} == {(2, 2)}:
        return np.stack(inner, axis=-1)
    sizes = {one.size for one in inner} | {max(one.shape, default=1) for one in inner}
    vectors = cells.shape == (2, 2) and len(sizes) == 1
    return np.stack([one.ravel() for one in inner]).reshape(2, 2, -1) if vectors else None


def _as_text(rows: list) -> np.ndarray:
    width = max(map(len, rows), default=0)
    return np.array(
        [[*map(_cell, row), *[""] * (width - len(row))] for row in rows], dtype=str
    ).reshape(len(rows), width)


def _cell(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return "" if value is None else str(value)
    text = repr(value) if isinstance(value, int | float | complex) else str(value).strip()
    return f"{text}0" if isinstance(value, float) and _THREE_DECIMALS.fullmatch(text) else text


def package(name: str, extra: str = "tables") -> Any:
    """A package that an extra installs; ImportError says how."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise ImportError(f"install {package} for it, pip install 'ibrid[{extra}]'") from None
