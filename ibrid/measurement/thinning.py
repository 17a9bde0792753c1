"""Every fourth frequency of a sweep held out: what is left to be fitted, and what is predicted."""

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


def _thinned(point: PointSweep, hold: bool) -> PointSweep:
    number = np.arange(len(point.frequency))
    chosen = (number % EVERY == EVERY // 2) & (number < len(number) - 1)
    return point.at(chosen if hold else ~chosen)
