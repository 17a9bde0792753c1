"""Sweeps apart and together: by injection amplitude, several files as one, every fourth frequency
held out.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep


def at_amplitudes(sweep: Sweep) -> tuple[Sweep, ...]:
    """The sweep at each injection amplitude, the smallest first; one sweep where there is one
    amplitude.

    The j-th has the operating points that were swept with j amplitudes or more, at the frequencies
    that were.
    """
    most = 1 + max(len(point.larger) for point in sweep.points)
    levels = [
        [levels_of(one)[level] for one in sweep.points if len(one.larger) >= level]
        for level in range(most)
    ]
    return tuple(replace(sweep, points=tuple(points)) for points in levels)


def joined(sweeps: Sequence[Sweep]) -> Sweep:
    """The opposite of `at_amplitudes`: sweeps of one inverter, the one with the smallest amplitudes
    first.

    Raises SweepError when there is none, a larger one has a point that the smallest lacks, or no
    amplitude.
    """
    if not sweeps:
        raise SweepError("joined must get at least one sweep; found none.")
    smallest, *larger = sweeps
    known = set(smallest.names)
    for sweep in larger:
        if unknown := [name for name in sweep.names if name not in known]:
            raise SweepError(
                f"operating point {unknown[0]} must be swept with the smallest amplitude too; it "
                "is not."
            )
    points = [
        replace(
            point,
            larger=tuple(one.point(point.op.name) for one in larger if point.op.name in one.names),
        )
        for point in smallest.points
    ]
    return replace(smallest, points=tuple(points))


def levels_of(point: PointSweep) -> tuple[PointSweep, ...]:
    """An operating point at each of its amplitudes, the smallest first."""
    return (replace(point, larger=()), *point.larger)


@takes_kinds
def merge(sweeps: Sequence[Sweep]) -> Sweep:
    """One sweep with the operating points of all of them (name them with op= when reading).

    Raises SweepError when there is none, f0, power node or bases differ, or two operating points
    share a name.
    """
    if not sweeps:
        raise SweepError("merge must get at least one sweep; found none.")
    first = sweeps[0]
    for other in sweeps[1:]:
        for field in ("f0_hz", "power_node", "s_base_va", "v_base_v", "sampling_hz"):
            ours, theirs = getattr(first, field), getattr(other, field)
            if ours != theirs:
                raise SweepError(
                    f"sweeps of one inverter must agree on {field}; found {ours} in {first.source} "
                    f"and {theirs} in "
                    f"{other.source}."
                )
    return replace(
        first,
        points=tuple(point for sweep in sweeps for point in sweep.points),
        notes=tuple(dict.fromkeys(note for sweep in sweeps for note in sweep.notes)),
        source=", ".join(dict.fromkeys(sweep.source for sweep in sweeps if sweep.source)),
    )


#: One frequency in so many is held out.
EVERY = 4


def thinned(sweep: Sweep, *, hold: bool) -> Sweep:
    """Every fourth frequency of each operating point, the ends never among them, or the others."""
    return replace(sweep, points=tuple(_thinned(point, hold) for point in sweep.points))


def can_be_thinned(sweep: Sweep) -> bool:
    """True when every operating point has frequencies enough to do without some."""
    return min(len(point.frequency) for point in sweep.points) >= 2 * EVERY


def coarse(
    points: Sequence[PointSweep], most_points: int, most_frequencies: int
) -> tuple[PointSweep, ...]:
    """So many operating points with so many frequencies each at most, evenly chosen, ends
    included.
    """
    few = [points[index] for index in evenly(len(points), most_points)]
    return tuple(point.at(evenly(len(point.frequency), most_frequencies)) for point in few)


def evenly(number: int, most: int) -> np.ndarray:
    """So many of `number` places at most, ends included."""
    return np.unique(np.linspace(0, max(number - 1, 0), min(number, most)).round().astype(int))


def _thinned(point: PointSweep, hold: bool) -> PointSweep:
    number = np.arange(len(point.frequency))
    chosen = (number % EVERY == EVERY // 2) & (number < len(number) - 1)
    return point.at(chosen if hold else ~chosen)
