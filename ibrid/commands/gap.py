"""`ibrid gap MODEL DATA --out DIR`: where they disagree, which effect is missing, and the model
with it.
"""

from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.commands.outputs import UNFINISHED
from ibrid.errors import IbridError
from ibrid.plugins import command
from ibrid.streams import complain
from ibrid.writing import inside, require_folder, write_whole

if TYPE_CHECKING:
    from ibrid.gap.results.gap import Gap
    from ibrid.gap.results.suggested_edits import Suggest
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep
    from ibrid.telling import Tell


def run(arguments: Namespace) -> int:
    """Answer, write the files, print the answer; 0: any verdict, 3: the effort was spent before
    everything was tried.
    """
    from ibrid.gap.refitting.prior import read_values
    from ibrid.gap.results.files import PAGE, write_gap
    from ibrid.report.pages.gap_page import gap_page
    from ibrid.report.texts.gap_text import gap_text
    from ibrid.telling import telling

    folder = _folder(arguments)
    sweep, events = inputs.measured_or_events(arguments)
    values = None if arguments.values is None else read_values(arguments.values)
    if arguments.suggest is not None and events is not None:
        raise IbridError(
            "--suggest asks about places that a sweep alone locates; leave it out beside records "
            "of events"
        )
    suggest = _suggest(arguments)
    with telling("auto") as tell:
        gap = _answer(arguments, sweep, events, values, suggest, tell)
    page = gap_page(gap)
    folder.mkdir(parents=True, exist_ok=True)
    given = f"the program of {arguments.model}" if _is_sweep(arguments.model) else arguments.model
    write_gap(gap, folder, given)
    write_whole(inside(folder, PAGE), page)
    print(gap_text(gap, folder).rstrip("\n"))
    return 0 if gap.complete else UNFINISHED


def _answer(
    arguments: Namespace,
    sweep: "Sweep | None",
    events: "Events | None",
    values: dict[str, Any] | None,
    suggest: "tuple[Suggest, ...]",
    tell: "Tell",
) -> "Gap":
    from ibrid.gap.results.files import write_partial
    from ibrid.gap.workflow import find_gap
    from ibrid.plugins import extended_catalogue

    options = {
        "holdout_op": arguments.holdout_op,
        "port": inputs.port(arguments.port, events if sweep is None else sweep),
        "events": events,
        "vocabulary": inputs.vocabulary(files=arguments.kinds),
        "catalogue": extended_catalogue(complain),
        "seed": arguments.seed,
        "suggest": suggest,
        "progress": tell,
        "labels": arguments.labels,
        "effort": arguments.effort,
        "so_far": partial(write_partial, folder=arguments.out),
    }
    if is_record(arguments.model):
        return find_gap(inputs.record(arguments.model, arguments.kinds), sweep, values, **options)
    if not _is_sweep(arguments.model):
        return find_gap(inputs.program(arguments.model), sweep, values, **options)
    if values is not None:
        raise IbridError("--values belongs to a program; a simulated sweep brings its own")
    if sweep is None or events is not None:
        raise IbridError(
            "events are compared with a program or a record; a simulated sweep says nothing of "
            "limits"
        )
    from ibrid.gap.results.simulated_sweep import identify_model, locate_differences
    from ibrid.measurement.sweeps.quantities import span

    simulated = inputs.data(arguments.model)
    where = locate_differences(inputs.simulation(arguments.model, sweep), sweep)
    tell("the program of the simulated sweep", 0.0)
    identified = identify_model(simulated, arguments.seed)
    gap = find_gap(identified.record.diagram, sweep, identified.values, **options)
    first = where[0]
    most = f"most of the difference lies at {first.op}, {span(*first.band)}, {first.entry}"
    return replace(
        gap, steps=(f"{identified.words}; {most} ({100 * first.share:.0f} %)", *gap.steps)
    )


def _suggest(arguments: Namespace) -> "tuple[Suggest, ...]":
    from ibrid.gap.results.suggested_edits import low_order_blocks

    if arguments.suggest is None:
        if arguments.models:
            raise IbridError(
                "--model names what --suggest llm and --suggest agent ask; add one of them, or "
                "leave --model out"
            )
        return (low_order_blocks,)
    return (low_order_blocks, *command("search:suggesting.suggesters")(arguments))


def _is_sweep(text: str) -> bool:
    path = Path(text)
    return path.is_file() and path.suffix.lower() not in inputs.PROGRAM_ENDINGS


def _folder(arguments: Namespace) -> Path:
    """Where the answer goes; IbridError before any work when it cannot be written there.

    Nothing is made yet.
    """
    from ibrid.gap.results.files import FILES

    if not arguments.out.strip():
        raise IbridError("--out needs a folder, found an empty name; write . for the current one")
    folder = Path(arguments.out)
    require_folder(folder, FILES)
    return folder
