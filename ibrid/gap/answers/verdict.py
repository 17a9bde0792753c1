"""The verdict: one of six, by rules that were fixed before any data were seen, and the sentence
that says it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.evaluation.adequacy import EQUALLY_GOOD, share_explained
from ibrid.evaluation.reading import is_usual
from ibrid.gap.answers.result import Located, LocatedEvent, Verdict
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.held_out import HeldOut
from ibrid.gap.refitting.model import (
    Model,
    best_first,
    explains_nearly_all,
    fits,
    is_form,
    significant,
    white,
)
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import FAR
from ibrid.gap.trials.delay_forms import lost_forms
from ibrid.measurement.conventions.labels import FREQUENCY, Convention
from ibrid.parts.editing.practice import Insertion

#: Part of chi2 that a wrong label leaves at most once it is put right, where every model leaves
#: more than noise.
LEFT = 0.5
#: Times that the error falls by fitting from which that is said.
MOVED = 3.0
#: Factor within which a noise that is not known agrees with what the best fit leaves.
AGREEING = 1.2


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a verdict is made from. `rivals` : for each edit of `best`, the trials that compete
    for its place.
    `trials` : of the first step, best first. `scale` : of the noise. `tests` : edits that were
    weighed. `before`, `after` : errors of `given`, and of what repairs it, where they were not
    fitted; None where nothing repairs it. `complete` : True when everything was tried, so that
    something can be excluded.
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
    before: HeldOut | None = None
    after: HeldOut | None = None
    complete: bool = True

    @property
    def weighed_wrongly(self) -> bool:
        """True when what is left over looks like noise, but not like the one that data and prior
        were weighed with.
        """
        agrees = self.noise.known or 1.0 / AGREEING < self.scale < AGREEING
        return not agrees and (white(self.given) or white(self.best))

    @property
    def misread(self) -> bool:
        """True when a usual mistake in the labels is among the edits and by itself takes most of
        the misfit away.
        """
        edits = [one for one in self.best.edits if isinstance(one, Convention)]
        alone = [
            one.refit.chi2 for one in self.trials if any(one.edits == (edit,) for edit in edits)
        ]
        return (
            any(map(is_usual, edits)) and min(alone, default=np.inf) < LEFT * self.given.refit.chi2
        )

    @property
    def repaired(self) -> bool:
        """True when an edit paid."""
        return self.best is not self.given


@dataclass(frozen=True)
class Errors:
    """NRMSE, nan where there is none, of the model with the values that were given, of it refitted,
    and of the repaired one.
    """

    nominal: float
    before: float
    after: float

    @classmethod
    def of(cls, before: Mapping[str, float | None], after: Mapping[str, float | None]) -> "Errors":
        """Of what a gap says of the model before and after."""
        found = (before["nominal"], before["refit"], after["refit"])
        return cls(*(np.nan if error is None else error for error in found))


def verdict_of(findings: Findings) -> Verdict:
    """One of six; where every model leaves more than noise, only whether a label is wrong can be
    said.
    """
    if findings.noise.measured is not None:
        return "data-convention" if findings.misread else "unexplained"
    if fits(findings.best, findings.noise, findings.scale):
        if any(isinstance(edit, Convention) for edit in findings.best.edits):
            return "data-convention"
        if findings.repaired:
            return "data-convention" if all(map(is_form, findings.best.edits)) else "named"
        return "parameters-only" if moved_far(findings.given) else "no-gap"
    if named_beside_rest(findings):
        return "named"
    return "located-unnamed" if any(one.adequate for one in findings.ports) else "unexplained"


def named_beside_rest(findings: Findings) -> bool:
    """True where one edit takes nearly all of the squared misfit away, and what is left is no
    matter of its name.
    """
    edits = findings.best.edits
    if len(edits) != 1 or not isinstance(edits[0], Insertion) or is_form(edits[0]):
        return False
    return explains_nearly_all(findings.given, findings.best, findings.scale)


def missed(model: Model) -> float:
    """What a model of a sweep leaves over, as the rms over all frequencies of its error over
    |Y|_F.
    """
    pairs = zip(model.refit.responses, model.refit.problem.points, strict=True)
    parts = [
        np.linalg.norm(y - one.admittance, axis=(1, 2))
        / np.linalg.norm(one.admittance, axis=(1, 2))
        for y, one in pairs
    ]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def moved_far(model: Model) -> list[str]:
    """Parameters further than `FAR` from their nominal value, the furthest first."""
    distance = {name: abs(sigmas) for name, sigmas in model.refit.moved.items()}
    return sorted(
        (name for name, far in distance.items() if far > FAR), key=lambda name: -distance[name]
    )


def alike(findings: Findings, place: int) -> tuple[str, ...]:
    """Ids of other effects that could take the place of an edit: as good, significant, and as
    adequate.
    """
    best, scale, names = findings.best, findings.scale, list[str]()
    edit, limit = best.edits[place], best.bic(scale) + EQUALLY_GOOD.bic
    if place >= len(findings.rivals):
        return ()
    if isinstance(edit, Convention):
        others = [one.edits[-1] for one in findings.rivals[place] if one.bic(scale) <= limit]
        labels = [one.ids for one in others if isinstance(one, Convention)]
        return tuple(dict.fromkeys(name for ids in labels for name in ids if name not in edit.ids))
    for rival in best_first(findings.rivals[place], scale):
        other = rival.edits[-1]
        if isinstance(other, Convention) or other.effect == edit.effect or other.effect in names:
            continue
        adequate = rival.adequate(scale) or not best.adequate(scale)
        if (
            rival.bic(scale) <= limit
            and adequate
            and significant(findings.given, rival, findings.tests, scale)
        ):
            names.append(other.effect)
    return tuple(names)


def sentence_of(
    verdict: Verdict,
    findings: Findings,
    errors: Errors,
    floor: float | None,
    missed: Sequence[Located | LocatedEvent] = (),
) -> str:
    """The verdict in words for an engineer. floor : NRMSE of noise alone. missed : where the best
    model misses the data, worst first.
    """
    before, after = errors.before, errors.after
    noise = "" if floor is None else f", noise alone would leave {floor:.2g}"
    taken = findings.scale * findings.noise.level
    limit = (
        ""
        if findings.noise.known
        else f"; the noise is not known, so down to {taken:.2g} of |Y| alone"
    )
    if verdict == "no-gap":
        fitted = (
            _fitted(findings.given, errors.nominal)
            if MOVED * before <= errors.nominal < np.inf
            else ""
        )
        return (
            f"The model explains the data (NRMSE {before:.2g}{noise}){limit}{fitted}: smaller "
            "effects cannot be excluded."
        )
    if verdict == "parameters-only":
        names = ", ".join(moved_far(findings.given))
        what = (
            "No effect is missing: other parameters explain"
            if findings.complete
            else "Other parameters explain"
        )
        return f"{what} the data (NRMSE {before:.2g}{noise}){limit}; far off: {names}."
    if verdict == "named":
        what = "; ".join(_told(findings, Insertion))
        if after > 0.9 * before:
            implausible = (
                "the model as given explains the data only with values far from their nominal ones"
            )
            return f"{what[0].upper()}{what[1:]}: {implausible} (error {after:.2g}{noise})."
        as_given = after < errors.nominal < before
        fell = (
            f"{'model as given' if as_given else 'refitted model'} falls from "
            f"{errors.nominal if as_given else before:.2g}"
        )
        left = (
            ""
            if fits(findings.best, findings.noise, findings.scale)
            else _left_beside(findings, missed)
        )
        return f"{what[0].upper()}{what[1:]}: the error of the {fell} to {after:.2g}{noise}.{left}"
    if verdict == "data-convention":
        rest = "" if findings.noise.measured is None else ", the rest is not explained"
        fell = f"(error {before:.2g} -> {after:.2g}{noise}{rest})."
        labels, forms = (
            list(_told(findings, Convention)),
            list(_told(findings, Insertion, form=True)),
        )
        if not labels:  # nothing of the data is wrong
            what = " and ".join(forms)
            nothing = "; nothing else is missing" if findings.complete else ""
            return f"{what[0].upper()}{what[1:]}{nothing} {fell}"
        also = "".join(
            f"; also {words}" for words in (*forms, *_told(findings, Insertion, form=False))
        )
        return (
            f"The data are written otherwise than the model means: {' and '.join(labels)}{also} "
            f"{fell}"
        )
    if verdict == "located-unnamed":
        places = [one.port.words for one in findings.ports if one.adequate]
        where = f"{'at one of these places: ' if len(places) > 1 else 'at '}{', '.join(places)}"
        known = (
            "that the catalogue does not know"
            if findings.complete
            else "that none of the effects tried is"
        )
        return f"Something is missing {known}; one unknown transfer would explain all, {where}."
    nearest = ""
    if findings.repaired:
        share = 1.0 - findings.best.refit.chi2 / findings.given.refit.chi2
        what = "; ".join(_told(findings, (Convention, Insertion)))
        handed = f", which the model handed over has: error {after:.2g}" if after < before else ""
        nearest = (
            f" Nearest, and not enough to be named: {what} ({100 * share:.0f} % of the squared "
            f"misfit){handed}."
        )
    neither = (
        "or single place does either"
        if findings.ports
        else "does either (places were not compared)"
    )
    tried = (
        f"no effect {neither}" if findings.complete else "nothing that was tried until then does"
    )
    return f"The model does not explain the data (error {before:.2g}{noise}), and {tried}.{nearest}"


def _left_beside(findings: Findings, missed: Sequence[Located | LocatedEvent]) -> str:
    """What a named effect leaves beside the noise, and where."""
    refit = findings.best.refit
    share = share_explained(findings.given.refit.chi2, refit.chi2, refit.dof)
    times = np.sqrt(refit.chi2 / refit.dof) / findings.scale
    where = "".join(f", most of it in {', '.join(worst.place)}" for worst in missed[:1])
    return (
        f" It explains {100 * share:.4g} % of the squared misfit; what is left is {times:.2g} "
        "times what noise would leave"
        f"{where}, and not explained."
    )


def _fitted(model: Model, nominal: float) -> str:
    """How far from the values that were given a model explains the data."""
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
    """The edits of the best model with their places, forms of what is there behind what is not
    there; one that takes away a part of what another added is told with that, and both are left out
    where nothing of it stays. Of forms the last one counts, while something that it drew is there.
    """
    lost = lost_forms(findings.given.diagram, findings.best.edits)
    before = {one.name for one in findings.given.diagram.instances}
    made, edits = dict[str, int](), dict[int, Insertion | Convention]()
    for place, edit in enumerate(findings.best.edits):
        if is_form(edit):
            edits = {one: other for one, other in edits.items() if not is_form(other)}
        edits[place] = edit
        if isinstance(edit, Convention):
            continue
        now = {one.name for one in edit.diagram.instances}
        origins = {made.get(name) for name in before - now}
        made |= dict.fromkeys(now - before, place)
        before = now
        origin = origins.pop() if edit.change == "remove" and len(origins) == 1 else None
        whole = None if origin is None else edits.get(origin)
        if isinstance(whole, Insertion) and whole.change == "add" and origin is not None:
            edits[origin] = replace(whole, where=f"{whole.where}, but for {edit.where}")
            del edits[place]
            if not any(made[name] == origin for name in now & made.keys()):
                del edits[origin]
    edits = {place: edit for place, edit in edits.items() if place not in lost}
    yield from sorted(edits.items(), key=lambda item: is_form(item[1]))


def _told(
    findings: Findings, sort: type | tuple[type, ...], form: bool | None = None
) -> Iterator[str]:
    """The edits of a sort in words, each with what these data cannot tell from it. form : those
    that say how something is drawn, or the others; None: all.
    """
    for place, edit in net_edits(findings):
        if isinstance(edit, sort) and form in (None, is_form(edit)):
            same = edit.equivalents.get(FREQUENCY, ()) if isinstance(edit, Convention) else ()
            others = " or ".join(
                name.replace("_", " ") for name in (*alike(findings, place), *same)
            )
            words = edit.words if isinstance(edit, Convention) else words_of(edit)
            yield words + (f" (or it is {others}: these data cannot tell)" if others else "")


def words_of(edit: Insertion) -> str:
    """An edit as what it says of the device."""
    if edit.says:
        return edit.says
    what = f"{edit.effect.replace('_', ' ')} ({edit.where})"
    if edit.change == "add":
        return f"the device has {what}, which the model lacks"
    if edit.change == "remove":
        return f"the model has {what}, which the device lacks"
    return f"the device has {what} in another form than the model"
