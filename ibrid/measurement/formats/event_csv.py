"""The events file of this project: CSV with `# key: value` lines first; dq or phases, read in any convention, written in ours."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, near
from ibrid.foreign_text import cell_meant, csv_text
from ibrid.measurement.conventions.header import number_of, read_keys, values_of
from ibrid.measurement.formats.csv_columns import require_once
from ibrid.measurement.formats.csv_table import comments_and_body, fields_of, require_body, require_cells
from ibrid.measurement.formats.files import write_atomically
from ibrid.measurement.formats.grouping import rows_of_each
from ibrid.measurement.recordings.event_samples import CHOICES, KEYS, REMARK, Samples, events_of, span_of
from ibrid.measurement.recordings.events import EventRecord, Events

COLUMNS = {"dq": ("v_d", "v_q", "i_d", "i_q"), "abc": ("v_a", "v_b", "v_c", "i_a", "i_b", "i_c")}


def is_event_csv(lines: Sequence[str]) -> bool:
    """Whether the line of column names is that of an events file as it is written here."""
    names = {name.strip() for name in head_of(lines).split(",")}
    own = max(len(names.intersection(columns)) / len(columns) for columns in COLUMNS.values())
    return "t" in names and (own == 1 or ("record" in names and own > 0))


def head_of(lines: Sequence[str]) -> str:
    """The first line that is no comment."""
    return next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")


def parse_event_csv(lines: Sequence[str], where: str, keys: Mapping[str, object]) -> Events:
    """Records of voltage and current in time, from the lines of a file.

    Columns record,t and v_d,v_q,i_d,i_q (frame: dq, turning at 2 pi f0_hz) or v_a,v_b,v_c,i_a,i_b,i_c (frame: abc); optional
    sigma (standard deviation of each current sample, per unit). Lines `# key: value` with f0_hz, unit (pu | si), current (out |
    in), frame (dq | abc), q_axis (leads | lags), power_node (capacitor | pcc), solver (continuous | trapezoidal), s_base_va,
    v_base_v say how they are meant.

    where : for errors, and the source of the events. keys : keys that the file lacks or has wrong; they win over the file.

    Raises SweepError naming file and line, or the record (event_rest, event_samples).
    """
    comments, body = comments_and_body(lines)
    stated, notes = read_keys(comments, where, KEYS, CHOICES)
    told = {**stated, **{key: value for key, value in keys.items() if value is not None}}
    header = {**values_of(told, where, CHOICES), **span_of(told)}
    require_body(body, where)
    head, *numbers = body
    names = fields_of(head, lines[head - 1], Path(where))
    frame = _frame(names, header.get("frame"), f"{where} line {head}")
    require_body(body, where, rows=True)
    rows = _rows(names, numbers, [lines[number - 1] for number in numbers], where)
    return events_of(_samples(rows, np.array(numbers), frame, where), {**header, "frame": frame}, where, notes)


@takes_kinds
def write_events(events: Events, path: str | Path, *, header: Sequence[str] = ()) -> None:
    """Write events as CSV: frame dq, per unit, current out, q leads, all digits; the file appears whole or not at all.

    header : further comment lines, without "#", put first; the notes of the events and the remarks on reading its records follow.
    """
    write_atomically(Path(path), event_csv(events, header=header))


def event_csv(events: Events, *, header: Sequence[str] = ()) -> str:
    """The text that `write_events` writes."""
    lines = [f"# note - {line}".rstrip() for text in (*header, *events.notes) for line in str(text).splitlines()]
    lines += [f"# {REMARK}{record.name}: {remark}" for record in events.records for remark in record.remarks]
    keys = {"f0_hz": events.f0_hz, "s_base_va": events.s_base_va, "v_base_v": events.v_base_v}
    lines += [f"# {key}: {value!r}" for key, value in keys.items() if value is not None]
    lines += [f"# power_node: {events.power_node}"]
    lines += [f"# solver: {events.solver}"] if events.solver else []
    with_sigma = any(record.sigma is not None for record in events.records)
    head = ["record", "t", *COLUMNS["dq"], *(["sigma"] if with_sigma else [])]
    return csv_text([head, *(row for record in events.records for row in _written(record, with_sigma))], lines)


def _written(record: EventRecord, with_sigma: bool) -> list[list[str]]:
    columns = [record.time, *record.v.T, *record.i.T]
    rows = [[record.name, *map(repr, row)] for row in np.column_stack(columns).tolist()]
    if with_sigma:
        sigma = [""] * len(rows) if record.sigma is None else [repr(value) for value in record.sigma.tolist()]
        rows = [[*row, value] for row, value in zip(rows, sigma, strict=True)]
    return rows


def _frame(names: list[str], said: object, where: str) -> str:
    """Whether columns are dq or phases; SweepError for missing, unknown or contradicting ones."""
    require_once(names, where)
    frame = str(said) if said else max(COLUMNS, key=lambda one: len(set(COLUMNS[one]) & set(names)))
    needed = ("record", "t", *COLUMNS[frame])
    missing = [name for name in needed if name not in names]
    wrong = [name for name in names if name not in (*needed, "sigma")]
    if missing:
        raise SweepError(
            f"{where}: column {missing[0]} is missing; events have the columns {','.join(needed)}"
            f"{f', found {wrong[0][:40]!r}' if wrong else ''} (frame: {frame})."
        )
    if wrong:
        raise SweepError(
            f"{where}: column {wrong[0][:40]!r} is not known, {near(wrong[0], (*needed, 'sigma'))}; rename or remove it."
        )
    return frame


def _rows(names: list[str], numbers: Sequence[int], lines: Sequence[str], where: str) -> dict[str, np.ndarray]:
    """Columns by name; NaN where a cell of sigma is empty."""
    kinds = np.dtype([(name, "U200" if name == "record" else float) for name in names])
    try:
        rows = np.loadtxt(lines, kinds, comments=None, delimiter=",", ndmin=1, quotechar='"', encoding=None)
        columns = {name: rows[name] for name in names}
    except ValueError:
        cells = [
            _row(names, fields_of(number, line, Path(where)), f"{where} line {number}")
            for number, line in zip(numbers, lines, strict=True)
        ]
        columns = {name: np.array([row[k] for row in cells]) for k, name in enumerate(names)}
    columns["record"] = np.char.strip(columns["record"].astype(str))
    for name in names:
        if name not in ("record", "sigma") and not np.isfinite(columns[name]).all():
            bad = int(np.argmin(np.isfinite(columns[name])))
            raise SweepError(
                f"{where} line {numbers[bad]}: {name} must be a finite number; found {columns[name][bad]}, is a channel cut off?"
            )
    return columns


def _row(names: list[str], fields: list[str], where: str) -> list[str | float]:
    require_cells(fields, len(names), where)
    return [
        field
        if name == "record"
        else float("nan")
        if name == "sigma" and not field
        else number_of(field, f"{where}: {name}")
        for name, field in zip(names, fields, strict=True)
    ]


def _samples(rows: dict[str, np.ndarray], numbers: np.ndarray, frame: str, where: str) -> list[Samples]:
    result = []
    for name, chosen in rows_of_each(rows["record"].tolist()).items():
        time = rows["t"][chosen]
        back = np.flatnonzero(np.diff(time) <= 0)
        if len(back):
            raise SweepError(
                f"{where} line {numbers[chosen][back[0] + 1]}: the time of record {name} must increase; found "
                f"{time[back[0] + 1]:g} s after {time[back[0]]:g} s, give another record a name of its own."
            )
        sigma = rows["sigma"][chosen] if "sigma" in rows else np.full(len(time), np.nan)
        meant = np.isfinite(sigma) & (sigma > 0)
        if not np.isnan(sigma).all() and not meant.all():
            raise SweepError(
                f"{where} line {numbers[chosen][np.argmin(meant)]}: sigma of record {name} must be positive and finite, in all "
                "its rows or in none."
            )
        values = np.stack([rows[column][chosen] for column in COLUMNS[frame]])
        half = len(values) // 2
        result.append(
            Samples(cell_meant(name), time, values[:half], values[half:], sigma if np.isfinite(sigma).all() else None)
        )
    return result
