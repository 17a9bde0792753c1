"""By what candidates rank: the error, down to that of an exact fit, and a price for every free
number.
"""

from dataclasses import dataclass, field
from math import inf, log, sqrt

import numpy as np

from ibrid.evaluation.adequacy import NEGLIGIBLE
from ibrid.evaluation.outcome import reward
from ibrid.evaluation.record import Record
from ibrid.gap.recordings.event_noise import event_noise
from ibrid.gap.recordings.event_record import noise_nrmse
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import Sweep, measured_numbers
from ibrid.study import Study
from ibrid_search.screening.oddities import SOUND, Oddities
from ibrid_search.settings import SearchSettings

#: Errors up to this count as exact.
EXACT = 1e-6
#: An error below this does not speak for a structure whose plant has absurd values: it swallows
#: something.
DOUBTFUL = 1e-3
#: An NRMSE above this, and above so many times what noise leaves, is gross: it speaks for another
#: structure, a smaller one for a detail.
GROSS, ABOVE_NOISE = 0.03, 2.0
#: Source of a noise that the data do not tell.
UNKNOWN = "unknown noise"


@dataclass(frozen=True)
class Floor:
    """The error that the noise of the data leaves: `level`, in `numbers` real numbers; `source` :
    how it is known.

    Error is measured against the noise where that is known: `Record.over_noise` times `level`, the
    relative size of the noise, so it means the same at every frequency. Without a known noise it is
    the NRMSE, and the floor that of an exact fit, `EXACT`.
    """

    level: float
    numbers: int
    source: str

    @property
    def known(self) -> bool:
        """True when the data tell their noise."""
        return self.source != UNKNOWN

    @property
    def most(self) -> float:
        """Largest error that noise explains, two standard deviations or what is negligible allowed;
        that of an exact fit where noise is not known.
        """
        return (
            self.level * max(1.0 + 2.0 / sqrt(2.0 * self.numbers), sqrt(1.0 + NEGLIGIBLE))
            if self.known
            else EXACT
        )

    def error(self, record: Record) -> float:
        """Error of a fitted record, infinite where it has none."""
        if self.known:
            return inf if record.over_noise is None else record.over_noise * self.level
        return inf if record.nrmse is None else record.nrmse

    def reached(self, error: float, free: int = 0) -> bool:
        """True when an error is no larger than noise would leave it after a fit of so many free
        numbers, two standard deviations allowed: of true structures half lie above the average.
        """
        left = max(1.0 - free / self.numbers, 0.0) if self.known else 1.0
        return error <= max(self.most * sqrt(left), EXACT)


def noise_floor(sweep: Sweep) -> Floor:
    """Law: level is the mean over frequencies and operating points of sqrt(2) |sigma|_F / |Y|_F.

    sigma as given, from repeats or from vector fits; smoothness gives only an upper bound, which
    must not end a search.
    """
    numbers, levels = measured_numbers(sweep.points), []
    for point in sweep.points:
        noise = estimate_point(point)
        if noise.relative is None or noise.source not in ("sigma", "repeats", "vector-fit"):
            return Floor(EXACT, numbers, UNKNOWN)
        levels.append(noise.relative)
        source = noise.source
    return Floor(max(float(np.mean(np.concatenate(levels))), EXACT), numbers, source)


def floor_of(study: Study) -> Floor:
    """Of the points that are fitted; where records are all there is, of these: the mean of sqrt(2)
    |sigma| / |i - i_rest|.
    """
    if (events := study.blind.events) is None:
        return noise_floor(study.fitted)
    noise = event_noise(events, study.fitted)
    return Floor(noise_nrmse(noise), sum(2 * len(one.time) for one in events.records), noise.source)


@dataclass(frozen=True)
class Criterion:
    """What the best of a run is: the least ln(max(error, `EXACT`)) + price x free numbers (of one
    operating point, when each has its own).

    With known noise the price is that of the Bayesian information criterion, ln(n) / 2n for n
    measured real numbers. Otherwise it only breaks ties. `alone` : operating points that have their
    own numbers. `settings` : with the prices that order the parents.
    """

    floor: Floor
    price: float
    alone: int = 1
    settings: SearchSettings = field(default_factory=SearchSettings)

    def value(self, error: float, free: int, odd: Oddities = SOUND) -> float:
        """The lower, the better; an oddity counts as two free numbers, an absurd plant earns
        nothing below `DOUBTFUL`.
        """
        return log(max(error, least_error(odd))) + self.price * (free / self.alone + 2 * odd.total)

    def merit(self, error: float, free: int, odd: Oddities = SOUND) -> float:
        """What the archive ranks parents by, the higher, the better; an absurd plant earns nothing
        below `DOUBTFUL`.
        """
        prices = self.settings
        return (
            reward(max(error, least_error(odd)))
            - (prices.parsimony * free + prices.bound * odd.at_bound) / self.alone
            - prices.layer * odd.missing
            - prices.residual * odd.residual
        )


def least_error(odd: Oddities) -> float:
    """What an error counts as at least."""
    return DOUBTFUL if odd.absurd else EXACT


def information_price(numbers: int, alone: int) -> float:
    """What a free number of one operating point must gain in ln(error) by the Bayesian information
    criterion, `alone` of them having their own: ln(n) / 2n for each of n measured real numbers.
    """
    return log(numbers) * alone / (2 * numbers)


#: Price of a free number when the noise is not known: it breaks ties.
TIE = 1e-3


def criterion(study: Study, settings: SearchSettings) -> Criterion:
    """The criterion for the operating points that are fitted."""
    floor = floor_of(study)
    alone = len(study.groups)
    price = information_price(floor.numbers, alone) if floor.known else TIE
    return Criterion(floor, price, alone, settings)
