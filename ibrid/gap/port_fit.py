"""The fit of an open port: parameters by damped Gauss-Newton, the open transfer eliminated at every frequency.

The admittance is analytic in the transfer g and every real and imaginary part has one sigma, so least squares for g are
complex scalars: with a = W dY/dg and r = W (Y - data) the step is -a'r / a'a, and of the parameters there remains what is
orthogonal to a (variable projection; Golub and Pereyra 1973, in Kaufman's form).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.gap.open_port import Opened, OpenPort

#: Steps of every start, and of the best of them.
FIRST_STEPS, MOST_STEPS = 15, 60
LARGEST_STEP = 2.0
FIRST_DAMPING, LEAST_DAMPING, GREATEST_DAMPING = 1e-2, 1e-9, 1e8
#: Gains of the cost that end a fit: of its size, and at all.
ENOUGH, SMALL = 1e-5, 1e-3
MOST_ROUNDS = 12
#: 1 over the size of Delta that is as unlikely as one sigma: where the data do not see it, it stays small.
LARGE = 1e-3


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted: `data`, `weight` : (M, K, 2, 2), 1/sigma. `centre`, `precision` : (P,) of the prior in x; a
    parameter without one has precision 0."""

    data: np.ndarray
    weight: np.ndarray
    centre: np.ndarray
    precision: np.ndarray

    def misfit(self, response: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Residuals of a response (..., M, K, 2, 2) with g (..., K), the last one that of g: (..., K, 4M + 1)."""
        return self.rows(self.weight * (response - self.data), LARGE * (g - 1.0))

    def rows(self, white: np.ndarray, last: np.ndarray) -> np.ndarray:
        """(..., M, K, 2, 2) and (..., K) -> (..., K, 4M + 1)."""
        entries = np.moveaxis(white, -4, -3)
        return np.concatenate([entries.reshape(*entries.shape[:-3], -1), last[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class Fit:
    """A point of the search.

    `x` : (P,). `g` : (K,). `chi2` : of the data. `cost` : with the prior. `power` : (K,) a'a of the data alone, the
    information on each g. `gradient`, `information` : of the data by x, g eliminated. `follows` : (K, P), dg/dx.
    """

    x: np.ndarray
    g: np.ndarray
    chi2: float
    cost: float
    power: np.ndarray
    gradient: np.ndarray
    information: np.ndarray
    follows: np.ndarray


def fit_port(model: OpenPort, target: Target, starts: Sequence[np.ndarray]) -> Fit | None:
    """The best local optimum inside the boxes that starts x (P,) lead to; None where none has a response."""
    low, high = model.coordinates.x_low, model.coordinates.x_high
    begun = [evaluated(model, target, np.clip(x, low, high)) for x in starts]
    ended = [_descended(model, target, one, FIRST_STEPS) for one in begun if one is not None]
    if not ended:
        return None
    return _descended(model, target, min(ended, key=lambda one: one.cost), MOST_STEPS - FIRST_STEPS)


def _descended(model: OpenPort, target: Target, best: Fit, steps: int) -> Fit:
    low, high = model.coordinates.x_low, model.coordinates.x_high
    damping = FIRST_DAMPING
    for _ in range(steps):
        gradient = best.gradient + target.precision * (best.x - target.centre)
        matrix = best.information + np.diag(target.precision)
        held = ((best.x <= low) & (gradient > 0)) | ((best.x >= high) & (gradient < 0))
        gradient = np.where(held, 0.0, gradient)
        matrix[held] = matrix[:, held] = 0.0
        diagonal = np.diag(matrix)
        damped = damping * (diagonal + 1e-6 * diagonal.max(initial=0.0)) + np.where(held, 1.0, 1e-12)
        step = -np.linalg.solve(matrix + np.diag(damped), gradient)
        step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(initial=0.0), 1e-300))
        expected = -2 * gradient @ step - step @ matrix @ step
        if (expected < ENOUGH * best.chi2 + SMALL and damping <= FIRST_DAMPING) or damping > GREATEST_DAMPING:
            break
        trial = evaluated(model, target, np.clip(best.x + step, low, high), best.g)
        if trial is not None and trial.cost < best.cost:
            best, damping = trial, max(damping / 5.0, LEAST_DAMPING)
        else:
            damping *= 6.0
    return best


def evaluated(model: OpenPort, target: Target, x: np.ndarray, before: np.ndarray | None = None) -> Fit | None:
    """The fit at x (P,) with the best g, also tried from the one `before`; None where the model has no response."""
    theta = model.coordinates.to_theta(x)
    opened = model.at(theta)
    if opened is None:
        return None
    with np.errstate(all="ignore"):
        g = eliminated(opened, target, before)
        misfit = target.misfit(opened.response(g), g)
        if not np.isfinite(misfit).all():
            return None
        a = _by_transfer(opened, target, g)
        white = target.weight[..., None] * (opened.slope_by_parameters(g) * model.coordinates.slope(theta))
    white = white.swapaxes(0, 1).reshape(len(g), -1, len(x))
    slope = np.concatenate([white, np.zeros((len(g), 1, len(x)))], axis=1)
    follows = -np.einsum("ke,kep->kp", a.conj(), slope) / _power(a)[:, None]
    slope = (slope + a[:, :, None] * follows[:, None, :]).reshape(-1, len(x))
    prior = float((target.precision * (x - target.centre) ** 2).sum())
    return Fit(
        x=x,
        g=g,
        chi2=float(_power(misfit[:, :-1]).sum()),
        cost=float(_power(misfit).sum()) + prior,
        power=_power(a[:, :-1]),
        gradient=np.real(slope.conj().T @ misfit.ravel()),
        information=np.real(slope.conj().T @ slope),
        follows=follows,
    )


def eliminated(opened: Opened, target: Target, before: np.ndarray | None = None) -> np.ndarray:
    """The transfer g (K,) of least cost at every frequency.

    Begins at the best of g = 1, the g before, and the estimate that is exact for data without noise: w from Y - Y_u, the
    z that belongs to it, and g between them.
    """
    ones = np.ones(opened.y_u.shape[1], dtype=complex)
    signal = target.data - opened.y_u
    entering = opened.z_u + opened.z_w @ (np.linalg.pinv(opened.y_w) @ signal)
    driven = target.rows(target.weight * (opened.y_w @ entering), LARGE * ones)
    guess = _projected(driven, target.rows(target.weight * signal, LARGE * ones))
    candidates = np.stack([ones, guess, ones if before is None else before])
    costs = _costs(opened, target, candidates)
    best = np.argmin(costs, axis=0)[None]
    g, cost = np.take_along_axis(candidates, best, 0)[0], np.take_along_axis(costs, best, 0)[0]
    part, moved = np.ones(len(g)), np.ones(len(g), dtype=bool)
    step, gain = np.zeros_like(g), np.zeros(len(g))
    for _ in range(MOST_ROUNDS):
        if moved.any():
            a, r = _by_transfer(opened, target, g), target.misfit(opened.response(g), g)
            step = -_projected(a, r)
            gain = np.abs(step) ** 2 * _power(a)
        if (part * gain < 1e-6 * (1.0 + cost)).all():
            break
        trial = g + part * step
        trial_cost = _costs(opened, target, trial)
        moved = trial_cost < cost
        g, cost = np.where(moved, trial, g), np.where(moved, trial_cost, cost)
        part = np.where(moved, 1.0, part / 4)
    return g


def _costs(opened: Opened, target: Target, g: np.ndarray) -> np.ndarray:
    """Cost of each frequency at g (..., K) -> (..., K), infinite where there is no response."""
    cost = _power(target.misfit(opened.response(g), g))
    return np.where(np.isfinite(cost), cost, np.inf)


def _by_transfer(opened: Opened, target: Target, g: np.ndarray) -> np.ndarray:
    return target.rows(target.weight * opened.slope_by_transfer(g), np.full(len(g), LARGE, dtype=complex))


def _projected(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a'b / a'a, row by row."""
    return (a.conj() * b).sum(axis=-1) / _power(a)


def _power(a: np.ndarray) -> np.ndarray:
    """a'a, row by row."""
    return np.real(a * a.conj()).sum(axis=-1)
