"""`ibrid evaluate PROGRAM DATA`: fit a diagram to a sweep, to records of events or to both, and
show the record.
"""

from argparse import Namespace

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
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.texts.text import format_record
from ibrid.streams import complain_of_program
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
    if events is None:
        record = _fitted(arguments, sweep)
    else:
        from ibrid.commands.fitting_events import fitted_to_events  # half a second of imports

        record = fitted_to_events(arguments, sweep, events)
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
        settings=inputs.fit_settings_of(arguments),
    )
