"""`ibrid sweep PLANT` and `ibrid inspect DATA|EVENTS`: measured data, made and looked at."""

from argparse import Namespace

from ibrid.commands import inputs
from ibrid.commands.outputs import command_line, give_json, require_json_place
from ibrid.errors import IbridError
from ibrid.writing import require_place


def run_sweep(arguments: Namespace) -> int:
    """Sweep a reference inverter and write the file."""
    from pathlib import Path

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
    values = ", ".join(f"{name} = {value!r}" for name, value in plant.diagram_values.items())
    noise = () if arguments.noise_db is None else ("noise_db", "repeats", "seed")
    line = command_line(arguments, "sweep", arguments.plant, options=("op", "freq", "method", *noise, "set"))
    header = (f"made by: {line}", f"inverter: {plant.source}", f"true parameters: {values}")
    write_sweep(measured, arguments.out, header=header)
    print(f"{arguments.out}: {len(measured.points[0].frequency)} frequencies at {'; '.join(measured.names)}")
    return 0


def run_inspect(arguments: Namespace) -> int:
    """Print the first look."""
    from ibrid.measurement.quality.event_inspection import inspect_events
    from ibrid.measurement.quality.inspect import inspect
    from ibrid.measurement.quality.inspection_table import format_events_inspection, format_inspection

    require_json_place(arguments.json)
    if arguments.channels or inputs.holds_events(arguments.data):
        inspection = inspect_events(inputs.read_events_at(arguments.data, inputs.said_of_events(arguments)))
        text = format_events_inspection(inspection)
    else:
        inputs.require_no_events_options(arguments)
        inspection = inspect(inputs.data(arguments.data), sampling_hz=arguments.sampling_hz)
        text = format_inspection(inspection)
    if not give_json(inspection.to_json(), arguments.json):
        print(text, end="")
    return 0
