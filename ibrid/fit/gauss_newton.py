"""Damped Gauss-Newton on a batch of starts at once, inside the boxes.

(J'J + lambda c I) dx = -J'r with the cost c: in logarithmic coordinates every parameter is of size one, so the identity
is the right metric, and the damping fades as the fit gets better.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ibrid.fit.problem import Coordinates

LARGEST_STEP = 2.0
FIRST_DAMPING, LEAST_DAMPING, GREATEST_DAMPING = 1e-2, 1e-9, 1e6


class Minimised(Protocol):
    """What can be descended: a fitting problem, or one with terms of its own beside the data."""

    @property
    def coordinates(self) -> Coordinates: ...

    def normal_equations(self, x: np.ndarray, objective: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Costs (S, M), gradients (S, M, P) and Gauss-Newton matrices (S, M, P, P) of starts x (S, P)."""
        ...


@dataclass
class Batch:
    """Starts under way: x (S, P), cost (S,), damping (S,), and the normal equations at x."""

    x: np.ndarray
    cost: np.ndarray
    damping: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    done: np.ndarray

    def best(self, number: int) -> "Batch":
        """The `number` starts of least cost."""
        order = np.argsort(self.cost, kind="stable")[:number]
        return Batch(
            self.x[order],
            self.cost[order],
            self.damping[order],
            self.gradient[order],
            self.hessian[order],
            self.done[order],
        )


def begin(problem: Minimised, x: np.ndarray, objective: str) -> Batch:
    """Evaluate starts x (S, P)."""
    x = np.clip(x, problem.coordinates.x_low, problem.coordinates.x_high)
    cost, gradient, hessian = _totals(problem, x, objective)
    starts = len(x)
    return Batch(x, cost, np.full(starts, FIRST_DAMPING), gradient, hessian, ~np.isfinite(cost))


def descend(problem: Minimised, batch: Batch, objective: str, iterations: int, *, floor: float = 1e-14) -> Batch:
    """Up to `iterations` steps of every start that is not done; done means a tiny step, a tiny gain or cost < floor.

    Changes the batch that it is given and returns it.
    """
    low, high = problem.coordinates.x_low, problem.coordinates.x_high
    stalled = np.zeros(len(batch.x), dtype=int)
    for _ in range(iterations):
        active = np.flatnonzero(~batch.done)
        if not active.size:
            break
        x, cost = batch.x[active], batch.cost[active]
        step = _steps(batch.gradient[active], batch.hessian[active], batch.damping[active] * cost, x, low, high)
        trial = np.clip(x + step, low, high)
        trial_cost, trial_gradient, trial_hessian = _totals(problem, trial, objective)
        better = trial_cost < cost
        gain = np.where(better, cost - trial_cost, 0.0)
        taken, kept = active[better], active[~better]
        batch.x[taken], batch.cost[taken] = trial[better], trial_cost[better]
        batch.gradient[taken], batch.hessian[taken] = trial_gradient[better], trial_hessian[better]
        batch.damping[taken] = np.maximum(batch.damping[taken] / 5.0, LEAST_DAMPING)
        batch.damping[kept] *= 6.0
        stalled[active] = np.where(
            better & (gain < 1e-7 * cost), stalled[active] + 1, np.where(better, 0, stalled[active])
        )
        size = np.abs(trial - x).max(axis=1) if x.shape[1] else np.zeros(len(active))
        batch.done[active] = (
            (batch.cost[active] < floor)
            | (stalled[active] >= 3)
            | (batch.damping[active] > GREATEST_DAMPING)
            | (size < 1e-12)
        )
    return batch


def _totals(problem: Minimised, x: np.ndarray, objective: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    cost, gradient, hessian = problem.normal_equations(x, objective)
    total = cost.sum(axis=1)
    total[~np.isfinite(total)] = np.inf
    return total, gradient.sum(axis=1), hessian.sum(axis=1)


def _steps(gradient, hessian, damping, x, low, high) -> np.ndarray:
    """Damped steps; a coordinate at its bound that would be pushed out is held."""
    held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
    size = x.shape[1]
    matrix = hessian + (damping[:, None] + 1e-300)[:, :, None] * np.eye(size)
    matrix[held[:, :, None] | held[:, None, :]] = 0.0
    diagonal = np.einsum("sii->si", matrix)
    diagonal[held | ~(diagonal > 0)] = 1.0
    right = np.where(held, 0.0, -gradient)
    try:
        step = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # one singular matrix; the others must not feel it
        step = np.array([_solve_one(*one) for one in zip(matrix, right, diagonal, strict=True)])
    largest = np.abs(step).max(axis=1, initial=0.0)
    return step * np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]


def _solve_one(matrix: np.ndarray, right: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return right / diagonal
