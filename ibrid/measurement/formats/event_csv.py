"""The events file of this project: CSV with `# key: value` lines first; dq, phases, phasors or rms
values, read in any convention, written in ours.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, near
from ibrid.foreign_text import cell_meant, csv_text
from ibrid.measurement.conventions.header import number_of, read_keys, values_of
from ibrid.measurement.formats.csv_columns import require_once
from ibrid.measurement.formats.csv_table import (
    comments_and_body,
    fields_of,
    require_body,
    require_cells,
)
from ibrid.measurement.formats.files import write_atomically
from ibrid.measurement.formats.grouping import rows_of_each
from ibrid.measurement.recordings.event_samples import (
    CHOICES,
    KEYS,
    REMARK,
    Samples,
    events_of,
    span_of,
)
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.phasors import BESIDE, FORMS, waves_of

#: What a device may be told, and all columns that a record may lack.
TOLD = ("p_ref", "q_ref", "v_ref", "f_ref")
OPTIONAL = ("sigma", *TOLD)
#: By which clocks are put back, s.
HOUR = 3600.0
COLUMNS = {"dq": ("v_d", "v_q", "i_d", "i_q"), "abc": ("v_a", "v_b", "v_c", "i_a", "i_b", "i_c")}
#: Frame -> the forms that its columns may have.
FRAMES: dict[str, tuple[tuple[str, ...], ...]] = {
    **{frame: (one,) for frame, one in COLUMNS.items()},
    **FORMS,
}


def is_event_csv(lines: Sequence[str]) -> bool:
    """Whether the line of column names is that of an events file as it is written here."""
    names = {name.strip() for name in head_of(lines).split(",")}
    own = max(
        len(names.intersection(columns)) / len(columns)
        for forms in FRAMES.values()
        for columns in forms
    )
    return "t" in names and (own == 1 or ("record" in names and own > 0))


def head_of(lines: Sequence[str]) -> str:
    """The first line that is no comment."""
    return next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")


def parse_event_csv(lines: Sequence[str], where: str, keys: Mapping[str, object]) -> Events:
    """Records of voltage and current in time, from the lines of a file.

    Columns record,t and v_d,v_q,i_d,i_q (frame: dq, turning at 2 pi f0_hz), v_a,v_b,v_c,i_a,i_b,i_c
    (frame: abc), v_mag,v_deg,i_mag,i_deg (frame: phasor, rms) or u,p,q or u,i_p,i_q (frame: rms),
    these two with f or angle_deg; optional sigma (standard deviation of each current sample, per
    unit) and p_ref, q_ref, v_ref, f_ref (what the device was told, per unit or SI as the rest,
    f_ref in Hz). Lines `# key: value` with f0_hz, unit (pu | si), current (out | in), frame, q_axis
    (leads | lags), power_node (capacitor | pcc), solver (continuous | trapezoidal), s_base_va,
    v_base_v, v_is (phase | line), phase (a | b | c), window (see `estimators.window`) say how they
    are meant.

    where : for errors, and the source of the events. keys : keys that the file lacks or has wrong;
    they win over the file.

    Raises SweepError naming file and line, or the record (event_rest, event_samples).
    """
    comments, body = comments_and_body(lines)
    stated, notes = read_keys(comments, where, KEYS, CHOICES)
    told = {**stated, **{key: value for key, value in keys.items() if value is not None}}
    header = {**values_of(told, where, CHOICES), **span_of(told)}
    header |= {"window": told["window"]} if told.get("window") else {}
    require_body(body, where)
    head, *numbers = body
    names = fields_of(head, lines[head - 1], Path(where))
    frame = _frame(names, header.get("frame"), f"{where} line {head}")
    require_body(body, where, rows=True)
    rows = _rows(names, numbers, [lines[number - 1] for number in numbers], where)
    header = {**header, "frame": frame}
    return events_of(_samples(rows, np.array(numbers), header, where), header, where, notes)


@takes_kinds
def write_events(events: Events, path: str | Path, *, header: Sequence[str] = ()) -> None:
    """Write events as CSV: frame dq, per unit, current out, q leads, all digits; the file appears
    whole or not at all.

    header : further comment lines, without "#", put first; the notes of the events and the remarks
    on reading its records follow.
    """
    write_atomically(Path(path), event_csv(events, header=header))


def event_csv(events: Events, *, header: Sequence[str] = ()) -> str:
    """The text that `write_events` writes."""
    lines = [
        f"# note - {line}".rstrip()
        for text in (*header, *events.notes)
        for line in str(text).splitlines()
    ]
    lines += [
        f"# {REMARK}{record.name}: {remark}"
        for record in events.records
        for remark in record.remarks
    ]
    keys = {"f0_hz": events.f0_hz, "s_base_va": events.s_base_va, "v_base_v": events.v_base_v}
    lines += [f"# {key}: {value!r}" for key, value in keys.items() if value is not None]
    lines += [f"# power_node: {events.power_node}"]
    lines += [f"# solver: {events.solver}"] if events.solver else []
    lines += [f"# window: {events.window}"] if events.window else []
    optional = ["sigma"] if any(record.sigma is not None for record in events.records) else []
    optional += [name for name in TOLD if any(name in record.told for record in events.records)]
    head = ["record", "t", *COLUMNS["dq"], *optional]
    return csv_text(
        [head, *(row for record in events.records for row in _written(record, optional))], lines
    )


def _written(record: EventRecord, optional: Sequence[str]) -> list[list[object]]:
    """The cells of each sample, numbers as numbers: with all digits, and no text to look into."""
    columns = [record.time, *record.v.T, *record.i.T]
    rows = [[record.name, *row] for row in np.column_stack(columns).tolist()]
    for name in optional:
        values = record.sigma if name == "sigma" else record.told.get(name)
        cells = [""] * len(rows) if values is None else values.tolist()
        rows = [[*row, cell] for row, cell in zip(rows, cells, strict=True)]
    return rows


def _frame(names: list[str], said: object, where: str) -> str:
    """The frame of columns; SweepError for missing, unknown or contradicting ones."""
    require_once(names, where)
    forms = [
        (one, columns) for one, some in FRAMES.items() for columns in some if said in (None, one)
    ]
    frame, columns = max(forms, key=lambda one: len(set(one[1]) & set(names)) / len(one[1]))
    begun = [one for form in FRAMES[frame] if {*form[1:]} & {*names} for one in form]
    needed = (*dict.fromkeys(("record", "t", *columns, *begun)),)
    missing = [name for name in needed if name not in names]
    wrong = [
        name for name in names if name not in (*needed, "sigma", *TOLD, *BESIDE.get(frame, ()))
    ]
    if frame == "phasor" and missing and missing[0].endswith("_deg"):
        raise SweepError(
            f"{where}: column {missing[0]} is missing, the angle; without angles write columns "
            "u,p,q or u,i_p,i_q of frame: rms."
        )
    if missing:
        raise SweepError(
            f"{where}: column {missing[0]} is missing; events have the columns {','.join(needed)}"
            f"{f', found {wrong[0][:40]!r}' if wrong else ''} (frame: {frame})."
        )
    if wrong:
        raise SweepError(
            f"{where}: column {wrong[0][:40]!r} is not known, "
            f"{near(wrong[0], (*needed, 'sigma', *TOLD))}; rename or remove it."
        )
    return frame


def _rows(
    names: list[str], numbers: Sequence[int], lines: Sequence[str], where: str
) -> dict[str, np.ndarray]:
    """Columns by name; NaN where a cell of sigma is empty."""
    kinds = np.dtype([(name, "U200" if name == "record" else float) for name in names])
    try:
        rows = np.loadtxt(
            lines, kinds, comments=None, delimiter=",", ndmin=1, quotechar='"', encoding=None
        )
        columns = {name: rows[name] for name in names}
    except ValueError:
        cells = [
            _row(names, fields_of(number, line, Path(where)), f"{where} line {number}")
            for number, line in zip(numbers, lines, strict=True)
        ]
        columns = {name: np.array([row[k] for row in cells]) for k, name in enumerate(names)}
    columns["record"] = np.char.strip(columns["record"].astype(str))
    for name in names:
        if name not in ("record", *OPTIONAL) and not np.isfinite(columns[name]).all():
            bad = int(np.argmin(np.isfinite(columns[name])))
            raise SweepError(
                f"{where} line {numbers[bad]}: {name} must be a finite number; found "
                f"{columns[name][bad]}, is a channel cut off?"
            )
    return columns


def _row(names: list[str], fields: list[str], where: str) -> list[str | float]:
    require_cells(fields, len(names), where)
    return [
        field
        if name == "record"
        else float("nan")
        if name in OPTIONAL and not field
        else number_of(field, f"{where}: {name}")
        for name, field in zip(names, fields, strict=True)
    ]


def _samples(
    rows: dict[str, np.ndarray], numbers: np.ndarray, header: Mapping[str, Any], where: str
) -> list[Samples]:
    result, frame = [], str(header["frame"])
    for name, chosen in rows_of_each(rows["record"].tolist()).items():
        time = rows["t"][chosen]
        back = np.flatnonzero(np.diff(time) <= 0)
        if len(back):
            at = f"{where} line {numbers[chosen][back[0] + 1]}"
            raise SweepError(
                f"{at}: "
                + why_not_increasing(str(name), float(time[back[0]]), float(time[back[0] + 1]))
            )
        sigma = rows["sigma"][chosen] if "sigma" in rows else np.full(len(time), np.nan)
        meant = np.isfinite(sigma) & (sigma > 0)
        if not np.isnan(sigma).all() and not meant.all():
            raise SweepError(
                f"{where} line {numbers[chosen][np.argmin(meant)]}: sigma of record {name} must be "
                "positive and finite, in all "
                "its rows or in none."
            )
        sigma = sigma if np.isfinite(sigma).all() else None
        told = {
            column: rows[column][chosen]
            for column in TOLD
            if column in rows and np.isfinite(rows[column][chosen]).any()
        }
        if broken := next(
            (column for column, value in told.items() if not np.isfinite(value).all()), ""
        ):
            raise SweepError(
                f"{where}: {broken} of record {name} must be a finite number in all its rows or in "
                "none."
            )
        if frame in FORMS:
            own = {
                column: rows[column][chosen]
                for column in rows
                if column not in ("record", "t", *OPTIONAL)
            }
            try:
                v, i, remarks = waves_of(frame, own, header, time, float(header.get("f0_hz", 60.0)))
            except SweepError as reason:
                raise SweepError(f"{where}: record {name}: {reason}") from reason
            v, i = (np.stack([np.real(wave), np.imag(wave)]) for wave in (v, i))
            result.append(Samples(cell_meant(name), time, v, i, sigma, remarks, told))
            continue
        values = np.stack([rows[column][chosen] for column in COLUMNS[frame]])
        half = len(values) // 2
        result.append(
            Samples(cell_meant(name), time, values[:half], values[half:], sigma, told=told)
        )
    return result


def why_not_increasing(name: str, before: float, after: float) -> str:
    """Say what is wrong with the times, s, of a record, which do not increase, and what to do."""
    back = before - after
    if back == 0.0:
        return (
            f"the time of record {name} must increase; found {after:g} s twice, leave one of the "
            "two samples out."
        )
    if abs(back - HOUR) <= HOUR / 60:
        return (
            f"the time of record {name} goes back by an hour, from {before:g} to {after:g} s, as "
            "clocks do at the end of "
            "daylight saving time; write seconds since the first sample, or UTC."
        )
    return (
        f"the time of record {name} must increase; found {after:g} s after {before:g} s, give "
        "another record a name "
        "of its own."
    )
