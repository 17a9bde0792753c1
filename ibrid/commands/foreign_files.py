"""What `ibrid import` and `ibrid inspect` make of anybody's files: the sweep or the records in
them, and how they were read.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.errors import IbridError

if TYPE_CHECKING:
    from ibrid.measurement.importing.foreign_table import ForeignTable
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep

#: Options that say what a table of matrices does not, and those of records too.
OF_TABLES = (
    "voltage_axis",
    "frame_deg",
    "polar",
    "quantity",
    "sequence_frequency",
    "sampling_hz",
    "op",
    "p",
    "q",
    "v",
)
OF_BOTH = ("unit", "base", "current", "q_axis", "power_node", "f0_hz", "decimal")
SPAN = ("begin", "end")
#: Options that say what records do not say, and no sweep takes.
OF_RECORDS = (*SPAN, "ratio")
#: What is said of a column that was read.
_READING = ("what", "column", "unit")


@dataclass(frozen=True)
class FromFiles:
    """`data` : what the files hold.

    `readings` : (what, from which columns, in which unit). `remarks` : what was assumed.
    """

    data: "Sweep | Events"
    readings: tuple[tuple[str, str, str], ...] = ()
    remarks: tuple[str, ...] = ()


def files_named(words: Sequence[str]) -> list[str]:
    """The files to read of those named: archives opened, of one recording in several files the
    first alone.
    """
    from ibrid.measurement.importing.timed.recording_files import each_once

    return [str(path) for path in each_once([Path(word) for word in words])]


def says_anything(arguments: Namespace) -> bool:
    """Whether an option says what a file does not."""
    said = [
        getattr(arguments, name, None)
        for name in (*OF_BOTH, *OF_TABLES, "ratio")
        if name != "sampling_hz"
    ]
    return bool(arguments.map or arguments.grid) or any(value not in (None, []) for value in said)


def recordings_of(files: Sequence[str], arguments: Namespace) -> "list[str | ForeignTable]":
    """The recordings in time, as `--channels` says or the files themselves do: the channels of one
    that lie in files of their own side by side, else the files; none where they hold no records.
    """
    from ibrid.measurement.importing.numbers.number_format import number_format
    from ibrid.measurement.importing.timed.recording_files import channels_apart

    form = number_format({"decimal": arguments.decimal})
    joined = channels_apart([Path(file) for file in files], form)
    if joined is not None:
        return [joined]
    is_recorded = arguments.channels or any(map(inputs.holds_events, files))
    return [*files] if is_recorded else []


def records_in(sources: "Sequence[str | ForeignTable]", arguments: Namespace) -> FromFiles:
    """All records of `recordings_of` some files, in one convention.

    Raises IbridError for options that say nothing of records, and for records of different nominal
    frequency or estimator, of which an events file says one.
    """
    from ibrid.measurement.read_events import READ_AS, read_events

    unfit = [
        name for name in OF_TABLES if getattr(arguments, name) is not None and name != "sampling_hz"
    ]
    unfit += ["grid"] * (arguments.grid is not None)
    if unfit or arguments.map:
        options = [*OF_BOTH, "ratio", "from", "to"]
        raise IbridError(
            f"--{(unfit or ['map'])[0].replace('_', '-')} says nothing of records in time; "
            "--channels, --"
            f"{', --'.join(options).replace('_', '-')} do"
        )
    keys = {name: getattr(arguments, name) for name in (*OF_BOTH, *OF_RECORDS)}
    read = [read_events(one, channels=arguments.channels, **keys) for one in sources]
    if len({events.f0_hz for events in read}) > 1:
        raise IbridError(
            "records in one file must have one nominal frequency; import them one by one"
        )
    if len({record.window and record.window.name for one in read for record in one.records}) > 1:
        raise IbridError(
            "records in one file must be waveforms, or frames of one estimator; import them one by "
            "one"
        )
    events = replace(read[0], records=tuple(record for one in read for record in one.records))
    notes = [note for note in events.notes if note.startswith(READ_AS)]
    readings = [note.removeprefix(READ_AS).split("; ") for note in notes]
    remarks = tuple(f"{one.name}: {said}." for one in events.records for said in one.remarks)
    told = tuple((one[0], one[1], one[2]) for one in readings if len(one) == len(_READING))
    return FromFiles(events, told, remarks)


def sweep_in(files: Sequence[str], arguments: Namespace, *, inspecting: bool = False) -> FromFiles:
    """The sweep of all files; sweep files of ours are joined, any other table is understood column
    by column.

    inspecting : a file with our columns is one of ours, whoever wrote it; an import asks for what
    its header leaves out.

    Raises SweepError with all that must be said first.
    """
    from ibrid.measurement.importing.importing import import_files
    from ibrid.measurement.read import is_own_sweep, is_sweep_file, read_sweep
    from ibrid.measurement.sweeps.amplitudes import merge

    said = {name: getattr(arguments, name) for name in (*OF_BOTH, *OF_TABLES)}
    if of_records := [name for name in OF_RECORDS if getattr(arguments, name) is not None]:
        option = {"begin": "--from", "end": "--to", "ratio": "--ratio"}[of_records[0]]
        raise IbridError(
            f"{option} says something of records in time, and {files[0]} holds none; leave it out"
        )
    of_points = [
        said[name] is not None for name in ("op", "p", "q", "v", "quantity", "sequence_frequency")
    ]
    known = is_own_sweep if inspecting else is_sweep_file
    if not arguments.map and not any(of_points) and all(known(Path(file)) for file in files):
        read = FromFiles(merge([read_sweep(file, **_header_keys(said)) for file in files]))
        return _without_grid(read, arguments.grid)
    imported = import_files(files, arguments.map, **said)
    if imported.sweep is None:
        raise UnansweredError(imported.asked, imported.readings, imported.remarks)
    read = FromFiles(imported.sweep, imported.readings, imported.remarks)
    return _without_grid(read, arguments.grid)


def _without_grid(read: FromFiles, text: str | None) -> FromFiles:
    """The device alone, where it was scanned in series with a grid that is known."""
    from ibrid.measurement.sweeps.sweep import Sweep

    if text is None or not isinstance(read.data, Sweep):
        return read
    from ibrid.analysis.grids.series_grid import without_series_grid

    grid = inputs.grid(text, read.data.f0_hz)
    device = without_series_grid(read.data, grid)
    words = (
        f"the impedance of the grid in series ({text}) is taken off: the matrices are those of the "
        "device, in the frame of the voltage at its terminals, where p, q and v must be counted"
    )
    device = replace(device, notes=(*device.notes, words))
    doubts = tuple(getattr(grid, "warnings", ()))
    return replace(read, data=device, remarks=(*read.remarks, words, *doubts))


def _header_keys(said: dict[str, Any]) -> dict[str, Any]:
    """What is said, by the keys of a sweep file."""
    from ibrid.measurement.conventions.header import HEADER_KEYS
    from ibrid.measurement.importing.told import base_of

    keys = {name: said[name] for name in HEADER_KEYS if said.get(name) is not None}
    if said["base"]:
        keys["s_base_va"], keys["v_base_v"] = base_of(said["base"], "--base")
    return keys


class UnansweredError(IbridError):
    """A table was understood, and something must be said first; with what was read until then."""

    def __init__(
        self, words: str, readings: Sequence[tuple[str, str, str]], remarks: Sequence[str]
    ) -> None:
        super().__init__(words)
        self.readings = tuple(readings)
        self.remarks = tuple(remarks)
