"""Sums and multiples of sweeps, and sweeps at other frequencies than their own.

Standard deviations follow as of independent measurements; single runs and larger amplitudes are
left behind.
"""

from cmath import isfinite
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.interpolating import interpolated
from ibrid.measurement.sweeps.sweep import LARGEST, PointSweep, Sweep

#: Part of a frequency by which rounding may put it beyond the measured range.
ROUNDED = 1e-9
#: What a computed admittance has no more; it may be zero, as a model's may.
_COMPUTED: dict[str, Any] = {"repeats": None, "amplitude": None, "larger": (), "predicted": True}


def added(first: Sweep, second: Sweep) -> Sweep:
    """first + second, point by point; SweepError unless both have the same bases, nominal frequency
    and node of p and q, and the same operating points at the same frequencies.
    """
    for key in ("f0_hz", "power_node", "s_base_va", "v_base_v"):
        if getattr(first, key) != getattr(second, key):
            raise SweepError(
                f"sweeps must have the same {key} to be added or subtracted; found "
                f"{getattr(first, key)} and {getattr(second, key)}."
            )
    if set(first.names) != set(second.names):
        raise SweepError(
            "sweeps must have the same operating points to be added or subtracted; found "
            f"{', '.join(first.names)} and {', '.join(second.names)}, choose with only(...)."
        )
    points = []
    for point in first.points:
        other = second.point(point.op.name)
        if point.op.pqv != other.op.pqv:
            raise SweepError(
                f"sweeps must have the same p, q, v at {point.op.name} to be added or subtracted; "
                f"found {point.op.pqv} and {other.op.pqv}."
            )
        if not np.array_equal(point.frequency, other.frequency):
            raise SweepError(
                f"sweeps must have the same frequencies at {point.op.name} to be added or "
                "subtracted; bring one to those of the other with resample(frequencies)."
            )
        sigma = None
        if point.sigma is not None and other.sigma is not None:
            sigma = np.hypot(point.sigma, other.sigma)
        admittance = point.admittance + other.admittance
        points.append(_computed(point, admittance, sigma))
    return replace(first, points=tuple(points))


def multiplied(sweep: Sweep, number: complex) -> Sweep:
    """Every admittance times a number, without sigma where that is zero; SweepError where it is not
    finite.
    """
    factor = _finite(number)
    return replace(sweep, points=tuple(_multiplied(point, factor) for point in sweep.points))


def divided(sweep: Sweep, number: complex) -> Sweep:
    """Every admittance over a number; SweepError for 0, and where it is not finite."""
    if not number:
        raise SweepError("a sweep must be divided by a number beside 0; found 0.")
    return multiplied(sweep, 1.0 / _finite(number))


def _finite(number: complex) -> complex:
    with suppress(OverflowError):
        if isfinite(factor := complex(number)):
            return factor
    raise SweepError("a sweep must be multiplied or divided by a finite number; found another.")


def _multiplied(point: PointSweep, factor: complex) -> PointSweep:
    sigma = None if point.sigma is None or not factor else abs(factor) * point.sigma
    with np.errstate(over="ignore", invalid="ignore"):
        return _computed(point, factor * point.admittance, sigma)


def _computed(point: PointSweep, admittance: np.ndarray, sigma: np.ndarray | None) -> PointSweep:
    largest = np.abs(admittance).max()
    if largest and not 1.0 / LARGEST < largest < LARGEST:
        raise SweepError(
            f"admittances must be of a size that can be; found {largest:.3g} at {point.op.name}."
        )
    return replace(point, admittance=admittance, sigma=sigma, **_COMPUTED)


def resampled(sweep: Sweep, frequencies: Any) -> Sweep:
    """The sweep at other frequencies, (K,) Hz: entries and their sigma linear in log f between
    neighbours; SweepError beyond the measured range.
    """
    wanted = frequencies_of(frequencies)
    if not len(wanted):
        raise SweepError("frequencies must be one in Hz or more; found none.")
    points = []
    for point in sweep.points:
        own = point.frequency
        if wanted[0] < own[0] * (1 - ROUNDED) or wanted[-1] > own[-1] * (1 + ROUNDED):
            raise SweepError(
                f"frequencies must lie within those of {point.op.name}, {own[0]:g} to {own[-1]:g} "
                f"Hz; found {wanted[0]:g} to {wanted[-1]:g} Hz, nothing is extrapolated."
            )
        at = np.clip(wanted, own[0], own[-1])
        sigma = None if point.sigma is None else np.real(interpolated(own, point.sigma, at))
        response = interpolated(own, point.admittance, at)
        computed = {**_COMPUTED, "predicted": point.predicted}
        points.append(replace(point, frequency=at, admittance=response, sigma=sigma, **computed))
    return replace(sweep, points=tuple(points))
