"""One door for records of events: the suffix, and where that leaves doubt the columns, choose the
reader.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from csv import Error, reader
from dataclasses import replace
from pathlib import Path
from typing import Any

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.header import read_keys, values_of
from ibrid.measurement.formats.bundle import beside, suffix_of
from ibrid.measurement.formats.event_csv import head_of, is_event_csv, parse_event_csv
from ibrid.measurement.formats.files import head_lines, read_lines
from ibrid.measurement.formats.response import sidecar_keys
from ibrid.measurement.importing.doubts.transformer_ratio import (
    Ratios,
    ratio_question,
    ratios_said,
)
from ibrid.measurement.importing.foreign_table import ForeignTable, frame_table
from ibrid.measurement.importing.numbers.number_format import (
    NumberFormat,
    number_format,
    without_format,
)
from ibrid.measurement.importing.shapes.signed_names import without_signs
from ibrid.measurement.importing.timed.clock_times import with_date_and_time
from ibrid.measurement.importing.timed.comtrade_file import SUFFIXES, read_comtrade
from ibrid.measurement.importing.timed.derived_columns import (
    complete_a_recording,
    with_derived_columns,
)
from ibrid.measurement.importing.timed.families import SignalFamily, family_of, signals_of
from ibrid.measurement.importing.timed.probes import probe_question, with_currents_in_volts
from ibrid.measurement.importing.timed.pscad_output import is_pscad_output
from ibrid.measurement.importing.timed.recording_comments import RecordingComments, read_comments
from ibrid.measurement.importing.timed.recording_files import (
    PSOUT,
    joined_channels,
    recording_tables,
)
from ibrid.measurement.importing.timed.recording_table import recording_of
from ibrid.measurement.importing.timed.sampled_times import (
    is_sampled_block,
    sampling_told,
    with_sampled_times,
)
from ibrid.measurement.importing.told import base_of
from ibrid.measurement.importing.unsaid import UnsaidError
from ibrid.measurement.recordings.channels import (
    DQ,
    OTHER_FAMILIES,
    Channel,
    ToldChannels,
    channels_told,
    chosen,
)
from ibrid.measurement.recordings.event_samples import CHOICES, KEYS, SPAN, events_of, span_of
from ibrid.measurement.recordings.events import Events

#: How a note begins that says which column was read as what.
READ_AS = "read as - "
#: What can be said about records, beside their channels.
SAYABLE = (*KEYS, *SPAN, "decimal", "base", "ratio")
#: What only tables of others are told, in lines of their `.meta` too.
_OF_TABLES = ("channels", "ratio")
#: Endings of files of which only the names of their columns say whether they hold records or a
#: sweep.
WORKBOOKS = (".xlsx", ".xlsm", ".xls", ".ods", ".parquet", ".mat", ".h5", ".hdf5", ".npz", ".json")
TEXTS = ("", ".csv", ".txt", ".tsv", ".dat", ".asc", ".adf", ".prn", ".tab", ".log", ".lvm")


@takes_kinds
def read_events(path: Any, *, channels: ToldChannels = None, **keys: object) -> Events:
    """Read records of terminal voltage and current in time, as per unit, current out of the
    inverter, v at rest [v, 0].

    path : a CSV of the project (docs/events.md), a COMTRADE record (.cfg beside .dat, .cff),
    another table (text,
        xlsx, Parquet, .mat, HDF5) or a DataFrame with one column for each channel; or a list of
        files of an oscilloscope, each with one channel.
    channels : `va=1,vb=2,vc=3,ia=4,ib=5,ic=6` or `vd=..,vq=..,id=..,iq=..`, by number or name,
    where names do not show them;
        of tables also t and record.
    keys : what the file does not say about itself or says wrongly: f0_hz, unit (pu | si), current
    (out | in), q_axis, window,
        power_node, solver (continuous | trapezoidal), s_base_va, v_base_v or base ("10kVA,400V";
        then a table that says nothing of itself is in SI), begin and end (s, the part to keep),
        decimal (point | comma, of numbers such as 1.234), ratio ("v=63000/100,i=1000/5", by which
        values of the secondary side of transformers are multiplied, or 1 for those of the primary).
        They win over the file, and lines `key: value` of `<path>.meta` do too.

    Raises SweepError: one sentence with file and line, or record.
    """
    keys = {key: value for key, value in keys.items() if value is not None}
    if "base" in keys:
        keys["s_base_va"], keys["v_base_v"] = base_of(str(keys["base"]), "base")
    for key in keys:
        if key not in SAYABLE:
            raise SweepError(
                f"{key} is not something to say about events; {near(key, (*SAYABLE, 'channels'))}"
            )
    form, keys = number_format(keys), without_format(keys)
    if isinstance(path, list | tuple):
        if others := [one for one in path if not isinstance(one, str | Path)]:
            raise SweepError(
                "read_events takes a path, a list of paths or a DataFrame; found a list with "
                f"{type(others[0]).__name__}, read them one by one."
            )
        path = joined_channels([*map(Path, path)], form)
    if isinstance(path, ForeignTable):
        ratios = ratios_said(keys.pop("ratio", None))
        return _of_tables([path], channels, keys, path.where, ratios)
    if not isinstance(path, str | Path):
        return _of_frame(path, channels, keys, form)
    path = Path(path)
    said_beside, notes = sidecar_keys(_configuration_of(path), (*KEYS, *_OF_TABLES), CHOICES)
    told: dict[str, object] = {**said_beside, **keys}
    beside_channels = told.pop("channels", None)
    channels = channels or (None if beside_channels is None else str(beside_channels))
    ratios = ratios_said(told.pop("ratio", None))
    suffix = suffix_of(path)
    if suffix in SUFFIXES:
        samples, frequency = read_comtrade(path, channels, ratios)
        said = {"unit": "si", **({"f0_hz": frequency} if frequency else {}), **told, "frame": "abc"}
        header = {**values_of(said, str(path), CHOICES), **span_of(told)}
        return events_of([samples], header, str(path), notes)
    if suffix in TEXTS and channels is None and _is_own(path):
        if ratios is not None:
            raise SweepError(
                f"{path} is an events file, whose values are those of the primary side; leave "
                "out --ratio."
            )
        return parse_event_csv(read_lines(path), str(path), told)
    return _of_tables(recording_tables(path, form), channels, told, str(path), ratios)


def _is_own(path: Path) -> bool:
    """Whether a text file has the columns of an events file, that of the records among them."""
    head = head_of(head_lines(path))
    return is_event_csv([head]) and "record" in {name.strip() for name in head.split(",")}


def is_events_file(path: Path) -> bool:
    """Whether a file holds records in time and not a sweep: COMTRADE by its suffix, tables by their
    column names.
    """
    suffix = suffix_of(path)
    if _configuration_of(path) != path:
        return True
    if suffix in (*SUFFIXES, PSOUT) and suffix != ".dat":
        return True
    try:
        if is_pscad_output(path):
            return True
        if suffix in WORKBOOKS:
            return any(
                _has_channels(list(one.columns), timed=sampling_told(one.notes) is not None)
                for one in recording_tables(path)
            )
        lines = head_lines(path) if suffix in TEXTS else []
        if is_sampled_block(lines):
            return True
        is_sampled = sampling_told(lines) is not None
        rows = [line.lstrip("#% ") for line in lines if any(letter.isalpha() for letter in line)]
        return is_event_csv([head_of(lines)]) or any(
            _has_channels(cells, timed=is_sampled)
            for row in rows
            for mark in (";", "\t", ",", "|", None)
            if len(cells := _parted(row, mark)) > 3 and not _are_mostly_numbers(cells)
        )
    except SweepError:
        return False


def _parted(row: str, mark: str | None) -> list[str]:
    """The cells of a row, of which those in quotes may hold the mark between them."""
    if mark is None or '"' not in row:
        return row.split(mark)
    with suppress(Error):  # of a cell that is too long
        return next(reader([row], delimiter=mark), [])
    return row.split(mark)


def _are_mostly_numbers(cells: Sequence[str]) -> bool:
    """Whether a row of text and numbers, as one of a table that names its operating points, is
    none of names.
    """
    numbers = sum(cell.lstrip(" \"'+-.")[:1].isdigit() for cell in cells)
    return 2 * numbers > len(cells)


def _has_channels(names: Sequence[str], *, timed: bool = False) -> bool:
    """Whether columns are called time, voltages and currents.

    timed : whether something else tells the times.
    """
    names = with_currents_in_volts(names)
    try:
        family = family_of(names, {}, "")
    except SweepError:  # several columns can be one
        return any(signal.quantity == "t" for signal in signals_of(names))
    if family is not None:
        return timed or "t" in family.columns
    roles = {signal.role for signal in signals_of(names)}
    return (timed or "t" in roles) and complete_a_recording(roles)


def _configuration_of(path: Path) -> Path:
    """The configuration beside the samples of a COMTRADE record, whose `.meta` holds of both; the
    path itself of other files.
    """
    if path.suffix.lower() != ".dat":
        return path
    called = f"{path.stem.lower()}.cfg"
    return next((one for one in beside(path) if one.name.lower() == called), path)


def _of_frame(frame: Any, channels: Any, keys: dict[str, object], form: NumberFormat) -> Events:
    if getattr(frame, "columns", None) is None:
        raise SweepError(f"read_events takes a path or a DataFrame; found {type(frame).__name__}.")
    said = {
        key: value
        for key, value in getattr(frame, "attrs", {}).items()
        if key in KEYS and value is not None
    }
    table = replace(
        frame_table(frame, form),
        comments=tuple((0, f"{key}: {value}") for key, value in said.items()),
    )
    ratios = ratios_said(keys.get("ratio"))
    said_of_frame = {key: value for key, value in keys.items() if key != "ratio"}
    return _of_tables([table], channels, said_of_frame, "DataFrame", ratios)


def _of_tables(
    tables: list[ForeignTable],
    channels: Any,
    told: Mapping[str, object],
    where: str,
    ratios: Ratios | None,
) -> Events:
    """Each table one record, or several where a column names them; a base implies SI where they say
    nothing of themselves.
    """
    tables = [with_date_and_time(without_signs(table)) for table in tables]
    base = base_of(str(told["base"]), "base") if "base" in told else None
    comments = read_comments(tables, base)
    stated, notes = read_keys(comments.lines, where, KEYS, CHOICES)
    tables = [replace(table, remarks=(*table.remarks, *comments.remarks)) for table in tables]
    notes = (*notes, *dict.fromkeys(remark for table in tables for remark in table.remarks))
    header = {**values_of({**comments.keys, **stated, **told}, where, CHOICES), **span_of(told)}
    if window := told.get("window", stated.get("window")):
        header["window"] = window
    supposed = "si" if "base" in told and not stated else ""
    said = channels_told(channels)
    tables = [with_sampled_times(table, said) for table in tables]
    tables = [with_derived_columns(table, said) for table in tables]
    recordings = [
        recording_of(
            table,
            _family(table, said, comments, ratios),
            header,
            supposed,
            ratios,
            comments.transformers,
        )
        for table in tables
    ]
    if len({one.frame for one in recordings}) > 1 or len({one.unit for one in recordings}) > 1:
        raise SweepError(f"{where}: the tables must all be dq or all be phases, in one unit.")
    first = recordings[0]
    if first.of_estimator:
        header.setdefault("window", "unknown")
    known = {"unit": first.unit} if first.unit else {}
    known |= {"f0_hz": first.f0_hz} if first.f0_hz and "f0_hz" not in header else {}
    samples = [one for recording in recordings for one in recording.samples]
    readings = dict.fromkeys(
        f"{READ_AS}{'; '.join(one)}" for recording in recordings for one in recording.readings
    )
    notes = (*notes, *readings)
    return events_of(samples, {**header, **known, "frame": first.frame}, where, notes)


def _family(
    table: ForeignTable,
    said: Mapping[str, str],
    comments: RecordingComments,
    ratios: Ratios | None,
) -> SignalFamily:
    """The columns that are taken; SweepError that lists them where they make no recording, and says
    what must be told of currents in V.
    """
    names = list(table.columns)
    family = family_of(names, said, table.where)
    if family is None and (probes := probe_question(names, said, comments.probes)):
        sides = "" if ratios else ratio_question(comments.transformers, "i")
        raise UnsaidError(f"{table.where} does not say {'; '.join(filter(None, (probes, sides)))}.")
    if family is None:
        own = {
            signal.role: name
            for name, signal in zip(names, signals_of(names), strict=True)
            if signal.role in (*DQ, "t")
        }
        chosen(
            [Channel(name) for name in names], {**own, **said}, table.where, OTHER_FAMILIES
        )  # which says what lacks
        raise SweepError(
            f"{table.where} must hold voltages and currents in time; say which columns: --channels "
            "t=1,va=2,.."
        )
    return family
