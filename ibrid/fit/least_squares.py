"""Levenberg-Marquardt with bounds on a batch of starts at once: the local descent of every fit.

Law: c(x) = |r(x)|^2 is minimised. With J = dr/dx, g = J'r and H = J'J (Gauss-Newton),

    c(x + h) ~ c + 2 g'h + h'H h,   (H + D) h = -g,

with a damping D > 0 that grows after a failed step and falls after a successful one, so that no
line search is needed:

- Levenberg, D = lambda c I: the coordinates are logarithms and of size one; the damping vanishes
  with the cost, so that exact fits converge quadratically;
- Marquardt, D = lambda diag(H): invariant to the scale of each coordinate; what the data do not
  identify hardly moves.

Bounds: a coordinate at a bound beyond which c falls is fixed for the step (active set by the sign
of the gradient); steps are clipped to the bounds and to `Descent.largest` in each coordinate.

Source: Nocedal & Wright, Numerical Optimization, 2006, sections 10.3 and 16.7. Weak side: the
normal equations square the condition number of J. Directions with singular values below about
1e-8 of the largest are lost in rounding; they count as non-identifiable here
(`ibrid.fit.identifiability` works on J itself), and Ipopt polishes the end.

`Descent`, `Points` and `Batch` are values: a caller descends some steps, keeps the best, goes on.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Protocol

import numpy as np

from ibrid.interrupts import heed_interrupt


@dataclass(frozen=True, eq=False)
class Points:
    """Hold points x (S, P) with their cost (S,), infinite where the model has no response.

    `carried` : what the model keeps for its derivatives, arrays with S as their first axis.
    """

    x: np.ndarray
    cost: np.ndarray
    carried: tuple[np.ndarray, ...] = ()

    def only(self, chosen: np.ndarray) -> "Points":
        """Return some of the points, by index or mask."""
        return Points(
            self.x[chosen], self.cost[chosen], tuple(part[chosen] for part in self.carried)
        )


class SumOfSquares(Protocol):
    """A sum of squared residuals with bounds: of data and prior, in standard deviations or
    relative.
    """

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and the upper bounds of x, (P,) each."""
        ...

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate the cost at x (S, P).

        near : nearby points, (S, P), from which an iterative evaluation may start.
        """
        ...

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return g = J'r (S, P) and H = J'J (S, P, P) at points that `at` returned."""
        ...


class Ending(IntEnum):
    """The reason for which a descent ended; NONE while it goes on."""

    NONE = 0
    NO_RESPONSE = 1
    EXACT = 2
    STALLED = 3
    DAMPED = 4
    STILL = 5
    NOT_WORTH = 6


@dataclass(frozen=True, eq=False)
class Batch:
    """Hold descents: `points`, their `damping` lambda (S,), and `ended` (S,) of `Ending`."""

    points: Points
    damping: np.ndarray
    ended: np.ndarray

    @property
    def x(self) -> np.ndarray:
        """Return the coordinates (S, P)."""
        return self.points.x

    @property
    def cost(self) -> np.ndarray:
        """Return the costs (S,)."""
        return self.points.cost

    def best(self, number: int) -> "Batch":
        """Return the `number` starts of least cost, the best first."""
        order = np.argsort(self.cost, kind="stable")[:number]
        return Batch(self.points.only(order), self.damping[order], self.ended[order])


#: Factors on the damping after a successful and after a failed step.
SHRINK, GROW = 5.0, 6.0
#: Successful steps in a row with a negligible decrease, after which a descent has stalled.
STALLED_STEPS = 3
#: Change of every coordinate below which a step is none.
NO_STEP = 1e-12


@dataclass(frozen=True)
class Descent:
    """Hold the settings of a descent.

    `marquardt` : True for D = lambda diag(H), False for D = lambda c I. `damping` : initial lambda.
    It is divided by `SHRINK` after a successful step, to `least` at most, and multiplied by `GROW`
    after a failed one; beyond `greatest` the descent ends. `largest` : change of a coordinate in a
    step, at most. `floor` : cost below which the fit is exact. `stall` : relative decrease of the
    cost; `STALLED_STEPS` smaller ones in a row end the descent. `enough`, `small` : a step whose
    predicted decrease is below enough x cost + small ends it too, if lambda is at most `trusted`.
    """

    marquardt: bool = False
    damping: float = 1e-2
    least: float = 1e-9
    greatest: float = 1e6
    largest: float = 2.0
    floor: float = 1e-14
    stall: float = 1e-7
    enough: float = 0.0
    small: float = 0.0
    trusted: float = 1e-2

    def begin(self, model: SumOfSquares, x: np.ndarray) -> Batch:
        """Evaluate starts x (S, P), clipped to the bounds."""
        return self.start(model.at(np.clip(x, *model.box)))

    def start(self, points: Points) -> Batch:
        """Begin descents at points that a model has evaluated."""
        lost = ~np.isfinite(points.cost)
        return Batch(
            points,
            np.full(len(points.x), self.damping),
            np.where(lost, Ending.NO_RESPONSE, Ending.NONE),
        )

    @np.errstate(
        over="ignore", invalid="ignore"
    )  # a start that overflows has an infinite cost, and is not taken
    def go(self, model: SumOfSquares, batch: Batch, steps: int) -> Batch:
        """Descend up to so many steps from every start that has not ended."""
        low, high = model.box
        points = replace(
            batch.points,
            x=batch.x.copy(),
            cost=batch.cost.copy(),
            carried=tuple(part.copy() for part in batch.points.carried),
        )
        damping, ended = batch.damping.copy(), batch.ended.copy()
        stalled = np.zeros(len(points.x), dtype=int)
        for _ in range(steps):
            heed_interrupt()
            active = np.flatnonzero(ended == Ending.NONE)
            if not active.size:
                break
            now = points.only(active)
            gradient, hessian = model.normal(now)
            step = self._steps(now, gradient, hessian, damping[active], low, high)
            if self.enough or self.small:
                promised = -2.0 * (gradient * step).sum(axis=1) - np.einsum(
                    "si,sij,sj->s", step, hessian, step
                )
                idle = (promised < self.enough * now.cost + self.small) & (
                    damping[active] <= self.trusted
                )
                ended[active[idle]] = Ending.NOT_WORTH
                active, now, step = active[~idle], now.only(~idle), step[~idle]
                if not active.size:
                    continue
            trial = model.at(np.clip(now.x + step, low, high), now)
            better = trial.cost < now.cost
            gain = np.where(better, now.cost - trial.cost, 0.0)
            taken = active[better]
            kept = active[~better]
            for mine, new in zip(_arrays(points), _arrays(trial), strict=True):
                mine[taken] = new[better]
            damping[taken] = np.maximum(damping[taken] / SHRINK, self.least)
            damping[kept] *= GROW
            stalling = np.where(gain < self.stall * now.cost, stalled[active] + 1, 0)
            stalled[active] = np.where(better, stalling, stalled[active])
            step_size = np.abs(trial.x - now.x).max(axis=1, initial=0.0)
            ended[active[step_size < NO_STEP]] = Ending.STILL
            ended[active[damping[active] > self.greatest]] = Ending.DAMPED
            ended[active[stalled[active] >= STALLED_STEPS]] = Ending.STALLED
            ended[active[points.cost[active] < self.floor]] = Ending.EXACT
        return Batch(points, damping, ended)

    def _steps(
        self,
        now: Points,
        gradient: np.ndarray,
        hessian: np.ndarray,
        damping: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
    ) -> np.ndarray:
        """Solve (H + D) h = -g for the steps h (S, P); coordinates fixed at a bound have none."""
        held = ((now.x <= low) & (gradient > 0)) | ((now.x >= high) & (gradient < 0))
        diagonal = np.where(held, 0.0, np.einsum("sii->si", hessian))
        if self.marquardt:
            hold = (
                damping[:, None] * (diagonal + 1e-6 * diagonal.max(axis=1, initial=0.0)[:, None])
                + 1e-12
            )
        else:
            hold = (damping * now.cost)[:, None] + 1e-300
        matrix = hessian + hold[:, :, None] * np.eye(hessian.shape[1])
        matrix[held[:, :, None] | held[:, None, :]] = 0.0
        diagonal = np.einsum("sii->si", matrix)
        diagonal[held | ~(diagonal > 0)] = 1.0
        right = np.where(held, 0.0, -gradient)
        try:
            step = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:  # one singular matrix; the others must not feel it
            step = np.array(
                [_solve_or_scale(*start) for start in zip(matrix, right, diagonal, strict=True)]
            )
        longest = np.abs(step).max(axis=1, initial=0.0)
        return step * np.minimum(1.0, self.largest / np.maximum(longest, 1e-300))[:, None]


#: For coordinates that are logarithms, and residuals that are relative or whitened.
LEVENBERG = Descent()


def carried(states: Iterable[Any]) -> tuple[np.ndarray]:
    """Pack objects of a model, one for each start, as `Points.carried`."""
    states = list(states)
    kept = np.empty(len(states), dtype=object)
    kept[:] = states
    return (kept,)


def evaluated(
    x: np.ndarray, evaluate: Callable[[np.ndarray, Any], Any], beginnings: Sequence[Any] | None
) -> Points:
    """Evaluate each x (S, P) by itself, from a beginning of its own or from None.

    evaluate : returns an object with its `cost`, which the points carry; None for an infinite one.
    """
    pairs = zip(x, beginnings or [None] * len(x), strict=True)
    states = [evaluate(*pair) for pair in pairs]
    costs = [np.inf if state is None else state.cost for state in states]
    return Points(x, np.array(costs), carried(states))


def _arrays(points: Points) -> tuple[np.ndarray, ...]:
    """Return all arrays of points; S is the first axis of each."""
    return points.x, points.cost, *points.carried


def _solve_or_scale(matrix: np.ndarray, right: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """Solve one system; a singular one by its diagonal alone."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return right / diagonal
