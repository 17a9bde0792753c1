"""The answer of a nonlinearity that is believed: its effect, its sentence, errors over all amplitudes and its port's gain."""

from dataclasses import replace
from typing import Any

from ibrid.gap.amplitude_result import AmplitudeAnswer, TriedNonlinearity, at_every_amplitude, nrmse_at_all
from ibrid.gap.nonlinear_data import AmplitudeData
from ibrid.gap.nonlinear_fit import NonlinearFit
from ibrid.gap.nonlinear_naming import Naming
from ibrid.gap.port_gain import port_gain
from ibrid.gap.result import NamedEffect


def believed_of(naming: Naming) -> NonlinearFit:
    """The fit that is believed; ValueError where there is none."""
    if naming.best is None:
        raise ValueError("no nonlinearity is believed")
    return naming.best


def sentence_of(naming: Naming, answer: AmplitudeAnswer) -> str:
    """What the device has, and what the model is then good for."""
    fit = believed_of(naming)
    side = "far above" if fit.place.shape.rises else "below"
    what = "its width" if fit.place.shape.rises else "the limit"
    return (
        f"The device has {fit.place.words} ({fit.place.id}, {fit.place.shape.parameter} {fit.threshold:.4g} pu), which the "
        f"model lacks: over all amplitudes the error falls from {answer.before:.2g} to "
        f"{answer.after:.2g}. A linear program cannot hold it: model.py is the model for signals {side} {what}."
    )


def effect_of(naming: Naming) -> NamedEffect:
    """The effect with its threshold and what it rests on."""
    fit = believed_of(naming)
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


def weighed(answer: AmplitudeAnswer, naming: Naming, data: AmplitudeData) -> AmplitudeAnswer:
    """The answer with every place that was tried, the errors over all amplitudes, and the gain of the best one's port."""
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
        before=nrmse_at_all(data, at_every_amplitude(naming.linear.responses, data)),
        after=None if fit is None else nrmse_at_all(data, fit.state.Y),
        floor=data.floor,
        port_gain=None if fit is None else port_gain(fit, data),
    )


def steps_of(naming: Naming, answer: AmplitudeAnswer) -> tuple[str, ...]:
    """What was decided, in order."""
    found = answer.linearity
    steps = [
        f"compared {len(found.amplitudes)} amplitudes at {found.tests} numbers, noise: {found.noise}; left out of the "
        f"small-signal model: {len(found.refused)} frequencies",
        f"fitted the linear model to all amplitudes: cost {naming.linear_cost:.4g}",
    ]
    steps += [f"tried {one.place.words}: cost {one.cost:.4g}, p {one.p_value:.2g}" for one in naming.fits[:3]]
    return tuple(steps)
