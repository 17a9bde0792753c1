"""What the guarded process makes of binary files of other programs: arrays by name, cells as text."""

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

#: Text of a missing package, as the sentence ends.
_MISSING = "install {} for it, pip install 'ibrid[tables]'"


def workbook_cells(content: bytes) -> dict[str, np.ndarray]:
    """Every sheet of xlsx, xls or ods as text, by name."""
    calamine = _package("python_calamine")
    book = calamine.CalamineWorkbook.from_filelike(io.BytesIO(content))
    return {name: _as_text(book.get_sheet_by_name(name).to_python()) for name in book.sheet_names}


def parquet_cells(content: bytes) -> dict[str, np.ndarray]:
    """The names and the rows of a table, as text."""
    table = _package("pyarrow.parquet").read_table(io.BytesIO(content))
    rows = list(zip(*(table.column(name).to_pylist() for name in table.column_names), strict=True))
    return {"table": _as_text([table.column_names, *rows])}


def hdf5_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Every array of numbers of an HDF5 file, MATLAB 7.3 among them, by its path; complex numbers as such.

    MATLAB keeps arrays with the first index running fastest, so its arrays come transposed; text comes as codes.
    """
    file = _package("h5py").File(io.BytesIO(content), "r")
    found: dict[str, np.ndarray] = {}

    def take(name: str, item: Any) -> None:
        if name.startswith("#") or not hasattr(item, "shape") or item.dtype.kind == "O":
            return
        value = np.asarray(item[()])
        if value.dtype.names and {"real", "imag"} <= set(value.dtype.names):
            value = value["real"] + 1j * value["imag"]
        matlab = bytes(item.attrs.get("MATLAB_class", b""))
        if matlab:
            value = value.T
        if matlab == b"char":
            value = np.array("".join(chr(int(code)) for code in value.ravel(order="F")))
        if value.dtype.kind in "biufcU":
            found[name.replace("/", ".")] = value

    file.visititems(take)
    return found


def mat_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Every array of numbers or text of a MAT file up to version 7, also in structures, by its path."""
    from scipy.io import loadmat

    return dict(_leaves(loadmat(io.BytesIO(content), struct_as_record=True)))


def _leaves(values: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, np.ndarray]]:
    for name, value in values.items():
        array = np.asarray(value)
        if name.startswith("__"):
            continue
        if array.dtype.names and array.size == 1:
            yield from _leaves({key: array[key].ravel()[0] for key in array.dtype.names}, f"{within}{name}.")
        elif array.dtype.kind in "biufcU":
            yield f"{within}{name}", array


def _as_text(rows: list) -> np.ndarray:
    width = max(map(len, rows), default=0)
    return np.array([[*map(_cell, row), *[""] * (width - len(row))] for row in rows], dtype=str).reshape(-1, width)


def _cell(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return "" if value is None else str(value)
    return repr(value) if isinstance(value, int | float | complex) else str(value).strip()


def _package(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise ImportError(_MISSING.format(name.partition(".")[0])) from None
