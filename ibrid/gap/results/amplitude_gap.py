"""What several amplitudes add to an answer: the nonlinearity that is believed, or where the
dependence sits without one.
"""

from dataclasses import dataclass, replace
from functools import cached_property

from ibrid.evaluation.adequacy import EQUALLY_GOOD
from ibrid.gap.amplitudes.amplitude_dataset import AmplitudeDataset
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFit
from ibrid.gap.amplitudes.port_gain import port_gain
from ibrid.gap.refitting.model import is_significant, significance_threshold
from ibrid.gap.results.gap import AmplitudeDependence, Gap, NamedEffect, NonlinearityTrial, Verdict
from ibrid.gap.results.verdict import Findings

#: Verdicts that a band which no amplitude touches may still have.
STANDING = ("named", "data-convention")
NEXT = "sweep with smaller amplitudes, and with two more between these"


@dataclass(frozen=True, eq=False)
class Nonlinear:
    """What was found in all amplitudes. `answer` : with the gate, to which this is added."""

    found: Findings
    data: AmplitudeDataset
    gate: AmplitudeDependence

    @property
    def fits(self) -> list[NonlinearityFit]:
        """Of every place, the best first."""
        return [one.refit for one in self.found.trials]

    @property
    def best(self) -> NonlinearityFit | None:
        """The one that is believed."""
        return self.found.best.refit if self.found.is_repaired else None

    @cached_property
    def alike(self) -> tuple[NonlinearityFit, ...]:
        """The best other of each effect or nameless place that these data cannot tell from the
        best.
        """
        others: dict[str, NonlinearityFit] = {}
        given, best, trials = self.found.given, self.found.best, self.found.trials
        for trial in trials if self.found.is_repaired else ():
            place, near = trial.refit.place, trial.refit.cost < best.refit.cost + EQUALLY_GOOD.bic
            key = place.effect or place.words
            believed = self.data.is_stable(trial) and is_significant(given, trial, len(trials), 1.0)
            if trial is not best and key != best.refit.place.effect and near and believed:
                others.setdefault(key, trial.refit)
        return tuple(others.values())

    @property
    def named(self) -> bool:
        """True when what is believed is an effect with a name, and so is all that cannot be told
        from it.
        """
        return self.best is not None and all(one.place.effect for one in (self.best, *self.alike))

    @cached_property
    def answer(self) -> AmplitudeDependence:
        """With every place that was tried, the errors over all amplitudes, and the gain of the best
        one's port.
        """
        fit, data, linear = self.best, self.data.data, self.found.given.refit
        tried = tuple(
            NonlinearityTrial(
                one.place.effect,
                one.place.words,
                one.place.where,
                linear.cost - one.cost,
                one.chi2 / one.dof,
                one.p_value(),
                one.threshold,
            )
            for one in self.fits
        )
        answer = replace(
            self.gate, tried=tried, before=data.linear_nrmse(linear.responses), floor=data.floor
        )
        if fit is None:
            return answer
        return replace(
            answer,
            words=fit.place.words,
            parameter=fit.place.shape.parameter,
            after=data.nrmse(fit.state.Y),
            port_gain=port_gain(fit, data),
        )

    @property
    def sentence(self) -> str:
        """What the device has, and what the model is then good for; "" where nothing is
        believed.
        """
        if self.best is None:
            return ""
        place, answer = self.best.place, self.answer
        side, what = ("far above", "its width") if place.shape.rises else ("below", "the limit")
        return (
            f"The device has {place.words} ({place.effect}, {place.shape.parameter} "
            f"{self.best.threshold:.4g} pu), which the "
            f"model lacks: over all amplitudes the error falls from {answer.before:.2g} to "
            f"{answer.after:.2g}. A linear program cannot hold it: model.py is the model for "
            f"signals {side} {what}."
        )

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """The effect with its threshold and what it rests on; () where nothing is believed."""
        fit = self.best
        if fit is None:
            return ()
        other = next((one for one in self.fits if one.place.effect != fit.place.effect), None)
        evidence = {
            "gain": self.found.given.refit.cost - fit.cost,
            "threshold": significance_threshold(1, len(self.fits)),
            "p_after": fit.p_value(),
            "runner_up": None if other is None else other.place.words,
            "runner_up_bic": None if other is None else other.cost - fit.cost,
            "tests": len(self.fits),
            "form": fit.place.words,
        }
        parameters = {fit.place.shape.parameter: (fit.threshold, *fit.interval)}
        alike = tuple(one.place.effect for one in self.alike)
        return (NamedEffect(fit.place.effect, "add", fit.place.where, parameters, evidence, alike),)

    @property
    def steps(self) -> tuple[str, ...]:
        """What was decided, in order."""
        gate = self.gate.linearity
        return (
            f"compared {len(gate.amplitudes)} amplitudes at {gate.tests} numbers, noise: "
            f"{gate.noise}; left out of the "
            f"small-signal model: {len(gate.refused)} frequencies",
            f"fitted the linear model to all amplitudes: cost {self.found.given.refit.cost:.4g}",
            *(
                f"tried {one.place.words}: cost {one.cost:.4g}, p {one.p_value():.2g}"
                for one in self.fits[:3]
            ),
        )


def alone(gap: Gap, nonlinear: Nonlinear, nominal: float | None) -> Gap:
    """A nonlinearity alone; gap : of the linear model at the values that all amplitudes tell.
    nominal : its error over all amplitudes at nominal values.
    """
    answer = nonlinear.answer
    return replace(
        gap,
        verdict="named",
        sentence=f"{nonlinear.sentence} {answer.linearity.sentence}",
        ports=(),
        effects=nonlinear.effects,
        before={**gap.before, "nominal": nominal, "refit": answer.before},
        after={**gap.after, "refit": answer.after},
        noise_floor=answer.floor,
        steps=(*nonlinear.steps, *gap.steps),
        amplitude=answer,
    )


def beside(gap: Gap, nonlinear: Nonlinear) -> Gap:
    """A nonlinearity beside what was named at the other frequencies."""
    return replace(
        gap,
        sentence=f"{gap.sentence} {nonlinear.sentence} {nonlinear.answer.linearity.sentence}",
        effects=(*gap.effects, *nonlinear.effects),
        steps=(*gap.steps, *nonlinear.steps),
        amplitude=nonlinear.answer,
    )


def unnamed(gap: Gap, nonlinear: Nonlinear | None, gate: AmplitudeDependence) -> Gap:
    """No nonlinearity with a name: what the other frequencies say, and where the dependence
    sits.
    """
    verdict: Verdict = gap.verdict
    words, ports, standing = [gate.linearity.sentence], gap.ports, gap.verdict in STANDING
    if nonlinear is not None and nonlinear.best is not None:
        verdict = "located-unnamed"
        what = " or ".join(one.place.words for one in (nonlinear.best, *nonlinear.alike))
        words += [f"{what[0].upper()}{what[1:]} explains it, which is no effect of the catalogue."]
    elif not standing:
        ports = (
            ()
            if nonlinear is None
            else nonlinear.data.at_each_amplitude(nonlinear.found.given.diagram)
        )
        where = ", ".join(one.port.words for one in ports if one.adequate)
        verdict = "located-unnamed" if where else "unexplained"
        acts = f"it acts at {where}" if where else "and no single place does"
        stopped = nonlinear is not None and nonlinear.data.budget.stopped
        none = (
            "Nothing that was tried until then"
            if stopped
            else "Neither a current limit nor a dead zone"
        )
        words += [f"{none} explains it{f'; {acts}' if where else '' if stopped else f', {acts}'}."]
    words += [f"Next: {NEXT}."]
    return replace(
        gap,
        verdict=verdict,
        sentence=" ".join(words if verdict not in STANDING else [gap.sentence, *words]),
        effects=gap.effects if verdict in STANDING else (),
        ports=ports,
        steps=(*(() if nonlinear is None else nonlinear.steps), *gap.steps),
        amplitude=gate if nonlinear is None else nonlinear.answer,
    )
