"""Fit one parameter set to recordings, and to a sweep with them, and return an evaluation record.

With a sweep, the fit begins at its best solution and at each equivalent one; a record that reaches
a limit or an outer loop distinguishes them. Without a sweep, the recordings stand for one as far as
deviations are small (`measurement.recordings.transformed`); where that is not enough, descents on
prediction errors follow (`event_fitter`).
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
from ibrid.gap.recordings.evaluation_record import build_record, simulate_events
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_fitter import EventFit
from ibrid.gap.recordings.event_noise import FITTED_PULSE_ERROR, NOMINAL_PULSE_ERROR
from ibrid.gap.recordings.event_problem import (
    NO_EQUILIBRIUM,
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
from ibrid.telling import Tell, silent

#: Multistart batches and basin hops of the fit to small deviations: it only leads to a valley.
MOST_RESTARTS = 1
MOST_HOPS = 0
#: Starts near the values of another fit that are descended first, with rounds and steps of each.
NEAR_STARTS = 2
NEAR_EFFORT = (4, 3)
#: Further descents of a fit that does not explain the data, and the part of its cost to which each
#: must lead for another.
MOST_DESCENTS = 4
WORTH_GAIN = 0.995
#: Difference of chi2 from which the data exclude a solution: odds of 1 to 20,000.
EXCLUDED_CHI2 = 20.0
#: Relative difference of a parameter from which two solutions differ in it.
DIFFERENT = 1e-2


@takes_kinds
@hearing_interrupts()
def evaluate_events(
    model: Diagram | Record,
    events: Events,
    sweep: Sweep | Study | None = None,
    *,
    values: Nominal | None = None,
    settings: FitSettings | None = None,
    tell: Tell = silent,
    **options: Unpack[StudyOptions],
) -> Record:
    """Fit a diagram's free parameters, and those of its limits, to recordings of events.

    Parameters
    ----------
    model : Diagram or Record
        Candidate structure; of a record, its limits are kept and its values are nominal.
    events : Events
        Voltage and current in time, each sample weighted by its noise.
    sweep : Sweep or Study, optional
        Measured on the same device.
    values : mapping, optional
        Nominal values, name -> value, from which the fit begins, too; those of a limit
        (`current_limit.i_max`) add it to the diagram.
    settings : FitSettings, optional
        Effort of the fit to the sweep. Of recordings alone, `restarts` counts the further starts
        that are descended where the first does not explain them, `descents` at most.
    tell : Tell
        Is given progress messages and the share that is done.
    holdout_op, vocabulary, seed
        As of `ibrid.study.Study`; records may be held out, too. Parameters are shared and the
        equilibrium is exact.

    Returns
    -------
    Record
        With `nrmse_by_record` (|i_model - i| / |i - i_rest|) and `nrmse_by_window`; its intervals
        and covariance are those of all data together, and `twins` those equivalent solutions of the
        sweep that the recordings do not distinguish either.

    Raises
    ------
    IbridError
        An illegal diagram, unknown names, or a model without an equilibrium at p, q and v of the
        records.
    """
    problem = build_event_problem(model, sweep, values, events, options)
    record, _ = fit_and_score(problem, settings, tell=tell)
    return record


def evaluate_records(
    diagram: Diagram, study: Study, settings: FitSettings, warm: Mapping[str, Values] | None = None
) -> Record:
    """Fit a diagram to a study of recordings alone, as `ibrid.evaluate` does to a sweep.

    A failure is an outcome of the record.

    warm : values of another fit by operating point, from which it begins.
    """
    warm_values = next(iter((warm or {}).values()), None)
    try:
        problem = event_problem_of_study(diagram, study)
        record, _ = fit_and_score(problem, settings, warm_values)
        return record
    except IbridError as error:
        if isinstance(error, OperatingPointError) and study.held:
            # the equilibrium may be missing where nothing is fitted
            return evaluate_records(diagram, study.blind, settings, warm)
        diagram = study.placed(diagram)
        outcome = Outcome.FAILED if str(error) == NO_EQUILIBRIUM else Outcome.INVALID
        record = unfitted(diagram, study, study.effort(settings))
        return replace(record, outcome=outcome, reasons=(str(error),))


def fit_and_score(
    problem: EventProblem,
    settings: FitSettings | None = None,
    warm: Values | None = None,
    tell: Tell = silent,
) -> tuple[Record, float]:
    """Fit a problem and return its record, and the Bayesian information criterion on all data.

    warm : values of another fit from which one of recordings alone begins.
    """
    started = time.perf_counter()
    kernel.load()
    _require_shared_parameters(problem)
    data = problem.build_dataset({})
    settings = settings or FitSettings()
    nominal = {name: entry.nominal for name, entry in problem.prior().items()}
    bounded_data = limit_to_decade(problem, nominal)
    twins: list[Values] = []
    tell("where small departures lead", 0.0)
    if problem.study is None:
        fits = _fit_until_explained(problem, bounded_data, nominal, settings, warm, tell)
    else:
        sweep_record = evaluate(problem.diagram, problem.study, settings=settings)
        twins = [{**nominal, **twin} for twin in sweep_record.twins]
        tell(f"the records, from {len(twins) + 1} answers of the sweep", 0.2)
        sweep_values = next(iter(sweep_record.parameters.values()), {})
        fits = _fit_starts([{**nominal, **sweep_values}, *twins], problem, bounded_data)
    if not fits:
        raise IbridError(NO_EQUILIBRIUM)
    tell("the solver of record, intervals and errors", 0.8)
    least_cost = min(fit.cost for fit in fits)
    best = next(fit for fit in fits if fit.cost - least_cost < CHI2_95_PERCENT)
    best = _refit_with_own_noise(best, problem, data, bounded_data)
    if problem.study is None and not best.is_adequate():
        further = _fit_until_explained(problem, bounded_data, nominal, settings, warm, tell)
        best = min((best, *further), key=lambda fit: fit.cost)
    best = data.fitter.polish(data.fitter.at(best.diagram, best.limits, best.x))
    model = Model(problem.diagram, Convention(), best)
    record = build_record(model, data, problem, simulate_events(model, data, problem.events))
    if twins:
        twin_fits = [
            data.fitter.evaluate_values(best.diagram, best.limits, {**best.values, **twin})
            for twin in twins
        ]
        record = _exclude_twins(record, best, [*fits, *twin_fits])
    record = replace(record, seconds=time.perf_counter() - started)
    return record, model.bic() + data.noise.logarithm


def _require_shared_parameters(problem: EventProblem) -> None:
    """Raise IbridError for a study with other options than recordings can have."""
    study = problem.study
    if study is not None and (study.parameters, study.equilibrium) != ("shared", "exact"):
        raise IbridError(
            "events are fitted with shared parameters and the exact equilibrium; leave other "
            "options out"
        )


def _refit_with_own_noise(
    fit: EventFit, problem: EventProblem, data: EventDataset, bounded_data: EventDataset
) -> EventFit:
    """Refit with the recordings weighted by what the fit makes of the voltage between samples.

    That of typical values may leave so much open that a fit ends early.
    """
    pulse_error = FITTED_PULSE_ERROR if fit.is_adequate() else NOMINAL_PULSE_ERROR
    for dataset in (bounded_data, data):
        dataset.estimate_sampling_noise(fit.diagram, fit.values, pulse_error)
    refits = _fit_starts([fit.values], problem, bounded_data)
    return min(refits, key=lambda refit: refit.cost, default=fit)


def limit_to_decade(
    problem: EventProblem, nominal: Values, *, sampled: bool = True
) -> EventDataset:
    """Return the data with a prior of one decade about nominal or typical values.

    It applies to positive parameters, and decides only what the data leave open.

    sampled : as of `EventProblem.build_dataset`.
    """
    unbounded = problem.build_dataset({}, sampled=False)
    misfit = unbounded.fitter.misfit(problem.diagram, problem.limits)
    free = [number.parameter for number in misfit.numbers]
    prior = {
        parameter.name: NominalValue(nominal.get(parameter.name, parameter.typical), DECADE)
        for parameter in free
        if parameter.logarithmic
    }
    return problem.build_dataset(prior, sampled=sampled)


def _fit_starts(
    starts: Sequence[Values],
    problem: EventProblem,
    data: EventDataset,
    worth_cost: float = np.inf,
    *,
    predict_first: bool = False,
    growing: bool = False,
    most_descents: int = MOST_DESCENTS,
) -> list[EventFit]:
    """Fit from every start, with further descents while they gain.

    Parameters
    ----------
    worth_cost : float
        Cost above which a fit gets no further descent.
    predict_first, growing : bool
        As of `EventFitter.fit`.
    """
    diagram = problem.diagram
    limits = problem.limits
    fits: list[EventFit] = []
    for start in starts:
        fit = data.fitter.fit(
            diagram, limits, [start], predict_first=predict_first, growing=growing
        )
        if fit is None:
            continue
        for _ in range(most_descents):
            if fit.cost > worth_cost or fit.is_adequate():
                break
            refit = data.fitter.fit(diagram, limits, [fit.values], predict_first=False)
            if refit is None or refit.cost > WORTH_GAIN * fit.cost:
                break
            fit = refit
        fits.append(fit)
    return fits


def _fit_until_explained(
    problem: EventProblem,
    data: EventDataset,
    nominal: Values,
    settings: FitSettings,
    warm: Values | None,
    tell: Tell,
) -> list[EventFit]:
    """Fit from several starts until one explains the recordings, `settings.descents` at most.

    First from the values of another fit or of the fit to small deviations, whichever is better;
    then from each of these as the records grow, and by prediction errors.
    """
    misfit = data.fitter.misfit(problem.diagram, problem.limits)
    small_deviations = fit_transformed_records(problem, nominal, settings)
    most_descents = MOST_DESCENTS if settings.restarts else 0
    fits: list[EventFit] = []
    if warm is not None:
        near = misfit.coarse.start_descents_from([warm, *small_deviations], NEAR_STARTS)
        ends = sorted([descent.run(*NEAR_EFFORT) for descent in near], key=lambda end: end.cost)
        first = [end.values for end in ends[:1]]
        fits = _fit_starts(first, problem, data, most_descents=most_descents)
    if _has_adequate(fits) or (fits and not settings.restarts):
        return fits
    starts = list(small_deviations)
    if problem.values or not small_deviations:
        starts.insert(0, nominal)
    schedule = [(start, predict) for predict in (False, True) for start in starts]
    most = min(settings.restarts + 1, settings.descents)
    for number, (start, predict) in enumerate(schedule[:most]):
        if _has_adequate(fits):
            break
        tell(f"descent {number + 1} of {most} at most", 0.1 + 0.7 * number / most)
        least_cost = min((fit.cost for fit in fits), default=np.inf)
        fits += _fit_starts(
            [start],
            problem,
            data,
            least_cost,
            predict_first=predict,
            growing=not predict,
            most_descents=most_descents,
        )
    return fits


def fit_transformed_records(
    problem: EventProblem, nominal: Values, settings: FitSettings
) -> list[Values]:
    """Fit the recordings as a sweep of small deviations; return the values and equivalent ones.

    Empty where that fit fails. Records with set-point steps are left out, since their current
    responds to more than the voltage.
    """
    names = [record.name for record in problem.fitted.records if not record.steps_told]
    if not names:
        return []
    sweep = transformed(problem.fitted.only(*names))
    study = Study(sweep, vocabulary=problem.kinds, seed=problem.seed)
    restarts = min(settings.restarts, MOST_RESTARTS)
    brief = replace(settings, objective=None, restarts=restarts, hops=MOST_HOPS)
    warm = dict.fromkeys(study.fitted.names, nominal) if problem.values else None
    record = evaluate(problem.diagram, study, settings=brief, warm=warm)
    values = next(iter(record.parameters.values()), None)
    if values is None:
        return []
    return [{**nominal, **values, **twin} for twin in ({}, *record.twins)]


def _has_adequate(fits: Sequence[EventFit]) -> bool:
    return any(fit.is_adequate() for fit in fits)


def _exclude_twins(record: Record, best: EventFit, others: Sequence[EventFit]) -> Record:
    """Keep the equivalent solutions of the sweep that the recordings do not exclude.

    What they exclude is reported in words.

    others : where the equivalent solutions lead, and these themselves, which need not be minima of
    all data.
    """
    intervals = next(iter(record.intervals.values()))
    visible = [name for name, interval in intervals.items() if interval is not None]
    different = [fit for fit in others if _list_differences(fit, best, visible)]
    twins: list[EventFit] = []
    kept: list[EventFit] = []
    for fit in different:
        is_left = fit.chi2 - best.chi2 < EXCLUDED_CHI2
        if not is_left:
            continue
        if all(_list_differences(fit, earlier, visible) for earlier in kept):
            twins.append(fit)
        kept.append(fit)
    excluded = [] if twins else [fit for fit in different if np.isfinite(fit.chi2)]
    sentences = [
        "a twin that the sweep does not exclude, "
        f"{_shorten_list(_list_differences(fit, best, visible))}, is excluded by the records "
        f"(chi2 higher by {fit.chi2 - best.chi2:.3g})"
        for fit in excluded
    ]
    names = list(next(iter(record.parameters.values())))
    twin_values = [{name: float(fit.values[name]) for name in names} for fit in twins]
    return replace(
        record,
        twins=tuple(twin_values),
        identifiability=(*record.identifiability, *sentences[-1:]),
    )


def _list_differences(fit: EventFit, best: EventFit, visible: Sequence[str]) -> list[str]:
    """List the identifiable parameters in which a fit differs from the best one."""
    return [
        f"{name} {fit.values[name]:.4g} instead of {best.values[name]:.4g}"
        for name in visible
        if abs(fit.values[name] - best.values[name]) > DIFFERENT * abs(best.values[name])
    ]


def _shorten_list(differences: Sequence[str]) -> str:
    more = f", {len(differences) - 3} more" if len(differences) > 3 else ""
    return ", ".join(differences[:3]) + more
