"""The gap workflow on sweeps at several injection amplitudes: gate, nonlinearity, and the small-signal answer beside it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.gap.amplitude_result import AmplitudeAnswer, TriedNonlinearity, nrmse_at_all, port_gain
from ibrid.gap.answer import answer_of
from ibrid.gap.catalogue import CATALOGUE
from ibrid.gap.convention import Convention
from ibrid.gap.noise import noise_of
from ibrid.gap.nonlinear_data import AmplitudeData, amplitude_data
from ibrid.gap.nonlinear_fit import NonlinearFit
from ibrid.gap.nonlinear_naming import Naming, name_nonlinearity
from ibrid.gap.nonlinear_places import places
from ibrid.gap.port_map import PortFit, port_map
from ibrid.gap.prior import Nominal, Prior
from ibrid.gap.result import Gap, NamedEffect, Verdict
from ibrid.gap.trial import Model, Workshop
from ibrid.gap.verdict import Findings
from ibrid.measurement.amplitudes import at_amplitudes
from ibrid.measurement.linearity import Linearity, small_signal
from ibrid.measurement.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram

#: Fewest frequencies of every operating point from which a small-signal answer can be had.
FEWEST = 4
#: Verdicts that a band which no amplitude touches may still have.
STANDING = ("named", "data-convention")
NEXT = "sweep with smaller amplitudes, and with two more between these"

Tell = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked: the model, all data, what is believed. `held` : operating points kept out. `find` : the small-signal
    workflow on a sweep with one amplitude."""

    diagram: Diagram
    sweep: Sweep
    held: tuple[str, ...]
    values: Nominal | None
    prior: Prior
    kinds: Vocabulary
    seed: int
    find: Callable[[Sweep], Gap]
    tell: Tell

    @property
    def fitted(self) -> Sweep:
        """All amplitudes of the operating points that are fitted."""
        return self.sweep.without(self.held) if self.held else self.sweep


def gap_at_amplitudes(asked: Question, found: Linearity) -> Gap:
    """The answer where there are several amplitudes.

    Where the response depends on the amplitude by more than products of signals cause, a nonlinearity is looked for in all
    amplitudes together, and the small-signal workflow sees the other frequencies alone. found : of the fitted points.
    """
    small = small_signal(asked.sweep, found)
    kept = 0 if small is None else min(len(point.frequency) for point in small.points)
    answer = AmplitudeAnswer(found, kept)
    if not len(found.refused) and small is not None:
        gap = asked.find(small)
        return replace(gap, sentence=f"{gap.sentence} {found.sentence}", amplitude=answer)
    data = amplitude_data(asked.fitted)
    naming = None if data is None else _named(asked, asked.diagram, data)
    if naming is not None and data is not None and naming.named:
        return _answered(asked, small if small is not None and kept >= FEWEST else None, naming, data, answer)
    if small is None or kept < FEWEST:
        gap = _linear_gap(asked, at_amplitudes(asked.sweep)[0], asked.diagram, {} if naming is None else naming.linear.values)
    else:
        gap = asked.find(small)
        if gap.verdict == "named" and data is not None:
            again = _named(asked, gap.diagram, data)
            if again is not None and again.named:
                return _answered_beside(gap, again, data, answer)
    return _unnamed(asked, gap, naming, data, answer)


def _named(asked: Question, diagram: Diagram, data: AmplitudeData) -> Naming | None:
    rng = np.random.default_rng(asked.seed)
    return name_nonlinearity(diagram, asked.kinds, data, asked.prior, rng, asked.tell)


# --- named -----------------------------------------------------------------------------------------------------------


def _answered(asked: Question, small: Sweep | None, naming: Naming, data: AmplitudeData, answer: AmplitudeAnswer) -> Gap:
    """A nonlinearity alone: the linear model at the values that all amplitudes tell."""
    fit = _of(naming)
    sweep = at_amplitudes(asked.sweep)[0] if small is None else small
    gap = _linear_gap(asked, sweep, asked.diagram, fit.values)
    answer = _weighed(answer, naming, data)
    return replace(
        gap,
        verdict="named",
        sentence=f"{_sentence(fit, answer)} {answer.linearity.sentence}",
        ports=(),
        effects=(_effect(naming, answer),),
        before={**gap.before, "refit": answer.before},
        after={**gap.after, "refit": answer.after},
        noise_floor=answer.floor,
        steps=(*_steps(naming, answer), *gap.steps),
        amplitude=answer,
    )


def _answered_beside(gap: Gap, naming: Naming, data: AmplitudeData, answer: AmplitudeAnswer) -> Gap:
    """A nonlinearity beside what the small-signal workflow named."""
    answer = _weighed(answer, naming, data)
    return replace(
        gap,
        sentence=f"{gap.sentence} {_sentence(_of(naming), answer)} {answer.linearity.sentence}",
        effects=(*gap.effects, _effect(naming, answer)),
        steps=(*gap.steps, *_steps(naming, answer)),
        amplitude=answer,
    )


def _of(naming: Naming) -> NonlinearFit:
    if naming.best is None:
        raise ValueError("no nonlinearity is believed")
    return naming.best


def _sentence(fit: NonlinearFit, answer: AmplitudeAnswer) -> str:
    side = "far above" if fit.place.shape.rises else "below"
    what = "its width" if fit.place.shape.rises else "the limit"
    return (
        f"The device has a {fit.place.id.replace('_', ' ')} ({fit.place.words}, {fit.place.shape.parameter} "
        f"{fit.threshold:.4g} pu), which the model lacks: over all amplitudes the error falls from {answer.before:.2g} to "
        f"{answer.after:.2g}. A linear program cannot hold it: model.py is the model for signals {side} {what}."
    )


def _effect(naming: Naming, answer: AmplitudeAnswer) -> NamedEffect:
    fit = _of(naming)
    others = [one for one in naming.fits if one.place.id != fit.place.id]
    evidence: dict[str, Any] = {
        "gain": naming.linear_cost - fit.cost,
        "threshold": naming.threshold,
        "p_after": fit.p_value,
        "runner_up": others[0].place.words if others else None,
        "runner_up_bic": others[0].cost - fit.cost if others else None,
        "tests": len(naming.fits),
        "form": fit.place.words,
    }
    return NamedEffect(
        id=fit.place.id,
        change="add",
        where=fit.place.where,
        parameters={fit.place.shape.parameter: (fit.threshold, *fit.interval)},
        evidence=evidence,
        indistinguishable_from=tuple(one.place.id for one in naming.alike),
    )


def _weighed(answer: AmplitudeAnswer, naming: Naming, data: AmplitudeData) -> AmplitudeAnswer:
    """The answer with every place that was tried, the errors over all amplitudes, and the gain of the best one's port."""
    linear = np.stack(naming.linear.responses, axis=1)[:, :, None]
    tried = tuple(
        TriedNonlinearity(
            one.place.id,
            one.place.words,
            one.place.where,
            naming.linear_cost - one.cost,
            one.chi2 / one.dof,
            one.p_value,
            one.threshold,
        )
        for one in naming.fits
    )
    fit = naming.best
    return replace(
        answer,
        words="" if fit is None else fit.place.words,
        parameter="" if fit is None else fit.place.shape.parameter,
        tried=tried,
        before=nrmse_at_all(data, np.broadcast_to(linear, data.admittance.shape)),
        after=None if fit is None else nrmse_at_all(data, fit.state.Y),
        floor=data.floor,
        port_gain=None if fit is None else port_gain(fit, data),
    )


def _steps(naming: Naming, answer: AmplitudeAnswer) -> tuple[str, ...]:
    found = answer.linearity
    steps = [
        f"compared {len(found.amplitudes)} amplitudes at {found.tests} numbers, noise: {found.noise}; left out of the "
        f"small-signal model: {len(found.refused)} frequencies",
        f"fitted the linear model to all amplitudes: cost {naming.linear_cost:.4g}",
    ]
    steps += [f"tried {one.place.words}: cost {one.cost:.4g}, p {one.p_value:.2g}" for one in naming.fits[:3]]
    return tuple(steps)


# --- not named -------------------------------------------------------------------------------------------------------


def _unnamed(
    asked: Question, gap: Gap, naming: Naming | None, data: AmplitudeData | None, answer: AmplitudeAnswer
) -> Gap:
    """No nonlinearity with a name: what the other frequencies say, and where the dependence sits."""
    words = [answer.linearity.sentence]
    steps = gap.steps
    if naming is not None and data is not None:
        answer = _weighed(answer, naming, data)
        steps = (*_steps(naming, answer), *steps)
    verdict: Verdict = gap.verdict
    ports: tuple[PortFit, ...] = gap.ports
    if naming is not None and naming.best is not None:
        verdict = "located-unnamed"
        found = " or ".join(one.place.words for one in (naming.best, *naming.alike))
        words += [f"{found[0].upper()}{found[1:]} explains it, which is no effect of the catalogue."]
    elif verdict not in STANDING:
        ports = () if data is None else _ports_at_all(asked, data)
        places_ = ", ".join(one.port.words for one in ports if one.adequate)
        verdict = "located-unnamed" if places_ else "unexplained"
        words += [
            f"Neither a current limit nor a dead zone explains it; it acts at {places_}."
            if places_
            else "Neither a current limit nor a dead zone explains it, and no single place does."
        ]
    words += [f"Next: {NEXT}."]
    sentence = " ".join(words if verdict not in STANDING else [gap.sentence, *words])
    effects = gap.effects if verdict in STANDING else ()
    return replace(gap, verdict=verdict, sentence=sentence, effects=effects, ports=ports, steps=steps, amplitude=answer)


def _ports_at_all(asked: Question, data: AmplitudeData) -> tuple[PortFit, ...]:
    """Ports of nonlinearities at which one unknown transfer explains each amplitude by itself; the worst amplitude's fit."""
    names = list(dict.fromkeys(one.port.name for one in places(asked.diagram, asked.kinds)))
    if not names:
        return ()
    by_level = []
    for level in range(data.amplitude.shape[2]):
        if not (data.weight[:, :, level] > 0).all():
            continue
        asked.tell(level, data.amplitude.shape[2], "the port map of an amplitude")
        points = tuple(
            replace(point, admittance=data.admittance[:, m, level], sigma=1.0 / data.weight[:, m, level], amplitude=None)
            for m, point in enumerate(data.sweep.points)
        )
        sweep = replace(data.sweep, points=points)
        by_level.append({one.port.name: one for one in port_map(asked.diagram, asked.kinds, sweep, asked.prior, [{}], only=names)})
    found = [
        max((level[name] for level in by_level), key=lambda one: one.chi2_per_dof)
        for name in names
        if all(name in level for level in by_level)
    ]
    return tuple(sorted(found, key=lambda one: one.chi2_per_dof))


def _linear_gap(asked: Question, sweep: Sweep, diagram: Diagram, values: Mapping[str, float]) -> Gap:
    """The linear model at given values as an answer that names nothing."""
    fitted = sweep.without(asked.held) if asked.held else sweep
    noise = noise_of(fitted)
    shop = Workshop(noise, asked.kinds, asked.prior, CATALOGUE, np.random.default_rng(asked.seed))
    given = Model(diagram, Convention(), shop.refitter(Convention()).at_values(diagram, values))
    found = Findings(noise, given, given, (), (), (), 1.0, 0, ())
    return answer_of(found, shop, diagram, sweep, asked.held, asked.values, ())
