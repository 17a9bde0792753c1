"""Measurements of a device, as the story asks for them, each in a file of its own, and all of them
together.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.devices.device_file import DeviceFile
from ibrid.devices.measuring import measure_timed
from ibrid.devices.recording_events import measure_events
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.telling import Tell
from ibrid.writing import inside
from ibrid_search.opening.story import DeviceExperiment, digest_of

#: Deviation of Y over |Y| below which nothing is asked of the control: what a device's integration
#: leaves.
INTEGRATED = 1e-4


def measure_experiment(
    device: DeviceFile, experiment: DeviceExperiment, folder: Path, name: str, tell: Tell
) -> DeviceExperiment:
    """Measure an experiment into the file `name`.csv of the folder; the experiment with its file.

    Raises IbridError as `ibrid.devices.measure`.
    """
    path = inside(folder, f"{name}.csv")
    if experiment.kind == "event":
        events = measure_events(device, [experiment.op], [experiment.event], tell=tell)
        record = _rename(events.records[0], f"{experiment.event} at {experiment.op}")
        write_events(replace(events, records=(record,)), path)
        simulated = float(record.time[-1])
    else:
        measured = measure_timed(
            device, [experiment.op], experiment.frequencies, out=path, tell=tell
        )
        simulated = measured.simulated_s
    return replace(experiment, file=path.name, sha256=digest_of(path), simulated_s=simulated)


def join_measurements(
    experiments: Sequence[DeviceExperiment], folder: Path, step_s: float
) -> tuple[Sweep, Events | None]:
    """Join all sweeps, and all records of events, None without any.

    step_s : T, between two samples of the voltage, s. Law: of each real and imaginary part
    sigma^2 = sigma_measured^2 + (`INTEGRATED`^2 + ((2 pi f T)^4 / 720)^2) |Y|^2 / 8; the last is
    the gain of a cubic spline through samples of a sine, less one, to first order.
    """
    done = [experiment for experiment in experiments if experiment.file]
    sweeps = [read_sweep(folder / swept.file) for swept in done if swept.kind == "sweep"]
    points: list[PointSweep] = []
    for point in (point for sweep in sweeps for point in sweep.points):
        name = _unused_name(point.op.name, [earlier.op.name for earlier in points])
        points.append(
            replace(_with_integration_error(point, step_s), op=replace(point.op, name=name))
        )
    recorded = [folder / event.file for event in done if event.kind == "event"]
    whole = replace(sweeps[0], points=tuple(points), notes=())
    return whole, join_events(recorded) if recorded else None


def join_events(files: Sequence[Path]) -> Events:
    """Join the records of one or more files."""
    recordings = [read_events(file) for file in files]
    records: list[EventRecord] = []
    for record in (record for events in recordings for record in events.records):
        name = _unused_name(record.name, [earlier.name for earlier in records])
        records.append(_rename(record, name))
    return replace(recordings[0], records=tuple(records), notes=())


def _with_integration_error(point: PointSweep, step_s: float) -> PointSweep:
    """The point with the deviation that integration and sampling leave."""
    size = np.linalg.norm(point.admittance, axis=(1, 2))
    sampled = (2 * np.pi * point.frequency * step_s) ** 4 / 720
    left = np.hypot(INTEGRATED, sampled) * size / np.sqrt(8.0)
    known = np.zeros((1, 2, 2)) if point.sigma is None else point.sigma
    return replace(point, sigma=np.hypot(known, left[:, None, None]))


def _unused_name(name: str, taken: Collection[str]) -> str:
    """The name, or with "again" and a number where it is taken."""
    number = 1
    free = name
    while free in taken:
        free = f"{name} again {number}"
        number += 1
    return free


def _rename(record: EventRecord, name: str) -> EventRecord:
    return replace(record, rest=replace(record.rest, name=name))
