"""Sweeps from DataFrames and arrays."""

from pathlib import Path
from typing import Any

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import parse_csv
from ibrid.measurement.formats.frd import from_responses
from ibrid.measurement.importing.foreign_table import frame_table
from ibrid.measurement.importing.importing import import_tables
from ibrid.measurement.sweeps.sweep import Sweep


def sweep_of_data(data: Any, keys: dict[str, Any]) -> Sweep:
    """A sweep from a DataFrame, in the columns of a sweep file or in others (`ibrid import`), or from (frequency, matrices).

    Raises SweepError for what is neither, and says what must be told beside it.
    """
    if isinstance(data, tuple | list) and len(data) == 2:
        if not {"p", "q"} <= set(keys):
            raise SweepError("arrays must come with the steady state: read_sweep((frequency, Y), p=0.8, q=0.1).")
        return from_responses(data[0], data[1], **keys)
    columns = getattr(data, "columns", None)
    if columns is None:
        raise SweepError(f"read_sweep takes a path, a DataFrame or (frequency, matrices); found {type(data).__name__}.")
    names = [str(name) for name in columns]
    to_csv = getattr(data, "to_csv", None)
    if {"op", "p", "q", "freq_hz"} <= set(names) and to_csv is not None:
        return parse_csv(to_csv(index=False).splitlines(), Path("DataFrame"), {**getattr(data, "attrs", {}), **keys})
    maps = keys.pop("map", ())
    return import_tables([frame_table(data)], [maps] if isinstance(maps, str) else maps, **keys).answered()
