"""Where a refitted model misses the data: significance by operating point, band and entry of the
matrix.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.fit.objective import band_index
from ibrid.gap.results.gap import LocatedMisfit
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep

#: Least significance, in standard deviations, of a part that is reported, and how many are.
LEAST_Z, MOST = 3.0, 12


def located(
    points: Sequence[PointSweep], residuals: Sequence[np.ndarray], left: float, scale: float
) -> tuple[LocatedMisfit, ...]:
    """The parts that are missed, the largest share of the misfit first.

    Law: 2 sum |e|^2 of n complex residuals e follows chi2 with 2 n degrees of freedom under noise
    alone; degrees that the fit used up are shared out evenly.

    residuals : (K, 2, 2) of each point, whitened. left : degrees of freedom by measured number.
    scale : factor on the standard deviation of the noise.
    """
    whole = sum(float((np.abs(one) ** 2).sum()) for one in residuals)
    misses = []
    for point, residual in zip(points, residuals, strict=True):
        for edges, entry, square, count in by_part(point.frequency, np.abs(residual) ** 2):
            z = normal_score(square / scale**2 / left, 2 * count)
            if z > LEAST_Z:
                misses.append(
                    LocatedMisfit(
                        point.op.name, edges, entry, square / whole if whole > 0 else 0.0, z
                    )
                )
    return tuple(sorted(misses, key=lambda one: -one.share)[:MOST])


def by_part(
    frequency: np.ndarray, square: np.ndarray
) -> Iterator[tuple[tuple[float, float], str, float, int]]:
    """Edges of a band (Hz) and entry of the matrix, the sum there of `square` (K, 2, 2), and how
    many frequencies it is over.
    """
    bands = band_index(frequency)
    for band in np.unique(bands):
        inside = bands == band
        edges = (float(frequency[inside][0]), float(frequency[inside][-1]))
        for entry, (i, j) in ENTRIES.items():
            yield edges, entry, float(square[inside, i, j].sum()), int(inside.sum())
