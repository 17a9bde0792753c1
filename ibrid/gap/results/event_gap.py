"""The `Gap` of findings on recordings.

Errors and noise floor are those of the recordings, also where there is a sweep.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.gap.recordings.evaluation_record import (
    assess_identifiability,
    build_record,
    linear_model_sweep,
    mean_nrmse,
    simulate_events,
)
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_noise import estimate_event_noise
from ibrid.gap.recordings.event_problem import EventProblem
from ibrid.gap.recordings.limit_edits import describe_location
from ibrid.gap.refitting.model import Model
from ibrid.gap.results.detectability import DETECTABLE, identifiable_basis, unexplained_change
from ibrid.gap.results.gap import EventComparison, Gap, LocatedEventMisfit, UndetectableEffect
from ibrid.gap.results.misfit_location import LEAST_Z, MOST_LOCATED
from ibrid.gap.results.named_effects import (
    describe_candidate,
    list_named_effects,
    list_parameter_changes,
    mean_holdout,
)
from ibrid.gap.results.verdict import ErrorSummary, Findings, decide_verdict, describe_verdict
from ibrid.measurement.recordings.event_windows import windows_of
from ibrid.measurement.recordings.events import EventRecord
from ibrid.playback.compare import EventModel, Playback, play
from ibrid.playback.limits import LIMITS, applicable
from ibrid.playback.places import places_of
from ibrid.structure.diagrams.program import program_text


def build_event_gap(findings: Findings, data: EventDataset, problem: EventProblem) -> Gap:
    """Build the Gap that findings on recordings amount to."""
    verdict = decide_verdict(findings)
    given, given_playback = _select_least_error(
        _list_given_models(findings.given, data, problem), data, problem
    )
    model = given
    playback = given_playback
    if verdict == "named":
        model = findings.best
        playback = simulate_events(model, data, problem.events)
    elif verdict == "unexplained":
        model, playback = _select_least_error([given, findings.best], data, problem)
    held = problem.held
    all_held = (*held, *(problem.study.held if problem.study else ()))
    baseline = build_record(given, data, problem, given_playback)
    repaired = baseline if model is given else build_record(model, data, problem, playback)
    before = {
        "nominal": _nominal_error(findings.given, data, problem) if problem.values else None,
        "refit": mean_nrmse(given_playback, held),
        "holdout": mean_holdout(baseline.holdout, all_held),
    }
    after = {
        "refit": mean_nrmse(playback, held),
        "holdout": mean_holdout(repaired.holdout, all_held),
    }
    floors = noise_floors(model, data, problem)
    floor = float(np.mean([floors[name] for name in data.noise.events.names]))
    errors = ErrorSummary.of(before, after)
    missed = locate_event_misfit(findings.best, data)
    sentence = describe_verdict(verdict, findings, errors, floor, missed)
    effects = ()
    if verdict == "named":
        intervals = assess_identifiability(findings.best.refit).intervals
        effects = list_named_effects(findings, intervals)
    return Gap(
        verdict=verdict,
        sentence=" ".join((sentence, *data.remarks)),
        located=locate_event_misfit(findings.given, data),
        ports=(),
        effects=effects,
        before=before,
        after=after,
        noise_floor=floor,
        moved=list_parameter_changes(model.refit, assess_identifiability(model.refit).intervals),
        could_not_have_seen=list_undetectable_limits(model, data),
        candidates=tuple(
            describe_candidate(trial, findings, data.is_stable(trial)) for trial in findings.trials
        ),
        steps=findings.steps,
        noise=findings.noise.source,
        noise_level=findings.noise.level,
        null_space=repaired.identifiability,
        given=program_text(problem.diagram),
        program=program_text(model.diagram),
        baseline=baseline,
        repaired=repaired,
        sweep=problem.sweep or linear_model_sweep(model, data, problem.events),
        held_out=all_held,
        events=EventComparison(given_playback, playback, problem.sweep is not None, floors),
    )


def noise_floors(model: Model, data: EventDataset, problem: EventProblem) -> Mapping[str, float]:
    """Return the NRMSE that noise and sampling alone would leave, by record.

    Of all records, those held out included, with what a model makes of the voltage between samples.
    """
    fitter = data.fitter.with_noise(estimate_event_noise(problem.events, data.noise.sweep))
    noise = fitter.noise_for_model(model.diagram, data.limits_of(model), model.refit.values)
    return noise.floors


def _list_given_models(given: Model, data: EventDataset, problem: EventProblem) -> list[Model]:
    """Return the refitted given model, and that at its nominal values where it is not adequate.

    What is missing may have biased the refit, so that it predicts worse.
    """
    if not problem.values or given.is_adequate():
        return [given]
    nominal = data.fitter.evaluate_values(given.diagram, data.limits, {})
    return [given, replace(given, refit=nominal)]


def _select_least_error(
    models: Sequence[Model], data: EventDataset, problem: EventProblem
) -> tuple[Model, Playback]:
    """Return the model of least error on the fitted records, and its simulated responses."""
    pairs = [(model, simulate_events(model, data, problem.events)) for model in models]

    def error(pair: tuple[Model, Playback]) -> float:
        nrmse = mean_nrmse(pair[1], problem.held)
        return np.inf if nrmse is None else nrmse

    return min(pairs, key=error)


def locate_event_misfit(model: Model, data: EventDataset) -> tuple[LocatedEventMisfit, ...]:
    """Locate the misfit of a model by record, window and component, the largest share first.

    Law: the sum of n squared residuals follows chi2 with n degrees of freedom under noise alone.
    """
    pairs = list(zip(data.noise.events.records, model.refit.residuals, strict=False))
    total = sum(float((np.abs(residual) ** 2).sum()) for _, residual in pairs)
    located: list[LocatedEventMisfit] = []
    for record, residual in pairs:
        located += _locate_in_record(record, residual, total, data)
    return tuple(sorted(located, key=lambda part: -part.share)[:MOST_LOCATED])


def _locate_in_record(
    record: EventRecord, residual: np.ndarray, total: float, data: EventDataset
) -> list[LocatedEventMisfit]:
    """Return the windows and components in which the residual d + j q (N,) is significant.

    total : sum of squares over all records.
    """
    independent = data.noise.of[record.name].independent
    located: list[LocatedEventMisfit] = []
    for begin, end in windows_of(record, data.noise.events.f0_hz).values():
        inside = (record.time >= begin) & (record.time <= end)
        for axis, component in enumerate("dq"):
            part = np.real(residual) if component == "d" else np.imag(residual)
            square = float((part[inside] ** 2).sum())
            z = normal_score(square, float(independent[inside, axis].sum()))
            if z > LEAST_Z:
                window = (begin, end)
                share = square / total
                located.append(LocatedEventMisfit(record.name, window, component, share, z))
    return located


def list_undetectable_limits(model: Model, data: EventDataset) -> tuple[UndetectableEffect, ...]:
    """List limits that would not be visible in the recordings at their typical values.

    Law: as of `detectability`, with the finite change of the response.
    """
    refit = model.refit
    limits = data.limits_of(model)
    places = places_of(model.diagram, data.kinds)
    present = {limit.id for limit in limits}
    row_count = sum(2 * len(record.time) for record in data.noise.events.records)
    basis = identifiable_basis(refit.jacobian[:row_count])
    response = refit.misfit.whitened_currents(refit.x)
    undetectable: list[UndetectableEffect] = []
    tried: set[str] = set()
    for limit in LIMITS:
        if limit.id in present | tried or not applicable(limit, places):
            continue
        tried.add(limit.id)
        misfit = data.fitter.misfit(model.diagram, (*limits, limit))
        x = misfit.parameter_prior.start(refit.values)
        change = misfit.whitened_currents(x) - response
        if not np.isfinite(change).all():
            continue
        strength = unexplained_change(change, basis)
        if strength < DETECTABLE:
            location = describe_location(limit, places)
            advice = f"a record that reaches it: {limit.law}"
            undetectable.append(UndetectableEffect(limit.id, "add", location, strength, advice))
    return tuple(undetectable)


def _nominal_error(given: Model, data: EventDataset, problem: EventProblem) -> float | None:
    """Return the mean NRMSE of the given model at its nominal values."""
    misfit = data.fitter.misfit(given.diagram, data.limits)
    values = misfit.values(misfit.parameter_prior.start({}))
    model = EventModel(given.diagram, values, data.limits, data.kinds)
    return mean_nrmse(play(model, problem.events), problem.held)
