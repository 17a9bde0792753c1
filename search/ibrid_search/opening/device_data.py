"""Measurements of a device, as the story asks for them, each in a file of its own, and all of them
together.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ibrid.devices.device_file import DeviceFile
from ibrid.devices.measuring import measure
from ibrid.devices.recording_events import measure_events
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.telling import Tell
from ibrid.writing import inside
from ibrid_search.opening.story import DeviceExperiment, digest_of

#: In the comment that a measurement of a sweep leaves for each operating point.
_SIMULATED = re.compile(r"([0-9.e+-]+) s simulated with")


def measured(
    device: DeviceFile, experiment: DeviceExperiment, folder: Path, name: str, tell: Tell
) -> DeviceExperiment:
    """Measure an experiment into the file `name`.csv of the folder; the experiment with its file.

    Raises IbridError as `ibrid.devices.measure`.
    """
    path = inside(folder, f"{name}.csv")
    if experiment.kind == "event":
        events = measure_events(device, [experiment.op], [experiment.event], tell=tell)
        record = _named(events.records[0], f"{experiment.event} at {experiment.op}")
        write_events(replace(events, records=(record,)), path)
        simulated = float(record.time[-1])
    else:
        sweep = measure(device, [experiment.op], experiment.frequencies, out=path, tell=tell)
        found = [match for note in sweep.notes if (match := _SIMULATED.search(note))]
        simulated = sum(float(match.group(1)) for match in found)
    return replace(experiment, file=path.name, sha256=digest_of(path), simulated_s=simulated)


def data_of(experiments: Sequence[DeviceExperiment], folder: Path) -> tuple[Sweep, Events | None]:
    """All sweeps as one, and all records of events, None without any."""
    sweeps = [
        read_sweep(folder / one.file) for one in experiments if one.file and one.kind == "sweep"
    ]
    points = []
    for sweep in sweeps:
        for point in sweep.points:
            same = sum(point.op.name == one.op.name.partition(" again")[0] for one in points)
            name = point.op.name + (f" again {same}" if same else "")
            points.append(replace(point, op=replace(point.op, name=name)))
    recordings = [
        read_events(folder / one.file) for one in experiments if one.file and one.kind == "event"
    ]
    records = []
    for events in recordings:
        for record in events.records:
            same = sum(record.name == one.name.partition(" again")[0] for one in records)
            name = record.name + (f" again {same}" if same else "")
            records.append(_named(record, name))
    return (
        replace(sweeps[0], points=tuple(points), notes=()),
        replace(recordings[0], records=tuple(records), notes=()) if recordings else None,
    )


def _named(record: EventRecord, name: str) -> EventRecord:
    return replace(record, rest=replace(record.rest, name=name))
