"""`ibrid predict RECORD`, `ibrid nfp RECORD` and `ibrid stability RECORD`: what a model says
elsewhere, and in a grid.
"""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.commands import inputs
from ibrid.commands.outputs import (
    command_line,
    give_json,
    require_distinct,
    require_json_place,
    say_sweep,
)
from ibrid.errors import IbridError
from ibrid.writing import require_place, write_whole

if TYPE_CHECKING:
    from ibrid.analysis.grids.grid import MeasuredGrid, SeriesRL
    from ibrid.evaluation.record import Record


def run_predict(arguments: Namespace) -> int:
    """Write the sweep and print what is predicted; or the current in time."""
    _require_places(arguments, {"--out": arguments.out, "--equivalent": arguments.equivalent})
    if bool(arguments.op) == (arguments.events is not None):
        raise IbridError(
            "predict takes --op p=..,q=.. or --events EVENTS, one of them; found neither or both"
        )
    if arguments.equivalent and arguments.port is None:
        raise IbridError(
            "--equivalent stands for the devices of a plant; give its network with --port PORT.toml"
        )
    if arguments.events is not None:
        inputs.require_no_plant(arguments)
        return _predict_events(arguments)
    inputs.require_no_events_options(arguments)
    if arguments.port is not None:
        return _predict_plant(arguments)

    from ibrid.analysis.models.prediction import SCHEMA, predict, predicted_sweep
    from ibrid.measurement.formats.csv_file import write_sweep
    from ibrid.plants.sweeping import frequency_grid
    from ibrid.report.texts.prediction_text import format_predictions

    frequency = frequency_grid(arguments.freq)
    record = inputs.record(arguments.record, arguments.kinds)
    predictions = [predict(record, op, frequency) for op in arguments.op]
    sweep = predicted_sweep(record, predictions)
    made = f"predicted, not measured: {_command(arguments, 'op', 'freq')}"
    bands = "sigma: one standard deviation of the prediction, from the covariance of the parameters"
    write_sweep(
        sweep, arguments.out, header=(made, bands) if sweep.points[0].sigma is not None else (made,)
    )
    content = {"schema": SCHEMA, "points": [one.plain() for one in predictions]}
    if not give_json(content, arguments.json):
        print(format_predictions(predictions))
        say_sweep(sweep, arguments.out)
    return 0


def run_nfp(arguments: Namespace) -> int:
    """Write the files, print a table."""
    _require_places(arguments, {"--out": arguments.out})

    from ibrid.analysis.grids.power_jacobian import power_jacobian
    from ibrid.plants.sweeping import frequency_grid
    from ibrid.report.texts.prediction_text import format_jacobian, jacobian_csv

    frequency = frequency_grid(arguments.freq)
    record = inputs.record(arguments.record, arguments.kinds)
    jacobians = [
        power_jacobian(record, op, frequency) for op in arguments.op or record.parameters or [None]
    ]
    if arguments.out is not None:
        write_whole(arguments.out, jacobian_csv(jacobians))
    if not give_json(
        {"schema": "ibrid.nfp/1", "points": [one.plain() for one in jacobians]}, arguments.json
    ):
        print("\n".join(map(format_jacobian, jacobians)))
    return 0


def _predict_plant(arguments: Namespace) -> int:
    """The sweep of a plant, and the port of one device in place of all."""
    from ibrid.analysis.several_devices.collector_file import KnownBases, read_collector
    from ibrid.analysis.several_devices.plant import predict_plant
    from ibrid.measurement.formats.csv_file import write_sweep
    from ibrid.plants.sweeping import frequency_grid
    from ibrid.report.texts.prediction_text import equivalent_file, format_plant

    record = inputs.record(arguments.record, arguments.kinds)
    bases = record.settings.get("bases", {})  # of one device: the plant's base of power is its own
    network = read_collector(
        arguments.port, KnownBases(None, bases.get("v_base_v"), float(record.settings["f0_hz"]))
    )
    plant = predict_plant(record, network, arguments.op, frequency_grid(arguments.freq))
    made = f"a plant, predicted, not measured: {_command(arguments, 'op', 'port', 'freq')}"
    write_sweep(plant.sweep, arguments.out, header=(made,))
    if arguments.equivalent is not None:
        write_whole(arguments.equivalent, equivalent_file(plant.equivalent))
    if not give_json(plant.plain(), arguments.json):
        print(format_plant(plant))
        say_sweep(plant.sweep, arguments.out)
    return 0


def _predict_events(arguments: Namespace) -> int:
    from ibrid.measurement.formats.event_csv import write_events
    from ibrid.playback.compare import answered, model_of_record, play
    from ibrid.report.texts.playback_text import playback_text

    events = inputs.events(arguments.events, inputs.said_of_events(arguments))
    playback = play(model_of_record(inputs.record(arguments.record, arguments.kinds)), events)
    made = f"the current is predicted, not measured: {_command(arguments, 'events')}"
    write_events(answered(events, playback), arguments.out, header=(made,))
    if not give_json(playback.plain(), arguments.json):
        print(playback_text(playback))
    return 0


def run_stability(arguments: Namespace) -> int:
    """Answer, write the files, print the tables; 0 whatever the answer."""
    _require_places(arguments, {"--report": arguments.report})
    if arguments.scr is not None and arguments.grid is not None:
        raise IbridError("stability takes --scr or --grid, found both; give one")
    if arguments.grid is not None and arguments.xr is not None:
        raise IbridError("--xr belongs to --scr; a --grid brings its own r and x")

    from ibrid.analysis.grids.grid import ratios
    from ibrid.analysis.grids.stability import stability
    from ibrid.plants.sweeping import frequency_grid
    from ibrid.report.texts.stability_text import format_stability

    scr = () if arguments.scr is None else ratios(arguments.scr)
    frequency = None if arguments.freq is None else frequency_grid(arguments.freq)
    record = inputs.record(arguments.record, arguments.kinds)
    grid = None if arguments.grid is None else _grid(arguments.grid, record)
    study = stability(
        record, scr, xr=arguments.xr or 10.0, grid=grid, op=arguments.op, frequency=frequency
    )
    printed = give_json(study.plain(), arguments.json)
    if arguments.report is not None:
        from ibrid.report.pages.stability_page import stability_page

        write_whole(arguments.report, stability_page(study, Path(arguments.record).name))
    if not printed:
        print(format_stability(study).rstrip("\n"))
    return 0


def _grid(text: str, record: "Record") -> "SeriesRL | MeasuredGrid":
    """Values when written so, else the impedance in a file."""
    from ibrid.analysis.models.linear_model import whole_record

    with whole_record():
        f0_hz = float(record.settings["f0_hz"])
    return inputs.grid(text, f0_hz)


def _require_places(arguments: Namespace, outputs: dict[str, str | None]) -> None:
    require_json_place(arguments.json)
    for place in outputs.values():
        if place is not None:
            require_place(place)
    require_distinct({**outputs, "--json": arguments.json})


def _command(arguments: Namespace, *options: str) -> str:
    return command_line(arguments, "predict", arguments.record, options=options)
