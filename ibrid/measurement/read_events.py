"""One door for records of events: the suffix, and where that leaves doubt the columns, choose the reader."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.header import read_keys, values_of
from ibrid.measurement.formats.event_csv import TOLD, head_of, is_event_csv, parse_event_csv
from ibrid.measurement.formats.files import read_lines
from ibrid.measurement.formats.response import sidecar_keys
from ibrid.measurement.importing.comtrade_file import SUFFIXES, read_comtrade
from ibrid.measurement.importing.foreign_table import ForeignTable, frame_table, read_tables
from ibrid.measurement.importing.told import base_of
from ibrid.measurement.recordings.channels import DQ, PHASES, Channel, ToldChannels, channels_told, chosen
from ibrid.measurement.recordings.event_samples import CHOICES, KEYS, Samples, events_of
from ibrid.measurement.recordings.events import Events

#: Endings of files of which only the names of their columns say whether they hold records or a sweep.
WORKBOOKS, TEXTS = (".xlsx", ".xlsm", ".parquet"), ("", ".csv", ".txt", ".tsv")


@takes_kinds
def read_events(path: Any, *, channels: ToldChannels = None, **keys: object) -> Events:
    """Read records of terminal voltage and current in time, as per unit, current out of the inverter, v at rest [v, 0].

    path : a CSV of the project (docs/events.md), a COMTRADE record (.cfg beside .dat, .cff), another table (text,
        xlsx, Parquet, .mat, HDF5) or a DataFrame with one column for each channel.
    channels : `va=1,vb=2,vc=3,ia=4,ib=5,ic=6` or `vd=..,vq=..,id=..,iq=..`, by number or name, where names do not show them;
        of tables also t and record.
    keys : what the file does not say about itself or says wrongly: f0_hz, unit (pu | si), current (out | in), q_axis, window,
        power_node, solver (continuous | trapezoidal), s_base_va, v_base_v or base ("10kVA,400V"; then a table that says nothing
        of itself is in SI). They win over the file, and lines `key: value` of `<path>.meta` do too.

    Raises SweepError: one sentence with file and line, or record.
    """
    keys = {key: value for key, value in keys.items() if value is not None}
    if "base" in keys:
        keys["s_base_va"], keys["v_base_v"] = base_of(str(keys["base"]), "base")
    for key in keys:
        if key not in (*KEYS, "base"):
            raise SweepError(f"{key} is not something to say about events; {near(key, (*KEYS, 'base', 'channels'))}")
    if not isinstance(path, str | Path):
        return _of_frame(path, channels, keys)
    path = Path(path)
    beside, notes = sidecar_keys(_configuration_of(path), (*KEYS, "channels"), CHOICES)
    told: dict[str, object] = {**beside, **keys}
    beside_channels = told.pop("channels", None)
    channels = channels or (None if beside_channels is None else str(beside_channels))
    if path.suffix.lower() in SUFFIXES:
        samples, frequency = read_comtrade(path, channels)
        said = {"unit": "si", **({"f0_hz": frequency} if frequency else {}), **told, "frame": "abc"}
        return events_of([samples], values_of(said, str(path), CHOICES), str(path), notes)
    if path.suffix.lower() in TEXTS and channels is None:
        lines = read_lines(path)
        if is_event_csv(lines):
            return parse_event_csv(lines, str(path), told)
    return _of_tables(read_tables(path), channels, told, str(path))


def is_events_file(path: Path) -> bool:
    """Whether a file holds records in time and not a sweep: COMTRADE by its suffix, tables by their column names."""
    if path.suffix.lower() == ".dat":
        return any(path.with_suffix(suffix).exists() for suffix in (".cfg", ".CFG"))
    if path.suffix.lower() in SUFFIXES:
        return True
    try:
        if path.suffix.lower() in WORKBOOKS:
            return any(_has_channels(list(table.columns)) for table in read_tables(path))
        head = head_of(read_lines(path)) if path.suffix.lower() in TEXTS else ""
        return is_event_csv([head]) or any(_has_channels(head.split(mark)) for mark in (";", "\t", ",", "|", None))
    except SweepError:
        return False


def _has_channels(names: Sequence[str]) -> bool:
    """Whether columns are called time, voltages and currents."""
    own = {_role(name): name for name in names if _role(name)}
    try:
        return "t" in chosen([Channel(name) for name in names], own, "")
    except SweepError:
        return False


def _configuration_of(path: Path) -> Path:
    """The configuration beside the samples of a COMTRADE record, whose `.meta` holds of both; the path itself of other files."""
    if path.suffix.lower() != ".dat" or not path.parent.is_dir():
        return path
    beside = (one for one in path.parent.iterdir() if one.stem == path.stem and one.suffix.lower() == ".cfg")
    return next(beside, path)


def _of_frame(frame: Any, channels: Any, keys: dict[str, object]) -> Events:
    if getattr(frame, "columns", None) is None:
        raise SweepError(f"read_events takes a path or a DataFrame; found {type(frame).__name__}.")
    said = {key: value for key, value in getattr(frame, "attrs", {}).items() if key in KEYS and value is not None}
    table = replace(frame_table(frame), comments=tuple((0, f"{key}: {value}") for key, value in said.items()))
    return _of_tables([table], channels, keys, "DataFrame")


def _of_tables(tables: list[ForeignTable], channels: Any, told: Mapping[str, object], where: str) -> Events:
    """Each table one record, or several where a column names them; a base implies SI where they say nothing of themselves."""
    stated, notes = read_keys([line for table in tables for line in table.comments], where, KEYS, CHOICES)
    notes = (*notes, *dict.fromkeys(remark for table in tables for remark in table.remarks))
    samples: list[Samples] = []
    frames = set()
    for table in tables:
        names = list(table.columns)
        own = {_role(name): name for name in names if _role(name)}
        place = chosen([Channel(name) for name in names], {**own, **channels_told(channels)}, table.where)
        if "t" not in place:
            raise SweepError(f"{table.where}: a column must be the time in s; tell which, --channels t=1,...")
        family = DQ if set(DQ) <= set(place) else PHASES
        frames.add("dq" if family is DQ else "abc")
        columns = [_numbers(table, names[place[role]]) for role in ("t", *family)]
        record = table.columns[names[place["record"]]] if "record" in place else np.full(len(columns[0]), table.stem)
        sigma = _numbers(table, names[place["sigma"]]) if "sigma" in place else None
        set_points = {name: table.columns[name] for name in TOLD if _is_numbers(table, name)}
        rows_of: dict[Any, list[int]] = {}
        for row, name in enumerate(record.tolist()):
            rows_of.setdefault(name, []).append(row)
        for name, rows in rows_of.items():
            time, *values = (column[rows] for column in columns)
            if (np.diff(time) <= 0).any():
                raise SweepError(f"{table.where}: the time of record {name} must increase.")
            half = len(values) // 2
            v, i = np.array(values[:half]), np.array(values[half:])
            own = {key: value[rows] for key, value in set_points.items() if np.isfinite(value[rows]).all()}
            samples.append(Samples(str(name), time, v, i, None if sigma is None else sigma[rows], told=own))
    if len(frames) > 1:
        raise SweepError(f"{where}: the tables must all be dq or all be phases.")
    implied = {"unit": "si"} if "base" in told and not stated else {}
    header = values_of({**implied, **stated, **told, "frame": frames.pop()}, where, CHOICES)
    if window := told.get("window", stated.get("window")):
        header["window"] = window
    return events_of(samples, header, where, notes)


def _role(name: str) -> str:
    """The role of a column that is called as in an events file."""
    plain = name.strip().strip('"').lower()
    role = "t" if plain in ("time", "time_s", "time [s]", "t [s]") else plain.replace("_", "")
    return role if role in ("record", "t", "sigma", *PHASES, *DQ) else ""


def _is_numbers(table: ForeignTable, name: str) -> bool:
    return name in table.columns and table.columns[name].dtype.kind == "f"


def _numbers(table: ForeignTable, name: str) -> np.ndarray:
    values = table.columns[name]
    if values.dtype.kind != "f" or not np.isfinite(values).all():
        raise SweepError(f"{table.where}: column {name} must be numbers in every row; found text or gaps.")
    return values
