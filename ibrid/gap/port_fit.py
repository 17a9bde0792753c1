"""The fit of an open port: parameters by damped Gauss-Newton, the open transfer eliminated at every frequency.

The admittance is analytic in the transfer g and every real and imaginary part has one sigma, so least squares for g are
complex scalars: with a = W dY/dg and r = W (Y - data) the step is -a'r / a'a, and of the parameters there remains what is
orthogonal to a (variable projection; Golub and Pereyra 1973, in Kaufman's form).
"""

from dataclasses import dataclass

import numpy as np

from ibrid.gap.open_port import Opened, OpenPort

MOST_STEPS, LARGEST_STEP = 60, 2.0
FIRST_DAMPING, LEAST_DAMPING, GREATEST_DAMPING = 1e-2, 1e-9, 1e8
#: Gains of chi2 that end the fit: of its size, and at all.
ENOUGH, SMALL = 1e-5, 1e-3
MOST_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted: `data`, `weight` : (M, K, 2, 2), 1/sigma. `centre`, `precision` : (P,) of the prior in x, a
    parameter without one has precision 0."""

    data: np.ndarray
    weight: np.ndarray
    centre: np.ndarray
    precision: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """A point of the search. `x` : (P,). `g` : (K,). `chi2` : of the data. `cost` : chi2 and prior.
    `by_transfer` : a, (K, 4M). `gradient`, `information` : of the data by x, g eliminated. `follows` : (K, P), dg/dx."""

    x: np.ndarray
    g: np.ndarray
    chi2: float
    cost: float
    by_transfer: np.ndarray
    gradient: np.ndarray
    information: np.ndarray
    follows: np.ndarray


def fit_port(model: OpenPort, target: Target, x: np.ndarray) -> Fit | None:
    """The local optimum that a start x (P,) leads to, inside the boxes; None where the start has no response."""
    low, high = model.coordinates.x_low, model.coordinates.x_high
    best = _evaluated(model, target, np.clip(x, low, high), None)
    damping = FIRST_DAMPING
    for _ in range(MOST_STEPS):
        if best is None or damping > GREATEST_DAMPING:
            break
        gradient = best.gradient + target.precision * (best.x - target.centre)
        information = best.information + np.diag(target.precision)
        held = ((best.x <= low) & (gradient > 0)) | ((best.x >= high) & (gradient < 0))
        gradient = np.where(held, 0.0, gradient)
        information[held] = information[:, held] = 0.0
        scale = np.where(held, 1.0, damping * (np.diag(information) + 1e-6 * np.diag(information).max(initial=1.0)))
        step = -np.linalg.solve(information + np.diag(scale), gradient)
        step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(initial=0.0), 1e-300))
        expected = -2 * gradient @ step - step @ information @ step
        if expected < ENOUGH * best.chi2 + SMALL and damping <= FIRST_DAMPING:
            break
        trial = _evaluated(model, target, np.clip(best.x + step, low, high), best.g)
        if trial is not None and trial.cost < best.cost:
            best, damping = trial, max(damping / 5.0, LEAST_DAMPING)
        else:
            damping *= 6.0
    return best


def _evaluated(model: OpenPort, target: Target, x: np.ndarray, before: np.ndarray | None) -> Fit | None:
    theta = model.coordinates.to_theta(x)
    opened = model.at(theta)
    if opened is None:
        return None
    with np.errstate(all="ignore"):
        g, cost = eliminated(opened, target, before)
        if not np.isfinite(cost).all():
            return None
        misfit = _stacked(target.weight * (opened.response(g) - target.data))
        a = _stacked(target.weight * opened.slope_by_transfer(g))
        slope = target.weight[..., None] * opened.slope_by_parameters(g) * model.coordinates.slope(theta)
        slope = slope.transpose(1, 0, 2, 3, 4).reshape(len(g), -1, len(x))
    power = np.maximum((np.abs(a) ** 2).sum(axis=1), np.finfo(float).tiny)
    follows = -np.einsum("ke,kep->kp", a.conj(), slope) / power[:, None]
    slope = (slope + a[:, :, None] * follows[:, None, :]).reshape(-1, len(x))
    chi2 = float(cost.sum())
    return Fit(
        x=x,
        g=g,
        chi2=chi2,
        cost=chi2 + float((target.precision * (x - target.centre) ** 2).sum()),
        by_transfer=a,
        gradient=(slope.conj().T @ misfit.ravel()).real,
        information=(slope.conj().T @ slope).real,
        follows=follows,
    )


def eliminated(opened: Opened, target: Target, before: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The transfer g (K,) of least chi2 at every frequency, and that chi2 (K,).

    Begins at the best of g = 1, the g before, and the estimate that is exact for data without noise: w from Y - Y_u, the
    z that belongs to it, and g between them.
    """
    signal = target.data - opened.y_u
    inner = np.linalg.pinv(opened.y_w) @ signal
    driven = _stacked(target.weight * (opened.y_w @ (opened.z_u + opened.z_w @ inner)))
    guess = _ratio(driven, _stacked(target.weight * signal))
    candidates = np.stack([np.ones(len(guess)), guess] if before is None else [np.ones(len(guess)), guess, before])
    costs = _cost(opened, target, candidates)
    best = np.argmin(costs, axis=0)[None]
    g, cost = np.take_along_axis(candidates, best, 0)[0], np.take_along_axis(costs, best, 0)[0]
    part = np.ones(len(g))
    step = gain = np.zeros(len(g))
    for round_ in range(MOST_ROUNDS):
        if round_ == 0 or moved.any():
            a = _stacked(target.weight * opened.slope_by_transfer(g))
            r = _stacked(target.weight * (opened.response(g) - target.data))
            step = -_ratio(a, r)
            gain = np.abs((a.conj() * r).sum(axis=1)) ** 2 / np.maximum((np.abs(a) ** 2).sum(axis=1), 1e-300)
        if (part * gain < 1e-6 * cost + 1e-6).all():
            break
        trial = g + part * step
        trial_cost = _cost(opened, target, trial)
        moved = trial_cost < cost
        g, cost = np.where(moved, trial, g), np.where(moved, trial_cost, cost)
        part = np.where(moved, 1.0, part / 4)
    return g, cost


def _cost(opened: Opened, target: Target, g: np.ndarray) -> np.ndarray:
    """chi2 of each frequency at g (..., K) -> (..., K), infinite where there is no response."""
    misfit = np.abs(target.weight * (opened.response(g) - target.data)) ** 2
    cost = misfit.sum(axis=(-4, -2, -1))
    return np.where(np.isfinite(cost), cost, np.inf)


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a'b / a'a, row by row; 0 where a is nothing."""
    power = (np.abs(a) ** 2).sum(axis=1)
    return (a.conj() * b).sum(axis=1) / np.where(power > 0, power, 1.0)


def _stacked(value: np.ndarray) -> np.ndarray:
    """(M, K, 2, 2) -> (K, 4M)."""
    return value.swapaxes(0, 1).reshape(value.shape[1], -1)
