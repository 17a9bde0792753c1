"""What noise the data are judged by: the measured one, or, where nobody knows it, the least that
any model deserves.
"""

from dataclasses import dataclass, replace

import numpy as np

from ibrid.evaluation.errors_by_part import noise_floor
from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.measurement.sweeps.noise import LEAST_TOLD, estimate_point, of_norm
from ibrid.measurement.sweeps.sweep import Sweep

#: Relative to |Y|_F: what data of unknown noise are taken to have at least.
LEAST_UNKNOWN = LEAST_TOLD
_WORDS = {
    "sigma": "the sigma of the data",
    "repeats": "the scatter of the repeats",
    "smoothness": "the roughness of the curves",
    "vector-fit": "what vector fits leave over",
    "unknown": "unknown, taken as 1e-4 of |Y| at least",
}


@dataclass(frozen=True, eq=False)
class Noise:
    """`sweep` : the data with a sigma at every point. `known` : False when it is believed only
    because nothing fits better.
    `source` : where it comes from, in words. `level` : of a noise that is not known, the rms of its
    matrix over |Y|_F.
    `measured` : the known noise, where every model leaves more than that and the data are weighed
    by what they leave.
    """

    sweep: Sweep
    known: bool
    source: str
    level: float = LEAST_UNKNOWN
    measured: "Noise | None" = None

    @property
    def floor(self) -> float | None:
        """NRMSE that the measured noise of a sweep alone leaves; None where it is not known."""
        noise = self.measured or self
        return noise_floor(noise.sweep.points) if noise.known else None

    def with_model_error(self, level: float) -> "Noise":
        """What the data are weighed by where every model leaves this part of |Y|, and so misses
        more than noise: as it is alike at all frequencies, where those of little noise would else
        rule the fit.
        """
        return replace(self, known=False, level=level, measured=self).scaled(1.0)

    def scaled(self, factor: float) -> "Noise":
        """A noise that is not known at another level, `LEAST_UNKNOWN` at least."""
        level = max(factor * self.level, LEAST_UNKNOWN)
        points = tuple(replace(one, sigma=of_norm(one, level)) for one in self.sweep.points)
        words = f"unknown, taken as the {level:.2g} of |Y| that is left over"
        if self.measured is not None:
            words = (
                f"{self.measured.source}; weighed by the {level:.2g} of |Y| that models leave over"
            )
        elif level <= LEAST_UNKNOWN:
            words = _WORDS["unknown"]
        return replace(self, sweep=replace(self.sweep, points=points), level=level, source=words)


def estimate_noise(sweep: Sweep, level: float = LEAST_UNKNOWN) -> Noise:
    """Sigma as given; else from repeats; else, from 15 points a decade, from smoothness; else from
    vector fits; else `level` of |Y|_F.

    To a known sigma a floor of `MODEL_FLOOR` |Y|_F is added, for linearisation and rounding.
    """
    estimates = [estimate_point(point) for point in sweep.points]
    source = "unknown" if any(one.sigma is None for one in estimates) else estimates[0].source
    points = []
    for point, estimate in zip(sweep.points, estimates, strict=True):
        if source == "unknown":
            sigma = of_norm(point, LEAST_UNKNOWN)
        else:
            sigma = np.hypot(np.asarray(estimate.sigma), of_norm(point, MODEL_FLOOR))
        points.append(replace(point, sigma=sigma, repeats=None))
    noise = Noise(replace(sweep, points=tuple(points)), source != "unknown", _WORDS[source])
    return noise if noise.known else noise.scaled(level / LEAST_UNKNOWN)
