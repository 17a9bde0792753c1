"""Damped Gauss-Newton (Levenberg, Marquardt) inside a box, on a batch of starts at once: the one
descent of every fit.

A model of the data answers a point x with c(x) = |r(x)|^2 and, with J = dr/dx, with g = J'r and H =
J'J. To first order

    c(x + h) = c + 2 g'h + h'H h,   least where H h = -g,

which is exact for a linear residual and too bold far from the minimum. A damping D > 0 holds the
step back, (H + D) h = -g: it is then a piece of steepest descent where D is large, Gauss-Newton
where D is small, and always downhill. D falls after a step that helped and grows after one that did
not, so no line search is needed. D says what "short" means:

- Levenberg, D = lambda c I: all coordinates are of size one, as logarithms are, and the damping
  fades with the misfit;
- Marquardt, D = lambda diag(H): what the data do not see hardly moves, whatever the units are.

A coordinate at a bound beyond which c falls is held; no coordinate moves further than
`Descent.largest` in a step. A `Descent` is a value, as are its batches: a search takes one and
steps as far as it likes, keeps the best, goes on.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Protocol

import numpy as np

from ibrid.interrupts import heed_interrupt


@dataclass(frozen=True, eq=False)
class Points:
    """Points x (S, P) and their cost (S,), infinite where there is no response.

    `carried` : what the model keeps of each, arrays with S as their first axis.
    """

    x: np.ndarray
    cost: np.ndarray
    carried: tuple[np.ndarray, ...] = ()

    def only(self, chosen: np.ndarray) -> "Points":
        """Some of them, by number or mask."""
        return Points(
            self.x[chosen], self.cost[chosen], tuple(part[chosen] for part in self.carried)
        )


class SumOfSquares(Protocol):
    """What can be descended: residuals in standard deviations, or relative ones, of data and of
    what is believed.
    """

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest x, (P,) each."""
        ...

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P); near : as many points close by, of which what is iterated may
        begin.
        """
        ...

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g (S, P) and H (S, P, P) at points that `at` returned."""
        ...


class Ending(IntEnum):
    """Why a start goes no further."""

    NONE = 0
    NO_RESPONSE = 1
    EXACT = 2
    STALLED = 3
    DAMPED = 4
    STILL = 5
    NOT_WORTH = 6


@dataclass(frozen=True, eq=False)
class Batch:
    """Starts under way: `points`, their `damping` (S,), and why they ended, `ended` (S,) of
    `Ending`.
    """

    points: Points
    damping: np.ndarray
    ended: np.ndarray

    @property
    def x(self) -> np.ndarray:
        """(S, P)."""
        return self.points.x

    @property
    def cost(self) -> np.ndarray:
        """(S,)."""
        return self.points.cost

    def best(self, number: int) -> "Batch":
        """The `number` starts of least cost, the best first."""
        order = np.argsort(self.cost, kind="stable")[:number]
        return Batch(self.points.only(order), self.damping[order], self.ended[order])


@dataclass(frozen=True)
class Descent:
    """How a sum of squares is descended.

    `marquardt` : True for that metric, False for Levenberg's. `damping` : the first lambda, which
    falls by 5 to `least` at most, grows by 6, and ends a start beyond `greatest`. `largest` :
    change of a coordinate in one step. `floor` : cost below which a start is exact; three gains in
    a row below `stall` of the cost end it, too. `enough`, `small` : a step that promises no more
    than enough times the cost and small is not worth taking, where its lambda is `trusted` at most.
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
        """Evaluate starts x (S, P), moved into the box."""
        return self.start(model.at(np.clip(x, *model.box)))

    def start(self, points: Points) -> Batch:
        """Points that a model has evaluated, as starts."""
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
        """Up to so many steps of every start that has not ended."""
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
            taken, kept = active[better], active[~better]
            for mine, new in zip(_arrays(points), _arrays(trial), strict=True):
                mine[taken] = new[better]
            damping[taken] = np.maximum(damping[taken] / 5.0, self.least)
            damping[kept] *= 6.0
            stalling = np.where(gain < self.stall * now.cost, stalled[active] + 1, 0)
            stalled[active] = np.where(better, stalling, stalled[active])
            ended[active[np.abs(trial.x - now.x).max(axis=1, initial=0.0) < 1e-12]] = Ending.STILL
            ended[active[damping[active] > self.greatest]] = Ending.DAMPED
            ended[active[stalled[active] >= 3]] = Ending.STALLED
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
        """Damped steps (S, P); the held coordinates have none."""
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
                [_solved(*start) for start in zip(matrix, right, diagonal, strict=True)]
            )
        reach = np.abs(step).max(axis=1, initial=0.0)
        return step * np.minimum(1.0, self.largest / np.maximum(reach, 1e-300))[:, None]


#: In logarithms, on relative residuals or whitened ones.
LEVENBERG = Descent()


def carried(states: Iterable[Any]) -> tuple[np.ndarray]:
    """Objects of a model, one for each start, as `Points.carried`."""
    states = list(states)
    kept = np.empty(len(states), dtype=object)
    kept[:] = states
    return (kept,)


def _arrays(points: Points) -> tuple[np.ndarray, ...]:
    return points.x, points.cost, *points.carried


def _solved(matrix: np.ndarray, right: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return right / diagonal
