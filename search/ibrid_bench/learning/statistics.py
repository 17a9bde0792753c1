"""Medians and differences with intervals: seeds are drawn again within each inverter, the inverters
stay.

A bootstrap (B. Efron and R. Tibshirani, An Introduction to the Bootstrap, 1993, chapters 8 and 13):
strata are the inverters, bounds are the 2.5 and 97.5 % quantiles. So an interval speaks of other
seeds on these inverters, not of other inverters.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

DRAWS = 4000
SEED = 7
LEVEL = 0.95
#: Seeds of every inverter below which there is no interval: drawn from two, it would say next to
#: nothing.
LEAST_SEEDS = 3

#: The values of each inverter, one for each seed.
Strata = Mapping[str, Sequence[float]]
#: (draws, n) to (draws,).
Statistic = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """A number with its interval, `low` and `high` None where there are too few seeds.

    `number` : of values behind it.
    """

    value: float
    low: float | None
    high: float | None
    number: int

    @property
    def excludes_zero(self) -> bool:
        """True where zero lies outside the interval."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


def median(values: np.ndarray) -> np.ndarray:
    """Of each row; infinite, "beyond the budget", where half of the values or more are."""
    return np.median(values, axis=-1)


def mean(values: np.ndarray) -> np.ndarray:
    """Of each row."""
    return np.mean(values, axis=-1)


def estimate(strata: Strata, statistic: Statistic) -> Estimate | None:
    """The statistic of all values together with its interval; None without a value.

    The same for the same values.
    """
    groups = [np.asarray(strata[name], dtype=float) for name in sorted(strata) if len(strata[name])]
    if not groups:
        return None
    whole = np.concatenate(groups)
    value = float(statistic(whole[None])[0])
    if min(map(len, groups)) < LEAST_SEEDS:
        return Estimate(value, None, None, whole.size)
    rng = np.random.default_rng(SEED)
    drawn = [group[rng.integers(len(group), size=(DRAWS, len(group)))] for group in groups]
    found = np.sort(statistic(np.concatenate(drawn, axis=1)))
    low, high = (float(found[_rank(share)]) for share in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return Estimate(value, low, high, whole.size)


def differences(
    first: Mapping[tuple[str, int], float], second: Mapping[tuple[str, int], float]
) -> dict[str, list[float]]:
    """first - second for each inverter, over the seeds that both have.

    Keys are (inverter, seed).
    """
    found: dict[str, list[float]] = {}
    for inverter, seed in sorted(first.keys() & second.keys()):
        found.setdefault(inverter, []).append(first[inverter, seed] - second[inverter, seed])
    return found


def _rank(share: float) -> int:
    """Place of a quantile among the sorted draws: one that was drawn, since values may be
    infinite.
    """
    return max(ceil(share * DRAWS) - 1, 0)
