"""When a model is adequate, when two are equally good, and when one is better: for sweeps,
recordings and changes of a device.

With residuals r of deviation sigma, chi2 = sum (r / sigma)^2 has the expectation dof when noise
alone is left. Of ten thousand numbers everything is significant, so that significance is asked
first, and then the size: what is left beside the noise, of its variance.
"""

from dataclasses import dataclass
from math import inf, isfinite

from scipy.special import chdtrc, fdtrc

#: Least probability of so large a chi2 by noise alone.
LEAST_P = 1e-3
#: What may be left beside the noise, of its variance: the error that a user sees is then 5 % larger
#: than noise makes it.
NEGLIGIBLE = 0.1
#: Part of the squared misfit from which on an effect that takes it away is named, whatever else is
#: left.
NEARLY_ALL = 0.999


@dataclass(frozen=True)
class EquallyGood:
    """How far apart two fits to the same data may be so that neither counts as the better one.

    Which limit holds follows from what is compared. The first three are of a noise that is known,
    and say nearly the same: 2 ln(20) = 5.99, which chi2 of two numbers exceeds by noise alone once
    in twenty.

    `chi2` : difference of chi2 (with its prior) of models with as many free numbers.
    `odds` : of structures with different numbers of them, the odds by the Bayesian information
    criterion, exp(difference / 2).
    `bic` : difference of that criterion where an answer of a gap excludes others; beyond 10 the
    evidence is very strong (Kass & Raftery, J. Am. Stat. Assoc. 90, 1995).
    `chi2_ratio` : ratio of chi2 of the same diagram on data that are read in two ways.
    `error_ratio` : ratio of errors where the noise is not known: its square is 1.04, near
    `chi2_ratio`.
    """

    chi2: float = 6.0
    odds: float = 20.0
    bic: float = 10.0
    chi2_ratio: float = 1.05
    error_ratio: float = 1.02


@dataclass(frozen=True)
class Better:
    """How far an error must fall to be worth something, as a part of the one before.

    `tie` : part of the error by which the best of a run must fall to be a new best.
    `promising` : that of a quick fit, to be fitted thoroughly; 1 % is the rounding of an unfinished
    descent.
    `stuck` : factor on that part for a structure with more free numbers than its parent: a quick
    fit of the right edit often stops in the parent's minimum.
    """

    tie: float = 1e-3
    promising: float = 0.99
    stuck: float = 1.02


EQUALLY_GOOD, BETTER = EquallyGood(), Better()


def p_value(chi2: float, dof: float, told_by: float = inf) -> float:
    """Probability of so large a chi2 by noise alone; told_by : degrees of freedom of the estimate
    of the noise.
    """
    if isfinite(told_by):
        return float(fdtrc(dof, told_by, chi2 / dof))
    return float(chdtrc(dof, chi2))


def is_adequate(chi2: float, dof: float, told_by: float = inf) -> bool:
    """True where what is left is noise, or too little beside it to matter."""
    return p_value(chi2, dof, told_by) > LEAST_P or chi2 <= (1.0 + NEGLIGIBLE) * dof


def share_explained(before: float, after: float, dof: float) -> float:
    """Part of the squared misfit beyond noise that a change of the model takes away: chi2 `before`
    and `after` it.
    """
    beyond = max(before - dof, 0.0)
    return (before - max(after, dof)) / beyond if beyond else 0.0
