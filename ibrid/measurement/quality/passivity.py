"""Where the inverter can feed an oscillation: the smallest eigenvalue of the Hermitian part of
-Y.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.noise import PointNoise
from ibrid.measurement.sweeps.sweep import PointSweep

_SIGNIFICANT = 2.0


@dataclass(frozen=True, eq=False)
class Passivity(Frozen):
    """Passivity of the load admittance -Y (the current out of the inverter makes Y its negative).

    smallest : (K,) smallest eigenvalue of (-Y - Y^H) / 2, per unit; negative: active.
    bands : of neighbouring points at which it lies below zero by more than twice its standard
    deviation (no noise known: below
        zero), (lowest, highest frequency) in Hz.
    """

    smallest: np.ndarray
    bands: tuple[tuple[float, float], ...]


def passivity(point: PointSweep, noise: PointNoise) -> Passivity:
    """Law: min eig of H = -(Y + Y^H) / 2; for its unit eigenvector x the error of x^H H x has the
    standard deviation sqrt(sum |x_i|^2 sigma_ij^2 |x_j|^2), to first order.
    """
    values, vectors = np.linalg.eigh(
        -(point.admittance + np.conj(np.swapaxes(point.admittance, 1, 2))) / 2
    )
    smallest = values[:, 0]
    deviation = np.zeros(len(smallest))
    if noise.sigma is not None:
        weight = np.abs(vectors[:, :, 0]) ** 2
        deviation = np.sqrt(np.einsum("ki,kij,kj->k", weight, noise.sigma**2, weight))
    certain = smallest < -_SIGNIFICANT * deviation - 1e-12 * np.abs(values).max(axis=1)
    return Passivity(smallest, bands_of(certain, point.frequency))


def bands_of(flags: np.ndarray, frequency: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Runs of neighbouring points where `flags` holds, as (lowest, highest frequency)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return tuple(
        (float(frequency[start]), float(frequency[stop - 1]))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
    )
