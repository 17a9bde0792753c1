"""The recorded voltage without the noise of the recorder where noise alone moves it: a filter with a capacitor amplifies that.

Law: the starlet (Starck, Fadili, Murtagh, IEEE Trans. Image Process. 16, 2007) writes v as a_J + sum of w_j, w_j = a_(j-1) - a_j,
where a_j is a_(j-1) convolved with (1, 4, 6, 4, 1)/16, 2^(j-1) samples apart. A w_j below `KEPT` standard deviations of white
noise in it is left out, so that steps and swings stay. White noise of variance s^2 has third differences of 20 s^2 at rest;
the waves of a grid hardly have any.
"""

import numpy as np
from scipy.ndimage import convolve1d

#: Standard deviations from which on a change is no noise; scales at most, of 1, 2, 4, .. samples.
KEPT, SCALES = 4.0, 8
#: Samples at rest from which a noise can be told, and the least that is one, per unit.
ENOUGH, LEAST = 40, 1e-9


def noise_at_rest(at_rest: np.ndarray) -> float:
    """Standard deviation of each component of v at rest (n, 2); 0 where too few samples rest."""
    if len(at_rest) < ENOUGH:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(at_rest, n=3, axis=0) ** 2) / 20.0))


def smoothed(v: np.ndarray, noise: float) -> np.ndarray:
    """v (n, 2) without white noise of that standard deviation, where nothing else moves it."""
    if noise < LEAST:
        return v
    impulse = np.zeros(8 << SCALES)
    impulse[len(impulse) // 2] = 1.0
    kept = np.zeros_like(v)
    for scale in range(min(SCALES, int(np.log2(len(v) / 8)))):
        smooth, response = _smooth(v, 2**scale), _smooth(impulse, 2**scale)
        moved, level = v - smooth, noise * float(np.linalg.norm(impulse - response))
        kept += np.where(np.hypot(*moved.T)[:, None] > KEPT * level, moved, 0.0)
        v, impulse = smooth, response
    return v + kept


def _smooth(values: np.ndarray, apart: int) -> np.ndarray:
    weights = np.zeros(4 * apart + 1)
    weights[::apart] = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
    return convolve1d(values, weights, axis=0, mode="nearest")
