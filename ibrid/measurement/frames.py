"""Sweeps from DataFrames and arrays."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import parse_csv
from ibrid.measurement.formats.frd import from_responses
from ibrid.measurement.formats.response_labels import require_d_first
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable, array_table, frame_table
from ibrid.measurement.importing.importing import import_tables
from ibrid.measurement.importing.numbers.number_format import number_format, without_format
from ibrid.measurement.sweeps.sweep import Sweep

#: An axis that counts what was injected.
_INPUT = re.compile("in(?!dex)|col|source|inj|from", re.IGNORECASE)


def sweep_of_data(data: Any, keys: dict[str, Any]) -> Sweep:
    """A sweep from a DataFrame, in the columns of a sweep file or in others (`ibrid import`), or
    from (frequency, matrices).

    Raises SweepError for what is neither, and says what must be told beside it.
    """
    if isinstance(data, tuple | list) and len(data) == 2:
        if not {"p", "q"} <= set(keys):
            raise SweepError(
                "arrays must come with the steady state: read_sweep((frequency, Y), p=0.8, q=0.1)."
            )
        if not np.iscomplexobj(data[1]):
            raise SweepError(
                "the matrices must be complex; found real numbers, give real + 1j * imaginary."
            )
        return from_responses(data[0], data[1], **keys)
    if (network := _of_network(data)) is not None:
        frequency, matrix, told = network
        if not {"p", "q"} <= set(keys):
            raise SweepError(
                "a Network must come with the steady state and the base: "
                "read_sweep(network, p=0.8, q=0.1, s_base_va=10e3, v_base_v=400)."
            )
        return from_responses(frequency, matrix, **{**told, **keys})
    if matrices := _of_xarray(data):
        form = number_format(keys)
        return _imported(array_table(matrices, type(data).__name__, "op", form=form), keys)
    if not isinstance(data, str | Path) and callable(
        to_frame := getattr(data, "to_dataframe", None)
    ):
        data = to_frame()  # xarray
    data = _with_index(data)
    columns = getattr(data, "columns", None)
    if columns is None:
        raise SweepError(
            "read_sweep takes a path, a DataFrame or (frequency, matrices); found "
            f"{type(data).__name__}."
        )
    names = [str(name) for name in columns]
    to_csv = getattr(data, "to_csv", None)
    if {"op", "p", "q", "freq_hz"} <= set(names) and to_csv is not None:
        return parse_csv(
            to_csv(index=False).splitlines(),
            Path("DataFrame"),
            {**getattr(data, "attrs", {}), **keys},
        )
    return _imported(frame_table(data, number_format(keys)), keys)


def _imported(table: ForeignTable, keys: dict[str, Any]) -> Sweep:
    maps = keys.pop("map", ())
    maps = [maps] if isinstance(maps, str) else maps
    return import_tables([table], maps, **without_format(keys)).answered()


def _of_xarray(data: Any) -> dict[str, np.ndarray]:
    """Arrays by name of a DataArray or Dataset that holds a matrix at each frequency, the output
    before the input, with what its attributes tell; empty for anything else.
    """
    if not (hasattr(data, "dims") and hasattr(data, "coords") and hasattr(data, "attrs")):
        return {}
    arrays = {str(name): np.asarray(one) for name, one in data.attrs.items() if np.ndim(one) == 0}
    stacks = False
    for name, variable in dict(
        getattr(data, "data_vars", {getattr(data, "name", ""): data})
    ).items():
        axes = [*map(str, variable.dims)]
        grid = next((axis for axis in axes if meaning_of(axis).role in ("freq", "omega")), "")
        others = [axis for axis in axes if axis != grid]
        if grid not in variable.coords or len(others) != 2:
            arrays[str(name)] = np.asarray(variable.values)
            continue
        others = others[::-1] if _INPUT.match(others[0]) and not _INPUT.match(others[1]) else others
        for axis in others:
            if axis in variable.coords:
                labels = [*map(str, np.asarray(variable.coords[axis].values).tolist())]
                require_d_first(labels, f"{axis} of the {type(data).__name__}")
        arrays[grid] = np.asarray(variable.coords[grid].values)
        arrays[str(name or "matrix")] = np.asarray(variable.transpose(grid, *others).values)
        stacks = True
    return arrays if stacks else {}


def _with_index(data: Any) -> Any:
    """A DataFrame whose named index, frequencies or operating points, is among its columns."""
    names = getattr(getattr(data, "index", None), "names", None)
    reset = getattr(data, "reset_index", None)
    if (
        callable(reset)
        and names
        and any(name is not None and str(name) not in map(str, data.columns) for name in names)
    ):
        return reset()
    return data


def _of_network(data: Any) -> tuple[np.ndarray, np.ndarray, dict[str, str]] | None:
    """Frequencies in Hz, admittances and their unit of a scikit-rf Network; None for anything else.

    As in Touchstone they are in S, but for ports of 1 ohm, which do not say their unit.
    """
    if not (
        hasattr(data, "f") and hasattr(data, "y") and hasattr(data, "z0") and hasattr(data, "s")
    ):
        return None
    if names := getattr(data, "port_names", None):
        require_d_first([*map(str, names)], "port_names of the Network")
    matrix = np.asarray(data.y)
    if matrix.ndim != 3 or matrix.shape[1:] != (2, 2):
        raise SweepError(
            f"a Network must have two ports, d and q; found {matrix.shape[1:]}, take a subnetwork."
        )
    told = {} if np.all(np.asarray(data.z0) == 1) else {"unit": "S"}
    return np.asarray(data.f, dtype=float), matrix, told
