"""The recorded voltage without the noise of the recorder where noise alone moves it: a filter with
a capacitor amplifies that.

Law: at rest the voltage is a constant and waves of multiples of f0; the median of what is left
tells the noise, by third differences, of which white noise of variance s^2 has 20 s^2. Waves that
stand out of it stay as they are all along. The starlet (Starck, Fadili, Murtagh, IEEE Trans. Image
Process. 16, 2007) writes the rest as a_J + sum of w_j, w_j = a_(j-1) - a_j, where a_j is a_(j-1)
convolved with (1, 4, 6, 4, 1)/16, 2^(j-1) samples apart; a w_j below `KEPT` deviations of the noise
in it is left out, so that steps and swings stay.
"""

import numpy as np

from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs

#: Standard deviations from which on a wave or a change is no noise.
KEPT = 4.0
#: Scales at most, of 1, 2, 4, .. samples; and waves at most, of so many times f0.
SCALES, WAVES = 8, 50
#: Samples at rest from which a noise can be told, and the least that is one, per unit.
ENOUGH, LEAST = 40, 1e-9


def noise_and_waves(
    time: np.ndarray, v: np.ndarray, rest_end: float, f0_hz: float
) -> tuple[float, np.ndarray]:
    """Standard deviation of the noise of each component of v (n, 2), 0 where nobody can tell; and
    the waves in it (n, 2).
    """
    rest = time <= rest_end
    count = int(rest.sum())
    if count < ENOUGH or not f0_hz:
        return 0.0, np.zeros_like(v)
    most = min(WAVES, int(0.5 / f0_hz / np.median(np.diff(time[rest])) - 1e-6))
    speeds, seen = 2j * np.pi * f0_hz * np.arange(-most, most + 1), to_complex(v[rest])
    at_rest = np.exp(np.multiply.outer(time[rest], speeds))
    sizes = np.linalg.lstsq(at_rest, seen, rcond=None)[0]
    left = np.diff(seen - at_rest @ sizes, n=3)
    freedom = max(count - len(sizes), 1) / count
    noise = float(np.median(np.abs(left)) / np.sqrt(2 * np.log(2) * 20 * freedom))
    told = np.abs(sizes) > KEPT * noise * np.sqrt(2 / count)
    waves = np.exp(np.multiply.outer(time, speeds[told])) @ sizes[told]
    return noise, to_pairs(waves)


def smoothed(time: np.ndarray, v: np.ndarray, rest_end: float, f0_hz: float) -> np.ndarray:
    """v (n, 2) without the noise that it has at rest, where nothing else moves it."""
    noise, waves = noise_and_waves(time, v, rest_end, f0_hz)
    if noise < LEAST:
        return v
    impulse = np.zeros(8 << SCALES)  # as long as the widest weights
    impulse[len(impulse) // 2] = 1.0
    moving, kept = v - waves, waves
    for scale in range(min(SCALES, int(np.log2(len(v) / 8)))):
        smooth, response = _smooth(moving, 2**scale), _smooth(impulse, 2**scale)
        moved, level = moving - smooth, noise * float(np.linalg.norm(impulse - response))
        kept = kept + np.where(np.hypot(*moved.T)[:, None] > KEPT * level, moved, 0.0)
        moving, impulse = smooth, response
    return kept + moving


def _smooth(values: np.ndarray, apart: int) -> np.ndarray:
    weights = np.zeros(4 * apart + 1)
    weights[::apart] = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
    from scipy.ndimage import convolve1d  # slow to import, for recordings alone

    return convolve1d(values, weights, axis=0, mode="nearest")
