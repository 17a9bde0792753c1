"""Seeds from vector fitting: the poles of the measured response rank the starts of a fit, as in the paper."""

import numpy as np

from ibrid.fit.problem import Problem
from ibrid.measurement.vector_fit import fitted_poles

#: Poles of the rational fit at most, and frequencies for each.
POLES, FREQUENCIES = 11, 2


def measured_poles(problem: Problem) -> list[np.ndarray]:
    """Stable poles (rad/s) of a rational fit to each operating point's four entries."""
    found = []
    for point in problem.points:
        order = min(POLES, len(point.frequency) // FREQUENCIES)
        poles = fitted_poles(point.frequency, point.admittance, order) if order else np.zeros(0, dtype=complex)
        found.append(poles[np.abs(poles) > 0])
    return found


def pole_distances(problem: Problem, x: np.ndarray, measured: list[np.ndarray]) -> np.ndarray:
    """Sum over measured poles of |log(pole / nearest model pole)|, for starts x (S, P) -> (S,)."""
    total = np.zeros(len(x))
    for m, poles in enumerate(measured):
        model = np.linalg.eigvals(problem.state_matrices(x, m)).astype(complex)
        model = np.where(np.abs(model) > 0, model, 1e-9)
        upper = np.where(np.imag(model) < 0, np.conj(model), model)
        ratio = poles[None, :, None] / upper[:, None, :]
        total += np.hypot(np.log(np.abs(ratio)), np.angle(ratio)).min(axis=2).sum(axis=1)
    return total
