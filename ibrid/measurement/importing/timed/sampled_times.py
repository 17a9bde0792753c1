"""Recordings without a column of times: a sampling interval or rate above the numbers makes them.

Yokogawa's text has names, units and sampling of its channels in rows, each behind a word for what
the row holds.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.families import columns_taken
from ibrid.measurement.importing.timed.signal_names import size_of

_NUMBER = r"(\d*[.,]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)"
_INTERVAL_WORDS = (
    r"sampl\w*[ _-]*(?:interval|period|time)|time[ _-]?(?:interval|step|increment)|"
    r"x?[ _-]?increment|h[ _-]?resolution|delta[ _-]?[xt]|Δt|dt|abtast(?:intervall|zeit|periode)|"
    r"(?:p[ée]riode|intervalle) d['’ e]*[ée]chantillonnage|per[ií]odo de muestreo|采样(?:间隔|周期)"
)
_RATE_WORDS = (
    r"sampl\w*[ _-]*(?:rate|freq\w*)|sampled at|fs|abtast(?:rate|frequenz)|"
    r"(?:fr[ée]quence|taux) d['’ e]*[ée]chantillonnage|frecuencia de muestreo|采样(?:率|频率)"
)
_UNIT = r"(?:\s*[\[(]\s*([\w/]+)\s*[\])])?"
_TOLD = r"(?<![^\W_])(?:{words}){unit}\s*[:=,;\t]?\s*{number}\s*([\w/µ]*)"
_INTERVAL = re.compile(
    _TOLD.format(words=_INTERVAL_WORDS, unit=_UNIT, number=_NUMBER), re.IGNORECASE
)
_RATE = re.compile(_TOLD.format(words=_RATE_WORDS, unit=_UNIT, number=_NUMBER), re.IGNORECASE)
#: Samples per second, after their prefix.
_SAMPLES = re.compile(r"([kMG]?)(?:S|Sa|samples)/s(?:ec)?|([kMG]?)sps", re.IGNORECASE)
#: Rows of Yokogawa's text.
_NAMES, _UNITS, _STEP, _BEGIN = "tracename", "vunit", "hresolution", "hoffset"
_TIME_UNIT = "hunit"
_MARK = re.compile(r"[,;\t]")
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}


def sampling_told(lines: Sequence[str]) -> tuple[float, str] | None:
    """The interval between samples, s, that lines above numbers tell, and the line; None where none
    does.
    """
    for line in lines:
        plain = line.replace('"', "")
        if (told := _INTERVAL.search(plain)) and (step := _seconds(told)) > 0:
            return step, plain.strip()
        if (told := _RATE.search(plain)) and (rate := _hertz(told)) > 0:
            return 1 / rate, plain.strip()
    return None


def _seconds(told: re.Match[str]) -> float:
    size = size_of(told[1] or told[3]) or ("time", 1.0)
    return _number(told[2]) * size[1] if size[0] == "time" else 0.0


def _hertz(told: re.Match[str]) -> float:
    unit = told[1] or told[3]
    if samples := _SAMPLES.fullmatch(unit):
        return _number(told[2]) * _PREFIXES[(samples[1] or samples[2] or "").lower()]
    size = size_of(unit) or ("frequency", 1.0)
    return _number(told[2]) * size[1] if size[0] == "frequency" else 0.0


def _number(digits: str) -> float:
    try:
        return float(digits.replace(",", "."))
    except ValueError:
        return 0.0


def with_sampled_times(table: ForeignTable, told: Mapping[str, str]) -> ForeignTable:
    """The table with a column of times behind its own where it has none and its sampling is told;
    with the names of its channels where they stand in a row of their own.

    told : role -> number or name of a channel, as `--channels` says.

    Raises SweepError where channels were sampled in different ways.
    """
    rows = _rows_of_channels(table)
    table = _with_names(table, rows)
    if "t" in told or "t" in columns_taken(list(table.columns), {}, table.where):
        return table
    sampling = sampling_told(table.notes)
    if sampling is None:
        return table
    step, line = sampling
    steps = {*filter(None, rows.get(_STEP, []))}
    if len(steps) > 1:
        raise SweepError(
            f"{table.where} must hold channels of one sampling interval; found {some(steps)}, "
            "export those of one interval alone."
        )
    time = _first_time(rows) + step * np.arange(len(table.line))
    remark = f"times made of a sample each {step:.6g} s, from {line[:60]!r}"
    columns = {**table.columns, "t [s]": time}
    return replace(table, columns=columns, remarks=(*table.remarks, remark))


def is_sampled_block(lines: Sequence[str]) -> bool:
    """Whether lines are the head of a text whose rows name channels and their sampling."""
    words = {_MARK.split(line.strip(), maxsplit=1)[0].strip('" ').lower() for line in lines}
    return {_NAMES, _STEP} <= words


def _rows_of_channels(table: ForeignTable) -> dict[str, list[str]]:
    """Word of a row -> its cells, one for each column with numbers; empty for other tables."""
    rows: dict[str, list[str]] = {}
    if not is_sampled_block(table.notes):
        return rows
    for note in table.notes:
        cells = [cell.strip('" ') for cell in _MARK.split(note)]
        word = cells[0].lower()
        is_known = word in (_NAMES, _UNITS, _STEP, _BEGIN, _TIME_UNIT)
        if is_known and rows.setdefault(word, cells[1:]) != cells[1:]:
            raise SweepError(
                f"{table.where} must hold one block of channels; found several, export them as "
                "files of their own."
            )
    return rows


def _with_names(table: ForeignTable, rows: Mapping[str, list[str]]) -> ForeignTable:
    """The table with the columns that hold numbers, called as the row of names says."""
    held = {
        name: column
        for name, column in table.columns.items()
        if column.dtype.kind != "f" or np.isfinite(column).any()
    }
    names = [name for name in rows.get(_NAMES, []) if name]
    units = rows.get(_UNITS, [])
    if not names or len(names) != len(held):
        return table
    called = names
    if len(units) >= len(names):
        pairs = zip(names, units[: len(names)], strict=True)
        called = [f"{name} [{unit}]" if unit else name for name, unit in pairs]
    if len({*called}) < len(called):
        return table
    return replace(table, columns=dict(zip(called, held.values(), strict=True)))


def _first_time(rows: Mapping[str, list[str]]) -> float:
    """The time of the first sample, s; 0 where nothing tells it."""
    begin = next(filter(None, rows.get(_BEGIN, [])), "0")
    unit = next(filter(None, rows.get(_TIME_UNIT, [])), "s")
    dimension, factor = size_of(unit) or ("time", 1.0)
    return _signed(begin) * (factor if dimension == "time" else 1.0)


def _signed(cell: str) -> float:
    digits = cell.strip().lstrip("+-−")
    return -_number(digits) if cell.strip()[:1] in ("-", "−") else _number(digits)
