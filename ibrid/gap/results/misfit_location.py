"""Where a refitted model misses a sweep, by operating point, frequency band and matrix entry."""

from collections.abc import Iterator, Sequence

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.fit.objective import band_index
from ibrid.gap.results.gap import LocatedMisfit
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep

#: Least significance of a part that is reported, in standard deviations, and most parts.
LEAST_Z = 3.0
MOST_LOCATED = 12


def locate_misfit(
    points: Sequence[PointSweep],
    residuals: Sequence[np.ndarray],
    dof_per_number: float,
    scale: float,
) -> tuple[LocatedMisfit, ...]:
    """Locate the misfit of a model, the largest share of it first.

    Law: 2 sum |e|^2 of n complex residuals e follows chi2 with 2 n degrees of freedom under noise
    alone; the degrees that the fit uses up are shared evenly.

    Parameters
    ----------
    residuals : sequence of ndarray
        (K, 2, 2) whitened, of each operating point.
    dof_per_number : float
        Degrees of freedom for each measured number.
    scale : float
        Factor on the standard deviation of the noise.
    """
    total = sum(float((np.abs(residual) ** 2).sum()) for residual in residuals)
    located: list[LocatedMisfit] = []
    for point, residual in zip(points, residuals, strict=True):
        for band, entry, square, count in sum_by_part(point.frequency, np.abs(residual) ** 2):
            z = normal_score(square / scale**2 / dof_per_number, 2 * count)
            if z > LEAST_Z:
                share = square / total if total > 0 else 0.0
                located.append(LocatedMisfit(point.op.name, band, entry, share, z))
    return tuple(sorted(located, key=lambda part: -part.share)[:MOST_LOCATED])


def sum_by_part(
    frequency: np.ndarray, square: np.ndarray
) -> Iterator[tuple[tuple[float, float], str, float, int]]:
    """Sum squares by frequency band and matrix entry.

    Parameters
    ----------
    frequency : ndarray
        (K,) Hz.
    square : ndarray
        (K, 2, 2) squared residuals.

    Yields
    ------
    tuple
        Edges of the band in Hz, entry ("dd" to "qq"), sum, and number of frequencies.
    """
    bands = band_index(frequency)
    for band in np.unique(bands):
        inside = bands == band
        edges = (float(frequency[inside][0]), float(frequency[inside][-1]))
        for entry, (i, j) in ENTRIES.items():
            yield edges, entry, float(square[inside, i, j].sum()), int(inside.sum())
