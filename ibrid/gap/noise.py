"""What noise the data are judged by: the measured one, or, where nobody knows it, the least that any model deserves."""

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.measurement.noise import estimate_point
from ibrid.measurement.sweep import PointSweep, Sweep

#: Relative to |Y|_F: what data of unknown noise are taken to have at least.
LEAST_UNKNOWN = 1e-4
#: Least p value of an absolute fit that counts as adequate.
ADEQUATE = 1e-3
_WORDS = {
    "sigma": "the sigma of the data",
    "repeats": "the scatter of the repeats",
    "smoothness": "the roughness of the curves",
    "unknown": "unknown, taken as 1e-4 of |Y| at least",
}


@dataclass(frozen=True, eq=False)
class Noise:
    """`sweep` : the data with a sigma at every point. `known` : False when it is believed only because nothing fits better.
    `source` : where it comes from, in words. `level` : of a noise that is not known, the rms of its matrix over |Y|_F."""

    sweep: Sweep
    known: bool
    source: str
    level: float = LEAST_UNKNOWN

    def times(self, factor: float) -> "Noise":
        """A noise that is not known at another level, `LEAST_UNKNOWN` at least."""
        level = max(factor * self.level, LEAST_UNKNOWN)
        points = tuple(replace(one, sigma=relative_sigma(one, level)) for one in self.sweep.points)
        words = (
            _WORDS["unknown"]
            if level <= LEAST_UNKNOWN
            else f"unknown, taken as the {level:.2g} of |Y| that is left over"
        )
        return replace(self, sweep=replace(self.sweep, points=points), level=level, source=words)


def noise_of(sweep: Sweep, level: float = LEAST_UNKNOWN) -> Noise:
    """Sigma as given; else from repeats; else, from 15 points a decade, from smoothness; else `level` of |Y|_F.

    To a known sigma a floor of `MODEL_FLOOR` |Y|_F is added, for linearisation and rounding.
    """
    found = [estimate_point(point) for point in sweep.points]
    source = "unknown" if any(one.sigma is None for one in found) else found[0].source
    points = []
    for point, one in zip(sweep.points, found, strict=True):
        if source == "unknown":
            sigma = relative_sigma(point, LEAST_UNKNOWN)
        else:
            sigma = np.hypot(np.asarray(one.sigma), relative_sigma(point, MODEL_FLOOR))
        points.append(replace(point, sigma=sigma, repeats=None))
    noise = Noise(replace(sweep, points=tuple(points)), source != "unknown", _WORDS[source])
    return noise if noise.known else noise.times(level / LEAST_UNKNOWN)


def relative_sigma(point: PointSweep, level: float) -> np.ndarray:
    """Standard deviation of each real number (K, 2, 2) for an rms error of the matrix of `level` |Y|_F."""
    norm = np.linalg.norm(point.admittance, axis=(1, 2))
    return np.broadcast_to((level * norm / (2.0 * sqrt(2.0)))[:, None, None], point.admittance.shape)
