"""Simulink's scopes, a structure with time whose signals stand in arrays of several columns; and
timeseries as structures, each with its own Time and Data.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.measurement.importing.foreign_table import ForeignTable

#: Time and values of a timeseries in a structure, one or several columns of values.
_SERIES_TIME, _SERIES_DATA = re.compile(r"(.*)\.[Tt]ime"), re.compile(r"(.*)\.[Dd]ata(:\d+)?")
_LABEL = re.compile(r"(?:label|title|name): (.+)")


def timeseries_table(table: ForeignTable) -> ForeignTable | None:
    """The signals of several timeseries side by side, called as their structures; None where they
    share no time.
    """
    times = {
        said[1]: name
        for name in table.columns
        if (said := _SERIES_TIME.fullmatch(name)) is not None
    }
    signals = {name: said for name in table.columns if (said := _SERIES_DATA.fullmatch(name))}
    if not times or any(said[1] not in times for said in signals.values()):
        return None
    first, *others = (table.columns[name] for name in times.values())
    if not signals or not all(np.array_equal(first, other) for other in others):
        return None
    columns = {"time": first}
    for name, said in signals.items():
        columns[f"{said[1].rsplit('.', 1)[-1]}{said[2] or ''}"] = table.columns[name]
    return replace(table, columns=columns, numbered=frozenset())


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
