"""The fit of an open port: parameters by damped Gauss-Newton, the unknown transfer function
eliminated at every frequency.

The admittance is analytic in the transfer g, and every real and imaginary part has one sigma, so
that least squares for g are in complex scalars: with a = W dY/dg and r = W (Y - data) the step is
-a'r / a'a, and of the parameters there remains what is orthogonal to a (variable projection; Golub
and Pereyra 1973, in Kaufman's form).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ibrid.fit.least_squares import Descent, Points, evaluated
from ibrid.gap.ports.open_port import OpenedModel, OpenPort
from ibrid.gap.refitting.prior import ParameterPrior

#: Steps of every start, and of the best of them.
FIRST_STEPS = 15
MOST_STEPS = 60
DESCENT = Descent(marquardt=True, greatest=1e8, enough=1e-4, small=1e-3)
#: Rounds of an elimination, and the gain in cost, over 1 + cost, below which it has converged.
MOST_ROUNDS = 12
CONVERGED_GAIN = 1e-6
#: The prior of each Delta is Student's t, -2 ln p = TAIL ln(1 + |Delta|^2 / LARGE^2): where the
#: data hardly determine Delta, noise does not become a resonance; where they do, any magnitude is
#: likely enough.
LARGE = 10.0
TAIL = 4.0
#: Divisor of a step that does not lower the cost.
STEP_DIVISOR = 4


@dataclass(frozen=True, eq=False)
class PortProblem:
    """The data that an open port is fitted to, with their weights and priors.

    Parameters
    ----------
    data, weight : ndarray
        (K, M, 2, 2) admittances, per unit, and 1/sigma of their parts.
    parameter_prior : ParameterPrior
        Of the parameters.
    tail : float
        Of the prior of each Delta; 0 for none.
    """

    data: np.ndarray
    weight: np.ndarray
    parameter_prior: ParameterPrior
    tail: float = TAIL

    def whitened_residuals(self, opened: OpenedModel, g: np.ndarray) -> np.ndarray:
        """Return the whitened residuals (..., K, 4 M) at transfers g (..., K)."""
        return _flatten_entries(self.weight * (opened.response(g) - self.data))

    def transfer_slope(self, opened: OpenedModel, g: np.ndarray) -> np.ndarray:
        """Return the derivative of the residuals by g, (..., K, 4 M), at g (..., K)."""
        return _flatten_entries(self.weight * opened.slope_by_transfer(g))

    def cost(self, residual: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return chi2 and prior penalty of each Delta, (..., K); infinite without a response.

        residual : (..., K, 4 M). g : (..., K).
        """
        penalty = self.tail * np.log1p(np.abs(g - 1.0) ** 2 / LARGE**2)
        cost = squared_norm(residual) + penalty
        return np.where(np.isfinite(cost), cost, np.inf)

    def prior_weight(self, g: np.ndarray) -> np.ndarray:
        """Return the weight (..., K) of |Delta|^2 that has the slope of the prior at g (..., K)."""
        return self.tail / (LARGE**2 + np.abs(g - 1.0) ** 2)


def squared_norm(a: np.ndarray) -> np.ndarray:
    """Return a'a (...) of complex rows (..., E)."""
    return np.real(a * a.conj()).sum(axis=-1)


def _flatten_entries(value: np.ndarray) -> np.ndarray:
    """Return (..., M, 2, 2) as (..., 4 M)."""
    return value.reshape(*value.shape[:-3], -1)


@dataclass(frozen=True, eq=False)
class PortPoint:
    """An open port at one point of the search.

    Parameters
    ----------
    x : ndarray
        (P,) search coordinates.
    g : ndarray
        (K,) the best transfers there.
    chi2, cost : float
        Of the data, and with the prior penalties.
    transfer_information : ndarray
        (K,) a'a, information of the data on each g.
    gradient : ndarray
        (P,) half that of the cost by x, with g eliminated.
    information : ndarray
        (P, P) of the data on x.
    prior_information : ndarray
        (P,) of the prior on x.
    transfer_by_x : ndarray
        (K, P) dg/dx.
    """

    x: np.ndarray
    g: np.ndarray
    chi2: float
    cost: float
    transfer_information: np.ndarray
    gradient: np.ndarray
    information: np.ndarray
    prior_information: np.ndarray
    transfer_by_x: np.ndarray


@dataclass(frozen=True, eq=False)
class OpenPortFit:
    """The fit of an open port as a `SumOfSquares` of its parameters x (P,).

    Its `Points` carry the `PortPoint` of each x.
    """

    model: OpenPort
    problem: PortProblem

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of x, (P,) each."""
        return self.model.coordinates.x_low, self.model.coordinates.x_high

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate the cost at x (S, P), with transfers that begin at those of `near`."""
        transfers = None if near is None else [point.g for point in near.carried[0]]
        return evaluated(x, partial(evaluate_port, self.model, self.problem), transfers)

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return half the gradient (S, P) and the Gauss-Newton Hessian (S, P, P)."""
        carried = points.carried[0]
        gradients = np.array([point.gradient for point in carried])
        hessians = [point.information + np.diag(point.prior_information) for point in carried]
        return gradients, np.array(hessians)


def fit_port(
    model: OpenPort, problem: PortProblem, starts: Sequence[np.ndarray], steps: int = MOST_STEPS
) -> PortPoint | None:
    """Descend from starts x (P,) and return the best local optimum; None without a response."""
    squares = OpenPortFit(model, problem)
    batch = DESCENT.begin(squares, np.array(starts))
    best = DESCENT.go(squares, batch, min(steps, FIRST_STEPS)).best(1)
    if not np.isfinite(best.cost[0]):
        return None
    further_steps = max(steps - FIRST_STEPS, 0)
    end = DESCENT.go(squares, DESCENT.start(best.points), further_steps)
    return end.points.carried[0][0]


@np.errstate(all="ignore")
def evaluate_port(
    model: OpenPort, problem: PortProblem, x: np.ndarray, before: np.ndarray | None = None
) -> PortPoint | None:
    """Evaluate an open port at x (P,) with the best transfers; None without a response.

    before : (K,) transfers from which these are searched, too.
    """
    theta = model.coordinates.to_theta(x)
    opened = model.at(theta)
    if opened is None:
        return None
    g = eliminate_transfer(opened, problem, before)
    residual = problem.whitened_residuals(opened, g)
    a = problem.transfer_slope(opened, g)
    cost = float(problem.cost(residual, g).sum())
    if not (np.isfinite(cost) and np.isfinite(a).all()):
        return None
    slope = problem.weight[..., None] * (
        opened.slope_by_parameters(g) * model.coordinates.slope(theta)
    )
    slope = slope.reshape(*residual.shape, len(x))
    prior_weight = problem.prior_weight(g)
    information_on_g = squared_norm(a)
    transfer_by_x = (
        -np.einsum("ke,kep->kp", a.conj(), slope) / (information_on_g + prior_weight)[:, None]
    )
    projected = slope + a[:, :, None] * transfer_by_x[:, None, :]
    weighted = prior_weight[:, None] * transfer_by_x
    penalty, prior_slope, prior_information = problem.parameter_prior.penalty_terms(x)
    by_data = np.einsum("kep,ke->p", projected.conj(), residual)
    by_transfer = weighted.conj().T @ (g - 1.0)
    of_data = np.einsum("kep,keq->pq", projected.conj(), projected)
    of_transfer = transfer_by_x.conj().T @ weighted
    return PortPoint(
        x=x,
        g=g,
        chi2=float(squared_norm(residual).sum()),
        cost=cost + float(penalty),
        transfer_information=information_on_g,
        gradient=np.real(by_data + by_transfer) + prior_slope,
        information=np.real(of_data + of_transfer),
        prior_information=prior_information,
        transfer_by_x=transfer_by_x,
    )


def eliminate_transfer(
    opened: OpenedModel, problem: PortProblem, before: np.ndarray | None = None
) -> np.ndarray:
    """Find the transfer g (K,) of least cost at every frequency.

    Begins at g = 1, at the g before, and at the estimate that is exact for data without noise: w
    from Y - Y_u, the z that belongs to it, and g between them.
    """
    unity = np.ones(len(opened.y_u), dtype=complex)
    signal = problem.data - opened.y_u
    z = opened.z_u + opened.z_w @ (np.linalg.pinv(opened.y_w) @ signal)
    driven = _flatten_entries(problem.weight * (opened.y_w @ z))
    wanted = _flatten_entries(problem.weight * signal)
    prior_weight = problem.prior_weight(unity)
    correlation = (driven.conj() * wanted).sum(axis=-1)
    estimate = (correlation + prior_weight) / (squared_norm(driven) + prior_weight)
    starts = [unity, estimate]
    if before is not None:
        starts.append(before)
    g, cost = iterate_transfer(opened, problem, np.stack(starts))
    return np.take_along_axis(g, np.argmin(cost, axis=0)[None], 0)[0]


def iterate_transfer(
    opened: OpenedModel,
    problem: PortProblem,
    g: np.ndarray,
    rounds: int = MOST_ROUNDS,
    enough: float = CONVERGED_GAIN,
) -> tuple[np.ndarray, np.ndarray]:
    """Iterate each transfer by Gauss-Newton from g (..., K), with shorter steps where needed.

    No `Descent`: one complex scalar for each frequency, in which the response is analytic, has a
    step in closed form.

    Returns
    -------
    tuple of ndarray
        The transfers (..., K), and the cost of each.
    """
    residual = problem.whitened_residuals(opened, g)
    cost = problem.cost(residual, g)
    part = np.ones(g.shape)
    is_better = True
    step = np.zeros_like(g)
    gain = np.zeros(g.shape)
    for _ in range(rounds):
        if np.any(is_better):
            a = problem.transfer_slope(opened, g)
            prior_weight = problem.prior_weight(g)
            curvature = squared_norm(a) + prior_weight
            gradient = (a.conj() * residual).sum(axis=-1) + prior_weight * (g - 1.0)
            step = -gradient / curvature
            gain = np.abs(step) ** 2 * curvature
        if (part * gain < enough * (1.0 + cost)).all():
            break
        trial = g + part * step
        trial_residual = problem.whitened_residuals(opened, trial)
        trial_cost = problem.cost(trial_residual, trial)
        is_better = trial_cost < cost
        g = np.where(is_better, trial, g)
        cost = np.where(is_better, trial_cost, cost)
        residual = np.where(is_better[..., None], trial_residual, residual)
        part = np.where(is_better, 1.0, part / STEP_DIVISOR)
    return g, cost
