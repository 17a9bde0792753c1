"""`ibrid start DATA`: from a file to a first answer, with a page and the commands that go on from there."""

from argparse import Namespace
from typing import TYPE_CHECKING

from ibrid.commands import inputs
from ibrid.commands.outputs import complain
from ibrid.errors import IbridError, SweepError

if TYPE_CHECKING:
    from pathlib import Path

    from ibrid.measurement.events import Events
    from ibrid.measurement.sweep import Sweep


def run(arguments: Namespace) -> int:
    """Answer, write the folder, and print the sentence, the ranking and the commands."""
    from pathlib import Path

    from ibrid.telling import telling
    from ibrid.writing import aligned, require_folder

    folder = Path(arguments.out or f"{Path(arguments.data).stem}_start")
    require_folder(folder)
    events = _events(arguments)
    sweep, data = _data(arguments.data, folder)

    from ibrid_search.start import start, write_start

    folder.mkdir(parents=True, exist_ok=True)
    with telling() as tell:
        port = inputs.port(arguments.port, sweep)
        answer = start(sweep, tell=tell, seed=arguments.seed, port=port, events=events)
    said = {"--port": arguments.port, "--events": arguments.events}
    said |= {"--channels": arguments.channels, "--base": arguments.base} if events is not None else {}
    answer = write_start(answer, data, folder, [part for pair in said.items() if pair[1] is not None for part in pair])
    for warning in answer.warnings:
        complain(f"mind: {warning}")
    print(answer.sentence)
    print()
    rows = [(ranked.diagram, ranked.grade or "looked at", f"NRMSE {ranked.nrmse:.3g}") for ranked in answer.ranked[:6]]
    print(aligned(rows))
    print(f"\nnext (page: {folder / 'report.html'}):")
    for line in answer.next:
        print(f"  {line}")
    return 0


def _events(arguments: Namespace) -> "Events | None":
    """The records beside the sweep; IbridError for options without them, and for records in place of a sweep."""
    if inputs.holds_events(arguments.data):
        raise IbridError(
            f"{arguments.data} holds records of events, which are no start alone; give a sweep and these as --events, or find a "
            f"diagram from them: ibrid search {arguments.data} --out RUN"
        )
    if arguments.events is not None:
        return inputs.read_events_at(arguments.events, arguments.channels, arguments.base)
    inputs.require_no_events_options(arguments)
    return None


def _data(text: str, folder: "Path") -> "tuple[Sweep, str]":
    """The sweep, and how commands name it; a foreign table is imported into the folder where its words suffice."""
    try:
        return inputs.data(text), text
    except SweepError as refused:
        from ibrid.measurement.csv_file import write_sweep
        from ibrid.measurement.importing import import_files

        if inputs.sweep_file(text) is None:
            raise
        try:
            imported = import_files([text])
        except SweepError:
            raise refused from None
        if imported.sweep is None:
            raise SweepError(
                f"{imported.asked} Say it to ibrid import {text} --out sweep.csv, then start on that."
            ) from None
        for remark in imported.remarks:
            complain(f"mind: {remark}")
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "sweep.csv"
        write_sweep(imported.sweep, file)
        return inputs.data(str(file)), str(file)
