"""What a linear fit minimises and how its size is chosen: the rule of `ibrid evaluate`, for all
baselines alike.

Where the noise of every number is known, errors count in its standard deviations; where it is not,
relative to the norm of Y.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.measurement.sweeps.sweep import PointSweep


def scales(points: Sequence[PointSweep]) -> tuple[list[np.ndarray], bool]:
    """(K, 2, 2) for each point: what an error of its real or imaginary part is divided by; and
    whether that is the noise.
    """
    known = [point.sigma for point in points if point.sigma is not None]
    if len(known) == len(points):
        return known, True
    return [
        np.full(p.admittance.shape, np.sqrt((np.abs(p.admittance) ** 2).mean() / 2)) for p in points
    ], False


def stacked(values: np.ndarray) -> np.ndarray:
    """(..., K, 2, 2) complex -> (..., 8 K) real: real parts, then imaginary parts."""
    flat = values.reshape(*values.shape[:-3], -1)
    return np.concatenate([np.real(flat), np.imag(flat)], axis=-1)


def information(residual: np.ndarray, coefficients: int, known: bool) -> float:
    """Bayesian information criterion of a fit; smaller is better.

    residual : (n,) real, divided by `scales`. known : whether these are standard deviations; if
    not, the noise is estimated from the residual itself, no smaller than 1e-9 of Y. G. Schwarz,
    Annals of Statistics 6 (1978) 461.
    """
    n = len(residual)
    squares = float(residual @ residual)
    misfit = squares if known else n * np.log(squares / n + MODEL_FLOOR**2)
    return float(misfit + coefficients * np.log(n))
