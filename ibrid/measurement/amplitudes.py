"""One inverter swept with several injection amplitudes: apart, and together as one sweep."""

from collections.abc import Sequence
from dataclasses import replace

from ibrid.errors import SweepError
from ibrid.measurement.sweep import PointSweep, Sweep


def at_amplitudes(sweep: Sweep) -> tuple[Sweep, ...]:
    """The sweep at each injection amplitude, the smallest first; one sweep where there is one amplitude.

    The j-th has the operating points that were swept with j amplitudes or more, at the frequencies that were.
    """
    most = 1 + max(len(point.larger) for point in sweep.points)
    levels = [[_all(point)[level] for point in sweep.points if len(point.larger) >= level] for level in range(most)]
    return tuple(replace(sweep, points=tuple(points)) for points in levels)


def joined(sweeps: Sequence[Sweep]) -> Sweep:
    """The opposite of `at_amplitudes`: sweeps of one inverter, the one with the smallest amplitudes first.

    Raises SweepError when there is none, a larger one has a point that the smallest lacks, or no amplitude.
    """
    if not sweeps:
        raise SweepError("joined must get at least one sweep; found none.")
    smallest, *larger = sweeps
    known = set(smallest.names)
    for sweep in larger:
        if unknown := [name for name in sweep.names if name not in known]:
            raise SweepError(f"operating point {unknown[0]} must be swept with the smallest amplitude too; it is not.")
    points = [
        replace(point, larger=tuple(one.point(point.op.name) for one in larger if point.op.name in one.names))
        for point in smallest.points
    ]
    return replace(smallest, points=tuple(points))


def levels_of(point: PointSweep) -> tuple[PointSweep, ...]:
    """An operating point at each of its amplitudes, the smallest first."""
    return tuple(_all(point))


def _all(point: PointSweep) -> list[PointSweep]:
    return [replace(point, larger=()), *point.larger]
