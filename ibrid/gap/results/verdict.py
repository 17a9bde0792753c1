"""The verdict on findings, one of six by rules that were fixed before any data were seen, and the
sentence that reports it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.evaluation.reading import is_usual
from ibrid.fit.adequacy import EQUALLY_GOOD, share_explained
from ibrid.gap.delay_forms import find_lost_forms
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.cross_validation import ValidationErrors
from ibrid.gap.refitting.model import (
    Model,
    explains_data,
    explains_nearly_all,
    has_white_residual,
    is_delay_form,
    is_significant,
    rank_by_bic,
)
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import FAR
from ibrid.gap.results.gap import LocatedEventMisfit, LocatedMisfit, Verdict
from ibrid.measurement.conventions.labels import FREQUENCY, Convention
from ibrid.parts.editing.practice import Insertion

#: Part of chi2 that corrected labels leave at most, where every model leaves more than noise.
MISLABELLED_SHARE = 0.5
#: Ratio of the error as given to the refitted one from which a report mentions the refit.
REFIT_GAIN = 3.0
#: Factor within which a noise that is not known agrees with what the best fit leaves.
AGREEING = 1.2


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a verdict is made from.

    Parameters
    ----------
    noise : Noise
        What the data were weighted by.
    given, best : Model
        The refitted given model and the repaired one; the same where no edit is significant.
    rivals : tuple of tuple of Model
        For each edit of `best`, the models that compete for its place.
    trials : tuple of Model
        Of the first step, best first.
    ports : tuple of PortFit
        The port map; () where none was computed.
    scale : float
        Factor on the standard deviation of the noise.
    tests : int
        Hypotheses tested.
    steps : tuple of str
        What was decided, in order.
    before, after : ValidationErrors or None
        Of `given` and of `best` on data they were not fitted to; None where nothing repairs.
    complete : bool
        Everything was tried, so that effects can be excluded.
    """

    noise: Noise
    given: Model
    best: Model
    rivals: tuple[tuple[Model, ...], ...]
    trials: tuple[Model, ...]
    ports: tuple[PortFit, ...]
    scale: float
    tests: int
    steps: tuple[str, ...]
    before: ValidationErrors | None = None
    after: ValidationErrors | None = None
    complete: bool = True

    @property
    def noise_disagrees(self) -> bool:
        """Whether the residual is white, but not of the level that the data were weighted by."""
        agrees = self.noise.known or 1.0 / AGREEING < self.scale < AGREEING
        return not agrees and (has_white_residual(self.given) or has_white_residual(self.best))

    @property
    def is_mislabelled(self) -> bool:
        """Whether a usual labelling mistake is among the edits and alone explains most."""
        labels = [edit for edit in self.best.edits if isinstance(edit, Convention)]
        chi2_of_labels = [
            trial.refit.chi2
            for trial in self.trials
            if any(trial.edits == (label,) for label in labels)
        ]
        limit = MISLABELLED_SHARE * self.given.refit.chi2
        return any(map(is_usual, labels)) and min(chi2_of_labels, default=np.inf) < limit

    @property
    def is_repaired(self) -> bool:
        """Whether an edit was significant."""
        return self.best is not self.given

    @property
    def is_best_explaining(self) -> bool:
        """Whether the best model fits as well as the noise allows."""
        return explains_data(self.best, self.noise, self.scale)


@dataclass(frozen=True)
class ErrorSummary:
    """NRMSE of the model at the given values, refitted, and repaired; nan where not known."""

    nominal: float
    before: float
    after: float

    @classmethod
    def of(
        cls, before: Mapping[str, float | None], after: Mapping[str, float | None]
    ) -> "ErrorSummary":
        """Take the errors from `Gap.before` and `Gap.after`."""
        errors = (before["nominal"], before["refit"], after["refit"])
        return cls(*(np.nan if error is None else error for error in errors))


def decide_verdict(findings: Findings) -> Verdict:
    """Decide the verdict.

    Where every model leaves more than the measured noise, only a wrong label can be recognised.
    """
    if findings.noise.measured is not None:
        return "data-convention" if findings.is_mislabelled else "unexplained"
    if findings.is_best_explaining:
        if any(isinstance(edit, Convention) for edit in findings.best.edits):
            return "data-convention"
        if findings.is_repaired:
            return "data-convention" if all(map(is_delay_form, findings.best.edits)) else "named"
        return "parameters-only" if list_implausible_parameters(findings.given) else "no-gap"
    if is_named_despite_rest(findings):
        return "named"
    is_located = any(port_fit.adequate for port_fit in findings.ports)
    return "located-unnamed" if is_located else "unexplained"


def is_named_despite_rest(findings: Findings) -> bool:
    """Whether one effect explains nearly all of the squared misfit, whatever else is left."""
    edits = findings.best.edits
    if len(edits) != 1 or not isinstance(edits[0], Insertion) or is_delay_form(edits[0]):
        return False
    return explains_nearly_all(findings.given, findings.best, findings.scale)


def relative_misfit(model: Model) -> float:
    """Return the rms over all frequencies of |Y_model - Y|_F / |Y|_F of a model of a sweep."""
    parts = []
    for response, point in zip(model.refit.responses, model.refit.problem.points, strict=True):
        error = np.linalg.norm(response - point.admittance, axis=(1, 2))
        parts.append(error / np.linalg.norm(point.admittance, axis=(1, 2)))
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def list_implausible_parameters(model: Model) -> list[str]:
    """List parameters beyond `FAR` standard deviations of their prior, the furthest first."""
    distances = {name: abs(sigmas) for name, sigmas in model.refit.moved.items()}
    implausible = [name for name, distance in distances.items() if distance > FAR]
    return sorted(implausible, key=lambda name: -distances[name])


def find_indistinguishable(findings: Findings, place: int) -> tuple[str, ...]:
    """Return the ids of other effects that could take the place of an edit of the best model.

    Those with a BIC as good, significant, and adequate if the best model is. Of a convention, the
    ids of other labels.
    """
    best = findings.best
    scale = findings.scale
    edit = best.edits[place]
    limit = best.bic(scale) + EQUALLY_GOOD.bic
    if place >= len(findings.rivals):
        return ()
    rivals = [rival for rival in findings.rivals[place] if rival.bic(scale) <= limit]
    if isinstance(edit, Convention):
        others = [rival.edits[-1] for rival in rivals]
        ids = [name for other in others if isinstance(other, Convention) for name in other.ids]
        return tuple(dict.fromkeys(name for name in ids if name not in edit.ids))
    names = list[str]()
    for rival in rank_by_bic(rivals, scale):
        other = rival.edits[-1]
        if isinstance(other, Convention) or other.effect in (edit.effect, *names):
            continue
        adequate = rival.is_adequate(scale) or not best.is_adequate(scale)
        if adequate and is_significant(findings.given, rival, findings.tests, scale):
            names.append(other.effect)
    return tuple(names)


# --- the sentence
# ----------------------------------------------------------------------------------------------


def describe_verdict(
    verdict: Verdict,
    findings: Findings,
    errors: ErrorSummary,
    floor: float | None,
    missed: Sequence[LocatedMisfit | LocatedEventMisfit] = (),
) -> str:
    """Report the verdict in a sentence for an engineer.

    Parameters
    ----------
    floor : float or None
        NRMSE that noise alone would leave.
    missed : sequence of Located or LocatedEvent
        Where the best model misses the data, worst first.
    """
    noise = "" if floor is None else f", noise alone would leave {floor:.2g}"
    if verdict in ("no-gap", "parameters-only"):
        return _report_no_gap(verdict, findings, errors, noise)
    if verdict == "named":
        return _report_named(findings, errors, noise, missed)
    if verdict == "data-convention":
        return _report_convention(findings, errors, noise)
    if verdict == "located-unnamed":
        return _report_located(findings)
    return _report_unexplained(findings, errors, noise)


def _report_no_gap(verdict: Verdict, findings: Findings, errors: ErrorSummary, noise: str) -> str:
    """Report that the model explains the data, with plausible parameters or with others."""
    level = findings.scale * findings.noise.level
    limit = f"; the noise is not known, so down to {level:.2g} of |Y| alone"
    error = f"(NRMSE {errors.before:.2g}{noise}){'' if findings.noise.known else limit}"
    if verdict == "no-gap":
        refit = ""
        if REFIT_GAIN * errors.before <= errors.nominal < np.inf:
            refit = _describe_refit(findings.given, errors.nominal)
        return f"The model explains the data {error}{refit}: smaller effects cannot be excluded."
    names = ", ".join(list_implausible_parameters(findings.given))
    others = "Other parameters explain"
    if findings.complete:
        others = "No effect is missing: other parameters explain"
    return f"{others} the data {error}; far off: {names}."


def _report_named(
    findings: Findings,
    errors: ErrorSummary,
    noise: str,
    missed: Sequence[LocatedMisfit | LocatedEventMisfit],
) -> str:
    """Report the named effects, how far the error falls, and what is left."""
    effects = _capitalise("; ".join(_describe_edits(findings, Insertion)))
    if errors.after > 0.9 * errors.before:
        return (
            f"{effects}: the model as given explains the data only with values far from their "
            f"nominal ones (error {errors.after:.2g}{noise})."
        )
    start = f"refitted model falls from {errors.before:.2g}"
    if errors.after < errors.nominal < errors.before:
        start = f"model as given falls from {errors.nominal:.2g}"
    left = "" if findings.is_best_explaining else _describe_remainder(findings, missed)
    return f"{effects}: the error of the {start} to {errors.after:.2g}{noise}.{left}"


def _report_convention(findings: Findings, errors: ErrorSummary, noise: str) -> str:
    """Report that the data follow other conventions, or the device another form of delay."""
    rest = "" if findings.noise.measured is None else ", the rest is not explained"
    error = f"(error {errors.before:.2g} -> {errors.after:.2g}{noise}{rest})."
    labels = list(_describe_edits(findings, Convention))
    forms = list(_describe_edits(findings, Insertion, form=True))
    if not labels:  # nothing of the data is wrong
        nothing = "; nothing else is missing" if findings.complete else ""
        return f"{_capitalise(' and '.join(forms))}{nothing} {error}"
    others = [*forms, *_describe_edits(findings, Insertion, form=False)]
    also = "".join(f"; also {words}" for words in others)
    return (
        f"The data are written otherwise than the model means: {' and '.join(labels)}{also} {error}"
    )


def _report_located(findings: Findings) -> str:
    """Report the places at which one unknown transfer function explains the data."""
    places = [port_fit.port.words for port_fit in findings.ports if port_fit.adequate]
    at = "at one of these places: " if len(places) > 1 else "at "
    unknown = "that none of the effects tried is"
    if findings.complete:
        unknown = "that the catalogue does not know"
    return (
        f"Something is missing {unknown}; one unknown transfer would explain all, "
        f"{at}{', '.join(places)}."
    )


def _report_unexplained(findings: Findings, errors: ErrorSummary, noise: str) -> str:
    """Report that nothing explains the data, and the nearest model."""
    nearest = ""
    if findings.is_repaired:
        share = 1.0 - findings.best.refit.chi2 / findings.given.refit.chi2
        edits = "; ".join(_describe_edits(findings, (Convention, Insertion)))
        handed_over = ""
        if errors.after < errors.before:
            handed_over = f", which the model handed over has: error {errors.after:.2g}"
        nearest = (
            f" Nearest, and not enough to be named: {edits} ({100 * share:.0f} % of the squared "
            f"misfit){handed_over}."
        )
    tried = "nothing that was tried until then does"
    if findings.complete and findings.ports:
        tried = "no effect or single place does either"
    elif findings.complete:
        tried = "no effect does either (places were not compared)"
    error = f"(error {errors.before:.2g}{noise})"
    return f"The model does not explain the data {error}, and {tried}.{nearest}"


def _capitalise(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}"


def _describe_remainder(
    findings: Findings, missed: Sequence[LocatedMisfit | LocatedEventMisfit]
) -> str:
    """Report what a named effect leaves in excess of the noise, and where."""
    refit = findings.best.refit
    share = share_explained(findings.given.refit.chi2, refit.chi2, refit.dof)
    residual = np.sqrt(refit.chi2 / refit.dof) / findings.scale
    where = "".join(f", most of it in {', '.join(worst.place)}" for worst in missed[:1])
    return (
        f" It explains {100 * share:.4g} % of the squared misfit; what is left is {residual:.2g} "
        f"times what noise would leave{where}, and not explained."
    )


def _describe_refit(model: Model, nominal: float) -> str:
    """Report the error at the given values, and the parameter that the refit changed most."""
    refit = model.refit
    if not refit.moved:  # values were given of what the program fixes alone
        return ""
    name = max(refit.moved, key=lambda name: abs(refit.moved[name]))
    values = f"{refit.prior[name].nominal:.3g} -> {refit.values[name]:.3g}"
    return (
        f", with its parameters fitted within their tolerances (as given {nominal:.2g}; furthest "
        f"{name}, {values})"
    )


def net_edits(findings: Findings) -> Iterator[tuple[int, Insertion | Convention]]:
    """Yield the edits of the best model that remain, with their places, forms of delays last.

    An edit that removes a part of what another added is reported with that one, and both are left
    out where nothing of it remains. Of forms of delays the last counts, while its block is there.
    """
    lost = find_lost_forms(findings.given.diagram, findings.best.edits)
    blocks = {block.name for block in findings.given.diagram.instances}
    added_by = dict[str, int]()
    edits = dict[int, Insertion | Convention]()
    for place, edit in enumerate(findings.best.edits):
        if is_delay_form(edit):
            edits = {other: kept for other, kept in edits.items() if not is_delay_form(kept)}
        edits[place] = edit
        if isinstance(edit, Convention):
            continue
        blocks_after = {block.name for block in edit.diagram.instances}
        origins = {added_by.get(name) for name in blocks - blocks_after}
        added_by |= dict.fromkeys(blocks_after - blocks, place)
        blocks = blocks_after
        origin = origins.pop() if edit.change == "remove" and len(origins) == 1 else None
        addition = None if origin is None else edits.get(origin)
        if origin is None or not isinstance(addition, Insertion) or addition.change != "add":
            continue
        edits[origin] = replace(addition, where=f"{addition.where}, but for {edit.where}")
        del edits[place]
        if not any(added_by[name] == origin for name in blocks & added_by.keys()):
            del edits[origin]
    remaining = [(place, edit) for place, edit in edits.items() if place not in lost]
    yield from sorted(remaining, key=lambda item: is_delay_form(item[1]))


def _describe_edits(
    findings: Findings, kinds: type | tuple[type, ...], form: bool | None = None
) -> Iterator[str]:
    """Describe the edits of some kinds, each with what the data cannot distinguish from it.

    form : forms of delays alone, or none of them; None: both.
    """
    for place, edit in net_edits(findings):
        if not isinstance(edit, kinds) or form not in (None, is_delay_form(edit)):
            continue
        others = list(find_indistinguishable(findings, place))
        if isinstance(edit, Convention):
            others += edit.equivalents.get(FREQUENCY, ())
            words = edit.words
        else:
            words = describe_insertion(edit)
        if others:
            alternatives = " or ".join(name.replace("_", " ") for name in others)
            words += f" (or it is {alternatives}: these data cannot tell)"
        yield words


def describe_insertion(edit: Insertion) -> str:
    """Describe an edit as a statement on the device."""
    if edit.says:
        return edit.says
    effect = f"{edit.effect.replace('_', ' ')} ({edit.where})"
    if edit.change == "add":
        return f"the device has {effect}, which the model lacks"
    if edit.change == "remove":
        return f"the model has {effect}, which the device lacks"
    return f"the device has {effect} in another form than the model"
