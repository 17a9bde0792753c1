"""From findings on records of events to the answer: where they miss, effects with intervals, errors before and after."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.grade import normal_score
from ibrid.evaluation.record import Record
from ibrid.gap.answer import candidate_of, evidence_of
from ibrid.gap.detectability import SEEN
from ibrid.gap.event_fit import EventFit
from ibrid.gap.event_places import LimitPlace, where
from ibrid.gap.locating import LEAST_Z, MOST
from ibrid.gap.records import Records
from ibrid.gap.result import EventAnswer, Gap, LocatedEvent, Moved, NamedEffect, Unseen
from ibrid.gap.trial import Model
from ibrid.gap.verdict import Findings, alike, sentence_of, verdict_of
from ibrid.measurement.event_windows import windows_of
from ibrid.measurement.events import Events
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.practice import Insertion
from ibrid.playback.compare import EventModel, Playback, play
from ibrid.playback.limits import LIMITS, applicable
from ibrid.playback.places import places_of
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text

#: Frequencies, Hz, at which a model that was fitted to events alone is described.
DESCRIBED = np.geomspace(1.0, 2500.0, 40)


@dataclass(frozen=True, eq=False)
class Asked:
    """What the answer is about: the `diagram` as given, whether there were nominal `values`, all `events` with the names `held`
    out, and the measured `sweep`, None without one."""

    diagram: Diagram
    values: bool
    events: Events
    held: Sequence[str]
    sweep: Sweep | None
    kinds: Vocabulary


def event_answer(found: Findings, data: Records, asked: Asked) -> Gap:
    """The Gap that findings on records amount to."""
    verdict = verdict_of(found)
    model = found.best if verdict == "named" else found.given
    before_played, after_played = (_played(one, data, asked.events) for one in (found.given, model))
    baseline = _record(found.given, data, asked, before_played)
    repaired = baseline if model is found.given else _record(model, data, asked, after_played)
    before = {
        "nominal": _nominal(found.given, data, asked) if asked.values else None,
        "refit": baseline.nrmse,
        "holdout": _mean(before_played, asked.held, held=True),
    }
    after = {"refit": repaired.nrmse, "holdout": _mean(after_played, asked.held, held=True)}
    floor = _floor(data)
    return Gap(
        verdict=verdict,
        sentence=sentence_of(verdict, found, float(baseline.nrmse or np.nan), float(repaired.nrmse or np.nan), floor),
        located=located(found.given, data),
        ports=(),
        effects=_effects(found, data) if verdict == "named" else (),
        before=before,
        after=after,
        noise_floor=floor,
        moved=_moved(model, data),
        could_not_have_seen=unseen(model, data),
        candidates=tuple(candidate_of(one, found, data.stable(one)) for one in found.trials),
        steps=found.steps,
        noise=found.noise.source,
        noise_level=found.noise.level,
        null_space=repaired.identifiability,
        given=program_text(asked.diagram),
        program=program_text(model.diagram),
        baseline=baseline,
        repaired=repaired,
        sweep=asked.sweep or _described(model, data, asked.events),
        held_out=tuple(asked.held),
        events=EventAnswer(before_played, after_played, asked.sweep is not None),
    )


def located(model: Model, data: Records) -> tuple[LocatedEvent, ...]:
    """Record, window and component where the refitted model misses, the largest share of the misfit first.

    Law: the sum of n squared residuals follows chi2 with n degrees of freedom under noise alone.
    """
    pairs = list(zip(data.noise.events.records, model.refit.residuals, strict=False))
    whole = sum(float((np.abs(one) ** 2).sum()) for _, one in pairs)
    found = []
    for record, residual in pairs:
        for begin, end in windows_of(record, data.noise.events.f0_hz).values():
            inside = (record.time >= begin) & (record.time <= end)
            for component, part in zip("dq", (residual.real[inside], residual.imag[inside]), strict=True):
                square = float((part**2).sum())
                z = normal_score(square, int(inside.sum()))
                if z > LEAST_Z:
                    found.append(LocatedEvent(record.name, (begin, end), component, square / whole, z))
    return tuple(sorted(found, key=lambda one: -one.share)[:MOST])


def unseen(model: Model, data: Records) -> tuple[Unseen, ...]:
    """Limits at their typical values that would not have shown in the records: these do not reach them."""
    refit, beside = model.refit, data.beside(model)
    places, present, found = places_of(model.diagram, data.kinds), {one.id for one in beside}, []
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
            found.append(Unseen(limit.id, "add", where(limit, places), strength, words))
    return tuple(found)


def intervals(fit: EventFit) -> dict[str, tuple[float, float] | None]:
    """95 % of each number, from the slopes."""
    rows, beliefs = fit.slopes, fit.misfit.beliefs
    covariance = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
    spread = 1.96 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    blind = (rows**2).sum(axis=0) < 1e-12
    ends = [beliefs.coordinates.to_theta(np.clip(fit.x + one, *fit.misfit.box)) for one in (-spread, spread)]
    rows_of = zip(beliefs.names, ends[0], ends[1], blind, strict=True)
    return {name: None if dark else (float(low), float(high)) for name, low, high, dark in rows_of}


def _effects(found: Findings, data: Records) -> tuple[NamedEffect, ...]:
    evidence, spans, effects = evidence_of(found), intervals(found.best.refit), []
    for place, edit in enumerate(found.best.edits):
        if not isinstance(edit, Insertion):
            continue
        names = [name for name in edit.parameters if name in found.best.refit.values]
        parameters: dict[str, tuple[float, float | None, float | None]] = {}
        for name in names:
            low, high = spans.get(name) or (None, None)
            parameters[name] = (found.best.refit.values[name], low, high)
        form = edit.limit.plain() if isinstance(edit, LimitPlace) else {}
        told = {**evidence, **{key: value for key, value in form.items() if key != "id"}}
        effects.append(NamedEffect(edit.effect, edit.change, edit.where, parameters, told, alike(found, place)))
    return tuple(effects)


def _moved(model: Model, data: Records) -> tuple[Moved, ...]:
    refit, spans, rows = model.refit, intervals(model.refit), []
    for name, sigmas in refit.moved.items():
        low, high = spans.get(name) or (None, None)
        rows.append(Moved(name, refit.prior[name].nominal, refit.values[name], low, high, sigmas))
    return tuple(sorted(rows, key=lambda row: -abs(row.sigmas)))


# --- errors and records ----------------------------------------------------------------------------------------------


def _played(model: Model, data: Records, events: Events) -> Playback:
    return play(EventModel(model.diagram, model.refit.values, data.beside(model), data.kinds), events)


def _mean(playback: Playback, names: Sequence[str], *, held: bool) -> float | None:
    """Of the records held out, or of the others; None where there is none or a simulation left."""
    errors = [one.nrmse for one in playback.records if (one.record.name in names) is held]
    known = [one for one in errors if one is not None]
    return float(np.mean(known)) if known and len(known) == len(errors) else None


def _nominal(given: Model, data: Records, asked: Asked) -> float | None:
    misfit = data.fitter.misfit(given.diagram, data.limits)
    values = misfit.values(misfit.beliefs.start({}))
    return _mean(play(EventModel(given.diagram, values, data.limits, data.kinds), asked.events), asked.held, held=False)


def _floor(data: Records) -> float:
    """NRMSE that noise alone would leave, the mean over the records."""
    found = []
    for record in data.noise.events.records:
        sigma = data.noise.sigma[record.name]
        found.append(float(np.sqrt(2 * (sigma**2).sum()) / np.linalg.norm(record.i - record.i_rest)))
    return float(np.mean(found))


def _described(model: Model, data: Records, events: Events) -> Sweep:
    """The linear model at the rest of each record, where nothing was swept."""
    frame = np.broadcast_to(np.eye(2, dtype=complex), (len(DESCRIBED), 2, 2))
    points = [OperatingPoint(one.name, one.rest.p, one.rest.q, one.rest.v) for one in events.records]
    sweep = Sweep(
        tuple(PointSweep(op, DESCRIBED, frame) for op in points),
        f0_hz=events.f0_hz,
        power_node="pcc",
        source=events.source,
    )
    record = record_at(model.diagram, sweep, model.refit.values, vocabulary=data.kinds)
    answers = tuple(PointSweep(op, DESCRIBED, record.response(op.name, DESCRIBED)) for op in points)
    return replace(sweep, points=answers)


def _record(model: Model, data: Records, asked: Asked, played: Playback) -> Record:
    """A record that predict and export accept: of the sweep, or where there is none of the linear model itself."""
    sweep = asked.sweep or _described(model, data, asked.events)
    record = record_at(model.diagram, sweep, model.refit.values, vocabulary=data.kinds)
    limits = [
        {**one.plain(), "parameters": {name: model.refit.values[f"{one.id}.{name}"] for name in one.parameters}}
        for one in data.beside(model)
    ]
    by_record = {one.record.name: one.nrmse for one in played.records if one.nrmse is not None}
    error = _mean(played, asked.held, held=False)
    settings: Mapping[str, Any] = {
        **record.settings,
        "large_signal": limits,
        "events": asked.events.source,
        "nrmse_by_record": by_record,
        "nrmse_by_window": played.by_window,
    }
    explains = model.adequate()
    grade = "explains" if explains else "close" if error is not None and error < 2 * _floor(data) else None
    if grade is None:
        grade = "fails" if error is None or error > 0.1 else "rough"
    if asked.sweep is not None:
        return replace(record, settings=settings)
    fitted = {name: value for name, value in by_record.items() if name not in asked.held}
    empty: dict[str, Any] = {"nrmse_by_band": {}, "nrmse_by_entry": {}, "share_by_band": {}, "nrmse_by_part": {}}
    return replace(
        record, settings=settings, nrmse=error, nrmse_by_op=fitted, grade=grade, misfit=None, noise_floor=_floor(data),
        over_noise=None, identifiability=(), holdout={name: by_record[name] for name in asked.held if name in by_record}, **empty,
    )  # fmt: skip
