"""What several injection amplitudes add to a `Gap`: the nonlinearity that explains them, or the
ports at which the dependence may lie without one.
"""

from dataclasses import dataclass, replace
from functools import cached_property

from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.amplitudes.amplitude_dataset import AmplitudeDataset
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFit
from ibrid.gap.amplitudes.port_gain import port_gain
from ibrid.gap.refitting.model import is_significant, significance_threshold
from ibrid.gap.results.gap import AmplitudeResult, Gap, NamedEffect, NonlinearityTrial, Verdict
from ibrid.gap.results.verdict import Findings

#: Verdicts that remain valid for the frequencies which do not depend on the amplitude.
REMAINING = ("named", "data-convention")
NEXT = "sweep with smaller amplitudes, and with two more between these"


@dataclass(frozen=True, eq=False)
class NonlinearityResult:
    """The search for a nonlinearity in all amplitudes together.

    Parameters
    ----------
    findings : Findings
        Its trials are nonlinearities.
    dataset : AmplitudeDataset
        The data that were searched.
    gate : AmplitudeResult
        The test of linearity, to which `amplitude_result` adds.
    """

    findings: Findings
    dataset: AmplitudeDataset
    gate: AmplitudeResult

    @property
    def fits(self) -> list[NonlinearityFit]:
        """Of every nonlinearity at every port, the best first."""
        return [trial.refit for trial in self.findings.trials]

    @property
    def best(self) -> NonlinearityFit | None:
        """The accepted one; None where none is."""
        return self.findings.best.refit if self.findings.is_repaired else None

    @cached_property
    def indistinguishable(self) -> tuple[NonlinearityFit, ...]:
        """The best fit of each other effect, or unnamed nonlinearity, that fits as well."""
        best = self.best
        if best is None:
            return ()
        given = self.findings.given
        trials = self.findings.trials
        others: dict[str, NonlinearityFit] = {}
        for trial in trials:
            fit = trial.refit
            key = fit.edit.effect or fit.edit.words
            is_other = trial is not self.findings.best and key != best.edit.effect
            if not is_other or fit.cost >= best.cost + EQUALLY_GOOD.bic:
                continue
            if self.dataset.is_stable(trial) and is_significant(given, trial, len(trials), 1.0):
                others.setdefault(key, fit)
        return tuple(others.values())

    @property
    def is_named(self) -> bool:
        """Whether the accepted nonlinearity, and all that fit as well, are in the catalogue."""
        if self.best is None:
            return False
        return all(fit.edit.effect for fit in (self.best, *self.indistinguishable))

    @cached_property
    def amplitude_result(self) -> AmplitudeResult:
        """The gate with every trial, the errors over all amplitudes, and the gain of the port."""
        best = self.best
        data = self.dataset.data
        linear = self.findings.given.refit
        trials = [
            NonlinearityTrial(
                id=fit.edit.effect,
                words=fit.edit.words,
                where=fit.edit.where,
                gain=linear.cost - fit.cost,
                chi2_per_dof=fit.chi2 / fit.dof,
                p_value=fit.p_value(),
                threshold=fit.threshold,
            )
            for fit in self.fits
        ]
        before = data.linear_nrmse(linear.responses)
        result = replace(self.gate, tried=tuple(trials), before=before, floor=data.floor)
        if best is None:
            return result
        return replace(
            result,
            words=best.edit.words,
            parameter=best.edit.nonlinearity.parameter,
            after=data.nrmse(best.point.Y),
            port_gain=port_gain(best, data),
        )

    @property
    def sentence(self) -> str:
        """Report of the nonlinearity, and of what the linear model is valid for; "" without one."""
        if self.best is None:
            return ""
        edit = self.best.edit
        parameter = edit.nonlinearity.parameter
        result = self.amplitude_result
        range_of_validity = "below the limit"
        if edit.nonlinearity.gain_rises:
            range_of_validity = "far above its width"
        return (
            f"The device has {edit.words} ({edit.effect}, {parameter} "
            f"{self.best.threshold:.4g} pu), which the "
            f"model lacks: over all amplitudes the error falls from {result.before:.2g} to "
            f"{result.after:.2g}. A linear program cannot hold it: model.py is the model for "
            f"signals {range_of_validity}."
        )

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """The effect with its threshold and evidence; () without one."""
        best = self.best
        if best is None:
            return ()
        edit = best.edit
        others = [fit for fit in self.fits if fit.edit.effect != edit.effect]
        runner_up = None
        runner_up_bic = None
        if others:
            runner_up = others[0].edit.words
            runner_up_bic = others[0].cost - best.cost
        evidence = {
            "gain": self.findings.given.refit.cost - best.cost,
            "threshold": significance_threshold(1, len(self.fits)),
            "p_after": best.p_value(),
            "runner_up": runner_up,
            "runner_up_bic": runner_up_bic,
            "tests": len(self.fits),
            "form": edit.words,
        }
        parameters = {edit.nonlinearity.parameter: (best.threshold, *best.interval)}
        names = tuple(fit.edit.effect for fit in self.indistinguishable)
        return (NamedEffect(edit.effect, "add", edit.where, parameters, evidence, names),)

    @property
    def steps(self) -> tuple[str, ...]:
        """What was decided, in order."""
        gate = self.gate.linearity
        tried = [
            f"tried {fit.edit.words}: cost {fit.cost:.4g}, p {fit.p_value():.2g}"
            for fit in self.fits[:3]
        ]
        return (
            f"compared {len(gate.amplitudes)} amplitudes at {gate.tests} numbers, noise: "
            f"{gate.noise}; left out of the "
            f"small-signal model: {len(gate.refused)} frequencies",
            f"fitted the linear model to all amplitudes: cost {self.findings.given.refit.cost:.4g}",
            *tried,
        )


def report_nonlinearity_alone(gap: Gap, result: NonlinearityResult, nominal: float | None) -> Gap:
    """Report a nonlinearity where nothing else is missing.

    Parameters
    ----------
    gap : Gap
        Of the linear model at the values that all amplitudes determine.
    nominal : float or None
        Its error over all amplitudes at nominal values.
    """
    amplitude = result.amplitude_result
    return replace(
        gap,
        verdict="named",
        sentence=f"{result.sentence} {amplitude.linearity.sentence}",
        ports=(),
        effects=result.effects,
        before={**gap.before, "nominal": nominal, "refit": amplitude.before},
        after={**gap.after, "refit": amplitude.after},
        noise_floor=amplitude.floor,
        steps=(*result.steps, *gap.steps),
        amplitude=amplitude,
    )


def report_nonlinearity_too(gap: Gap, result: NonlinearityResult) -> Gap:
    """Report a nonlinearity in addition to what was named at the other frequencies."""
    amplitude = result.amplitude_result
    return replace(
        gap,
        sentence=f"{gap.sentence} {result.sentence} {amplitude.linearity.sentence}",
        effects=(*gap.effects, *result.effects),
        steps=(*gap.steps, *result.steps),
        amplitude=amplitude,
    )


def report_no_named_nonlinearity(
    gap: Gap, result: NonlinearityResult | None, gate: AmplitudeResult
) -> Gap:
    """Report that no nonlinearity with a name explains the dependence on the amplitude.

    gap : of the frequencies that do not depend on it.
    """
    remains = gap.verdict in REMAINING
    verdict: Verdict = gap.verdict
    ports = gap.ports
    sentences = [gate.linearity.sentence]
    if result is not None and result.best is not None:
        verdict = "located-unnamed"
        sentences.append(_describe_unnamed(result.best, result.indistinguishable))
    elif not remains:
        if result is None:
            ports = ()
        else:
            ports = result.dataset.map_each_amplitude(result.findings.given.diagram)
        places = ", ".join(fit.port.words for fit in ports if fit.adequate)
        verdict = "located-unnamed" if places else "unexplained"
        sentences.append(_describe_unexplained(result, places))
    sentences.append(f"Next: {NEXT}.")
    if verdict in REMAINING:
        sentences.insert(0, gap.sentence)
    return replace(
        gap,
        verdict=verdict,
        sentence=" ".join(sentences),
        effects=gap.effects if verdict in REMAINING else (),
        ports=ports,
        steps=(*(() if result is None else result.steps), *gap.steps),
        amplitude=gate if result is None else result.amplitude_result,
    )


def _describe_unnamed(best: NonlinearityFit, others: tuple[NonlinearityFit, ...]) -> str:
    """Report nonlinearities that explain the data and are no effect of the catalogue."""
    words = " or ".join(fit.edit.words for fit in (best, *others))
    return f"{words[0].upper()}{words[1:]} explains it, which is no effect of the catalogue."


def _describe_unexplained(result: NonlinearityResult | None, places: str) -> str:
    """Report that no nonlinearity explains the data, and at which ports the dependence lies."""
    is_stopped = result is not None and result.dataset.budget.stopped
    nothing = "Neither a current limit nor a dead zone"
    if is_stopped:
        nothing = "Nothing that was tried until then"
    if places:
        return f"{nothing} explains it; it acts at {places}."
    if is_stopped:
        return f"{nothing} explains it."
    return f"{nothing} explains it, and no single place does."
