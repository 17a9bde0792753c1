"""One step of damped Gauss-Newton inside a box."""

import numpy as np


def damped_step(
    gradient: np.ndarray, matrix: np.ndarray, held: np.ndarray, damping: float, largest: float
) -> tuple[np.ndarray, float]:
    """The step (P,), no entry beyond `largest`, and the fall of the cost that it promises.

    gradient : (P,) half of it, matrix : (P, P) its Gauss-Newton matrix; both may be changed. held : (P,) coordinates at a
    bound beyond which the cost falls; they stay. damping : as in Levenberg and Marquardt, on the diagonal.
    """
    gradient = np.where(held, 0.0, gradient)
    matrix[held] = matrix[:, held] = 0.0
    diagonal = np.diag(matrix)
    damped = damping * (diagonal + 1e-6 * diagonal.max(initial=0.0)) + np.where(held, 1.0, 1e-12)
    step = -np.linalg.solve(matrix + np.diag(damped), gradient)
    step *= min(1.0, largest / max(np.abs(step).max(initial=0.0), 1e-300))
    return step, float(-2 * gradient @ step - step @ matrix @ step)


def held_at_bounds(x: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(P,) true where x lies at a bound and the cost falls beyond it."""
    return ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
