"""Representative frequencies of a measured admittance: starts of a fit are searched on those,
and its end takes all of them.
"""

import numpy as np

from ibrid.measurement.sweeps.sweep import PointSweep


def representative_frequencies(point: PointSweep, number: int) -> np.ndarray:
    """Return the indices (number,), ascending, of frequencies that represent an admittance.

    Half of them are spread evenly over the logarithm of frequency. The others are chosen one after
    the other where the curve is farthest from the straight line between its chosen neighbours
    (Douglas & Peucker, Cartographica 10, 1973), so that a resonance stays. The curve has the
    coordinates Y / |Y| and ln |Y|, with the Frobenius norm |Y| of each frequency.
    """
    count = len(point.frequency)
    if count <= number:
        return np.arange(count)
    position = np.log(point.frequency)
    norm = np.linalg.norm(point.admittance, axis=(1, 2))
    shape = (point.admittance / norm[:, None, None]).reshape(count, 4)
    curve = np.column_stack([shape.real, shape.imag, np.log(norm)])
    even = np.linspace(position[0], position[-1], number // 2)
    chosen = set(np.abs(position[:, None] - even).argmin(axis=0).tolist())
    while len(chosen) < number:
        known = sorted(chosen)
        between = np.array([np.interp(position, position[known], axis[known]) for axis in curve.T])
        distance = np.linalg.norm(curve - between.T, axis=1)
        distance[known] = -1.0
        chosen.add(int(distance.argmax()))
    return np.array(sorted(chosen))
