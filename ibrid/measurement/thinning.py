"""Parts of a sweep: every fourth frequency held out, and a few of many, for looks and for where fits begin."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.measurement.sweep import PointSweep, Sweep

#: One frequency in so many is held out.
EVERY = 4


def thinned(sweep: Sweep, *, hold: bool) -> Sweep:
    """Every fourth frequency of each operating point, the ends never among them, or the others."""
    return replace(sweep, points=tuple(_thinned(point, hold) for point in sweep.points))


def can_be_thinned(sweep: Sweep) -> bool:
    """True when every operating point has frequencies enough to do without some."""
    return min(len(point.frequency) for point in sweep.points) >= 2 * EVERY


def coarse(points: Sequence[PointSweep], most_points: int, most_frequencies: int) -> tuple[PointSweep, ...]:
    """So many operating points with so many frequencies each at most, evenly chosen, ends included."""

    def chosen(number: int, most: int) -> np.ndarray:
        return np.unique(np.linspace(0, number - 1, min(number, most)).round().astype(int))

    few = [points[index] for index in chosen(len(points), most_points)]
    return tuple(point.at(chosen(len(point.frequency), most_frequencies)) for point in few)


def _thinned(point: PointSweep, hold: bool) -> PointSweep:
    number = np.arange(len(point.frequency))
    chosen = (number % EVERY == EVERY // 2) & (number < len(number) - 1)
    return point.at(chosen if hold else ~chosen)
