"""Simulink's scopes, a structure with time whose signals stand in arrays of several columns; and
timeseries as structures, each with its own Time and Data; channels of Dewesoft.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.measurement.importing.foreign_table import ForeignTable

#: Time and values of a timeseries in a structure, one or several columns of values; and of a
#: channel of Dewesoft.
_SERIES = (
    (r"(.*)\.time", r"(.*)\.(?:data|signal|values?)(:\d+)?"),
    (r"Data\d*_time_(.*)", r"Data\d*_(?!time_)(.*?)(:\d+)?"),
)
_LABEL = re.compile(r"(?:label|title|name): (.+)")


def timeseries_table(table: ForeignTable) -> ForeignTable | None:
    """The signals of several timeseries side by side, called as their structures; None where they
    share no time.
    """
    for time_of, data_of in _SERIES:
        times, signals = (
            {name: said for name in table.columns if (said := re.fullmatch(one, name, re.I))}
            for one in (time_of, data_of)
        )
        timed = {said[1] for said in times.values()}
        if not signals or (times and not {said[1] for said in signals.values()} <= timed):
            continue
        grids = [table.columns[name] for name in times]
        if not all(np.array_equal(grids[0], grid) for grid in grids):
            continue
        columns = {"time": grids[0]} if grids else {}
        for name, column in table.columns.items():
            if name in signals:
                called, number = signals[name].groups("")
                columns[called.rsplit(".", 1)[-1] + number] = column
            elif not times:
                columns[name] = column
        return replace(table, columns=columns, numbered=frozenset())
    return None


def scope_table(tables: Sequence[ForeignTable]) -> ForeignTable | None:
    """The signals of a structure array side by side, called by their labels; None where they share
    no time.
    """
    if any("time" not in table.columns and "tout" not in table.columns for table in tables):
        return None
    first = tables[0]
    time_name = "time" if "time" in first.columns else "tout"
    time = first.columns[time_name]
    columns: dict[str, np.ndarray] = {"time": time}
    for number, table in enumerate(tables, 1):
        if len(table.line) != len(time) or not np.array_equal(table.columns[time_name], time):
            return None
        label = next(
            (said[1].strip() for note in table.notes if (said := _LABEL.fullmatch(note))),
            f"signal{number}",
        )
        held = [column for name, column in table.columns.items() if name != time_name]
        for k, column in enumerate(held, 1):
            name = f"{label.strip('<>')}:{k}" if len(held) > 1 else label.strip("<>")
            columns[name if name not in columns else f"{name} #{number}"] = column
    where = first.where.rsplit(" ", 1)[0]
    return replace(
        first, where=where, stem=first.stem.split("_")[0], columns=columns, numbered=frozenset()
    )
