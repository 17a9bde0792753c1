"""Times of a recording in seconds: numbers, durations with a unit in the cell, and clocks of every
kind.
"""

import re
from dataclasses import replace

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.families import Column
from ibrid.measurement.importing.timed.signal_names import without_clock_form

#: Times beyond this, s, are of a clock: the record begins at zero.
_CLOCK = 1e6
#: Unix times of the years 2001 to 2096, s, as programs count them, and the second in their unit.
_UNIX_S = (1e9, 4e9)
_UNIX_UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_STAMP = np.dtype("datetime64[ns]")
_DAY_S = 86400.0
#: The zone of a clock behind a time: hours and minutes ahead of UTC.
_ZONE = re.compile(r"(.*[T ]\d\d:.*?)([-+])(\d\d):?(\d\d)")
#: A time with its unit in the cell, as MATLAB writes durations.
_DURATION = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(sec|s|ms|min|hr)")
_SECONDS = {"sec": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "hr": 3600.0}
#: Hours, minutes and seconds, with anything before them as the date.
_OF_DAY = re.compile(
    r"(.*?)[T\s]*(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,:]\d+)?))?\s*([AaPp])?\.?(?:[Mm]\.?)?"
)
#: Names of columns that hold a date, and of those that hold the time of a day.
_DATES = ("date", "datum", "jour", "fecha", "dia", "día", "日期")
_TIMES = ("time", "uhrzeit", "zeit", "heure", "temps", "hora", "tiempo", "时间")
_FROM_FIRST = "counted from the first sample on"


def times_of(table: ForeignTable, name: str, column: Column) -> tuple[np.ndarray, tuple[str, ...]]:
    """(n,) s, of a clock from its first sample on; and what was assumed.

    Raises SweepError for cells that are no times.
    """
    values = table.columns[name]
    if values.dtype.kind != "f":
        cells = [str(cell).strip() for cell in values.tolist()]
        if (durations := _durations(cells)) is not None:
            return durations, ()
        seconds = _stamps(cells)
        if seconds is None:
            seconds = _seconds_of_day(cells)
        if seconds is None:
            raise SweepError(
                f"{table.where}: column {name} must be times, in s or as 2026-03-01T12:00:00.004; "
                f"found {cells[0][:40]!r}."
            )
        return seconds, (f"its times are those of a clock: {_FROM_FIRST}",)
    first = float(values[0]) if len(values) else 0.0
    if not column.signal.dimension:
        for unit, count in _UNIX_UNITS.items():
            if _UNIX_S[0] * count < first < _UNIX_S[1] * count:
                return (values - values[0]) / count, (
                    f"its times begin at {first:.13g}, {unit} since 1970: {_FROM_FIRST}",
                )
    time = values * column.signal.factor
    if abs(first * column.signal.factor) > _CLOCK:
        return (values - values[0]) * column.signal.factor, (
            f"its times begin at {first:.10g} s: {_FROM_FIRST}",
        )
    return time, ()


def with_date_and_time(table: ForeignTable) -> ForeignTable:
    """The table with dates before times in both columns, where these are apart; all columns keep
    their places, by which they are told.
    """
    texts = {
        without_clock_form(name).strip().lower(): name
        for name, values in table.columns.items()
        if values.dtype.kind not in "fc"
    }
    date = next((texts[word] for word in _DATES if word in texts), None)
    time = next((texts[word] for word in _TIMES if word in texts), None)
    if date is None or time is None:
        return table
    joined = [
        f"{day} {clock}"
        for day, clock in zip(table.columns[date], table.columns[time], strict=True)
    ]
    clock = np.array(joined, dtype=object)
    return replace(
        table,
        columns={**table.columns, date: clock, time: clock},
        made_of=table.made_of | {date, time},
    )


def _durations(cells: list[str]) -> np.ndarray | None:
    """(n,) s of cells such as `0.1 sec`; None where one is something else."""
    read = [_DURATION.fullmatch(cell) for cell in cells]
    if not all(read):
        return None
    return np.array([float(one[1]) * _SECONDS[one[2]] for one in read if one])


def _stamps(cells: list[str]) -> np.ndarray | None:
    """(n,) s from the first of ISO dates and times, perhaps of a zone; None for others."""
    plain = [cell.replace("/", "-").removesuffix("Z") for cell in cells]
    zones = [_ZONE.fullmatch(cell) for cell in plain]
    bare = [zone[1] if zone else cell for zone, cell in zip(zones, plain, strict=True)]
    try:
        stamps = np.array(bare, dtype=_STAMP)
    except ValueError:
        return None
    if any(zones):
        ahead = [f"{zone[2]}{60 * int(zone[3]) + int(zone[4])}" if zone else "0" for zone in zones]
        stamps = stamps - np.array(ahead, dtype=int).astype("timedelta64[m]")
    return (stamps - stamps[0]).astype(np.int64) * 1e-9


def _seconds_of_day(cells: list[str]) -> np.ndarray | None:
    """(n,) s from the first of clocks such as `12:00:00.020` or `3/1/2026 1:02:03.5 PM`, whatever
    the order of day and month: a date that changes, or a clock that starts anew, is the next day.
    None for others.
    """
    read = [_OF_DAY.fullmatch(cell) for cell in cells]
    if not all(read):
        return None
    seconds = np.empty(len(cells))
    days = 0
    before: tuple[str, float] | None = None
    for row, match in enumerate(one for one in read if one):
        date, hours, minutes, rest, half = match.groups(default="")
        hour = int(hours) % 12 + (12 if half in "Pp" else 0) if half else int(hours)
        of_day = 3600.0 * hour + 60.0 * int(minutes) + float(re.sub("[,:]", ".", rest or "0"))
        if before is not None and (date != before[0] or of_day < before[1] - _DAY_S / 2):
            days += 1
        before = (date, of_day)
        seconds[row] = days * _DAY_S + of_day
    return seconds - seconds[0]
