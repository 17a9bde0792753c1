"""How uncertain a response at a finite amplitude is: its noise, and what products of signals add to it.

Products (p = e' i) and rotations change a response by the order of the amplitude squared even where every controller is
linear: a converter that keeps its power by 3/4 a^2. The amplitude is the larger of voltage and current, which at a
resonance is that of the current.
"""

from dataclasses import replace

import numpy as np

from ibrid.measurement.noise_estimate import estimate_point
from ibrid.measurement.sweep import PointSweep

#: rms error of the matrix over |Y|_F that a sweep of unknown noise is taken to have.
UNKNOWN = 5e-3
#: Change of the matrix over |Y|_F that products and rotations cause, over the square of the larger amplitude of voltage and
#: current, per unit.
PRODUCTS = 1.0


def with_products(point: PointSweep) -> PointSweep:
    """A point whose sigma (K, 2, 2) holds what products and rotations may add at its amplitude."""
    sigma = sigma_of(point)
    if point.amplitude is None:
        return replace(point, sigma=sigma)
    largest = point.amplitude * np.maximum(np.linalg.norm(point.admittance, ord=2, axis=(1, 2)), 1.0)
    return replace(point, sigma=np.hypot(sigma, _of_norm(point, PRODUCTS * largest**2)))


def sigma_of(point: PointSweep) -> np.ndarray:
    """Standard deviation of each part (K, 2, 2): as known, else an rms error of the matrix of UNKNOWN |Y|_F."""
    known = estimate_point(point).sigma
    return _of_norm(point, np.full(len(point.frequency), UNKNOWN)) if known is None else known


def _of_norm(point: PointSweep, level: np.ndarray) -> np.ndarray:
    """Standard deviation of each part (K, 2, 2) for an rms error of the matrix of `level` (K,) |Y|_F."""
    norm_of_y = np.linalg.norm(point.admittance, axis=(1, 2))
    return np.broadcast_to((level * norm_of_y / np.sqrt(8.0))[:, None, None], point.admittance.shape)
