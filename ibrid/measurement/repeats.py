"""Repeated runs of one sweep: their mean and how uncertain that mean is."""

import numpy as np

NEIGHBOURS = 2
ENOUGH = 10
"""From this many runs on, each frequency's own scatter is used; below, its neighbours help."""
_ROUNDING = 1e-28
_SMALLEST = 1e-9
"""Floor of sigma relative to ||Y||_F: an entry that repeats to the last digit still weighs finitely."""


def sigma_of_mean(repeats: np.ndarray) -> np.ndarray | None:
    """Standard deviation of each real and imaginary part of the mean of R runs.

    Law: s^2 = sum_r |Y_r - mean|^2 / (2 (R - 1)) per entry and frequency, both parts together; sigma = s / sqrt(R).
    With fewer than 10 runs s is too uncertain at a single frequency (R = 3: four degrees of freedom), so
    s^2 / ||Y||_F^2 is averaged over the frequency and its two neighbours on each side, entry by entry, and scaled back.

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
        relative = _pooled(relative)
    return np.maximum(np.sqrt(relative / runs), _SMALLEST) * norm


def _pooled(variance: np.ndarray) -> np.ndarray:
    count = len(variance)
    windows = [slice(max(0, k - NEIGHBOURS), min(count, k + NEIGHBOURS + 1)) for k in range(count)]
    return np.array([variance[window].mean(axis=0) for window in windows])
