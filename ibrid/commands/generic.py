"""`ibrid generic DATA --model NAME`: a generic planning model fitted to recordings, or to what an
identified model answers to standard events.
"""

from argparse import Namespace
from pathlib import Path

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.errors import IbridError
from ibrid.writing import inside, require_folder, write_json, write_whole

JSON, PAGE, DYR, ANDES = "generic.json", "report.html", "model.dyr", "andes.json"


def run(arguments: Namespace) -> int:
    """Fit, write the files, print what was found."""
    from ibrid.generic.andes_case import andes_case
    from ibrid.generic.dialect import dialect_named
    from ibrid.generic.dyr import dyr_text, read_dyr, values_from
    from ibrid.generic.fitting import generic_model
    from ibrid.generic.model import model_named
    from ibrid.plants.sweeping import operating_point
    from ibrid.report.pages.generic_page import generic_page
    from ibrid.report.texts.generic_text import generic_text

    folder = Path(arguments.out)
    require_folder(folder, (JSON, PAGE, DYR, ANDES))
    model, dialect = model_named(arguments.model), dialect_named(arguments.dialect)
    machine = arguments.id or "1"
    if not machine.isalnum() or len(machine) > 2:
        raise IbridError(f"--id has one or two letters or digits; found {machine!r}")
    bus, start = arguments.bus, None
    if arguments.start is not None:
        start, at, machine = values_from(read_dyr(arguments.start), model.blocks, bus, arguments.id)
        bus = at
    data = (
        inputs.record(arguments.events)
        if is_record(arguments.events)
        else inputs.events(arguments.events, inputs.said_of_events(arguments))
    )
    answer = generic_model(
        data,
        model.name,
        points=[operating_point(text) for text in arguments.op],
        start=start,
        dialect=arguments.dialect,
    )
    rest = answer.played[0].record.rest
    case = andes_case(
        model.blocks,
        answer.fit.values,
        (rest.p, rest.q, rest.v),
        answer.f0_hz,
        dialect.rate_over_tg,
    )
    page = generic_page(answer)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(inside(folder, DYR), dyr_text(model.blocks, answer.fit.values, bus or 1, machine))
    write_whole(inside(folder, ANDES), case)
    write_json(inside(folder, JSON), answer.plain())
    write_whole(inside(folder, PAGE), page)
    print(generic_text(answer))
    return 0
