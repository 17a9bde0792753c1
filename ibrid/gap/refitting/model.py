"""A fitted model with its edits, and the statistical tests that judge it.

Whether it fits as well as the noise allows (chi2 test and whiteness of the residual), and whether
an edit is significant (likelihood ratio and information criterion).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log
from typing import Generic, TypeGuard, TypeVar

import numpy as np
from scipy.special import chdtri

from ibrid.fit.adequacy import NEARLY_ALL, is_adequate, p_value, share_explained
from ibrid.gap.refitting.noise import LEAST_UNKNOWN, Noise
from ibrid.gap.refitting.prior import FAR
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

Values = Mapping[str, float]

#: Standard deviations beyond which neighbouring residuals resemble each other more than noise does.
WHITENESS_LIMIT = 4.0
#: Standard deviations of chi2 by which the best of all fits may be better than a right one.
SELECTION_MARGIN = 2.0
#: Probability of one false alarm in a whole catalogue of tests.
FALSE_ALARM_RATE = 1e-3
#: Gain of chi2, one degree of freedom, that noise reaches once in twenty.
CHI2_95_PERCENT = 3.84


@dataclass(frozen=True, eq=False)
class FitResult:
    """A model at its best parameters.

    Parameters
    ----------
    values : mapping
        Free parameter -> its value.
    chi2, penalty : float
        Of the data alone, and of the prior.
    dof : float
        Degrees of freedom of chi2.
    measurement_count, parameter_count : int
        Measured real numbers, and fitted parameters.
    """

    values: Values
    chi2: float
    penalty: float
    dof: float
    measurement_count: int
    parameter_count: int

    @property
    def cost(self) -> float:
        """chi2 and prior together."""
        return self.chi2 + self.penalty

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom of the estimate of the noise; infinite where it is known."""
        return inf

    def p_value(self, scale: float = 1.0) -> float:
        """Return the probability of a larger chi2 by noise alone.

        scale : factor on the standard deviation of the noise.
        """
        return p_value(self.chi2 / scale**2, self.dof, self.noise_dof)

    def is_adequate(self, scale: float = 1.0) -> bool:
        """Whether it fits as well as the noise allows, or so nearly that it does not matter."""
        return is_adequate(self.chi2 / scale**2, self.dof, self.noise_dof)


Fit = TypeVar("Fit", bound=FitResult)


def is_delay_form(edit: Insertion | Convention) -> TypeGuard[Insertion]:
    """Whether an edit only changes the form of what is there, such as Pade for a delay."""
    return isinstance(edit, Insertion) and edit.form


@dataclass(frozen=True, eq=False)
class Model(Generic[Fit]):
    """A diagram, the convention in which the data are read, and its best fit.

    Parameters
    ----------
    refit : FitResult
        Of the diagram.
    edits : tuple of Insertion or Convention
        What led to it from the given model, in order.
    extra : int
        Free parameters of the convention.
    """

    diagram: Diagram
    convention: Convention
    refit: Fit
    edits: tuple[Insertion | Convention, ...] = ()
    extra: int = 0

    @property
    def parameter_count(self) -> int:
        """Free parameters, those of the convention included."""
        return self.refit.parameter_count + self.extra

    @property
    def effect_count(self) -> int:
        """Number of edits, without forms of delays."""
        return sum(not is_delay_form(edit) for edit in self.edits)

    def bic(self, scale: float = 1.0) -> float:
        """Return the Bayesian information criterion: cost + ln(n) for every free parameter.

        Rounded, so that equivalent models, such as p and q on another scale and another base, stay
        in the order in which they were tried, on every machine.

        scale : factor on the standard deviation of the noise.
        """
        return round(self.cost(scale) + self.parameter_count * log(self.refit.measurement_count), 6)

    def cost(self, scale: float = 1.0) -> float:
        """Return chi2 plus prior penalty, with the noise scaled."""
        return self.refit.chi2 / scale**2 + self.refit.penalty

    def is_adequate(self, scale: float = 1.0) -> bool:
        """Whether it fits as well as the noise allows."""
        return self.refit.is_adequate(scale)


def rank_by_bic(models: Iterable[Model], scale: float) -> list[Model]:
    """Rank models by the information criterion, lowest first; equal ones stay in their order."""
    return sorted(models, key=lambda model: model.bic(scale))


# --- adequacy
# ----------------------------------------------------------------------------------------------


def estimate_noise_scale(
    noise: Noise, models: Sequence[Model], others: Iterable[float] = ()
) -> float:
    """Estimate the factor on the standard deviation of the noise from the best fit.

    1 where the noise is known. The best of many fits is better by chance: the first model counts
    whose chi2 per degree of freedom is within `SELECTION_MARGIN` standard deviations of the least,
    sqrt(2 / dof) each. The noise is not estimated below `LEAST_UNKNOWN`.

    others : chi2 per degree of freedom of other fits, such as ports.
    """
    if noise.known:
        return 1.0
    per_dof = [model.refit.chi2 / model.refit.dof for model in models]
    least = min([*per_dof, *others], default=1.0)
    estimate = least
    for model, value in zip(models, per_dof, strict=True):
        if value <= least * (1.0 + SELECTION_MARGIN * np.sqrt(2.0 / model.refit.dof)):
            estimate = value
            break
    return max(float(np.sqrt(estimate)), LEAST_UNKNOWN / noise.level)


def has_white_residual(model: Model) -> bool:
    """Whether the residual of a model is white."""
    return bool(abs(whiteness_score(model.refit.residuals)) < WHITENESS_LIMIT)


def explains_data(model: Model, noise: Noise, scale: float) -> bool:
    """Whether a model fits as well as the noise allows.

    With a noise that was estimated from fits, the residual must be white, too.
    """
    if not model.is_adequate(scale):
        return False
    least = scale * noise.level <= LEAST_UNKNOWN
    return noise.known or least or has_white_residual(model)


def whiteness_score(residuals: Iterable[np.ndarray]) -> float:
    """Return the correlation of neighbouring residuals (K, 2, 2), in standard deviations.

    Law: r = Re sum conj(e_k) e_k+1 / sum |e|^2 over all entries and points; r sqrt(2 n) is standard
    normal for white noise.
    """
    top = bottom = count = 0.0
    for residual in residuals:
        top += float(np.real(np.conj(residual[:-1]) * residual[1:]).sum())
        bottom += float((np.abs(residual) ** 2).sum())
        count += residual[1:].size
    return top / bottom * np.sqrt(2.0 * count) if bottom > 0 else 0.0


# --- significance
# ----------------------------------------------------------------------------------------------


def significance_threshold(extra: int, tests: int) -> float:
    """Return the gain of chi2 that `extra` free parameters must bring in one of so many tests."""
    return float(chdtri(max(extra, 1), FALSE_ALARM_RATE / max(tests, 1)))


def removes_implausible_parameter(before: Model, after: Model) -> bool:
    """Whether a parameter that an edit removes was beyond `FAR` tolerances from nominal."""
    kept = {number.name for number in after.refit.problem.numbers}
    return any(abs(sigmas) > FAR for name, sigmas in before.refit.moved.items() if name not in kept)


def is_significant(before: Model, after: Model, tests: int, scale: float) -> bool:
    """Whether an edit is significant, as one of so many tests.

    By the likelihood ratio where it adds parameters, else by the information criterion.
    """
    extra = after.parameter_count - before.parameter_count
    gain = before.cost(scale) - after.cost(scale)
    if np.isfinite(after.refit.noise_dof):  # the residual may be noise larger than estimated
        gain /= max(after.refit.chi2 / scale**2 / after.refit.dof, 1.0)
    if extra > 0:
        return gain > significance_threshold(extra, tests)
    if extra < 0 and removes_implausible_parameter(before, after):
        return gain > CHI2_95_PERCENT
    return gain > significance_threshold(1, tests) + extra * log(after.refit.measurement_count)


def explains_nearly_all(before: Model, after: Model, scale: float = 1.0) -> bool:
    """Whether an edit removes nearly all of the squared misfit, whatever else is left."""
    chi2_before = before.refit.chi2 / scale**2
    chi2_after = after.refit.chi2 / scale**2
    return share_explained(chi2_before, chi2_after, after.refit.dof) >= NEARLY_ALL
