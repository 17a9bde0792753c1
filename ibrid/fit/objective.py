"""What a fit minimises: the weight of each measured number, and whether the residual is a
difference or a logarithm.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweeps.sweep import PointSweep, measured_numbers

#: `nrmse` is the paper's; `log` finds the right minimum most often; `sigma` is whitened by the
#: measured noise; `relative` weighs frequencies equally, `band` weighs bands and entries equally;
#: `chi2` is `sigma` times the number of measured numbers.
FINAL_OBJECTIVES = ("nrmse", "relative", "band", "sigma")
OBJECTIVES = (*FINAL_OBJECTIVES, "log", "chi2")

#: Edges of the bands of the paper in Hz; the first and the last band are open-ended.
BAND_EDGES = (50.0, 500.0, 2000.0)
BAND_NAMES = ("5-50", "50-500", "500-2000", "2000-5000")


@dataclass(frozen=True)
class Residual:
    """r = weight (Y - data), or weight log(Y / data) when `logarithmic`; weight : (K, 2, 2)."""

    weight: np.ndarray
    logarithmic: bool = False


def objective_for(points: Iterable[PointSweep]) -> str:
    """What a fit minimises when nothing is asked for: sigma where the noise of every point is
    known, else the paper's nrmse.

    Weighing by the noise is the maximum likelihood; the NRMSE is ruled by the few largest numbers.
    """
    return "sigma" if all(point.sigma is not None for point in points) else "nrmse"


def band_index(frequency: np.ndarray) -> np.ndarray:
    """Number of the band of each frequency (Hz)."""
    return np.searchsorted(BAND_EDGES, frequency, side="right")


def mean_error(costs: np.ndarray, objective: str) -> np.ndarray:
    """Error (S,) of starts with squared errors (S, M) at operating points: the mean of their roots,
    as scores are; under `sigma` the root of their mean, which orders by likelihood.
    """
    return np.sqrt(costs.mean(axis=1)) if objective == "sigma" else np.sqrt(costs).mean(axis=1)


def residuals(points: Sequence[PointSweep], objective: str) -> list[Residual]:
    """Weights at each operating point, such that the sum of |r|^2 there is a squared relative
    error.

    Under `sigma` the sum over all of them is chi2 * points / numbers: a number weighs by its noise
    alone, however many others there are at its operating point.

    Raises SweepError when a measurement is zero, or when `sigma` is asked for and not known.
    """
    if objective != "sigma":
        return [_residual(point, objective) for point in points]
    mean = np.sqrt(measured_numbers(points) / len(points))
    return [Residual(_residual(point, "chi2").weight / mean) for point in points]


def _residual(point: PointSweep, objective: str) -> Residual:
    magnitude = np.abs(point.admittance)
    per_frequency = np.sqrt((magnitude**2).sum(axis=(1, 2)))
    if not per_frequency.all():
        hertz = point.frequency[np.argmin(per_frequency)]
        raise SweepError(
            f"the admittance of {point.op.name} is zero at {hertz:g} Hz; leave that frequency out"
        )
    ones = np.ones_like(magnitude)
    count = len(point.frequency)
    if objective == "nrmse":
        return Residual(ones / np.sqrt((magnitude**2).sum()))
    if objective == "relative":
        return Residual(ones / per_frequency[:, None, None] / np.sqrt(count))
    if objective == "log":
        return Residual(magnitude / per_frequency[:, None, None] / np.sqrt(count), logarithmic=True)
    if objective == "chi2":
        if point.sigma is None:
            raise SweepError(
                f"the noise of {point.op.name} is not known; give sigma or repeats, or choose "
                "another objective"
            )
        return Residual(1.0 / point.sigma)
    if objective == "band":
        weight = np.zeros_like(magnitude)
        bands = band_index(point.frequency)
        for band in np.unique(bands):
            norm = np.sqrt((magnitude[bands == band] ** 2).sum(axis=0))
            weight[bands == band] = 1.0 / np.where(norm > 0, norm, np.inf)
        return Residual(weight / np.sqrt(4 * len(np.unique(bands))))
    raise SweepError(f"no objective is called {objective!r}; known are {', '.join(OBJECTIVES)}")
