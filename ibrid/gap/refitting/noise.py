"""The noise by which a sweep is weighted: the measured one, or an assumed one."""

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
    """The noise of a sweep.

    Parameters
    ----------
    sweep : Sweep
        The data, with a sigma at every point.
    known : bool
        False where it is assumed, or estimated from the residual of models.
    source : str
        Where it comes from, in words.
    level : float
        Of an unknown noise, the rms of its matrix over |Y|_F.
    measured : Noise or None
        The known noise, where every model leaves more than that and the data are weighted by the
        residual of models.
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
        """Return the noise where every model leaves this part of |Y|, and so more than noise.

        The weights are equal at all frequencies; those of little noise would dominate the fit.
        """
        return replace(self, known=False, level=level, measured=self).scaled(1.0)

    def scaled(self, factor: float) -> "Noise":
        """Return an unknown noise at another level, `LEAST_UNKNOWN` at least."""
        level = max(factor * self.level, LEAST_UNKNOWN)
        points = tuple(replace(point, sigma=of_norm(point, level)) for point in self.sweep.points)
        words = f"unknown, taken as the {level:.2g} of |Y| that is left over"
        if self.measured is not None:
            words = (
                f"{self.measured.source}; weighed by the {level:.2g} of |Y| that models leave over"
            )
        elif level <= LEAST_UNKNOWN:
            words = _WORDS["unknown"]
        return replace(self, sweep=replace(self.sweep, points=points), level=level, source=words)


def estimate_noise(sweep: Sweep, level: float = LEAST_UNKNOWN) -> Noise:
    """Estimate the noise of a sweep.

    Sigma as given; else from repeats; else, with 15 points a decade or more, from smoothness; else
    from vector fits; else `level` of |Y|_F. To a known sigma a floor of `MODEL_FLOOR` |Y|_F is
    added, for linearisation and rounding.
    """
    estimates = [estimate_point(point) for point in sweep.points]
    source = estimates[0].source
    if any(estimate.sigma is None for estimate in estimates):
        source = "unknown"
    points = []
    for point, estimate in zip(sweep.points, estimates, strict=True):
        if source == "unknown":
            sigma = of_norm(point, LEAST_UNKNOWN)
        else:
            sigma = np.hypot(np.asarray(estimate.sigma), of_norm(point, MODEL_FLOOR))
        points.append(replace(point, sigma=sigma, repeats=None))
    noise = Noise(replace(sweep, points=tuple(points)), source != "unknown", _WORDS[source])
    return noise if noise.known else noise.scaled(level / LEAST_UNKNOWN)
