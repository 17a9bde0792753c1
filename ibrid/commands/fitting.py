"""`ibrid evaluate PROGRAM DATA`: fit a diagram to a sweep, to records of events or to both, and
show the record.
"""

from argparse import Namespace
from dataclasses import replace

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.commands.outputs import (
    TERMINAL,
    UNFINISHED,
    give_json,
    require_distinct,
    require_json_place,
)
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings, fit_settings
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.gap.refitting.prior import read_values
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.texts.text import format_record
from ibrid.streams import complain_of_program
from ibrid.telling import telling
from ibrid.writing import require_place


def run(arguments: Namespace) -> int:
    """Fit and print the record; 0: a fit, 2: an illegal program, 3: unfinished, 1: no fit came out;
    files are written anyway.
    """
    require_json_place(arguments.json)
    if arguments.report is not None:
        require_place(arguments.report)
    require_distinct({"--json": arguments.json, "--report": arguments.report})
    sweep, events = inputs.measured_or_events(arguments)
    record = (
        _fitted(arguments, sweep) if events is None else _fitted_to_events(arguments, sweep, events)
    )
    printed = give_json(record.to_json(), arguments.json)
    if arguments.report is not None:
        from ibrid.report.pages.page import write_report  # pictures are slow to import

        try:
            write_report(record, arguments.report, sweep=sweep, events=events)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_page_is_missing(arguments)) from None
    if record.outcome != "ok":
        complain_of_program(arguments.program, record.reasons)
        return {"invalid": 2, "unfinished": UNFINISHED}.get(record.outcome, 1)
    if not printed:
        print(format_record(record).rstrip("\n"))
    return 0


def _page_is_missing(arguments: Namespace) -> str:
    """What is told where an interrupt ends the command before its page is whole."""
    page = f"stopped before {arguments.report} was written"
    if arguments.json in (None, TERMINAL):
        return f"{page}; run the same command again"
    return (
        f"{page}; the fit is in {arguments.json}, of which ibrid report {arguments.json} --out "
        f"{arguments.report} makes the page"
    )


def _settings(arguments: Namespace) -> FitSettings:
    settings = fit_settings(arguments.effort)
    return (
        settings if arguments.restarts is None else replace(settings, restarts=arguments.restarts)
    )


def _fitted(arguments: Namespace, sweep: Sweep | None) -> Record:
    if sweep is None or arguments.values is not None or arguments.standard != "none":
        option = "--standard" if arguments.values is None else "--values"
        raise IbridError(
            f"{option} is for records of events; give them with --events, or leave it out"
        )
    return evaluate(
        inputs.program(arguments.program),
        sweep,
        parameters=arguments.parameters,
        equilibrium=arguments.equilibrium,
        vocabulary=inputs.vocabulary(arguments.vocabulary, arguments.kinds),
        objective=arguments.objective,
        seed=arguments.seed,
        holdout_op=arguments.holdout_op,
        port=inputs.port(arguments.port, sweep),
        labels=arguments.labels,
        settings=_settings(arguments),
    )


def _fitted_to_events(arguments: Namespace, sweep: Sweep | None, events: Events) -> Record:
    usual = {"parameters": "shared", "equilibrium": "exact", "labels": "exact", "objective": None}
    if odd := [f"--{name}" for name, value in usual.items() if getattr(arguments, name) != value]:
        raise IbridError(
            f"a fit to records of events knows no {odd[0]} but the usual; leave it out"
        )
    if is_record(arguments.program):
        model = inputs.record(arguments.program, arguments.kinds)
    else:
        model = inputs.program(arguments.program)
    with telling("interactive") as tell:
        record = evaluate_events(
            model,
            events,
            sweep,
            values=None if arguments.values is None else read_values(arguments.values),
            port=inputs.port(arguments.port, events if sweep is None else sweep),
            vocabulary=inputs.vocabulary(arguments.vocabulary, arguments.kinds),
            seed=arguments.seed,
            holdout_op=arguments.holdout_op,
            settings=_settings(arguments),
            tell=tell,
        )
    return (
        record
        if arguments.standard == "none" or not record.parameters
        else _validated(record, events)
    )


def _validated(record: Record, events: Events) -> Record:
    """With the error measures of the standard."""
    from ibrid.playback.compare import model_of_record, play
    from ibrid.playback.validation import validation

    return replace(record, validation=validation(play(model_of_record(record), events)))
