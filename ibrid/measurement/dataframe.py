"""Sweeps, events and what is found in them as pandas DataFrames."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import ModuleType, NoneType
from typing import Any

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.measurement.formats.event_csv import event_csv
from ibrid.measurement.quality.event_inspection import EventsInspection
from ibrid.measurement.quality.inspect import Inspection, PointInspection
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep

#: What an inspection tells of a point or a record in one cell.
_PLAIN = (str, int, float, NoneType)
_ATTRIBUTES = ("f0_hz", "power_node", "s_base_va", "v_base_v", "sampling_hz", "solver", "window")


def dataframe(data: Sweep | Events) -> Any:
    """See `Sweep.to_dataframe`."""
    pandas = _pandas(f"write the {type(data).__name__.lower()} to a CSV file")
    text = event_csv(data) if isinstance(data, Events) else sweep_csv(data)
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    frame = pandas.read_csv(
        io.StringIO("\n".join(lines)), engine="python"
    )  # exact to the last digit
    said = {name: getattr(data, name, None) for name in _ATTRIBUTES}
    frame.attrs.update({name: value for name, value in said.items() if value is not None})
    return frame


def inspection_frame(inspection: Inspection | EventsInspection) -> Any:
    """See `Inspection.to_dataframe`: the numbers and words of each point or record that fit a
    cell, after its name, p, q and v.
    """
    rows = []
    is_sweep = isinstance(inspection, Inspection)
    for part in inspection.points if is_sweep else inspection.records:
        rest = part.op if isinstance(part, PointInspection) else part.rest
        told = {one.name: getattr(part, one.name) for one in fields(part)}
        cells = {name: value for name, value in told.items() if isinstance(value, _PLAIN)}
        rows.append({"op": rest.name, "p": rest.p, "q": rest.q, "v": rest.v, **cells})
    return _pandas("take to_json()").DataFrame(rows).set_index("op")


def table_frame(rows: Sequence[Mapping[str, Any]]) -> Any:
    """A DataFrame of rows that have the same columns."""
    return _pandas("take the JSON").DataFrame([*rows])


def _pandas(otherwise: str) -> ModuleType:
    try:
        import pandas
    except ImportError:
        raise SweepError(
            f"a DataFrame is made by pandas; pip install pandas, or {otherwise}."
        ) from None
    return pandas
