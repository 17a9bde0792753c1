"""A model under repair, and how it is judged.

A diagram, how the data are read, and what its fit to any kind of data ends in; whether it fits as
well as the noise allows, and whether an edit of it pays.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log
from typing import Generic, TypeGuard, TypeVar

import numpy as np
from scipy.special import chdtri

from ibrid.evaluation.adequacy import NEARLY_ALL, is_adequate, p_value, share_explained
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
        """Probability of so large a misfit by noise alone, its standard deviation `scale` times
        what was stated.
        """
        return p_value(self.chi2 / scale**2, self.dof, self.noise_dof)

    def is_adequate(self, scale: float = 1.0) -> bool:
        """True when it fits as well as the noise allows, or too nearly so to matter."""
        return is_adequate(self.chi2 / scale**2, self.dof, self.noise_dof)


Fit = TypeVar("Fit", bound=FitResult)


def is_delay_form(edit: Insertion | Convention) -> TypeGuard[Insertion]:
    """True for an edit that says in which form the device has something, which is no effect."""
    return isinstance(edit, Insertion) and edit.form


@dataclass(frozen=True, eq=False)
class Model(Generic[Fit]):
    """A diagram, how the data are read, and its best refit.

    `edits` : what led to it, in order. `extra` : free numbers of the convention.
    """

    diagram: Diagram
    convention: Convention
    refit: Fit
    edits: tuple[Insertion | Convention, ...] = ()
    extra: int = 0

    @property
    def parameter_count(self) -> int:
        """Free numbers, those of the convention included."""
        return self.refit.parameter_count + self.extra

    @property
    def effect_count(self) -> int:
        """Number of edits, but for the form in which the device has its delays."""
        return sum(not is_delay_form(edit) for edit in self.edits)

    def bic(self, scale: float = 1.0) -> float:
        """chi2 and prior, with ln(n) for every free number; `scale` : of the noise.

        Rounded, so that exact twins, such as p and q on another scale and another base, stay in the
        order in which they were tried, on every machine.
        """
        return round(self.cost(scale) + self.parameter_count * log(self.refit.measurement_count), 6)

    def cost(self, scale: float = 1.0) -> float:
        """chi2 and prior."""
        return self.refit.chi2 / scale**2 + self.refit.penalty

    def is_adequate(self, scale: float = 1.0) -> bool:
        """True when it fits as well as the noise allows."""
        return self.refit.is_adequate(scale)


def rank_by_bic(models: Iterable[Model], scale: float) -> list[Model]:
    """Models by the information criterion; those that are alike in it stay as they come."""
    return sorted(models, key=lambda one: one.bic(scale))


# --- does it fit as well as the noise allows?
# ----------------------------------------------------------------------------------------------


def estimate_noise_scale(
    noise: Noise, models: Sequence[Model], others: Iterable[float] = ()
) -> float:
    """Factor on the standard deviation of the noise: 1 where it is known; else from the best fit
    found, so large at least that the noise is not below `LEAST_UNKNOWN`. others : chi2 per degree
    of freedom of what else was fitted, such as ports.

    The best of many fits is better by chance: the first model counts that misses the least chi2 per
    degree of freedom by no more than `SELECTION_MARGIN` of its standard deviations, sqrt(2 / dof).
    """
    if noise.known:
        return 1.0
    per_dof = [one.refit.chi2 / one.refit.dof for one in models]
    least = min([*per_dof, *others], default=1.0)
    pairs = zip(models, per_dof, strict=True)
    as_good = (
        value
        for one, value in pairs
        if value <= least * (1.0 + SELECTION_MARGIN * np.sqrt(2.0 / one.refit.dof))
    )
    return max(float(np.sqrt(next(as_good, least))), LEAST_UNKNOWN / noise.level)


def has_white_residual(model: Model) -> bool:
    """True when what a model leaves over has no more structure than noise."""
    return bool(abs(whiteness_score(model.refit.residuals)) < WHITENESS_LIMIT)


def explains_data(model: Model, noise: Noise, scale: float) -> bool:
    """True when a model fits as well as the noise allows; with a noise that was estimated from
    fits, only where what is left over is white as well.
    """
    if not model.is_adequate(scale):
        return False
    least = scale * noise.level <= LEAST_UNKNOWN
    return noise.known or least or has_white_residual(model)


def whiteness_score(residuals: Iterable[np.ndarray]) -> float:
    """How much neighbouring residuals, (K, 2, 2) each, resemble each other, in standard deviations:
    beyond 4 it is no noise.

    Law: r = Re sum conj(e_k) e_k+1 / sum |e|^2 over all entries and points; r sqrt(2 n) is standard
    normal for white noise.
    """
    top = bottom = count = 0.0
    for residual in residuals:
        top += float(np.real(np.conj(residual[:-1]) * residual[1:]).sum())
        bottom += float((np.abs(residual) ** 2).sum())
        count += residual[1:].size
    return top / bottom * np.sqrt(2.0 * count) if bottom > 0 else 0.0


# --- does an edit pay?
# ----------------------------------------------------------------------------------------------


def significance_threshold(extra: int, tests: int) -> float:
    """Gain of chi2 that so many further free numbers must bring in one of so many tests."""
    return float(chdtri(max(extra, 1), FALSE_ALARM_RATE / max(tests, 1)))


def removes_implausible_parameter(before: Model, after: Model) -> bool:
    """True when a number that an edit takes away was driven beyond `FAR` of its tolerance."""
    kept = {one.name for one in after.refit.problem.numbers}
    return any(abs(sigmas) > FAR for name, sigmas in before.refit.moved.items() if name not in kept)


def is_significant(before: Model, after: Model, tests: int, scale: float) -> bool:
    """True when an edit pays: the likelihood ratio for added numbers, the information criterion
    where none is added.
    """
    extra = after.parameter_count - before.parameter_count
    gain = before.cost(scale) - after.cost(scale)
    if np.isfinite(
        after.refit.noise_dof
    ):  # what is left may be noise that is larger than it was told to be
        gain /= max(after.refit.chi2 / scale**2 / after.refit.dof, 1.0)
    if extra > 0:
        return gain > significance_threshold(extra, tests)
    if extra < 0 and removes_implausible_parameter(before, after):
        return gain > CHI2_95_PERCENT
    return gain > significance_threshold(1, tests) + extra * log(after.refit.measurement_count)


def explains_nearly_all(before: Model, after: Model, scale: float = 1.0) -> bool:
    """True when an edit takes nearly all of the squared misfit away, whatever else is left."""
    chi2, left = (one.refit.chi2 / scale**2 for one in (before, after))
    return share_explained(chi2, left, after.refit.dof) >= NEARLY_ALL
