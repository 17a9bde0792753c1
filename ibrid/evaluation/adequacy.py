"""When a model is adequate: one rule for sweeps, recordings and changes of a device.

With residuals r of deviation sigma, chi2 = sum (r / sigma)^2 has the expectation dof when noise alone is left. Of ten thousand
numbers everything is significant, so that significance is asked first, and then the size: what is left beside the noise, of its
variance.
"""

from math import inf, isfinite

from scipy.special import chdtrc, fdtrc

#: Least probability of so large a chi2 by noise alone.
LEAST_P = 1e-3
#: What may be left beside the noise, of its variance: the error that a user sees is then 5 % larger than noise makes it.
NEGLIGIBLE = 0.1
#: Part of the squared misfit from which on an effect that takes it away is named, whatever else is left.
NEARLY_ALL = 0.999


def p_value(chi2: float, dof: float, told_by: float = inf) -> float:
    """Probability of so large a chi2 by noise alone; told_by : degrees of freedom of the estimate of the noise."""
    if isfinite(told_by):
        return float(fdtrc(dof, told_by, chi2 / dof))
    return float(chdtrc(dof, chi2))


def is_adequate(chi2: float, dof: float, told_by: float = inf) -> bool:
    """True where what is left is noise, or too little beside it to matter."""
    return p_value(chi2, dof, told_by) > LEAST_P or chi2 <= (1.0 + NEGLIGIBLE) * dof


def share_explained(before: float, after: float, dof: float) -> float:
    """Part of the squared misfit beyond noise that a change of the model takes away: chi2 `before` and `after` it."""
    beyond = max(before - dof, 0.0)
    return (before - max(after, dof)) / beyond if beyond else 0.0
