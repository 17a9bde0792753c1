"""What a fit minimises: the weight of each measured number, and whether the residual is a difference or a logarithm."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweep import PointSweep

#: `nrmse` is the paper's; `log` finds the right minimum most often; `sigma` is whitened by the measured noise;
#: `relative` weighs frequencies equally, `band` weighs bands and entries equally; `chi2` is `sigma` times the number of
#: measured numbers.
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
    """What a fit minimises when nothing is asked for: sigma where the noise of every point is known, else the paper's nrmse.

    Weighing by the noise is the maximum likelihood; the NRMSE is ruled by the few largest numbers.
    """
    return "sigma" if all(point.sigma is not None for point in points) else "nrmse"


def band_index(frequency: np.ndarray) -> np.ndarray:
    """Number of the band of each frequency (Hz)."""
    return np.searchsorted(BAND_EDGES, frequency, side="right")


def residual(point: PointSweep, objective: str) -> Residual:
    """Weights at one operating point, such that the sum of |r|^2 is a squared relative error.

    Raises SweepError when the measurement is zero, or when `sigma` is asked for and not known.
    """
    magnitude = np.abs(point.admittance)
    per_frequency = np.sqrt((magnitude**2).sum(axis=(1, 2)))
    if not per_frequency.all():
        hertz = point.frequency[np.argmin(per_frequency)]
        raise SweepError(f"the admittance of {point.op.name} is zero at {hertz:g} Hz; leave that frequency out")
    ones = np.ones_like(magnitude)
    count = len(point.frequency)
    if objective == "nrmse":
        return Residual(ones / np.sqrt((magnitude**2).sum()))
    if objective == "relative":
        return Residual(ones / per_frequency[:, None, None] / np.sqrt(count))
    if objective == "log":
        return Residual(magnitude / per_frequency[:, None, None] / np.sqrt(count), logarithmic=True)
    if objective in ("sigma", "chi2"):
        if point.sigma is None:
            raise SweepError(
                f"the noise of {point.op.name} is not known; give sigma or repeats, or choose another objective"
            )
        return Residual(1.0 / point.sigma / (np.sqrt(magnitude.size * 2) if objective == "sigma" else 1.0))
    if objective == "band":
        weight = np.zeros_like(magnitude)
        bands = band_index(point.frequency)
        for band in np.unique(bands):
            norm = np.sqrt((magnitude[bands == band] ** 2).sum(axis=0))
            weight[bands == band] = 1.0 / np.where(norm > 0, norm, np.inf)
        return Residual(weight / np.sqrt(4 * len(np.unique(bands))))
    raise SweepError(f"no objective is called {objective!r}; known are {', '.join(OBJECTIVES)}")
