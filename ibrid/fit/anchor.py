"""Among parameter values that no data can tell apart, those nearest to textbook values.

Where a direction of x changes no response (the scale of an inner loop with unit feedforward, say)
the optimum is a line, and which of its points a solver returns is chance. The point nearest to the
typical values is reported instead. Where the noise is known, directions that it hides are as good
as invisible: there a value lies within a `DECADE` of what is typical, as far as nothing is seen of
it.
"""

from collections.abc import Sequence
from math import log

import numpy as np

from ibrid.fit.problem import Problem
from ibrid.measurement.sweeps.sweep import PointSweep

#: Singular values of the scaled Jacobian below this part of the largest are zero.
NULL = 1e-9
#: Relative rise of the cost that still counts as no change.
NO_CHANGE = 1e-6
#: One standard deviation of the logarithm of a positive number around its typical value.
DECADE = log(10.0)


class Decades:
    """Positive numbers that all operating points share lie within a `DECADE` of their typical
    values; `Believed`.
    """

    def __init__(self, problem: Problem) -> None:
        self._typical, parameters = problem.typical, [one.parameter for one in problem.numbers]
        believed = [
            one.logarithmic and not one.local and one.tolerance is None for one in parameters
        ]
        self._weight = np.array(believed, dtype=float) / DECADE

    def penalty_terms(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sum of the squared standard deviations (S,), half its gradient and its curvature (S, P),
        at x (S, P).
        """
        away = (x - self._typical) * self._weight
        return (
            (away**2).sum(axis=-1),
            away * self._weight,
            np.broadcast_to(self._weight**2, x.shape),
        )


def nearest(
    problem: Problem,
    x: np.ndarray,
    target: np.ndarray,
    objective: str,
    *,
    ignoring: Sequence[int] = (),
) -> np.ndarray:
    """Move x (P,) along the null directions of the responses towards `target` (P,), inside the
    boxes.

    ignoring : entries whose distance from the target does not count.
    """
    coordinates = problem.coordinates
    counted = np.setdiff1d(np.arange(problem.size), ignoring)
    for _ in range(3):
        directions = null_directions(problem, x)
        if not directions.shape[1]:
            return x
        step = (
            directions @ np.linalg.lstsq(directions[counted], (target - x)[counted], rcond=None)[0]
        )
        room = np.where(
            step > 0, coordinates.x_high - x, np.where(step < 0, x - coordinates.x_low, np.inf)
        )
        moving = np.abs(step) > 1e-12
        if not moving.any():
            return x
        part = min(1.0, float((room[moving] / np.abs(step[moving])).min()))
        trial = x + part * step
        before, after = problem.costs(np.stack([x, trial]), objective).sum(axis=1)
        if not np.isfinite(after) or after > before * (1 + NO_CHANGE) + 1e-20:
            return x
        x = trial
    return x


def null_directions(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Directions of x that change no response, as orthonormal columns (P, number)."""
    if not problem.size:
        return np.zeros((0, 0))
    jacobian = problem.white_slopes(x, map(frobenius, problem.points))
    if not np.isfinite(jacobian).all():
        return np.zeros((problem.size, 0))
    values, right = right_singular_vectors(jacobian)
    return right[values <= NULL * values[0]].T


def frobenius(point: PointSweep) -> np.ndarray:
    """|Y|_F at each frequency, (K, 1, 1)."""
    return np.linalg.norm(point.admittance, axis=(1, 2))[:, None, None]


def right_singular_vectors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All P singular values, zeros included, and right singular vectors as rows (P, P) of a tall
    matrix (n, P).
    """
    size = matrix.shape[1]
    _, values, right = np.linalg.svd(np.linalg.qr(matrix, mode="r"), full_matrices=True)
    return np.concatenate([values, np.zeros(size - len(values))]), right
