"""evaluate_events(model, events, sweep) -> Record: one parameter set fitted to records of events,
and to a sweep beside them.

A fit begins where the sweep alone leads: at its best answer, and at each other one that fits the
sweep as well, of which a record that reaches a limit or an outer loop tells the right one. Without
a sweep the records stand for one, as far as departures are small (`recordings.transformed`); where
that is not enough, predictions follow (`ibrid.gap.recordings.event_fitter`).
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import IbridError, OperatingPointError
from ibrid.evaluation.describe import unfitted
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit import kernel
from ibrid.fit.anchor import DECADE
from ibrid.fit.settings import FitSettings
from ibrid.gap.recordings.evaluation_record import record_of, simulate_events
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_fitter import EventFit
from ibrid.gap.recordings.event_noise import FITTED, NOMINAL
from ibrid.gap.recordings.event_problem import (
    NO_REST,
    EventProblem,
    build_event_problem,
    event_problem_of_study,
)
from ibrid.gap.refitting.model import CHI2_95_PERCENT, Model, Values
from ibrid.gap.refitting.prior import Nominal, NominalValue
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.recordings.transformed import transformed
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.study import Study, StudyOptions
from ibrid.telling import Tell

#: Further waves of starts of a fit to small departures at most, and rounds of hops: it leads to a
#: valley, and no further.
WAVES, HOPS = 1, 0
#: Rounds, and steps of each, of a first descent beside values of another fit, and how many starts
#: have one.
NEAR, NEAREST = (4, 3), 2
#: Further descents of a fit that does not explain the data, and to which part the cost must fall
#: for another.
ROUNDS, GAIN = 4, 0.995
#: Difference of chi2 from which the data tell two answers apart: odds of 1 to 20,000.
APART = 20.0


@takes_kinds
@hearing_interrupts()
def evaluate_events(
    model: Diagram | Record,
    events: Events,
    sweep: Sweep | Study | None = None,
    *,
    values: Nominal | None = None,
    settings: FitSettings | None = None,
    tell: Tell = lambda *_: None,
    **options: Unpack[StudyOptions],
) -> Record:
    """Fit a diagram's free parameters, and those of limits beside it, to records of events.

    Parameters
    ----------
    model : candidate structure; or a record, whose limits stand beside its program and whose values
    are nominal.
    events : voltage and current in time, each datum weighed by its noise. sweep : measured beside
    them, or a study of it.
    values : nominal values, name -> value, from which a fit begins too; those of a limit
    (`current_limit.i_max`) put it there.
    settings : effort of the fit to the sweep. Of records alone its restarts say how many further
    starts are descended where the
        first does not explain them, `descents` at most. tell : is told what goes on, and the share
        that is done.
    holdout_op, vocabulary, seed : as of `ibrid.study.Study`; held out may be records, too.
    Parameters are shared and the
        equilibrium exact.

    Returns
    -------
    Record with `nrmse_by_record` (|i_model - i| / |i - i_rest|) and `nrmse_by_window`; its
    intervals and covariance are those of all data together, and `twins` those that records do not
    tell apart either.

    Raises
    ------
    IbridError : an illegal diagram, names that do not exist, or a model without a rest at the
    records' p, q and v.
    """
    return fit_and_score(
        build_event_problem(model, sweep, values, events, options), settings, tell=tell
    )[0]


def evaluate_records(
    diagram: Diagram, study: Study, settings: FitSettings, warm: Mapping[str, Values] | None = None
) -> Record:
    """`ibrid.evaluate` for a study of records alone.

    warm : values of another fit at some rest, from which it begins.
    """
    try:
        return fit_and_score(
            event_problem_of_study(diagram, study),
            settings,
            next(iter((warm or {}).values()), None),
        )[0]
    except IbridError as error:
        if (
            isinstance(error, OperatingPointError) and study.held
        ):  # no rest where it was not fitted, perhaps
            return evaluate_records(diagram, study.blind, settings, warm)
        diagram, outcome = (
            study.placed(diagram),
            Outcome.FAILED if str(error) == NO_REST else Outcome.INVALID,
        )
        return replace(
            unfitted(diagram, study, study.effort(settings)), outcome=outcome, reasons=(str(error),)
        )


def fit_and_score(
    question: EventProblem,
    settings: FitSettings | None = None,
    warm: Values | None = None,
    tell: Tell = lambda *_: None,
) -> tuple[Record, float]:
    """The record of `evaluate_events`, and the Bayesian information criterion of the model on all
    data together.

    warm : values of another fit from which one of records alone begins.
    """
    started = time.perf_counter()
    kernel.load()
    if question.study is not None and (question.study.parameters, question.study.equilibrium) != (
        "shared",
        "exact",
    ):
        raise IbridError(
            "events are fitted with shared parameters and the exact equilibrium; leave other "
            "options out"
        )
    data, effort = question.records({}), settings or FitSettings()
    nominal = {name: belief.nominal for name, belief in question.prior().items()}
    held = limit_to_decade(question, nominal)
    twins: list[Values] = []
    tell("where small departures lead", 0.0)
    if question.study is None:
        fits = _fit_until_explained(question, held, nominal, effort, warm, tell)
    else:
        begun = evaluate(question.diagram, question.study, settings=effort)
        twins = [{**nominal, **twin} for twin in begun.twins]
        tell(f"the records, from {len(twins) + 1} answers of the sweep", 0.2)
        fits = _fit_starts(
            [{**nominal, **next(iter(begun.parameters.values()), {})}, *twins], question, held
        )
    if not fits:
        raise IbridError(NO_REST)
    tell("the solver of record, intervals and errors", 0.8)
    least = min(fit.cost for fit in fits)
    best = next(fit for fit in fits if fit.cost - least < CHI2_95_PERCENT)
    best = _refit_with_own_noise(best, question, data, held)
    if question.study is None and not best.is_adequate():
        best = min(
            (best, *_fit_until_explained(question, held, nominal, effort, warm, tell)),
            key=lambda fit: fit.cost,
        )
    best = data.fitter.polish(data.fitter.at(best.diagram, best.limits, best.x))
    model = Model(question.diagram, Convention(), best)
    record = record_of(model, data, question, simulate_events(model, data, question.events))
    if twins:
        others = [
            *fits,
            *(
                data.fitter.evaluate_values(best.diagram, best.limits, {**best.values, **twin})
                for twin in twins
            ),
        ]
        record = _exclude_twins(record, best, others)
    return replace(
        record, seconds=time.perf_counter() - started
    ), model.bic() + data.noise.logarithm


def _refit_with_own_noise(
    fit: EventFit, question: EventProblem, data: EventDataset, held: EventDataset
) -> EventFit:
    """A fit gone on with, where the records are weighed by what it makes of the voltage between
    their samples: that of typical values may leave so much open that a fit ends early.
    """
    for weighed in (held, data):
        weighed.estimate_sampling_noise(
            fit.diagram, fit.values, FITTED if fit.is_adequate() else NOMINAL
        )
    return min(_fit_starts([fit.values], question, held), key=lambda one: one.cost, default=fit)


def limit_to_decade(
    question: EventProblem, nominal: Values, *, sampled: bool = True
) -> EventDataset:
    """The data where positive values lie within a decade of nominal or typical ones: so says what
    they leave open, and only
    that. sampled : as of `Asked.records`.
    """
    free = (
        one.parameter
        for one in question.records({}, sampled=False)
        .fitter.misfit(question.diagram, question.limits)
        .numbers
    )
    prior = {
        one.name: NominalValue(nominal.get(one.name, one.typical), DECADE)
        for one in free
        if one.logarithmic
    }
    return question.records(prior, sampled=sampled)


def _fit_starts(
    starts: Sequence[Values],
    question: EventProblem,
    data: EventDataset,
    least: float = np.inf,
    *,
    led: bool = False,
    growing: bool = False,
    rounds: int = ROUNDS,
) -> list[EventFit]:
    """From every start, on and on while it gains and is below the `least` cost; led, growing : as
    of `EventFitter.fit`.
    """
    fits = []
    for start in starts:
        fit = data.fitter.fit(question.diagram, question.limits, [start], led=led, growing=growing)
        for _ in range(rounds):
            if fit is None or fit.cost > least or fit.is_adequate():
                break
            again = data.fitter.fit(question.diagram, question.limits, [fit.values], led=False)
            if again is None or again.cost > GAIN * fit.cost:
                break
            fit = again
        fits += [] if fit is None else [fit]
    return fits


def _fit_until_explained(
    question: EventProblem,
    data: EventDataset,
    nominal: Values,
    effort: FitSettings,
    warm: Values | None,
    tell: Tell,
) -> list[EventFit]:
    """Fits from known values or where small departures lead, whichever is ahead; then from each of
    these, until one explains the records, `effort.descents` at most.
    """
    misfit = data.fitter.misfit(question.diagram, question.limits)
    small = fit_transformed_records(question, nominal, effort)
    rounds = ROUNDS if effort.restarts else 0
    near = (
        []
        if warm is None
        else [one.run(*NEAR) for one in misfit.coarse.start_descents_from([warm, *small], NEAREST)]
    )
    first = sorted(near, key=lambda one: one.cost)[:1]
    fits = _fit_starts([one.values for one in first], question, data, rounds=rounds)
    if _is_any_adequate(fits) or (fits and not effort.restarts):
        return fits
    known = [nominal] * (bool(question.values) or not small)
    starts = [(start, led) for led in (False, True) for start in (*known, *small)]
    most = min(effort.restarts + 1, effort.descents)
    for place, (start, led) in enumerate(starts[:most]):
        if _is_any_adequate(fits):
            break
        tell(f"descent {place + 1} of {most} at most", 0.1 + 0.7 * place / most)
        least = min((fit.cost for fit in fits), default=np.inf)
        fits += _fit_starts([start], question, data, least, led=led, growing=not led, rounds=rounds)
    return fits


def fit_transformed_records(
    question: EventProblem, nominal: Values, effort: FitSettings
) -> list[Values]:
    """Where a fit to the records as a sweep leads, and its twins; none where it has no answer.

    Records whose set points move are left out, since their current answers to more than the
    voltage.
    """
    answers = [one.name for one in question.fitted.records if not one.steps_told]
    if not answers:
        return []
    study = Study(
        transformed(question.fitted.only(*answers)), vocabulary=question.kinds, seed=question.seed
    )
    brief = replace(effort, objective=None, restarts=min(effort.restarts, WAVES), hops=HOPS)
    warm = dict.fromkeys(study.fitted.names, nominal) if question.values else None
    record = evaluate(question.diagram, study, settings=brief, warm=warm)
    found = next(iter(record.parameters.values()), None)
    return [] if found is None else [{**nominal, **found, **twin} for twin in ({}, *record.twins)]


def _is_any_adequate(fits: Sequence[EventFit]) -> bool:
    return any(fit.is_adequate() for fit in fits)


def _exclude_twins(record: Record, best: EventFit, others: Sequence[EventFit]) -> Record:
    """The record with the twins of the sweep that the records leave, and in words those that they
    exclude.

    others : where the twins lead, and the twins themselves, which need not be minima any more.
    """
    visible = [
        name for name, span in next(iter(record.intervals.values())).items() if span is not None
    ]
    apart = [fit for fit in others if _list_differences(fit, best, visible)]
    left = [fit for fit in apart if fit.chi2 - best.chi2 < APART]
    twins = [
        fit
        for place, fit in enumerate(left)
        if all(_list_differences(fit, before, visible) for before in left[:place])
    ]
    excluded = [fit for fit in apart if not twins and np.isfinite(fit.chi2)]
    sentences = [
        "a twin that the sweep does not exclude, "
        f"{_shorten_list(_list_differences(fit, best, visible))}, is excluded by the records "
        f"(chi2 higher by {fit.chi2 - best.chi2:.3g})"
        for fit in excluded
    ]
    return replace(
        record,
        twins=tuple(
            {name: float(fit.values[name]) for name in next(iter(record.parameters.values()))}
            for fit in twins
        ),
        identifiability=(*record.identifiability, *sentences[-1:]),
    )


def _list_differences(fit: EventFit, best: EventFit, visible: Sequence[str]) -> list[str]:
    """What has another value, of what the data see."""
    return [
        f"{name} {fit.values[name]:.4g} instead of {best.values[name]:.4g}"
        for name in visible
        if abs(fit.values[name] - best.values[name]) > 1e-2 * abs(best.values[name])
    ]


def _shorten_list(moved: Sequence[str]) -> str:
    return ", ".join(moved[:3]) + (f", {len(moved) - 3} more" if len(moved) > 3 else "")
