"""From findings on records of events to the answer: where they miss, effects with intervals, errors
before and after.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.gap.recordings.evaluation_record import (
    assess_identifiability,
    describe_linear_model,
    mean_error,
    record_of,
    simulate_events,
)
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_noise import event_noise
from ibrid.gap.recordings.event_problem import EventProblem
from ibrid.gap.recordings.limit_edits import where
from ibrid.gap.refitting.model import Model
from ibrid.gap.results.detectability import SEEN
from ibrid.gap.results.gap import EventComparison, Gap, LocatedEventMisfit, UndetectableEffect
from ibrid.gap.results.misfit_location import LEAST_Z, MOST
from ibrid.gap.results.sweep_gap import candidate_of, effects_of, mean_holdout, moved
from ibrid.gap.results.verdict import ErrorSummary, Findings, decide_verdict, describe_verdict
from ibrid.measurement.recordings.event_windows import windows_of
from ibrid.playback.compare import EventModel, Playback, play
from ibrid.playback.limits import LIMITS, applicable
from ibrid.playback.places import places_of
from ibrid.structure.diagrams.program import program_text


def event_answer(findings: Findings, data: EventDataset, asked: EventProblem) -> Gap:
    """The Gap that findings on records amount to; errors and floor are those of the records, also
    beside a sweep.
    """
    verdict = decide_verdict(findings)
    given, given_played = _least_error(
        [findings.given, *_as_given(findings.given, data, asked)], data, asked
    )
    model, after_played = given, given_played
    if verdict == "named":
        model, after_played = findings.best, simulate_events(findings.best, data, asked.events)
    elif verdict == "unexplained":
        model, after_played = _least_error([given, findings.best], data, asked)
    held = (*asked.held, *(asked.study.held if asked.study else ()))
    baseline = record_of(given, data, asked, given_played)
    repaired = baseline if model is given else record_of(model, data, asked, after_played)
    before = {
        "nominal": _nominal(findings.given, data, asked) if asked.values else None,
        "refit": mean_error(given_played, asked.held),
        "holdout": mean_holdout(baseline.holdout, held),
    }
    after = {
        "refit": mean_error(after_played, asked.held),
        "holdout": mean_holdout(repaired.holdout, held),
    }
    floors = floors_of(model, data, asked)
    floor = float(np.mean([floors[name] for name in data.noise.events.names]))
    sentence = describe_verdict(
        verdict, findings, ErrorSummary.of(before, after), floor, located(findings.best, data)
    )
    return Gap(
        verdict=verdict,
        sentence=" ".join((sentence, *data.remarks)),
        located=located(findings.given, data),
        ports=(),
        effects=effects_of(findings, assess_identifiability(findings.best.refit).intervals)
        if verdict == "named"
        else (),
        before=before,
        after=after,
        noise_floor=floor,
        moved=moved(model.refit, assess_identifiability(model.refit).intervals),
        could_not_have_seen=unseen(model, data),
        candidates=tuple(
            candidate_of(one, findings, data.is_stable(one)) for one in findings.trials
        ),
        steps=findings.steps,
        noise=findings.noise.source,
        noise_level=findings.noise.level,
        null_space=repaired.identifiability,
        given=program_text(asked.diagram),
        program=program_text(model.diagram),
        baseline=baseline,
        repaired=repaired,
        sweep=asked.sweep or describe_linear_model(model, data, asked.events),
        held_out=held,
        events=EventComparison(given_played, after_played, asked.sweep is not None, floors),
    )


def floors_of(model: Model, data: EventDataset, asked: EventProblem) -> Mapping[str, float]:
    """Record -> NRMSE that noise and sampling would leave, of all records, as a model sees the
    voltage between samples.
    """
    fitter = data.fitter.of(event_noise(asked.events, data.noise.sweep))
    return fitter.noise_for_model(model.diagram, data.limits_of(model), model.refit.values).floors


def _as_given(given: Model, data: EventDataset, asked: EventProblem) -> Iterator[Model]:
    """The model with the values that it came with, where its refit does not explain the data: what
    is missing may have bent that, so that it answers worse.
    """
    if asked.values and not given.is_adequate():
        yield replace(given, refit=data.fitter.evaluate_values(given.diagram, data.limits, {}))


def _least_error(
    models: Sequence[Model], data: EventDataset, asked: EventProblem
) -> tuple[Model, Playback]:
    """The model that answers the fitted records best, and what it answers."""
    answers = [(one, simulate_events(one, data, asked.events)) for one in models]
    errors = (mean_error(playback, asked.held) for _, playback in answers)
    places = {place: np.inf if error is None else error for place, error in enumerate(errors)}
    return answers[min(places, key=places.__getitem__)]


def located(model: Model, data: EventDataset) -> tuple[LocatedEventMisfit, ...]:
    """Record, window and component where the refitted model misses, the largest share of the misfit
    first.

    Law: the sum of n squared residuals follows chi2 with n degrees of freedom under noise alone.
    """
    pairs = list(zip(data.noise.events.records, model.refit.residuals, strict=False))
    whole = sum(float((np.abs(one) ** 2).sum()) for _, one in pairs)
    misses = []
    for record, residual in pairs:
        count = data.noise.of[record.name].independent
        for begin, end in windows_of(record, data.noise.events.f0_hz).values():
            inside = (record.time >= begin) & (record.time <= end)
            for component, part in zip(
                "dq", (residual.real[inside], residual.imag[inside]), strict=True
            ):
                square = float((part**2).sum())
                z = normal_score(square, float(count[inside, "dq".index(component)].sum()))
                if z > LEAST_Z:
                    misses.append(
                        LocatedEventMisfit(record.name, (begin, end), component, square / whole, z)
                    )
    return tuple(sorted(misses, key=lambda one: -one.share)[:MOST])


def unseen(model: Model, data: EventDataset) -> tuple[UndetectableEffect, ...]:
    """Limits at their typical values that would not have shown in the records: these do not reach
    them.
    """
    refit, beside = model.refit, data.limits_of(model)
    places, present, undetectable = (
        places_of(model.diagram, data.kinds),
        {one.id for one in beside},
        [],
    )
    slopes = refit.jacobian[: sum(2 * len(one.time) for one in data.noise.events.records)]
    basis, sizes, _ = np.linalg.svd(
        slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300), full_matrices=False
    )
    basis, tried = basis[:, sizes > 1e-9 * sizes[0]], set[str]()
    own = refit.misfit.whitened_currents(refit.x)
    for limit in LIMITS:
        if limit.id in present | tried or not applicable(limit, places):
            continue
        tried.add(limit.id)
        misfit = data.fitter.misfit(model.diagram, (*beside, limit))
        move = misfit.whitened_currents(misfit.parameter_prior.start(refit.values)) - own
        if not np.isfinite(move).all():
            continue
        left = move - basis @ (basis.T @ move)
        if (strength := float(left @ left)) < SEEN:
            words = "a record that reaches it: " + limit.law
            undetectable.append(
                UndetectableEffect(limit.id, "add", where(limit, places), strength, words)
            )
    return tuple(undetectable)


def _nominal(given: Model, data: EventDataset, asked: EventProblem) -> float | None:
    misfit = data.fitter.misfit(given.diagram, data.limits)
    values = misfit.values(misfit.parameter_prior.start({}))
    return mean_error(
        play(EventModel(given.diagram, values, data.limits, data.kinds), asked.events), asked.held
    )
