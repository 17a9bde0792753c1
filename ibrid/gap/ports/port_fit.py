"""The fit of an open port: parameters by damped Gauss-Newton, the open transfer eliminated at every
frequency.

The admittance is analytic in the transfer g and every real and imaginary part has one sigma, so
least squares for g are complex scalars: with a = W dY/dg and r = W (Y - data) the step is -a'r /
a'a, and of the parameters there remains what is orthogonal to a (variable projection; Golub and
Pereyra 1973, in Kaufman's form).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.least_squares import Descent, Points, carried
from ibrid.gap.ports.open_port import OpenedModel, OpenPort
from ibrid.gap.refitting.prior import ParameterPrior

#: Steps of every start, and of the best of them.
FIRST_STEPS, MOST_STEPS = 15, 60
DESCENT = Descent(marquardt=True, greatest=1e8, enough=1e-4, small=1e-3)
#: Rounds of an elimination, and the gain in cost, over 1 + cost, below which a transfer is settled.
MOST_ROUNDS, SETTLED = 12, 1e-6
#: The prior of each Delta is Student's, -2 ln p = TAIL ln(1 + |Delta|^2 / LARGE^2): where the data
#: hardly see it, it is not one that makes a resonance of the noise; where they do, any size is
#: likely enough.
LARGE, TAIL = 10.0, 4.0


@dataclass(frozen=True, eq=False)
class PortProblem:
    """What is fitted: `data`, `weight` : (K, M, 2, 2), 1/sigma.

    `parameter_prior` : of the parameters. `tail` : of the prior of each Delta; 0 for none.
    """

    data: np.ndarray
    weight: np.ndarray
    parameter_prior: ParameterPrior
    tail: float = TAIL

    def whitened_residuals(self, opened: OpenedModel, g: np.ndarray) -> np.ndarray:
        """White residuals at g (..., K) -> (..., K, 4M)."""
        return _flatten_entries(self.weight * (opened.response(g) - self.data))

    def transfer_slope(self, opened: OpenedModel, g: np.ndarray) -> np.ndarray:
        """Their derivative by g (..., K) -> (..., K, 4M)."""
        return _flatten_entries(self.weight * opened.slope_by_transfer(g))

    def cost(self, misfit: np.ndarray, g: np.ndarray) -> np.ndarray:
        """chi2 and the prior of each Delta, (..., K, 4M) and (..., K) -> (..., K); infinite where
        there is no response.
        """
        cost = squared_norm(misfit) + self.tail * np.log1p(np.abs(g - 1.0) ** 2 / LARGE**2)
        return np.where(np.isfinite(cost), cost, np.inf)

    def prior_weight(self, g: np.ndarray) -> np.ndarray:
        """What the square of a Delta is weighed by, such that it has the slope of the prior."""
        return self.tail / (LARGE**2 + np.abs(g - 1.0) ** 2)


def squared_norm(a: np.ndarray) -> np.ndarray:
    """a'a, row by row."""
    return np.real(a * a.conj()).sum(axis=-1)


def _flatten_entries(value: np.ndarray) -> np.ndarray:
    return value.reshape(*value.shape[:-3], -1)


@dataclass(frozen=True, eq=False)
class PortPoint:
    """A point of the search.

    `x` : (P,). `g` : (K,). `chi2` : of the data. `cost` : with the prior. `seen` : (K,) a'a of the
    data alone, the information on each g. `gradient` : half of the cost's by x, g eliminated.
    `information` : (P, P), of the data on x.
    `believed` : (P,) of the prior. `follows` : (K, P), dg/dx.
    """

    x: np.ndarray
    g: np.ndarray
    chi2: float
    cost: float
    seen: np.ndarray
    gradient: np.ndarray
    information: np.ndarray
    believed: np.ndarray
    follows: np.ndarray


@dataclass(frozen=True, eq=False)
class OpenPortFit:
    """The fit of an open port as a `SumOfSquares` of its parameters x (P,).

    Its `Points` carry the `PortPoint` of each x.
    """

    model: OpenPort
    target: PortProblem

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the model's coordinates."""
        return self.model.coordinates.x_low, self.model.coordinates.x_high

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P), the transfers from those near."""
        before = [None] * len(x) if near is None else [fit.g for fit in near.carried[0]]
        fits = [
            evaluate_port(self.model, self.target, *pair) for pair in zip(x, before, strict=True)
        ]
        return Points(
            x, np.array([np.inf if fit is None else fit.cost for fit in fits]), carried(fits)
        )

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g and H of the parameters."""
        fits = points.carried[0]
        return np.array([fit.gradient for fit in fits]), np.array(
            [f.information + np.diag(f.believed) for f in fits]
        )


def fit_port(
    model: OpenPort, target: PortProblem, starts: Sequence[np.ndarray], steps: int = MOST_STEPS
) -> PortPoint | None:
    """The best local optimum inside the boxes that starts x (P,) lead to; None where none has a
    response.
    """
    squares = OpenPortFit(model, target)
    best = DESCENT.go(
        squares, DESCENT.begin(squares, np.array(starts)), min(steps, FIRST_STEPS)
    ).best(1)
    if not np.isfinite(best.cost[0]):
        return None
    return DESCENT.go(
        squares, DESCENT.start(best.points), max(steps - FIRST_STEPS, 0)
    ).points.carried[0][0]


@np.errstate(all="ignore")
def evaluate_port(
    model: OpenPort, target: PortProblem, x: np.ndarray, before: np.ndarray | None = None
) -> PortPoint | None:
    """The fit at x (P,) with the best g, also tried from the one `before`; None where the model has
    no response.
    """
    theta = model.coordinates.to_theta(x)
    opened = model.at(theta)
    if opened is None:
        return None
    g = eliminate_transfer(opened, target, before)
    misfit, a = target.whitened_residuals(opened, g), target.transfer_slope(opened, g)
    cost = float(target.cost(misfit, g).sum())
    if not (np.isfinite(cost) and np.isfinite(a).all()):
        return None
    slope = target.weight[..., None] * (
        opened.slope_by_parameters(g) * model.coordinates.slope(theta)
    )
    slope = slope.reshape(*misfit.shape, len(x))
    held, seen = target.prior_weight(g), squared_norm(a)
    follows = -np.einsum("ke,kep->kp", a.conj(), slope) / (seen + held)[:, None]
    left = slope + a[:, :, None] * follows[:, None, :]
    of_g = held[:, None] * follows
    pulled, down, hold_x = target.parameter_prior.penalty_terms(x)
    return PortPoint(
        x=x,
        g=g,
        chi2=float(squared_norm(misfit).sum()),
        cost=cost + float(pulled),
        seen=seen,
        gradient=np.real(np.einsum("kep,ke->p", left.conj(), misfit) + of_g.conj().T @ (g - 1.0))
        + down,
        believed=hold_x,
        information=np.real(np.einsum("kep,keq->pq", left.conj(), left) + follows.conj().T @ of_g),
        follows=follows,
    )


def eliminate_transfer(
    opened: OpenedModel, target: PortProblem, before: np.ndarray | None = None
) -> np.ndarray:
    """The transfer g (K,) of least cost at every frequency.

    Begins at g = 1, the g before, and the estimate that is exact for data without noise: w from Y -
    Y_u, the z that belongs to it, and g between them.
    """
    ones = np.ones(len(opened.y_u), dtype=complex)
    signal = target.data - opened.y_u
    entering = opened.z_u + opened.z_w @ (np.linalg.pinv(opened.y_w) @ signal)
    driven, wanted = (
        _flatten_entries(target.weight * one) for one in (opened.y_w @ entering, signal)
    )
    guess = ((driven.conj() * wanted).sum(axis=-1) + target.prior_weight(ones)) / (
        squared_norm(driven) + target.prior_weight(ones)
    )
    g, cost = iterate_transfer(
        opened, target, np.stack([ones, guess] if before is None else [ones, guess, before])
    )
    return np.take_along_axis(g, np.argmin(cost, axis=0)[None], 0)[0]


def iterate_transfer(
    opened: OpenedModel,
    target: PortProblem,
    g: np.ndarray,
    rounds: int = MOST_ROUNDS,
    enough: float = SETTLED,
) -> tuple[np.ndarray, np.ndarray]:
    """Where Gauss-Newton, each transfer for itself and with shorter steps where whole ones do not
    help, leads from g (..., K), and the cost there.

    It is no `Descent`: one complex scalar per frequency, in which the response is analytic, has a
    step in closed form.
    """
    misfit = target.whitened_residuals(opened, g)
    cost, part, moved = target.cost(misfit, g), np.ones(g.shape), True
    step, gain = np.zeros_like(g), np.zeros(g.shape)
    for _ in range(rounds):
        if np.any(moved):
            a = target.transfer_slope(opened, g)
            total = squared_norm(a) + target.prior_weight(g)
            step = -((a.conj() * misfit).sum(axis=-1) + target.prior_weight(g) * (g - 1.0)) / total
            gain = np.abs(step) ** 2 * total
        if (part * gain < enough * (1.0 + cost)).all():
            break
        trial = g + part * step
        trial_misfit = target.whitened_residuals(opened, trial)
        trial_cost = target.cost(trial_misfit, trial)
        moved = trial_cost < cost
        g, cost = np.where(moved, trial, g), np.where(moved, trial_cost, cost)
        misfit = np.where(moved[..., None], trial_misfit, misfit)
        part = np.where(moved, 1.0, part / 4)
    return g, cost
