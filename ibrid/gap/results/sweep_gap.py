"""The `Gap` of findings on a sweep: records before and after, located misfit, effects."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import mean_or_none, nrmse
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.grade import grade_of, misfit_of
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.delay_forms import find_allowed_delay_forms, unite_intervals
from ibrid.gap.refitting.model import Model
from ibrid.gap.refitting.prior import Nominal
from ibrid.gap.results.detectability import list_undetectable_effects
from ibrid.gap.results.gap import Gap, LocatedMisfit
from ibrid.gap.results.misfit_location import locate_misfit
from ibrid.gap.results.named_effects import (
    describe_candidate,
    list_named_effects,
    list_parameter_changes,
    mean_holdout,
)
from ibrid.gap.results.suggested_edits import Suggest, SuggestionRequest, check_suggestions
from ibrid.gap.results.verdict import ErrorSummary, Findings, decide_verdict, describe_verdict
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.parts.plant.delay_form import delay_forms
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text

#: Verdicts that change the model.
REPAIRED = ("named", "data-convention")


def build_sweep_gap(
    findings: Findings,
    dataset: SweepDataset,
    diagram: Diagram,
    sweep: Sweep,
    held: Sequence[str],
    values: Nominal | None,
    suggest: Sequence[Suggest],
) -> Gap:
    """Build the Gap that findings on a sweep amount to.

    Parameters
    ----------
    diagram : Diagram
        The given model.
    sweep : Sweep
        All operating points, those held out included.
    held : sequence of str
        Names of the held-out points.
    values : mapping or None
        Nominal values as given.
    suggest : sequence of Suggest
        Sources of further edits where something is located and has no name.
    """
    verdict = decide_verdict(findings)

    def record_of(model: Model) -> Record:
        return _build_record(model, findings, dataset, sweep)

    baseline = record_of(findings.given)
    model, repaired = _select_reported_model(verdict, findings, baseline, record_of)
    other_forms = find_allowed_delay_forms(dataset, model, findings.scale, EQUALLY_GOOD.bic)
    if other_forms:
        form_intervals = [record_of(other).intervals for other in other_forms]
        united = unite_intervals(repaired.intervals, form_intervals)
        repaired = replace(repaired, intervals=united)
    forms = [
        form
        for other in (model, *other_forms)
        for form in delay_forms(other.diagram, dataset.kinds)
    ]
    intervals = next(iter(repaired.intervals.values()), {})
    baseline = repaired if model is findings.given else baseline
    nominal = _nominal_responses(findings.given, dataset) if values else {}
    before = {
        "nominal": _mean_nominal_error(findings.given, nominal),
        "refit": baseline.nrmse,
        "holdout": mean_holdout(baseline.holdout, held),
    }
    after = {"refit": repaired.nrmse, "holdout": mean_holdout(repaired.holdout, held)}
    floor = findings.noise.floor
    missed = _locate(model, findings.scale)
    errors = ErrorSummary.of(before, after)
    adequate_ports = tuple(port_fit for port_fit in findings.ports if port_fit.adequate)
    request = SuggestionRequest(
        findings.given.diagram, baseline, adequate_ports, dataset.kinds, sweep
    )
    suggested = ()
    if verdict == "located-unnamed":
        suggested = check_suggestions(findings, dataset, request, suggest)
    return Gap(
        verdict=verdict,
        sentence=describe_verdict(verdict, findings, errors, floor, missed),
        located=_locate(findings.given, findings.scale),
        ports=findings.ports,
        effects=list_named_effects(findings, intervals, forms) if verdict in REPAIRED else (),
        before=before,
        after=after,
        noise_floor=floor,
        moved=list_parameter_changes(model.refit, intervals),
        candidates=tuple(
            describe_candidate(trial, findings, dataset.known_stable.get(trial))
            for trial in findings.trials
        ),
        could_not_have_seen=list_undetectable_effects(
            dataset.fitter_for(model.convention),
            model.refit,
            dataset.insertions(model),
            dataset.catalogue,
            findings.scale,
        ),
        steps=(*findings.steps, *_report_open_form(forms)),
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
        suggested=suggested,
    )


def _select_reported_model(
    verdict: str, findings: Findings, baseline: Record, record_of: Callable[[Model], Record]
) -> tuple[Model, Record]:
    """Return the model that is reported, and its record.

    The repaired one; the better one where none explains the data; else the given one.
    """
    best = findings.best
    if verdict in REPAIRED:
        return best, record_of(best)
    same_convention = best.convention == findings.given.convention
    if verdict == "unexplained" and findings.is_repaired and same_convention:
        other = record_of(best)
        if baseline.nrmse is None or (other.nrmse is not None and other.nrmse < baseline.nrmse):
            return best, other
    return findings.given, baseline


def _build_record(model: Model, findings: Findings, dataset: SweepDataset, sweep: Sweep) -> Record:
    """Build the record of a model on the data read in its convention.

    Its intervals are those of the noise by which it was judged; its grade is that of the noise that
    the data themselves show.
    """
    convention = model.convention
    fitted = {point.op.name: point for point in findings.noise.sweep.points}
    points = tuple(
        replace(point, sigma=findings.scale * np.asarray(fitted[point.op.name].sigma), repeats=None)
        if point.op.name in fitted
        else point
        for point in sweep.points
    )
    judged = convention.undone(replace(sweep, points=points))
    held = [name for name in sweep.names if name not in fitted]
    record = record_at(
        model.diagram, judged, model.refit.values, vocabulary=dataset.kinds, holdout_op=held
    )
    if not findings.noise.known:
        record = replace(record, noise_floor=None, over_noise=None)
    frame: dict[str, Any] = {}
    if convention.angle:
        frame["frame_angle"] = convention.angle
    if convention.angles:
        frame["frame_angles"] = dict(convention.angles)
    record = replace(record, settings={**record.settings, **frame})
    if record.nrmse is None:
        return record
    read_points = {point.op.name: point for point in convention.undone(sweep).points}
    measured = [read_points[name] for name in record.nrmse_by_op]
    responses = [record.response(point.op.name, point.frequency) for point in measured]
    misfit = misfit_of(responses, measured, record.free_parameters)
    return replace(record, misfit=misfit, grade=str(grade_of(record.nrmse, misfit)))


def _locate(model: Model, scale: float) -> tuple[LocatedMisfit, ...]:
    """Locate the misfit of a fitted model."""
    fit = model.refit
    dof_per_number = fit.dof / fit.measurement_count
    return locate_misfit(fit.problem.points, fit.residuals, dof_per_number, scale)


def _report_open_form(forms: Sequence[str]) -> tuple[str, ...]:
    """Report that the data allow delays in several forms; () where they allow one."""
    distinct = dict.fromkeys(forms)
    if len(distinct) < 2:
        return ()
    step = (
        f"the data do not tell in which form the device has its delays ({', '.join(distinct)}): "
        "intervals hold for all of these"
    )
    return (step,)


def _nominal_responses(given: Model, dataset: SweepDataset) -> dict[str, np.ndarray]:
    """Return the response (K, 2, 2) of the given model at nominal values, by operating point."""
    fit = dataset.fitter_for(given.convention).evaluate_values(given.diagram, {})
    pairs = zip(fit.problem.points, fit.responses, strict=True)
    return {point.op.name: response for point, response in pairs}


def _mean_nominal_error(given: Model, nominal: dict[str, np.ndarray]) -> float | None:
    """Return the mean NRMSE of nominal responses; None without any."""
    points = given.refit.problem.points if nominal else []
    return mean_or_none(nrmse(nominal[point.op.name], point) for point in points)
