"""Measurement noise: added to clean sweeps, or known from sigma, repeats, smoothness or what vector
fits leave over.
"""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

import numpy as np

from ibrid.border import takes_kinds
from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.measurement.sweeps.vector_fit import left_over
from ibrid.ranges import require_in_range

#: Beginning of the note of a sweep of `ibrid measure`; a simulated device has no grid's harmonics.
SIMULATED = "simulated by ibrid measure: multisines"


@takes_kinds
def add_noise(
    sweep: Sweep,
    noise_db: float,
    *,
    rng: np.random.Generator,
    repeats: int = 1,
    record_sigma: bool = True,
) -> Sweep:
    """Add noise of `noise_db` below the Frobenius norm of Y at each frequency.

    Law: each real and each imaginary part of each entry gets a normal error with standard deviation
    s(w) = ||Y(jw)||_F / (2 sqrt 2) 10^(-noise_db / 20), so that the expected squared error of the
    matrix is
    ||Y||_F^2 10^(-noise_db / 10).

    Parameters
    ----------
    noise_db : signal-to-noise ratio of one run in dB (60: 0.1 %).
    rng : the source of randomness; the same state gives the same noise.
    repeats : number of runs; with more than one, the runs are kept and `admittance` is their mean.
    record_sigma : whether the result carries sigma (of the mean) or, as in most measured files,
    nothing.

    Raises SweepError for numbers out of range.
    """
    require_in_range("repeats", repeats, "repeats")
    require_in_range("noise_db", noise_db, "noise_db")
    return replace(
        sweep,
        points=tuple(_noisy(point, noise_db, rng, repeats, record_sigma) for point in sweep.points),
    )


def _noisy(
    point: PointSweep, noise_db: float, rng: np.random.Generator, repeats: int, record_sigma: bool
) -> PointSweep:
    clean = point.admittance
    norm = np.linalg.norm(clean, axis=(1, 2))
    scale = np.broadcast_to(
        (norm / (2 * sqrt(2)) * 10 ** (-noise_db / 20))[:, None, None], clean.shape
    )
    shape = (repeats, *clean.shape)
    runs = clean + scale * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    return replace(
        point,
        admittance=runs.mean(axis=0),
        sigma=scale / sqrt(repeats) if record_sigma and scale.min() > 0 else None,
        repeats=runs if repeats > 1 else None,
        larger=tuple(_noisy(one, noise_db, rng, repeats, record_sigma) for one in point.larger),
    )


Source = Literal["sigma", "repeats", "smoothness", "vector-fit", "unknown"]

DENSE = 15.0
"""Points a decade from which on a physical response is smooth between neighbours."""
LEAST_TOLD = 1e-4
"""Of |Y|_F: what vector fits leave below it may as well be their own error, so the noise stays
unknown.
"""
_WINDOW = 7
_DEGREES = (2, 3)
_POOL = 4
_UNBIASED = 1 / 0.92


@dataclass(frozen=True, eq=False)
class PointNoise(Frozen):
    """Noise of one operating point.

    source : where the number comes from.
    sigma : (K, 2, 2) standard deviation of each real and imaginary part of the admittance; None if
    unknown.
    relative : (K,) rms error of the matrix over ||Y||_F, sqrt(2 sum sigma^2) / ||Y||_F (0.001 is 60
    dB); or None.
    """

    source: Source
    sigma: np.ndarray | None
    relative: np.ndarray | None

    @property
    def level(self) -> float | None:
        """Median over frequency of `relative`."""
        return None if self.relative is None else float(np.median(self.relative))


@takes_kinds
def estimate(sweep: Sweep) -> dict[str, PointNoise]:
    """Noise per operating point: sigma; else repeats; else, from 15 points a decade, smoothness;
    else what vector fits leave; else unknown.
    """
    return {point.op.name: estimate_point(point) for point in sweep.points}


def estimate_point(point: PointSweep) -> PointNoise:
    """Noise of one operating point.

    A sigma that was taken from the repeats or from vector fits counts as these.
    """
    scatter = (
        None if point.repeats is None or len(point.repeats) < 2 else sigma_of_mean(point.repeats)
    )
    if point.sigma is not None:
        stated = _noise("sigma", point, point.sigma)
        if scatter is not None and _same(point.sigma, scatter):
            return replace(stated, source="repeats")
        as_fitted = _same(point.sigma, of_norm(point, stated.level or 0.0)) and _same(
            point.sigma, _of_vector_fits(point)
        )
        return replace(stated, source="vector-fit") if as_fitted else stated
    if scatter is not None:
        return _noise("repeats", point, scatter)
    if _dense(point):
        return _noise("smoothness", point, roughness(point.frequency, point.admittance))
    fitted = _of_vector_fits(point)
    return (
        PointNoise("unknown", None, None) if fitted is None else _noise("vector-fit", point, fitted)
    )


def with_sigma(sweep: Sweep) -> Sweep:
    """The sweep with the sigma that its repeats tell, or vector fits of all its operating points,
    where it has none.
    """
    noise = estimate(sweep)
    sparse = all(one.source == "vector-fit" for one in noise.values())

    def filled(point: PointSweep) -> PointSweep:
        own = noise[point.op.name]
        return replace(point, sigma=own.sigma) if sparse or own.source == "repeats" else point

    return replace(sweep, points=tuple(filled(point) for point in sweep.points))


def _same(sigma: np.ndarray, other: np.ndarray | None) -> bool:
    return other is not None and np.allclose(sigma, other, rtol=1e-6, atol=0)


def _dense(point: PointSweep) -> bool:
    return points_per_decade(point.frequency) >= DENSE and len(point.frequency) >= 2 * _WINDOW


def _of_vector_fits(point: PointSweep) -> np.ndarray | None:
    """Standard deviation (K, 2, 2) by what vector fits leave over; None where the data are dense,
    or they do not tell.
    """
    level = None if _dense(point) else left_over(point.frequency, point.admittance)
    return None if level is None or level <= LEAST_TOLD else of_norm(point, level)


def of_norm(point: PointSweep, level: float | np.ndarray) -> np.ndarray:
    """Standard deviation of each real number (K, 2, 2) for an rms error of the matrix of `level`,
    one or (K,), of |Y|_F.
    """
    size = level * np.linalg.norm(point.admittance, axis=(1, 2)) / sqrt(8.0)
    return np.broadcast_to(size[:, None, None], point.admittance.shape)


def points_per_decade(frequency: np.ndarray) -> float:
    """Average density of a grid, (K - 1) / decades; 0 for a single frequency."""
    if len(frequency) < 2:
        return 0.0
    return float((len(frequency) - 1) / np.log10(frequency[-1] / frequency[0]))


def roughness(frequency: np.ndarray, response: np.ndarray) -> np.ndarray:
    """What a smooth curve through the neighbours leaves over, as a standard deviation per real and
    imaginary part.

    Law: in each window of 7 neighbours a polynomial in log f is fitted to each complex entry; the
    residual sum of squares over its degrees of freedom is its variance. Degree 2 and degree 3 are
    tried and the one that leaves less is taken, since curvature, unlike noise, shrinks with the
    degree. The median over 9 windows, relative to ||Y||_F, makes it steady and keeps single spikes
    (lines at harmonics) out. Both choices read white noise low by 8 %, which is put back. An upper
    bound where a resonance is spanned by few points.

    frequency : (K,) Hz, K >= 7; response : complex, (K, 2, 2). Returns (K, 2, 2).
    """
    count = len(frequency)
    log_frequency = np.log(frequency)
    norm = np.linalg.norm(response, axis=(1, 2))
    norm = np.maximum(norm, norm.max() * 1e-12)
    starts = np.clip(np.arange(count) - _WINDOW // 2, 0, count - _WINDOW)
    windows = starts[:, None] + np.arange(_WINDOW)
    values = response[windows].reshape(count, _WINDOW, 4) / norm[:, None, None]
    variance = _window_variances(log_frequency[windows], values)
    padded = np.pad(variance, ((_POOL, _POOL), (0, 0)), constant_values=np.nan)
    pools = np.lib.stride_tricks.sliding_window_view(padded, 2 * _POOL + 1, axis=0)
    deviation = _UNBIASED * np.sqrt(np.nanmedian(pools, axis=-1).reshape(count, 2, 2))
    return np.maximum(deviation, 1e-12) * norm[:, None, None]


def _window_variances(position: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Residual variance per part and entry of the better of two local polynomials, (K, 4).

    position : (K, 7). values : (K, 7, 4) complex.
    """
    centred = position - position.mean(axis=1, keepdims=True)
    centred /= np.ptp(position, axis=1)[:, None]
    best = np.full((len(values), 4), np.inf)
    for degree in _DEGREES:
        basis, _ = np.linalg.qr(centred[:, :, None] ** np.arange(degree, -1, -1))
        residual = values - basis @ (np.swapaxes(basis, 1, 2) @ values)
        freedom = 2 * (_WINDOW - degree - 1)
        best = np.minimum(best, (np.abs(residual) ** 2).sum(axis=1) / freedom)
    return best


def _noise(source: Source, point: PointSweep, sigma: np.ndarray) -> PointNoise:
    norm = np.linalg.norm(point.admittance, axis=(1, 2))
    norm = np.maximum(norm, norm.max() * 1e-12)
    return PointNoise(source, sigma, np.sqrt(2 * (sigma**2).sum(axis=(1, 2))) / norm)


NEIGHBOURS = 2
ENOUGH = 10
"""From this many runs on, each frequency's own scatter is used; below, its neighbours help."""
_ROUNDING = 1e-28
_SMALLEST = 1e-9
"""Floor of sigma relative to ||Y||_F: an entry that repeats to the last digit still weighs
finitely.
"""


def sigma_of_mean(repeats: np.ndarray) -> np.ndarray | None:
    """Standard deviation of each real and imaginary part of the mean of R runs.

    Law: s^2 = sum_r |Y_r - mean|^2 / (2 (R - 1)) per entry and frequency, both parts together;
    sigma = s / sqrt(R). With fewer than 10 runs s is too uncertain at a single frequency (R = 3:
    four degrees of freedom), so s^2 / ||Y||_F^2 is averaged over the frequency and its two
    neighbours on each side, entry by entry, and scaled back.

    repeats : (R, K, 2, 2) complex, R >= 2.

    Returns (K, 2, 2), or None if all runs are equal: then they say nothing about noise.
    """
    runs = len(repeats)
    mean = repeats.mean(axis=0)
    norm = np.linalg.norm(mean, axis=(1, 2))[:, None, None]
    norm = np.maximum(norm, np.finfo(float).tiny * 1e20)
    relative = (np.abs((repeats - mean) / norm) ** 2).sum(axis=0) / (2 * (runs - 1))
    if relative.max() < _ROUNDING:
        return None
    if runs < ENOUGH:
        windows = [
            relative[max(0, k - NEIGHBOURS) : k + NEIGHBOURS + 1] for k in range(len(relative))
        ]
        relative = np.array([window.mean(axis=0) for window in windows])
    return np.maximum(np.sqrt(relative / runs), _SMALLEST) * norm
