"""`ibrid import FILE...`: anybody's table as a sweep file, a recorder's as an events file; what was read as what is shown."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from ibrid.commands import inputs
from ibrid.errors import IbridError
from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.conventions.header import HEADER_KEYS, POINT_KEYS
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.timed.recording_files import each_once
from ibrid.measurement.importing.told import base_of
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.read import is_sweep_file, read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.sweeps.amplitudes import merge
from ibrid.streams import complain
from ibrid.writing import aligned, require_place

#: Options that say what a table does not.
_OF_TABLES = ("voltage_axis", "frame_deg", "quantity", "sequence_frequency", "sampling_hz", "op", "p", "q", "v")
_OF_EVENTS = ("unit", "base", "current", "q_axis", "power_node", "f0_hz")


def run(arguments: Namespace) -> int:
    """Show what each column was read as, then write the sweep or say what must be told first."""
    require_place(arguments.out)
    arguments.files = [str(path) for path in each_once([Path(file) for file in arguments.files])]
    said = {name: getattr(arguments, name) for name in _OF_EVENTS + _OF_TABLES}
    if arguments.channels or any(map(inputs.holds_events, arguments.files)):
        return _import_events(arguments, said)
    plain = not arguments.map and all(said[name] is None for name in (*POINT_KEYS, "quantity", "sequence_frequency"))
    if plain and all(is_sweep_file(Path(file)) for file in arguments.files):
        keys = {name: said[name] for name in HEADER_KEYS if said.get(name) is not None}
        if said["base"]:
            keys["s_base_va"], keys["v_base_v"] = base_of(said["base"], "--base")
        sweep = merge([read_sweep(file, **keys) for file in arguments.files])
    else:
        imported = import_files(arguments.files, arguments.map, **said)
        print(aligned(imported.readings))
        for remark in imported.remarks:
            complain(f"mind: {remark}")
        sweep = imported.answered()
    for warning in check_conventions(sweep).warnings:
        complain(f"mind: {warning}")
    write_sweep(sweep, arguments.out)
    frequency = [len(point.frequency) for point in sweep.points]
    grid = f"{frequency[0]}" if len(set(frequency)) == 1 else f"{min(frequency)} to {max(frequency)}"
    print(f"{Path(arguments.out)}: {grid} frequencies at {'; '.join(sweep.names)}")
    print(f"next: ibrid start {arguments.out} --out {Path(arguments.out).stem}_start")
    return 0


def _import_events(arguments: Namespace, said: dict[str, Any]) -> int:
    """All records of the files in one events file."""
    unfit = [name for name in _OF_TABLES if said[name] is not None]
    if unfit or arguments.map:
        raise IbridError(
            f"--{(unfit or ['map'])[0].replace('_', '-')} says nothing of records in time; --channels, --"
            f"{', --'.join(_OF_EVENTS).replace('_', '-')} do"
        )
    keys = {name: said[name] for name in _OF_EVENTS}
    read = [read_events(file, channels=arguments.channels, **keys) for file in arguments.files]
    if len({events.f0_hz for events in read}) > 1:
        raise IbridError("records in one file must have one nominal frequency; import them one by one")
    events = replace(read[0], records=tuple(record for one in read for record in one.records))
    remarks = [f"{record.name}: {remark}." for record in events.records for remark in record.remarks]
    for sentence in dict.fromkeys((*remarks, *contradictions(events))):
        complain(f"mind: {sentence}")
    write_events(events, arguments.out, header=[f"imported from {file}" for file in arguments.files])
    print(f"{arguments.out}: {'; '.join(f'{record.name} ({len(record.time)} samples)' for record in events.records)}")
    print(f"next: ibrid inspect {arguments.out}")
    return 0
