"""`ibrid sweep PLANT` and `ibrid inspect DATA|EVENTS`: measured data, made and looked at."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.commands import inputs
from ibrid.commands.outputs import command_line, give_json, made_of, require_json_place, say_sweep
from ibrid.errors import IbridError, SweepError
from ibrid.streams import complain
from ibrid.writing import require_place

if TYPE_CHECKING:
    from ibrid.commands.foreign_files import FromFiles
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep


def run_sweep(arguments: Namespace) -> int:
    """Sweep a reference inverter and write the file."""
    from ibrid.measurement.formats.csv_file import write_sweep
    from ibrid.plants.sweeping import frequency_grid, operating_point, plant_named, sweep

    require_place(arguments.out)
    if Path(arguments.out).exists() and not Path(arguments.out).is_file():
        raise IbridError(f"{arguments.out}: is a device or a pipe; a sweep is written to a file")
    plant = plant_named(arguments.plant).with_overrides(inputs.overrides(arguments.set))
    measured = sweep(
        plant,
        [operating_point(text) for text in arguments.op] if arguments.op else None,
        frequency_grid(arguments.freq),
        method=arguments.method,
        noise_db=arguments.noise_db,
        repeats=arguments.repeats,
        seed=arguments.seed,
    )
    noise = () if arguments.noise_db is None else ("noise_db", "repeats", "seed")
    line = command_line(
        arguments, "sweep", arguments.plant, options=("op", "freq", "method", *noise, "set")
    )
    write_sweep(measured, arguments.out, header=made_of(plant, line))
    say_sweep(measured, arguments.out)
    return 0


def run_inspect(arguments: Namespace) -> int:
    """Print the first look."""
    from ibrid.measurement.quality.event_inspection import inspect_events
    from ibrid.measurement.quality.inspect import inspect
    from ibrid.measurement.quality.inspection_table import (
        format_events_inspection,
        format_inspection,
    )
    from ibrid.measurement.recordings.events import Events

    require_json_place(arguments.json)
    data = _measured(arguments)
    if isinstance(data, Events):
        inspection = inspect_events(data)
        text = format_events_inspection(inspection)
    else:
        inspection = inspect(data, sampling_hz=arguments.sampling_hz)
        text = format_inspection(inspection)
    if not give_json(inspection.to_json(), arguments.json):
        print(text, end="")
    return 0


def _measured(arguments: Namespace) -> "Sweep | Events":
    """The sweep or the records that DATA names: a file of ours, a shipped sweep, or anybody's with
    what is said beside it.
    """
    from ibrid.commands import foreign_files
    from ibrid.measurement.formats.bundle import is_there
    from ibrid.measurement.read import is_own_sweep

    if not is_there(Path(arguments.data)):
        return inputs.data(arguments.data)
    files = foreign_files.files_named([arguments.data])
    if recordings := foreign_files.recordings_of(files, arguments):
        return foreign_files.records_in(recordings, arguments).data
    if foreign_files.says_anything(arguments) or len(files) > 1:
        return _said_of(foreign_files.sweep_in(files, arguments, inspecting=True))
    inputs.require_no_events_options(arguments)
    try:
        return inputs.data(arguments.data)
    except SweepError as reason:
        if is_own_sweep(Path(arguments.data)):
            raise
        try:
            return _said_of(foreign_files.sweep_in(files, arguments, inspecting=True))
        except foreign_files.UnansweredError:
            raise
        except SweepError:
            raise reason from None


def _said_of(read: "FromFiles") -> "Sweep | Events":
    """The data, after what was assumed in reading them is said."""
    for remark in read.remarks:
        complain(f"mind: {remark}")
    return read.data
