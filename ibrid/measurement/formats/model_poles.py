"""The poles of a state space, and what is said of a model that is read as its response."""

import numpy as np
from scipy.linalg import eigvals

from ibrid.errors import SweepError

#: How the words begin.
MODEL = "a state space of order "
#: Damping below which a pole is named; Hz below which one stands still.
_DAMPED, _STILL = 0.05, 1e-9
#: A pencil s E - A is singular where its determinant is so small a part of what its rows allow, at
#: so many points.
_SINGULAR, _POINTS = 1e-12, (1.0 + 0.7j, -3.0 + 40.0j, 500.0 + 900.0j)
#: A generalised eigenvalue b / a with an a smaller than this part of b is at infinity: a row of E
#: without a derivative.
_INFINITE = 1e-12


def poles_of(a: np.ndarray, mass: np.ndarray, where: str) -> np.ndarray:
    """The finite roots of det(s E - A), 1/s (or z of a sampled model).

    a, mass : (n, n). Rows of E may have no derivative; SweepError where s E - A is singular for
    every s, so that the model has no response.
    """
    if not len(a):
        return np.zeros(0, dtype=complex)
    if all(_is_singular(s * mass - a) for s in _POINTS):
        raise SweepError(
            f"{where}: s E - A must be invertible for some s; found a descriptor system whose E "
            "and A leave a state without an equation, export its explicit form: in MATLAB "
            "sys = ss(sys, 'explicit'), in Simulink linmod."
        )
    above, below = np.asarray(eigvals(a, mass, homogeneous_eigvals=True))
    finite = np.abs(below) > _INFINITE * np.abs(above)
    return above[finite] / below[finite]


def model_words(order: int, poles: np.ndarray, period: float, grid: np.ndarray) -> str:
    """Order, poles and grid of a model of which the response is taken.

    period : s between the samples of a discrete one, 0 of a continuous one. grid : (K,) Hz.
    """
    sampled = f"sampled at {len(grid)} frequencies, {grid[0]:g} to {grid[-1]:g} Hz"
    return f"{MODEL}{order}, {_pole_words(poles, period)}, {sampled}"


def _pole_words(poles: np.ndarray, period: float) -> str:
    """The slowest and the fastest pole, the least damped, and those that are unstable."""
    poles = np.log(poles[poles != 0] + 0j) / period if period else poles
    sizes = np.sort(np.abs(poles)) / (2 * np.pi)
    moving = sizes[sizes > _STILL]
    if not len(moving):
        return "with poles at zero alone"
    words = f"poles from {moving[0]:.3g} to {moving[-1]:.3g} Hz"
    unstable = poles[np.real(poles) > _STILL * np.abs(poles).max()]
    if len(unstable):
        at = abs(unstable[0]) / (2 * np.pi)
        return f"{words}, {len(unstable)} of them UNSTABLE (at {at:.3g} Hz)"
    moves = np.abs(poles) > 2 * np.pi * _STILL
    damping = -np.real(poles[moves]) / np.abs(poles[moves])
    least = int(np.argmin(damping))
    if damping[least] < _DAMPED:
        at = abs(poles[moves][least]) / (2 * np.pi)
        words += (
            f", the least damped at {at:.3g} Hz ({100 * max(float(damping[least]), 0.0):.2g} %)"
        )
    return words


def _is_singular(matrix: np.ndarray) -> bool:
    """Whether rows of a matrix are linearly dependent, each counted at its own size."""
    sizes = np.linalg.norm(matrix, axis=1)
    if not sizes.all():
        return True
    return bool(np.linalg.svd(matrix / sizes[:, None], compute_uv=False)[-1] < _SINGULAR)
