"""From findings on records of events to the answer: where they miss, effects with intervals, errors before and after."""

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.gap.answer import candidate_of, effects_of, mean_holdout, moved
from ibrid.gap.detectability import SEEN
from ibrid.gap.event_places import where
from ibrid.gap.event_question import Asked
from ibrid.gap.event_record import described, mean_error, noise_nrmse, played, record_of, seen
from ibrid.gap.locating import LEAST_Z, MOST
from ibrid.gap.records import Records
from ibrid.gap.result import EventAnswer, Gap, LocatedEvent, Unseen
from ibrid.gap.trial import Model
from ibrid.gap.verdict import Errors, Findings, sentence_of, verdict_of
from ibrid.measurement.event_windows import windows_of
from ibrid.playback.compare import EventModel, play
from ibrid.playback.limits import LIMITS, applicable
from ibrid.playback.places import places_of
from ibrid.structure.program import program_text


def event_answer(findings: Findings, data: Records, asked: Asked) -> Gap:
    """The Gap that findings on records amount to."""
    verdict = verdict_of(findings)
    model = findings.best if verdict == "named" else findings.given
    before_played, after_played = (played(one, data, asked.events) for one in (findings.given, model))
    held = (*asked.held, *(asked.study.held if asked.study else ()))
    baseline = record_of(findings.given, data, asked, before_played)
    repaired = baseline if model is findings.given else record_of(model, data, asked, after_played)
    before = {
        "nominal": _nominal(findings.given, data, asked) if asked.values else None,
        "refit": baseline.nrmse,
        "holdout": mean_holdout(baseline, held),
    }
    after = {"refit": repaired.nrmse, "holdout": mean_holdout(repaired, held)}
    floor = noise_nrmse(data.noise)
    return Gap(
        verdict=verdict,
        sentence=sentence_of(verdict, findings, Errors.of(before, after), floor),
        located=located(findings.given, data),
        ports=(),
        effects=effects_of(findings, seen(findings.best.refit).intervals) if verdict == "named" else (),
        before=before,
        after=after,
        noise_floor=floor,
        moved=moved(model.refit, seen(model.refit).intervals),
        could_not_have_seen=unseen(model, data),
        candidates=tuple(candidate_of(one, findings, data.stable(one)) for one in findings.trials),
        steps=findings.steps,
        noise=findings.noise.source,
        noise_level=findings.noise.level,
        null_space=repaired.identifiability,
        given=program_text(asked.diagram),
        program=program_text(model.diagram),
        baseline=baseline,
        repaired=repaired,
        sweep=asked.sweep or described(model, data, asked.events),
        held_out=held,
        events=EventAnswer(before_played, after_played, asked.sweep is not None),
    )


def located(model: Model, data: Records) -> tuple[LocatedEvent, ...]:
    """Record, window and component where the refitted model misses, the largest share of the misfit first.

    Law: the sum of n squared residuals follows chi2 with n degrees of freedom under noise alone.
    """
    pairs = list(zip(data.noise.events.records, model.refit.residuals, strict=False))
    whole = sum(float((np.abs(one) ** 2).sum()) for _, one in pairs)
    misses = []
    for record, residual in pairs:
        for begin, end in windows_of(record, data.noise.events.f0_hz).values():
            inside = (record.time >= begin) & (record.time <= end)
            for component, part in zip("dq", (residual.real[inside], residual.imag[inside]), strict=True):
                square = float((part**2).sum())
                z = normal_score(square, int(inside.sum()))
                if z > LEAST_Z:
                    misses.append(LocatedEvent(record.name, (begin, end), component, square / whole, z))
    return tuple(sorted(misses, key=lambda one: -one.share)[:MOST])


def unseen(model: Model, data: Records) -> tuple[Unseen, ...]:
    """Limits at their typical values that would not have shown in the records: these do not reach them."""
    refit, beside = model.refit, data.beside(model)
    places, present, undetectable = places_of(model.diagram, data.kinds), {one.id for one in beside}, []
    slopes = refit.slopes[: sum(2 * len(one.time) for one in data.noise.events.records)]
    basis, sizes, _ = np.linalg.svd(slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300), full_matrices=False)
    basis, tried = basis[:, sizes > 1e-9 * sizes[0]], set[str]()
    own = refit.misfit.answered(refit.x)
    for limit in LIMITS:
        if limit.id in present | tried or not applicable(limit, places):
            continue
        tried.add(limit.id)
        misfit = data.fitter.misfit(model.diagram, (*beside, limit))
        move = misfit.answered(misfit.beliefs.start(refit.values)) - own
        if not np.isfinite(move).all():
            continue
        left = move - basis @ (basis.T @ move)
        if (strength := float(left @ left)) < SEEN:
            words = "a record that reaches it: " + limit.law
            undetectable.append(Unseen(limit.id, "add", where(limit, places), strength, words))
    return tuple(undetectable)


def _nominal(given: Model, data: Records, asked: Asked) -> float | None:
    misfit = data.fitter.misfit(given.diagram, data.limits)
    values = misfit.values(misfit.beliefs.start({}))
    return mean_error(play(EventModel(given.diagram, values, data.limits, data.kinds), asked.events), asked.held)
