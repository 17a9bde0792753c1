"""`ibrid start DATA`: from a file to a first result, with a page and the commands that go on from
there.
"""

from argparse import Namespace
from typing import TYPE_CHECKING

from ibrid.commands import inputs
from ibrid.errors import IbridError
from ibrid.streams import complain

if TYPE_CHECKING:
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep


#: Records as they were read, where the commands that go on have no option for what was said.
EVENTS = "events.csv"


def run(arguments: Namespace) -> int:
    """Answer, write the folder, and print the sentence, the ranking and the commands."""
    from pathlib import Path

    from ibrid.telling import telling
    from ibrid.writing import aligned, require_folder
    from ibrid_search.starting.start import start
    from ibrid_search.starting.start_files import FILES, write_start

    folder = Path(arguments.out or f"{Path(arguments.data).stem}_start")
    says_frequency = arguments.f0_hz is not None
    require_folder(folder, (*FILES, EVENTS) if says_frequency else FILES)
    data, name, events = _data(arguments)

    folder.mkdir(parents=True, exist_ok=True)
    options = _options_of_data(arguments)
    if says_frequency:
        recordings = data if events is None else events
        recordings.save(folder / EVENTS)
        name = str(folder / EVENTS) if events is None else name
        options = {"--port": arguments.port}
        options |= {"--events": None if events is None else str(folder / EVENTS)}
    with telling() as tell:
        port = inputs.port(arguments.port, data)
        asked = {"effort": arguments.effort, "devices": arguments.devices}
        result = start(data, tell=tell, seed=arguments.seed, port=port, events=events, **asked)
    behind = [part for pair in options.items() if pair[1] is not None for part in map(str, pair)]
    result = write_start(result, name, folder, [*behind, *["--robust"] * arguments.robust])
    for warning in result.warnings:
        complain(f"mind: {warning}")
    print(result.sentence)
    print()
    rows = [
        (fit.diagram, fit.grade or "screened only", f"NRMSE {fit.nrmse:.3g}")
        for fit in result.ranked[:6]
    ]
    print(aligned(rows))
    print(f"\nnext (page: {folder / 'report.html'}):")
    for line in result.next:
        print(f"  {line}")
    return 0


def _options_of_data(arguments: Namespace) -> dict[str, object]:
    """What the commands that go on must say of the data, too."""
    return {
        "--port": arguments.port,
        "--events": arguments.events,
        "--channels": arguments.channels,
        "--base": arguments.base,
        "--from": arguments.begin,
        "--to": arguments.end,
    }


def _data(arguments: Namespace) -> "tuple[Sweep | Events, str, Events | None]":
    """A sweep or records, how commands name them, and records beside a sweep."""
    options = inputs.said_of_events(arguments)
    if arguments.f0_hz is not None:
        options["f0_hz"] = arguments.f0_hz
    if inputs.holds_events(arguments.data):
        inputs.require_no_second_events(arguments)
        return inputs.read_events_at(arguments.data, options), arguments.data, None
    if arguments.events is None:
        inputs.require_no_events_options(arguments)
        if arguments.f0_hz is not None:
            raise IbridError(
                "--f0-hz is of records of events, and none are given; say it of a sweep in ibrid "
                f"import {arguments.data} --f0-hz {arguments.f0_hz:g} --out sweep.csv"
            )
    beside = None if arguments.events is None else inputs.read_events_at(arguments.events, options)
    sweep = inputs.data(arguments.data)
    return inputs.without_wrong_rows(sweep) if arguments.robust else sweep, arguments.data, beside
