"""`ibrid record PLANT` and `ibrid playback MODEL EVENTS`: faults and steps of our own inverters,
and models beside records.
"""

from argparse import Namespace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.commands.outputs import command_line, give_events, made_of
from ibrid.errors import IbridError
from ibrid.streams import complain
from ibrid.writing import inside, require_folder, require_place, write_json, write_whole

if TYPE_CHECKING:
    from ibrid.playback.compare import EventModel
    from ibrid.structure.network.outside import Outside

JSON, PAGE = "playback.json", "report.html"


def run_record(arguments: Namespace) -> int:
    """Simulate and write the file."""
    require_place(arguments.out)

    from ibrid.plants.sweeping import operating_point, plant_named
    from ibrid.playback.recording import event_of, record_events

    plant = plant_named(arguments.plant).with_overrides(inputs.overrides(arguments.set))
    points = (
        [operating_point(text) for text in arguments.op] if arguments.op else plant.operating_points
    )
    events = record_events(
        plant,
        points,
        [event_of(text) for text in arguments.event],
        rate=arguments.rate,
        length=arguments.length,
        angle=radians(arguments.angle),
        noise_db=arguments.noise_db,
        seed=arguments.seed,
    )
    options = ("op", "event", "set", "rate", "angle", "seed", "length", "noise_db")
    line = command_line(arguments, "record", arguments.plant, options=options)
    give_events(events, arguments.out, *made_of(plant, line))
    return 0


def run_playback(arguments: Namespace) -> int:
    """Play, write the files, print the errors."""
    from ibrid.playback.compare import play
    from ibrid.playback.step_figures import step_figures
    from ibrid.playback.validation import validation
    from ibrid.report.pages.playback_page import playback_page
    from ibrid.report.texts.playback_text import playback_text

    folder = Path(arguments.out)
    require_folder(folder, (JSON, PAGE))
    events = inputs.events(arguments.events, inputs.said_of_events(arguments))
    model = event_model(
        arguments.model, arguments.values, arguments.kinds, inputs.port(arguments.port, events)
    )
    if model.assumed:
        complain(
            f"no value for {', '.join(model.assumed)}: typical ones are played; put others into a "
            "file of --values"
        )
    playback = play(model, events)
    measured = {"validation": validation(playback)} if arguments.standard == "iec" else {}
    steps = {
        one.record.name: found
        for one in playback.records
        if (found := step_figures(one)) is not None
    }
    page = playback_page(playback, Path(arguments.model).name, measured.get("validation"), steps)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(
        inside(folder, JSON), playback.plain() | measured | ({"steps": steps} if steps else {})
    )
    write_whole(inside(folder, PAGE), page)
    print(playback_text(playback, measured.get("validation"), steps))
    return 0


def event_model(text: str, values: str | None, kinds: list[str], port: "Outside") -> "EventModel":
    """What a program at values behind a port, or a record, stands for when it is played."""
    from ibrid.gap.refitting.prior import read_values
    from ibrid.playback.compare import model_of_program, model_of_record

    if is_record(text):
        if values is not None or port:
            option = "--port" if values is None else "--values"
            raise IbridError(f"{option} belongs to a program; a record brings its own")
        return model_of_record(inputs.record(text, kinds))
    from ibrid.modules.vocabulary import choose_vocabulary
    from ibrid.structure.compiling.check import require_legal

    known = choose_vocabulary(inputs.vocabulary(files=kinds))
    diagram = inputs.program(text)
    require_legal(diagram, known, equilibrium="exact")
    nominal = {} if values is None else read_values(values)
    if any(isinstance(entry, dict) and "tolerance" in entry for entry in nominal.values()):
        complain(f"{values}: values are played as they are, and tolerances change nothing")
    return model_of_program(diagram.behind(port), nominal, known)
