"""What a `Gap` reports of its models: named effects, evidence, candidates, changed parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from ibrid.evaluation.errors_by_part import mean_or_none
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.refitting.model import (
    Model,
    explains_data,
    is_delay_form,
    is_significant,
    rank_by_bic,
    significance_threshold,
)
from ibrid.gap.results.gap import Candidate, NamedEffect, ParameterChange
from ibrid.gap.results.verdict import Findings, find_indistinguishable, net_edits
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion

#: Parameter -> 95 % confidence interval; None where it is open.
Intervals = Mapping[str, Sequence[float] | None]
#: Estimate, and the ends of its 95 % confidence interval.
Estimate = tuple[float, float | None, float | None]


def list_named_effects(
    findings: Findings, intervals: Intervals, forms: Sequence[str] = ()
) -> tuple[NamedEffect, ...]:
    """List the effects of the best model that the given one lacks, with their evidence.

    Parameters
    ----------
    intervals : mapping
        Of the parameters of the best model.
    forms : sequence of str
        Forms in which the device may have its delays, that of the best model first.
    """
    evidence = collect_evidence(findings)
    effects: list[NamedEffect] = []
    for position, edit in net_edits(findings):
        indistinguishable = find_indistinguishable(findings, position)
        if isinstance(edit, Convention):
            effects += _list_convention_effects(edit, evidence, indistinguishable)
        else:
            described = {**evidence, **_describe_form(edit, forms)}
            values = findings.best.refit.values
            parameters = {
                name: _estimate(values[name], name, intervals)
                for name in edit.parameters
                if name in values
            }
            effects.append(
                NamedEffect(
                    edit.effect, edit.change, edit.where, parameters, described, indistinguishable
                )
            )
    return tuple(effects)


def _list_convention_effects(
    convention: Convention, evidence: Mapping[str, Any], indistinguishable: tuple[str, ...]
) -> list[NamedEffect]:
    """Return a named effect for each label that a convention changes."""
    change = "replace"
    location = "the labels of the data"
    if convention.turned:
        change = "add"
        location = "between the measuring frame and the grid"
    effects: list[NamedEffect] = []
    for label, numbers in convention.ids.items():
        angles = numbers.get("angles", {})
        values = numbers
        if angles:
            values = {f"angle at {name}": value for name, value in angles.items()}
        parameters = {name: (value, None, None) for name, value in values.items()}
        equivalents = (*indistinguishable, *convention.equivalents.get(label, ()))
        effects.append(NamedEffect(label, change, location, parameters, evidence, equivalents))
    return effects


def _describe_form(edit: Insertion, forms: Sequence[str]) -> dict[str, Any]:
    """Return the form of a limit, or the forms of delays that the data allow."""
    if isinstance(edit, LimitEdit):
        return {"mode": edit.limit.mode, "windup": edit.limit.windup}
    if is_delay_form(edit):
        return {"form": forms[0] if forms else "", "forms": list(dict.fromkeys(forms))}
    return {}


def collect_evidence(findings: Findings) -> dict[str, Any]:
    """Collect the evidence for the best model: gain, significance, runner-up, validation errors."""
    given = findings.given
    best = findings.best
    scale = findings.scale
    named = {_edit_name(edit) for edit in best.edits}
    others = [
        trial
        for trial in findings.trials
        if not trial.edits or _edit_name(trial.edits[-1]) not in named
    ]
    runner_up = next(iter(rank_by_bic(others, scale)), None)
    runner_up_name = None
    runner_up_bic = None
    if runner_up is not None:
        runner_up_name = _edit_name(runner_up.edits[-1])
        runner_up_bic = runner_up.bic(scale) - best.bic(scale)
    held_out = {}
    if findings.before is not None and findings.after is not None:
        held_out = {"before": asdict(findings.before), "after": asdict(findings.after)}
    added = best.parameter_count - given.parameter_count
    return {
        "gain": given.cost(scale) - best.cost(scale),
        "threshold": significance_threshold(added, findings.tests),
        "p_before": given.refit.p_value(scale),
        "p_after": best.refit.p_value(scale),
        "runner_up": runner_up_name,
        "runner_up_bic": runner_up_bic,
        "held_out": held_out,
        "tests": findings.tests,
        "noise_scale": scale,
    }


def _edit_name(edit: Insertion | Convention) -> str:
    return edit.words if isinstance(edit, Convention) else edit.effect


def describe_candidate(trial: Model, findings: Findings, stable: bool | None) -> Candidate:
    """Describe a trial, and why it is rejected.

    stable : None where that was not determined.
    """
    edit = trial.edits[-1]
    scale = findings.scale
    if isinstance(edit, Convention):
        name = next(iter(edit.ids), "convention")
        change = "replace"
        location = edit.words
        added: tuple[str, ...] = ()
    else:
        name = edit.effect
        change = edit.change
        location = edit.where
        added = tuple(edit.parameters)
    adequate = explains_data(trial, findings.noise, scale)
    reasons: list[str] = []
    if not is_significant(findings.given, trial, max(len(findings.trials), 1), scale):
        reasons.append("does not pay")
    elif not adequate:
        reasons.append("does not fit as well as the noise allows")
    if stable is False:
        reasons.append("unstable")
    values = trial.refit.values
    return Candidate(
        id=name,
        change=change,
        where=location,
        cost=trial.cost(scale),
        gain=findings.given.cost(scale) - trial.cost(scale),
        bic=trial.bic(scale),
        free_parameters=trial.parameter_count,
        adequate=adequate,
        stable=stable,
        reason=", ".join(reasons),
        parameters={name: values[name] for name in added if name in values},
    )


def list_parameter_changes(refit: Any, intervals: Intervals) -> tuple[ParameterChange, ...]:
    """List the parameters with a nominal value and how far the fit changed them, furthest first."""
    changes: list[ParameterChange] = []
    for name, sigmas in refit.moved.items():
        nominal = refit.prior[name].nominal
        estimate = _estimate(refit.values[name], name, intervals)
        changes.append(ParameterChange(name, nominal, *estimate, sigmas))
    return tuple(sorted(changes, key=lambda change: -abs(change.sigmas)))


def _estimate(value: float, name: str, intervals: Intervals) -> Estimate:
    """Return a value with its interval."""
    low, high = intervals.get(name) or (None, None)
    return value, low, high


def mean_holdout(errors: Mapping[str, float], held: Sequence[str]) -> float | None:
    """Return the mean error on held-out data; None without any, or without a response there."""
    return mean_or_none(errors.get(name) for name in held)
