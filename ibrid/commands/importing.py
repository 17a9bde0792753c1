"""`ibrid import FILE...`: anybody's table as a sweep file, a recorder's as an events file; what was
read as what is shown.
"""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.commands.foreign_files import (
    FromFiles,
    UnansweredError,
    files_named,
    recordings_of,
    records_in,
    sweep_in,
)
from ibrid.errors import IbridError
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import Events
from ibrid.streams import complain
from ibrid.writing import aligned, require_place, write_whole

if TYPE_CHECKING:
    from ibrid.measurement.sweeps.sweep import Sweep

#: Operating points whose rows are compared with one another after reading; `ibrid inspect` looks at
#: all of them.
CHECKED = 4


def run(arguments: Namespace) -> int:
    """Show what each column was read as, then write the sweep or say what must be told first."""
    if arguments.out is None and not arguments.explain:
        raise IbridError(
            "--out names the file to write, such as --out sweep.csv; or --explain shows the "
            "reading alone"
        )
    for place in (arguments.out, arguments.picture):
        if place is not None:
            require_place(place)
    files = files_named(arguments.files)
    try:
        recordings = recordings_of(files, arguments)
        read = records_in(recordings, arguments) if recordings else sweep_in(files, arguments)
    except UnansweredError as unanswered:
        _say(unanswered.readings, unanswered.remarks)
        raise
    if arguments.explain:
        _explain(read)
    else:
        _say(read.readings, read.remarks)
    for warning in _warnings(read.data):
        complain(f"mind: {warning}")
    if arguments.picture is not None:
        _draw(read.data, arguments.picture)
    if arguments.out is not None:
        _write(read, files, arguments.out)
    return 0


def _say(readings: "tuple[tuple[str, str, str], ...]", remarks: tuple[str, ...]) -> None:
    if readings:
        print(aligned(readings))
    for remark in remarks:
        complain(f"mind: {remark}")


def _explain(read: FromFiles) -> None:
    """The reading as a table: what each column is, in which unit, and what the numbers say of other
    readings.
    """
    from ibrid.measurement.quality.other_readings import other_readings, other_readings_of_records

    rows = [("read as", "column", "unit"), *read.readings] if read.readings else []
    if rows:
        print(aligned(rows))
    if read.remarks:
        print("\non what it rests:")
        print("".join(f"  {remark}\n" for remark in read.remarks), end="")
    others = (
        other_readings_of_records(read.data)
        if isinstance(read.data, Events)
        else other_readings(read.data)
    )
    print("\nother readings of the same numbers:")
    print(aligned([(one.words, one.verdict) for one in others], indent="  "))


def _warnings(data: "Sweep | Events") -> tuple[str, ...]:
    """What contradicts itself in a sweep or in records."""
    from ibrid.measurement.conventions.contradictions import check_conventions
    from ibrid.measurement.quality.event_contradictions import contradictions
    from ibrid.measurement.quality.plausibility import implausible_numbers
    from ibrid.measurement.quality.shifted_entries import shifted_entries
    from ibrid.measurement.quality.wrong_rows import contradicted_rows

    if isinstance(data, Events):
        said = {f"{record.name}: {one}." for record in data.records for one in record.remarks}
        return tuple(sentence for sentence in contradictions(data) if sentence not in said)
    first = replace(data, points=data.points[:CHECKED])
    return (
        *contradicted_rows(first),
        *shifted_entries(first),
        *check_conventions(data).warnings,
        *implausible_numbers(data),
    )


def _draw(data: "Sweep | Events", place: str) -> None:
    from ibrid.report.import_picture import import_picture

    suffix = Path(place).suffix.lower().lstrip(".")
    if suffix not in ("svg", "png"):
        raise IbridError(f"--picture {place} must end with .svg or .png")
    write_whole(place, import_picture(data, suffix))


def _write(read: FromFiles, files: list[str], out: str) -> None:
    """The file of ours, and what to do next."""
    data = read.data
    if isinstance(data, Events):
        write_events(data, out, header=[f"imported from {file}" for file in files])
        print(
            f"{out}: {'; '.join(f'{record.name} ({len(record.time)} samples)' for record in data.records)}"
        )
        print(f"next: ibrid inspect {out}")
        return
    write_sweep(data, out)
    frequency = [len(point.frequency) for point in data.points]
    grid = (
        f"{frequency[0]}" if len(set(frequency)) == 1 else f"{min(frequency)} to {max(frequency)}"
    )
    print(f"{Path(out)}: {grid} frequencies at {'; '.join(data.names)}")
    print(f"next: ibrid start {out} --out {Path(out).stem}_start")
