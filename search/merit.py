"""By what candidates rank: the error, down to that of an exact fit, and a price for every free number."""

from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from ibrid.evaluation.reward import reward
from ibrid.measurement.noise_estimate import estimate_point
from ibrid.measurement.sweep import Sweep
from search.oddities import SOUND, Oddities
from search.settings import SearchSettings

#: Errors up to this count as exact.
EXACT = 1e-6
#: An error below this does not speak for a structure whose plant has absurd values: it swallows something.
DOUBTFUL = 1e-3


@dataclass(frozen=True)
class Floor:
    """The NRMSE that the noise of the data leaves: `nrmse` and its standard deviation; `source` : how it is known.

    Without a known noise it is that of an exact fit, `EXACT`.
    """

    nrmse: float
    deviation: float
    source: str

    def reached(self, error: float) -> bool:
        """True when an error is no larger than noise would leave it, within two standard deviations."""
        return error <= self.nrmse + 2 * self.deviation


def noise_floor(sweep: Sweep) -> Floor:
    """Law: mean over operating points of sqrt(2) |sigma|_F / |Y|_F, sigma of each real and imaginary part.

    sigma as given or from repeats (smoothness gives only an upper bound, which must not end a search). The squared error
    has mean 2 sum sigma^2 and variance 4 sum sigma^4 (two real numbers each), so few large entries make it uncertain.
    """
    levels, variances, source = [], [], ""
    for point in sweep.points:
        noise = estimate_point(point)
        if noise.sigma is None or noise.source not in ("sigma", "repeats"):
            return Floor(EXACT, 0.0, "unknown noise")
        power, size = noise.sigma**2, np.linalg.norm(point.admittance)
        level = sqrt(2.0 * power.sum()) / size
        levels.append(level)
        variances.append(level**2 * (power**2).sum() / (4.0 * power.sum() ** 2))
        source = noise.source
    number = len(levels)
    return Floor(max(sum(levels) / number, EXACT), sqrt(sum(variances)) / number, source)


@dataclass(frozen=True)
class Criterion:
    """What the best of a run is: the least ln(max(NRMSE, `EXACT`)) + price x free numbers (of one operating point, when
    each has its own).

    With known noise the price is that of the Bayesian information criterion, ln(n) / 2n for n measured real numbers.
    Otherwise it only breaks ties. `alone` : operating points that have their own numbers. `parsimony`, `layer`, `bound`,
    `residual` : prices of a free number, a missing control layer, a parameter at its bound and a residual module in the
    order of the parents.
    """

    floor: Floor
    price: float
    parsimony: float
    alone: int = 1
    layer: float = 0.0
    bound: float = 0.0
    residual: float = 0.0

    def value(self, nrmse: float, free: int, odd: Oddities = SOUND) -> float:
        """The lower, the better; an oddity counts as two free numbers, an absurd plant earns nothing below `DOUBTFUL`."""
        return log(max(nrmse, self._least(odd))) + self.price * (free / self.alone + 2 * odd.total)

    def merit(self, nrmse: float, free: int, odd: Oddities = SOUND) -> float:
        """What the archive ranks parents by, the higher, the better."""
        priced = self.parsimony * free + self.bound * odd.at_bound
        return (
            reward(max(nrmse, self._least(odd)))
            - priced / self.alone
            - self.layer * odd.missing
            - self.residual * odd.residual
        )

    def _least(self, odd: Oddities) -> float:
        return DOUBTFUL if odd.absurd else EXACT


#: Price of a free number when the noise is not known: it breaks ties.
TIE = 1e-3


def criterion(sweep: Sweep, parameters: str, settings: SearchSettings) -> Criterion:
    """The criterion for the operating points that are fitted."""
    floor = noise_floor(sweep)
    numbers = 8 * sum(len(point.frequency) for point in sweep.points)
    alone = len(sweep.points) if parameters == "per-op" else 1
    known = floor.source != "unknown noise"
    price = log(numbers) * alone / (2 * numbers) if known else TIE
    return Criterion(floor, price, settings.parsimony, alone, settings.layer, settings.bound, settings.residual)
