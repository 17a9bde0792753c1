"""Measurement noise added to clean sweeps: complex Gaussian, relative to the size of the whole matrix."""

from dataclasses import replace
from math import isfinite, sqrt

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweep import PointSweep, Sweep


def add_noise(
    sweep: Sweep, noise_db: float, *, rng: np.random.Generator, repeats: int = 1, record_sigma: bool = True
) -> Sweep:
    """Add noise of `noise_db` below the Frobenius norm of Y at each frequency.

    Law: each real and each imaginary part of each entry gets a normal error with standard deviation
    s(w) = ||Y(jw)||_F / (2 sqrt 2) 10^(-noise_db / 20), so that the expected squared error of the matrix is
    ||Y||_F^2 10^(-noise_db / 10).

    Parameters
    ----------
    noise_db : signal-to-noise ratio of one run in dB (60: 0.1 %).
    rng : the source of randomness; the same state gives the same noise.
    repeats : number of runs; with more than one, the runs are kept and `admittance` is their mean.
    record_sigma : whether the result carries sigma (of the mean) or, as in most measured files, nothing.

    Raises SweepError if repeats < 1 or noise_db is not a finite number.
    """
    if repeats < 1:
        raise SweepError(f"repeats must be at least 1; found {repeats}.")
    if not isfinite(noise_db):
        raise SweepError(f"noise_db must be a finite number of dB, for instance 60; found {noise_db}.")
    points = tuple(_noisy(point, noise_db, rng, repeats, record_sigma) for point in sweep.points)
    return replace(sweep, points=points)


def _noisy(
    point: PointSweep, noise_db: float, rng: np.random.Generator, repeats: int, record_sigma: bool
) -> PointSweep:
    clean = point.admittance
    norm = np.linalg.norm(clean, axis=(1, 2))
    scale = np.broadcast_to((norm / (2 * sqrt(2)) * 10 ** (-noise_db / 20))[:, None, None], clean.shape)
    shape = (repeats, *clean.shape)
    runs = clean + scale * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    return replace(
        point,
        admittance=runs.mean(axis=0),
        sigma=scale / sqrt(repeats) if record_sigma and scale.min() > 0 else None,
        repeats=runs if repeats > 1 else None,
        larger=tuple(_noisy(one, noise_db, rng, repeats, record_sigma) for one in point.larger),
    )
