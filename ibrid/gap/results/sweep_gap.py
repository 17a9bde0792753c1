"""From findings to the answer: effects with intervals and evidence, errors before and after, what
moved, what stays unseen.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ibrid.evaluation.adequacy import EQUALLY_GOOD
from ibrid.evaluation.errors_by_part import mean_or_none, nrmse
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.grade import grade_of, misfit_of
from ibrid.evaluation.record import Record
from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.delay_forms import find_allowed_delay_forms, unite_intervals
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.refitting.model import (
    Model,
    explains_data,
    is_delay_form,
    is_significant,
    rank_by_bic,
    significance_threshold,
)
from ibrid.gap.refitting.prior import Nominal
from ibrid.gap.results.detectability import unseen
from ibrid.gap.results.gap import Candidate, Gap, NamedEffect, ParameterChange
from ibrid.gap.results.misfit_location import located
from ibrid.gap.results.suggested_edits import Question, Suggest, suggested
from ibrid.gap.results.verdict import (
    ErrorSummary,
    Findings,
    decide_verdict,
    describe_verdict,
    find_indistinguishable,
    net_edits,
)
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.parts.editing.practice import Insertion
from ibrid.parts.plant.delay_form import delay_forms
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text

#: Verdicts that change the model.
REPAIRED = ("named", "data-convention")

#: Parameter -> 95 % interval, None for an open one; and a value with the ends of its own.
Intervals = Mapping[str, Sequence[float] | None]
Strength = tuple[float, float | None, float | None]


def build_sweep_gap(
    findings: Findings,
    dataset: SweepDataset,
    diagram: Diagram,
    sweep: Sweep,
    held: Sequence[str],
    values: Nominal | None,
    suggest: Sequence[Suggest],
) -> Gap:
    """The Gap that findings amount to. sweep : all points, those held out included. suggest : who
    is asked for edits when something is located and unnamed.
    """
    verdict = decide_verdict(findings)
    baseline = _record(findings.given, findings, dataset, sweep)
    model, repaired = _handed_over(
        verdict, findings, baseline, lambda one: _record(one, findings, dataset, sweep)
    )
    others = find_allowed_delay_forms(dataset, model, findings.scale, EQUALLY_GOOD.bic)
    fit_other_delay_forms = [_record(one, findings, dataset, sweep).intervals for one in others]
    repaired = (
        replace(repaired, intervals=unite_intervals(repaired.intervals, fit_other_delay_forms))
        if others
        else repaired
    )
    intervals = next(iter(repaired.intervals.values()), {})
    baseline = repaired if model is findings.given else baseline
    forms = [form for one in (model, *others) for form in delay_forms(one.diagram, dataset.kinds)]
    nominal = _nominal_responses(findings.given, dataset) if values else {}
    before = {
        "nominal": mean_or_none(
            nrmse(nominal[one.op.name], one)
            for one in findings.given.refit.problem.points
            if nominal
        ),
        "refit": baseline.nrmse,
        "holdout": mean_holdout(baseline.holdout, held),
    }
    after = {"refit": repaired.nrmse, "holdout": mean_holdout(repaired.holdout, held)}
    floor = findings.noise.floor
    missed, missed_by_given = (
        located(one.problem.points, one.residuals, one.dof / one.measurement_count, findings.scale)
        for one in (model.refit, findings.given.refit)
    )
    adequate = tuple(one for one in findings.ports if one.adequate)
    question = Question(findings.given.diagram, baseline, adequate, dataset.kinds, sweep)
    return Gap(
        verdict=verdict,
        sentence=describe_verdict(verdict, findings, ErrorSummary.of(before, after), floor, missed),
        located=missed_by_given,
        ports=findings.ports,
        effects=effects_of(findings, intervals, forms) if verdict in REPAIRED else (),
        before=before,
        after=after,
        noise_floor=floor,
        moved=moved(model.refit, intervals),
        candidates=tuple(
            candidate_of(one, findings, dataset.known_stable.get(one)) for one in findings.trials
        ),
        could_not_have_seen=unseen(
            dataset.refitter(model.convention),
            model.refit,
            dataset.insertions(model),
            dataset.catalogue,
            findings.scale,
        ),
        steps=(*findings.steps, *_allowing(forms)),
        noise=findings.noise.source,
        noise_level=findings.noise.level,
        null_space=repaired.identifiability,
        given=program_text(diagram),
        program=program_text(model.diagram),
        baseline=baseline,
        repaired=repaired,
        sweep=sweep,
        held_out=tuple(held),
        nominal=nominal,
        angle=model.convention.angle,
        convention=model.convention,
        suggested=suggested(findings, dataset, question, suggest)
        if verdict == "located-unnamed"
        else (),
    )


def _handed_over(
    verdict: str, findings: Findings, baseline: Record, record: Callable[[Model], Record]
) -> tuple[Model, Record]:
    """The model that the answer hands over, and its record: the repaired one, or the better one
    where none explains the data.
    """
    if verdict in REPAIRED:
        return findings.best, record(findings.best)
    if (
        verdict == "unexplained"
        and findings.is_repaired
        and findings.best.convention == findings.given.convention
    ):
        other = record(findings.best)
        if baseline.nrmse is None or (other.nrmse is not None and other.nrmse < baseline.nrmse):
            return findings.best, other
    return findings.given, baseline


def _record(model: Model, findings: Findings, dataset: SweepDataset, sweep: Sweep) -> Record:
    """The record of a model on the data as it reads them; its intervals are those of the noise that
    judged it.
    """
    fitted = {point.op.name: point for point in findings.noise.sweep.points}
    points = tuple(
        replace(point, sigma=findings.scale * np.asarray(fitted[point.op.name].sigma), repeats=None)
        if point.op.name in fitted
        else point
        for point in sweep.points
    )
    judged = model.convention.undone(replace(sweep, points=points))
    held = [name for name in sweep.names if name not in fitted]
    record = record_at(
        model.diagram, judged, model.refit.values, vocabulary=dataset.kinds, holdout_op=held
    )
    if not findings.noise.known:
        record = replace(record, noise_floor=None, over_noise=None)
    frame: dict[str, Any] = (
        {"frame_angle": model.convention.angle} if model.convention.angle else {}
    )
    frame |= {"frame_angles": dict(model.convention.angles)} if model.convention.angles else {}
    record = replace(record, settings={**record.settings, **frame})
    own = {point.op.name: point for point in model.convention.undone(sweep).points}
    read = [own[name] for name in record.nrmse_by_op]
    responses = [record.response(point.op.name, point.frequency) for point in read]
    misfit = misfit_of(
        responses, read, record.free_parameters
    )  # by the noise that the data themselves tell
    return (
        record
        if record.nrmse is None
        else replace(record, misfit=misfit, grade=str(grade_of(record.nrmse, misfit)))
    )


def _allowing(forms: Sequence[str]) -> Iterator[str]:
    """Where the data do not tell in which form the device has its delays."""
    if len(several := dict.fromkeys(forms)) > 1:
        names = ", ".join(several)
        yield (
            f"the data do not tell in which form the device has its delays ({names}): intervals "
            "hold for all of these"
        )


def effects_of(
    findings: Findings, intervals: Intervals, forms: Sequence[str] = ()
) -> tuple[NamedEffect, ...]:
    """What the best model has that the given one lacks, with what speaks for it; a limit's form is
    told with that.

    forms : in which the device may have its delays, that of the best model first.
    """
    evidence, effects = evidence_of(findings), []
    for place, edit in net_edits(findings):
        if isinstance(edit, Convention):
            frame = ("add", "between the measuring frame and the grid")
            change, where = frame if edit.turned else ("replace", "the labels of the data")
            for label, numbers in edit.ids.items():
                by_point = numbers.get("angles", {})
                single = (
                    numbers
                    if not by_point
                    else {f"angle at {name}": value for name, value in by_point.items()}
                )
                shown = {name: (value, None, None) for name, value in single.items()}
                same = (*find_indistinguishable(findings, place), *edit.equivalents.get(label, ()))
                effects.append(NamedEffect(label, change, where, shown, evidence, same))
            continue
        values = findings.best.refit.values
        parameters = {
            name: _held(values[name], name, intervals) for name in edit.parameters if name in values
        }
        form: dict[str, Any] = {}
        if isinstance(edit, LimitEdit):
            form = {"mode": edit.limit.mode, "windup": edit.limit.windup}
        elif is_delay_form(edit):
            form = {"form": forms[0] if forms else "", "forms": list(dict.fromkeys(forms))}
        told = {**evidence, **form}
        effects.append(
            NamedEffect(
                edit.effect,
                edit.change,
                edit.where,
                parameters,
                told,
                find_indistinguishable(findings, place),
            )
        )
    return tuple(effects)


def evidence_of(findings: Findings) -> dict[str, Any]:
    """What speaks for the best model."""
    given, best, scale = findings.given, findings.best, findings.scale
    named = {_name(edit) for edit in best.edits}
    others = [one for one in findings.trials if not one.edits or _name(one.edits[-1]) not in named]
    before, after = findings.before, findings.after
    runner_up = next(iter(rank_by_bic(others, scale)), None)
    return {
        "gain": given.cost(scale) - best.cost(scale),
        "threshold": significance_threshold(
            best.parameter_count - given.parameter_count, findings.tests
        ),
        "p_before": given.refit.p_value(scale),
        "p_after": best.refit.p_value(scale),
        "runner_up": None if runner_up is None else _name(runner_up.edits[-1]),
        "runner_up_bic": None if runner_up is None else runner_up.bic(scale) - best.bic(scale),
        "held_out": {}
        if before is None or after is None
        else {"before": asdict(before), "after": asdict(after)},
        "tests": findings.tests,
        "noise_scale": scale,
    }


def _name(edit: Insertion | Convention) -> str:
    return edit.words if isinstance(edit, Convention) else edit.effect


def candidate_of(model: Model, findings: Findings, stable: bool | None) -> Candidate:
    """A trial as it is told."""
    edit, scale = model.edits[-1], findings.scale
    new = () if isinstance(edit, Convention) else tuple(edit.parameters)
    adequate = explains_data(model, findings.noise, scale)
    reasons = []
    if not is_significant(findings.given, model, max(len(findings.trials), 1), scale):
        reasons.append("does not pay")
    elif not adequate:
        reasons.append("does not fit as well as the noise allows")
    if stable is False:
        reasons.append("unstable")
    return Candidate(
        id=next(iter(edit.ids), "convention") if isinstance(edit, Convention) else edit.effect,
        change="replace" if isinstance(edit, Convention) else edit.change,
        where=edit.words if isinstance(edit, Convention) else edit.where,
        cost=model.cost(scale),
        gain=findings.given.cost(scale) - model.cost(scale),
        bic=model.bic(scale),
        free_parameters=model.parameter_count,
        adequate=adequate,
        stable=stable,
        reason=", ".join(reasons),
        parameters={name: model.refit.values[name] for name in new if name in model.refit.values},
    )


def moved(refit: Any, intervals: Intervals) -> tuple[ParameterChange, ...]:
    """What the fit moved from its nominal value, the farthest first."""
    rows = (
        ParameterChange(
            name, refit.prior[name].nominal, *_held(refit.values[name], name, intervals), sigmas
        )
        for name, sigmas in refit.moved.items()
    )
    return tuple(sorted(rows, key=lambda row: -abs(row.sigmas)))


def _held(value: float, name: str, intervals: Intervals) -> Strength:
    low, high = intervals.get(name) or (None, None)
    return value, low, high


def _nominal_responses(given: Model, dataset: SweepDataset) -> dict[str, np.ndarray]:
    refit = dataset.refitter(given.convention).evaluate_values(given.diagram, {})
    return {
        point.op.name: response
        for point, response in zip(refit.problem.points, refit.responses, strict=True)
    }


def mean_holdout(errors: Mapping[str, float], held: Sequence[str]) -> float | None:
    """Mean of a model's errors at what was held out; None where nothing was, or it has no answer
    there.
    """
    return mean_or_none(errors.get(name) for name in held)
