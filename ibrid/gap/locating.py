"""Where a refitted model misses the data: significance by operating point, band and entry of the matrix."""

from collections.abc import Iterator

import numpy as np

from ibrid.evaluation.grade import normal_score
from ibrid.fit.objective import BAND_EDGES, band_index
from ibrid.gap.refit import Refit
from ibrid.gap.result import Located
from ibrid.measurement.sweep import ENTRIES

#: Least significance, in standard deviations, of a part that is reported, and how many are.
LEAST_Z, MOST = 3.0, 12


def located(refit: Refit, scale: float = 1.0) -> tuple[Located, ...]:
    """The parts that are missed, the largest share of the misfit first.

    Law: 2 sum |e|^2 of n complex residuals e follows chi2 with 2 n degrees of freedom under noise alone; degrees that the
    fit used up are shared out evenly. `scale` : factor on the standard deviation of the noise.
    """
    left = refit.dof / refit.numbers
    whole = sum(float((np.abs(one) ** 2).sum()) for one in refit.residuals)
    misses = []
    for op, frequency, band, entry, square, count in _parts(refit):
        z = normal_score(square / scale**2 / left, 2 * count)
        if z > LEAST_Z:
            inside = frequency[band]
            edges = (float(inside[0]), float(inside[-1]))
            misses.append(Located(op, edges, entry, square / whole if whole > 0 else 0.0, z))
    return tuple(sorted(misses, key=lambda one: -one.share)[:MOST])


def whiteness(refit: Refit) -> float:
    """How much neighbouring residuals resemble each other, in standard deviations: beyond 4 it is no noise.

    Law: r = Re sum conj(e_k) e_k+1 / sum |e|^2 over all entries and points; r sqrt(2 n) is standard normal for white noise.
    """
    top = bottom = count = 0.0
    for residual in refit.residuals:
        top += float(np.real(np.conj(residual[:-1]) * residual[1:]).sum())
        bottom += float((np.abs(residual) ** 2).sum())
        count += residual[1:].size
    return top / bottom * np.sqrt(2.0 * count) if bottom > 0 else 0.0


def _parts(refit: Refit) -> Iterator[tuple[str, np.ndarray, np.ndarray, str, float, int]]:
    for point, residual in zip(refit.problem.points, refit.residuals, strict=True):
        bands = band_index(point.frequency)
        for band in range(len(BAND_EDGES) + 1):
            inside = bands == band
            if not inside.any():
                continue
            for number, entry in enumerate(ENTRIES):
                part = residual[inside, number // 2, number % 2]
                yield point.op.name, point.frequency, inside, entry, float((np.abs(part) ** 2).sum()), int(inside.sum())
