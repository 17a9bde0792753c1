"""Rows of a parameter table: one for each number that was fitted, whether shared or one per
operating point.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from math import pi
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.report.block_diagrams.layering import LONGEST
from ibrid.report.block_diagrams.marks import AT_BOUND, OPEN
from ibrid.report.look.numbers import in_si, interval, more_readable, number
from ibrid.structure.reading.parameters import parameter_table

SHARED = "all"
#: Relative change of a value above which a twin counts as different there.
CHANGED = 1e-3


@dataclass(frozen=True)
class ParameterRow:
    """`where` : operating point, or "all". `readable` : the value in another unit, or "".

    `ends` : 95 % interval or None. `box` : (low, high) or None. `at_bound` : the value lies at an
    end of its box.
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
        seen = {
            (record.parameters[op][name], tuple(record.intervals.get(op, {}).get(name) or ()))
            for op in here
        }
        if len(points) > 1 and len(here) == len(points) and len(seen) == 1:
            rows.append(_row(record, points[0], name, SHARED))
        else:
            rows += [_row(record, op, name, op) for op in here]
    return rows


def parameter_groups(record: Record) -> dict[str, Any]:
    """For a table: `groups`, (name, its rows), and `shared`, whether no row needs to say its
    operating point.
    """
    rows = parameter_rows(record)
    return {
        "groups": [(name, list(group)) for name, group in groupby(rows, key=lambda row: row.name)],
        "shared": len(record.parameters) == 1 or all(row.where == SHARED for row in rows),
    }


def values_of(record: Record) -> dict[str, list[str]]:
    """Module -> its parameters in short lines, two on each; a range where they differ between
    operating points, and marks (`OPEN`, `AT_BOUND`) behind what is not to be relied on.
    """
    if not record.parameters:
        return {}
    bound = {label.split(" at ")[0] for label in record.at_bound}
    unseen = {
        name for ends in record.intervals.values() for name, end in ends.items() if end is None
    }
    wiring = record.wiring
    table = parameter_table(wiring, record.settings["equilibrium"])
    lines = {}
    for name, kind in wiring.kinds.items():
        told = []
        for parameter in kind.parameters:
            values = [
                float(table.value(name, parameter, point)) for point in record.parameters.values()
            ]
            low, high = number(min(values), 3), number(max(values), 3)
            label = table.of(name, parameter)
            mark = OPEN * (label in unseen) + AT_BOUND * (label in bound)
            span = low if low == high else f"{low}…{high}"
            told.append(f"{parameter} {span}{mark}")
        lines[name] = _filled(told)
    return lines


def _filled(words: Sequence[str]) -> list[str]:
    """Words in lines of at most `LONGEST` characters, two on each."""
    lines: list[list[str]] = []
    for word in words:
        if lines and len(lines[-1]) == 1 and len(lines[-1][0]) + 2 + len(word) <= LONGEST:
            lines[-1].append(word)
        else:
            lines.append([word])
    return [", ".join(line) for line in lines]


def values_or_none(record: Record | None) -> dict[str, list[str]]:
    """`values_of` for drawings, which show a record whatever is the matter with it."""
    try:
        return {} if record is None else values_of(record)
    except (IbridError, KeyError, TypeError):
        return {}


def twin_rows(record: Record) -> list[tuple[str, list[float | None]]]:
    """(name, reported value and that of each twin) of what differs between solutions that fit
    equally well.

    Empty for values per operating point: a twin does not say where it belongs, the record's
    sentences do.
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
    unit, meaning = str(box.get("unit", "")), str(box.get("meaning", ""))
    return ParameterRow(
        name=name,
        where=where,
        value=value,
        unit=unit,
        meaning=meaning,
        readable=more_readable(value, unit)
        or (_in_si(record, value, meaning) if unit == "pu" else ""),
        ends=record.intervals.get(op, {}).get(name),
        box=(box["low"], box["high"]) if "low" in box and "high" in box else None,
        at_bound=name in record.at_bound or f"{name} at {op}" in record.at_bound,
    )


def _in_si(record: Record, value: float, meaning: str) -> str:
    """In SI where the measurement said its bases."""
    bases = record.settings.get("bases", {})
    if not bases:
        return ""
    return in_si(
        value,
        meaning,
        bases["v_base_v"] ** 2 / bases["s_base_va"],
        2 * pi * record.settings["f0_hz"],
    )
