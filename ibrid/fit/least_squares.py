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
from typing import Any, Protocol, cast

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


class CurvedSumOfSquares(SumOfSquares, Protocol):
    """A sum of squared residuals whose curvature along a step costs no more than its residuals."""

    def projected(self, x: np.ndarray, points: Points) -> np.ndarray:
        """Return J'r (S, P) of the residuals r at x (S, P) and the slopes J at points near by; not
        a number where there is no response.
        """
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


#: Factors on the damping after a successful and after a failed step of a descent by straight steps.
SHRINK, GROW = 5.0, 6.0
#: Of one with acceleration: the least factor after a successful step (Nielsen, IMM-REP-1999-05),
#: and the factor after a failed one, which doubles with each further failure.
LEAST_FACTOR, DOUBLE = 1.0 / 3.0, 2.0
#: Part of a step at whose end the residuals are evaluated for their curvature.
PROBED = 0.1
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

    `acceleration` : length of a geodesic acceleration over that of its step, up to which it is
    added (Transtrum & Sethna, arXiv:1201.5885); 0 for straight steps. With it lambda follows the
    gain ratio: it is multiplied by max(`LEAST_FACTOR`, 1 - (2 ratio - 1)^3) after a successful
    step. It asks for a `CurvedSumOfSquares`.
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
    acceleration: float = 0.0

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
        growth = np.full(len(points.x), DOUBLE)
        for _ in range(steps):
            heed_interrupt()
            active = np.flatnonzero(ended == Ending.NONE)
            if not active.size:
                break
            now = points.only(active)
            system = self._damped(model, now, damping[active])
            step = self._shortened(system.solve(-system.gradient))
            promised = system.promised(step)
            if self.enough or self.small:
                idle = (promised < self.enough * now.cost + self.small) & (
                    damping[active] <= self.trusted
                )
                ended[active[idle]] = Ending.NOT_WORTH
                if idle.all():
                    continue
                active, now, system = active[~idle], now.only(~idle), system.only(~idle)
                step, promised = step[~idle], promised[~idle]
            if self.acceleration:
                step = self._accelerated(cast(CurvedSumOfSquares, model), now, system, step)
            trial = model.at(np.clip(now.x + step, low, high), now)
            better = trial.cost < now.cost
            taken = active[better]
            kept = active[~better]
            gain = np.where(better, now.cost - trial.cost, 0.0)
            for mine, new in zip(_arrays(points), _arrays(trial), strict=True):
                mine[taken] = new[better]
            ratio = gain[better] / promised[better]
            if self.acceleration:
                damping[taken] *= np.maximum(LEAST_FACTOR, 1.0 - (2.0 * ratio - 1.0) ** 3)
            else:
                damping[taken] /= SHRINK
            damping[taken] = np.maximum(damping[taken], self.least)
            growth[taken] = DOUBLE
            damping[kept] *= growth[kept] if self.acceleration else GROW
            growth[kept] *= DOUBLE
            stalling = np.where(gain < self.stall * now.cost, stalled[active] + 1, 0)
            stalled[active] = np.where(better, stalling, stalled[active])
            step_size = np.abs(trial.x - now.x).max(axis=1, initial=0.0)
            ended[active[step_size < NO_STEP]] = Ending.STILL
            ended[active[damping[active] > self.greatest]] = Ending.DAMPED
            ended[active[stalled[active] >= STALLED_STEPS]] = Ending.STALLED
            ended[active[points.cost[active] < self.floor]] = Ending.EXACT
        return Batch(points, damping, ended)

    def _damped(self, model: SumOfSquares, now: Points, damping: np.ndarray) -> "DampedSystem":
        """Return (H + D) h = -g; coordinates at a bound beyond which the cost falls are held."""
        low, high = model.box
        gradient, hessian = model.normal(now)
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
        return DampedSystem(gradient, hessian, matrix, held)

    def _shortened(self, step: np.ndarray) -> np.ndarray:
        """Return steps (S, P) of at most `largest` in each coordinate."""
        longest = np.abs(step).max(axis=1, initial=0.0)
        return step * np.minimum(1.0, self.largest / np.maximum(longest, 1e-300))[:, None]

    def _accelerated(
        self, model: CurvedSumOfSquares, now: Points, system: "DampedSystem", step: np.ndarray
    ) -> np.ndarray:
        """Return steps (S, P) with their geodesic acceleration, where it is small beside them.

        The residuals at a tenth of the step give their second derivative along it,
        r_vv ~ 2 ((r(x + t h) - r(x)) / t - J h) / t, of which J'r_vv is all that is needed.
        """
        low, high = model.box
        probe = np.clip(now.x + PROBED * step, low, high)
        change = (model.projected(probe, now) - system.gradient) / PROBED
        along = np.einsum("sij,sj->si", system.hessian, step)
        bend = 0.5 * system.solve(-2.0 / PROBED * (change - along))
        longest = self.acceleration * np.linalg.norm(step, axis=1)
        usable = np.linalg.norm(bend, axis=1) <= longest
        return np.where(usable[:, None], step + bend, step)


@dataclass(frozen=True, eq=False)
class DampedSystem:
    """Hold the linear systems (H + D) h = right of some starts.

    gradient : g (S, P). hessian : H (S, P, P). matrix : H + D (S, P, P), where held coordinates
    have no coupling. held : (S, P), True where a coordinate does not move.
    """

    gradient: np.ndarray
    hessian: np.ndarray
    matrix: np.ndarray
    held: np.ndarray

    def only(self, chosen: np.ndarray) -> "DampedSystem":
        """Return the systems of some of the starts, by index or mask."""
        parts = self.gradient, self.hessian, self.matrix, self.held
        return DampedSystem(*(part[chosen] for part in parts))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return h (S, P), none in held coordinates."""
        right = np.where(self.held, 0.0, right)
        try:
            return np.linalg.solve(self.matrix, right[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:  # one singular matrix; the others must not feel it
            return np.array([*map(_solve_or_scale, self.matrix, right)])

    def promised(self, step: np.ndarray) -> np.ndarray:
        """Return the decrease (S,) of the cost that the quadratic model promises for steps."""
        return -2.0 * (self.gradient * step).sum(axis=1) - np.einsum(
            "si,sij,sj->s", step, self.hessian, step
        )


#: For coordinates that are logarithms, and residuals that are relative or whitened: short descents,
#: and long ones to convergence, which follow curved valleys.
LEVENBERG, GEODESIC = Descent(), Descent(acceleration=0.75)


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


def _solve_or_scale(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve one system; a singular one by its diagonal alone."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return right / np.diag(matrix)
