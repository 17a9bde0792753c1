"""Sweeps from DataFrames and arrays."""

from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import parse_csv
from ibrid.measurement.formats.frd import from_responses
from ibrid.measurement.formats.response_labels import require_d_first
from ibrid.measurement.importing.foreign_table import frame_table
from ibrid.measurement.importing.importing import import_tables
from ibrid.measurement.importing.numbers.number_format import number_format, without_format
from ibrid.measurement.sweeps.sweep import Sweep


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
    maps = keys.pop("map", ())
    maps = [maps] if isinstance(maps, str) else maps
    form, keys = number_format(keys), without_format(keys)
    return import_tables([frame_table(data, form)], maps, **keys).answered()


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
