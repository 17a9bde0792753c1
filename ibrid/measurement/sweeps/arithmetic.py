"""Sums and multiples of sweeps, and sweeps at other frequencies than their own.

Standard deviations follow as of independent measurements; single runs and larger amplitudes are
left behind.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.interpolating import interpolated
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: What a computed admittance has no more; it may be zero, as a model's may.
_COMPUTED: dict[str, Any] = {"repeats": None, "amplitude": None, "larger": (), "predicted": True}


def added(first: Sweep, second: Sweep, sign: float) -> Sweep:
    """first + sign second, point by point; SweepError unless both have the same operating points at
    the same frequencies.
    """
    if set(first.names) != set(second.names):
        raise SweepError(
            "sweeps must have the same operating points to be added or subtracted; found "
            f"{', '.join(first.names)} and {', '.join(second.names)}, choose with only(...)."
        )
    points = []
    for point in first.points:
        other = second.point(point.op.name)
        if not np.array_equal(point.frequency, other.frequency):
            raise SweepError(
                f"sweeps must have the same frequencies at {point.op.name} to be added or "
                "subtracted; bring one to those of the other with resample(frequencies)."
            )
        sigma = None
        if point.sigma is not None and other.sigma is not None:
            sigma = np.hypot(point.sigma, other.sigma)
        admittance = point.admittance + sign * other.admittance
        points.append(replace(point, admittance=admittance, sigma=sigma, **_COMPUTED))
    return replace(first, points=tuple(points))


def multiplied(sweep: Sweep, number: complex) -> Sweep:
    """Every admittance times a number; without sigma where that is zero."""
    return replace(sweep, points=tuple(_multiplied(point, number) for point in sweep.points))


def _multiplied(point: PointSweep, number: complex) -> PointSweep:
    sigma = None if point.sigma is None or not number else abs(number) * point.sigma
    return replace(point, admittance=number * point.admittance, sigma=sigma, **_COMPUTED)


def resampled(sweep: Sweep, frequencies: Any) -> Sweep:
    """The sweep at other frequencies, (K,) Hz: entries and their sigma linear in log f between
    neighbours; SweepError beyond the measured range.
    """
    wanted = frequencies_of(frequencies)
    points = []
    for point in sweep.points:
        own = point.frequency
        if wanted[0] < own[0] or wanted[-1] > own[-1]:
            raise SweepError(
                f"frequencies must lie within those of {point.op.name}, {own[0]:g} to {own[-1]:g} "
                f"Hz; found {wanted[0]:g} to {wanted[-1]:g} Hz, nothing is extrapolated."
            )
        sigma = None if point.sigma is None else np.real(interpolated(own, point.sigma, wanted))
        at = {"frequency": wanted, "admittance": interpolated(own, point.admittance, wanted)}
        computed = {**_COMPUTED, "predicted": point.predicted}
        points.append(replace(point, **at, sigma=sigma, **computed))
    return replace(sweep, points=tuple(points))
