"""`ibrid evaluate` where records of events are given: fit them, and a sweep with them."""

from argparse import Namespace
from dataclasses import replace

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.gap.refitting.prior import read_values
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.playback.compare import model_of_record, play
from ibrid.playback.validation import validation
from ibrid.telling import telling


def fitted_to_events(arguments: Namespace, sweep: Sweep | None, events: Events) -> Record:
    """Fit the program or record of `arguments` to records of events, and to a sweep with them."""
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
            settings=inputs.fit_settings_of(arguments),
            tell=tell,
        )
    return (
        record
        if arguments.standard == "none" or not record.parameters
        else _validated(record, events)
    )


def _validated(record: Record, events: Events) -> Record:
    """With the error measures of the standard."""
    return replace(record, validation=validation(play(model_of_record(record), events)))
