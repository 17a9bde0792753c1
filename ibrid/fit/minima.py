"""Other minima that the noise does not exclude: a fit with a weakly seen inner loop has several, and the best of one draw of
noise need not be that of the next. What the covariance of one minimum says is then too narrow.

A minimum whose chi2 lies D above that of the best has the relative likelihood exp(-D / 2). Answers of the model are spread
about that of the best by the second moment of the mixture, sum over minima of exp(-D / 2) (y_k - y)^2, beside the linear
spread. Starts that end at equal responses, twins among them, are one minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.multistart import Solution
from ibrid.fit.problem import Problem

#: Minima with a chi2 this far above the best weigh 2 % and are left out.
FARTHEST = 8.0
#: Norm of the difference of two responses, in standard deviations of the noise, below which they are one minimum.
SAME = 0.3
#: So many are kept, the likeliest.
MOST = 12


@dataclass(frozen=True, eq=False)
class Minimum:
    """x (P,) and the chi2 above that of the reported answer (at least 0)."""

    x: np.ndarray
    above: float


def other_minima(problem: Problem, solution: Solution, deviations: Sequence[np.ndarray]) -> tuple[Minimum, ...]:
    """Ends of a fit within `FARTHEST` of its answer, the likeliest first; `deviations` (K, 2, 2) of the noise by point."""

    def whitened(x: np.ndarray) -> np.ndarray:
        rows = [
            ((response - point.admittance) / deviation).ravel()
            for response, point, deviation in zip(problem.responses(x), problem.points, deviations, strict=True)
        ]
        return np.concatenate(rows)

    best = whitened(solution.x)
    chi2 = float((np.abs(best) ** 2).sum())
    worth = float(np.mean(solution.errors)) * (1.0 + 2.0 * FARTHEST / max(chi2, 1.0))
    found = [
        (end.x, residual, max(float((np.abs(residual) ** 2).sum()) - chi2, 0.0))
        for end in solution.finished
        if end.error <= worth and np.isfinite(residual := whitened(end.x)).all()
    ]
    kept, seen = [], [best]
    for x, residual, above in sorted(found, key=lambda end: end[2]):
        if above < FARTHEST and len(kept) < MOST and min(np.linalg.norm(residual - other) for other in seen) > SAME:
            kept.append(Minimum(x, above))
            seen.append(residual)
    return tuple(kept)
