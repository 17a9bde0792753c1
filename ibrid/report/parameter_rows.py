"""Rows of a parameter table: one for each number that was fitted, whether shared or one per operating point."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from ibrid.evaluation.record import Record
from ibrid.report.numbers import interval, more_readable, number

SHARED = "all"
#: Relative change of a value above which a twin counts as different there.
CHANGED = 1e-3


@dataclass(frozen=True)
class ParameterRow:
    """`where` : operating point, or "all". `readable` : the value in another unit, or "".

    `ends` : 95 % interval or None. `box` : (low, high) or None. `at_bound` : the value lies at an end of its box.
    """

    name: str
    where: str
    value: float
    unit: str
    meaning: str
    readable: str
    ends: Sequence[float] | None
    box: tuple[float, float] | None
    at_bound: bool

    @property
    def interval(self) -> str:
        """The interval in words."""
        return interval(self.value, self.ends, self.box)

    @property
    def box_words(self) -> str:
        """The box in words."""
        return f"{number(self.box[0], 3)} to {number(self.box[1], 3)}" if self.box else ""


def parameter_rows(record: Record) -> list[ParameterRow]:
    """Rows in the order of the program; a value that all operating points share gives one row."""
    points = list(record.parameters)
    names = dict.fromkeys(name for values in record.parameters.values() for name in values)
    rows = []
    for name in names:
        here = [op for op in points if name in record.parameters[op]]
        seen = {(record.parameters[op][name], _frozen(_ends(record, op, name))) for op in here}
        if len(points) > 1 and len(here) == len(points) and len(seen) == 1:
            rows.append(_row(record, points[0], name, SHARED))
        else:
            rows += [_row(record, op, name, op) for op in here]
    return rows


def parameter_groups(record: Record) -> dict[str, Any]:
    """For a table: `groups`, (name, its rows), and `shared`, whether no row needs to say its operating point."""
    rows = parameter_rows(record)
    return {
        "groups": [(name, list(group)) for name, group in groupby(rows, key=lambda row: row.name)],
        "shared": len(record.parameters) == 1 or all(row.where == SHARED for row in rows),
    }


def twin_rows(record: Record) -> list[tuple[str, list[float | None]]]:
    """(name, reported value and that of each twin) of what differs between solutions that fit equally well.

    Empty for values per operating point: a twin does not say where it belongs, the record's sentences do.
    """
    if not record.twins or record.settings.get("parameters") != "shared":
        return []
    return [
        (name, [value, *(twin.get(name) for twin in record.twins)])
        for name, value in next(iter(record.parameters.values())).items()
        if any(abs(twin.get(name, value) - value) > CHANGED * abs(value) for twin in record.twins)
    ]


def _row(record: Record, op: str, name: str, where: str) -> ParameterRow:
    value, box = record.parameters[op][name], record.boxes.get(name, {})
    unit = str(box.get("unit", ""))
    return ParameterRow(
        name=name,
        where=where,
        value=value,
        unit=unit,
        meaning=str(box.get("meaning", "")),
        readable=more_readable(value, unit),
        ends=_ends(record, op, name),
        box=(box["low"], box["high"]) if "low" in box and "high" in box else None,
        at_bound=name in record.at_bound or f"{name} at {op}" in record.at_bound,
    )


def _ends(record: Record, op: str, name: str) -> Sequence[float] | None:
    return record.intervals.get(op, {}).get(name)


def _frozen(ends: Sequence[float] | None) -> tuple[float, ...] | None:
    return None if ends is None else tuple(ends)
