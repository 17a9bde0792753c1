"""The refit of one diagram: all operating points together, whitened by the noise, held to nominal values by a prior.

cost(x) = chi2(x) + sum of the squared `Beliefs.sigmas`, minimised by batches of damped Gauss-Newton from many starts. A minimum
that is missed looks exactly like a missing effect, so starts are many and whoever finds a better one passes it on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, log

import numpy as np
from scipy.stats import chi2 as chi2_law

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import DiagramError
from ibrid.fit.gauss_newton import begin, descend
from ibrid.fit.problem import Coordinates, Problem
from ibrid.gap.noise import Noise
from ibrid.gap.prior import Beliefs, Prior
from ibrid.gap.whole_fit import whole_fit
from ibrid.measurement.sweep import measured_numbers
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram
from ibrid.structure.wiring import wire

Values = Mapping[str, float]

#: Iterations on the logarithm of the response, which leads to the right valley, and on chi2.
FAR, NEAR = 10, 60
#: Iterations on chi2 of a first look.
GLANCE = 12
#: Starts that go on to chi2.
KEPT = 6
#: Width of a draw of a parameter without a nominal value, of its logarithm: a decade.
DECADE = log(10.0)


class Penalised:
    """A problem with the prior as one more column of the cost; `normal_equations` as in `Problem`."""

    def __init__(self, problem: Problem, prior: Prior) -> None:
        self.problem = problem
        self.beliefs = Beliefs([one.parameter for one in problem.numbers], prior)
        self.numbers = measured_numbers(problem.points)

    @property
    def coordinates(self) -> Coordinates:
        """Those of the problem."""
        return self.problem.coordinates

    def normal_equations(self, x: np.ndarray, objective: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Costs (S, M + 1), gradients (S, M + 1, P) and Gauss-Newton matrices (S, M + 1, P, P)."""
        cost, gradient, hessian = self.problem.normal_equations(x, objective)
        scale = 1.0 if objective == "chi2" else 1.0 / self.numbers
        theta = self.coordinates.to_theta(x)
        away, slope = self.beliefs.sigmas(theta), self.slope(theta)
        cost = np.concatenate([cost, scale * (away**2).sum(axis=1)[:, None]], axis=1)
        gradient = np.concatenate([gradient, scale * (away * slope)[:, None]], axis=1)
        own = scale * (slope**2)[:, None, :, None] * np.eye(x.shape[1])
        return cost, gradient, np.concatenate([hessian, own], axis=1)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """Standard deviations for each unit of x, at theta (..., P)."""
        return self.beliefs.slope(theta) * self.coordinates.slope(theta)

    def start(self, values: Values) -> np.ndarray:
        """x (P,) at values by name; what they lack is the nominal or the typical value."""
        pairs = zip(self.problem.numbers, self.beliefs.nominal, strict=True)
        theta = np.array([values.get(one.name, nominal) for one, nominal in pairs])
        return self.coordinates.to_x(np.clip(theta, self.coordinates.low, self.coordinates.high))


@dataclass(frozen=True, eq=False)
class Refit:
    """A diagram at its best parameters. `x` : (P,) in search coordinates. `chi2` : of the data alone. `penalty` : of the
    prior. `effective` : parameters that the data, not the prior, decide."""

    diagram: Diagram
    problem: Problem
    prior: Prior
    x: np.ndarray
    chi2: float
    penalty: float
    effective: float

    @property
    def cost(self) -> float:
        """chi2 and prior together."""
        return self.chi2 + self.penalty

    @property
    def numbers(self) -> int:
        """Measured real numbers."""
        return measured_numbers(self.problem.points)

    @property
    def dof(self) -> float:
        """Degrees of freedom of chi2."""
        return max(self.numbers - self.effective, 1.0)

    @property
    def free(self) -> int:
        """Free parameters."""
        return self.problem.size

    def p_value(self, scale: float = 1.0) -> float:
        """Probability of so large a misfit by noise alone, its standard deviation `scale` times what was stated."""
        return float(chi2_law.sf(self.chi2 / scale**2, self.dof))

    @cached_property
    def values(self) -> dict[str, float]:
        """Free parameter -> value."""
        return self.problem.values_at(self.x, 0)

    @cached_property
    def moved(self) -> dict[str, float]:
        """Parameter with a nominal value -> how far it is from that, in standard deviations of its tolerance."""
        beliefs = Penalised(self.problem, self.prior).beliefs
        sigmas = beliefs.sigmas(self.problem.coordinates.to_theta(self.x))
        rows = zip(self.problem.numbers, sigmas, beliefs.known, strict=True)
        return {one.name: float(away) for one, away, known in rows if known}

    @cached_property
    def responses(self) -> list[np.ndarray]:
        """Admittances at the measured frequencies, one array (K, 2, 2) for each operating point."""
        return self.problem.responses(self.x)

    @cached_property
    def residuals(self) -> list[np.ndarray]:
        """(Y - data) / sigma, complex, one array (K, 2, 2) for each operating point."""
        pairs = zip(self.responses, self.problem.points, strict=True)
        return [(response - point.admittance) / np.asarray(point.sigma) for response, point in pairs]


class Refitter:
    """Fits diagrams to the same data."""

    def __init__(self, noise: Noise, kinds: Vocabulary, prior: Prior, rng: np.random.Generator) -> None:
        self.noise, self.sweep, self.kinds, self.prior, self.rng = noise, noise.sweep, kinds, prior, rng
        self._models: dict[int, tuple[Diagram, Problem]] = {}

    def problem(self, diagram: Diagram) -> Problem:
        """The fitting problem of a legal diagram; the last ones are kept."""
        key = id(diagram)
        if key not in self._models:
            sweep = self.sweep
            model = symbolic_model(
                wire(diagram, self.kinds), equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0
            )
            self._models[key] = (diagram, Problem(model, sweep.points))
        return self._models[key][1]

    def refit(self, diagram: Diagram, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7) -> Refit | None:
        """The best of many descents; None when no start has a response, or the diagram no matrices.

        starts : values by name; what they lack is the nominal value, or drawn. draws : further starts, each a `starts` entry
        moved by `spread` standard deviations of the prior.
        """
        try:
            problem = self.problem(diagram)
        except DiagramError:
            return None
        penalised = Penalised(problem, self.prior)
        x = np.array([penalised.start(one) for one in starts])
        if draws:
            x = np.concatenate([x, self._moved(x, penalised, draws, spread)])
        near = descend(penalised, begin(penalised, x[: len(starts)], "chi2"), "chi2", NEAR // 4)
        far = descend(penalised, begin(penalised, x, "log"), "log", FAR)
        candidates = np.concatenate([near.best(KEPT // 2).x, far.best(KEPT).x])
        ends = descend(penalised, begin(penalised, candidates, "chi2"), "chi2", NEAR)
        if not np.isfinite(ends.cost).any():
            return None
        return self.at(diagram, ends.x[int(np.argmin(ends.cost))])

    def whole_fit(self, diagram: Diagram) -> Refit | None:
        """A refit from where a fit without any prior ends, which takes seconds; None where there is none."""
        wiring = wire(diagram, self.kinds)
        starts = whole_fit(self.problem(diagram), wiring, self.rng, self.sweep.omega_0)
        return self.refit(diagram, starts) if starts else None

    def glance(self, diagram: Diagram, starts: Sequence[Values]) -> float:
        """Cost, with ln(n) for every free number, after a few steps from the starts: an upper end of what a refit finds.

        Infinite where no start has a response, or the diagram no matrices.
        """
        try:
            problem = self.problem(diagram)
        except DiagramError:
            return inf
        penalised = Penalised(problem, self.prior)
        x = np.array([penalised.start(one) for one in starts])
        cost = descend(penalised, begin(penalised, x, "chi2"), "chi2", GLANCE).cost
        return float(cost.min()) + problem.size * log(penalised.numbers)

    def at(self, diagram: Diagram, x: np.ndarray) -> Refit:
        """A diagram at given search coordinates (P,)."""
        problem = self.problem(diagram)
        penalised = Penalised(problem, self.prior)
        cost, _, hessian = penalised.normal_equations(x[None], "chi2")
        data, prior = hessian[0, :-1].sum(axis=0), hessian[0, -1]
        return Refit(
            diagram=diagram,
            problem=problem,
            prior=self.prior,
            x=x,
            chi2=float(cost[0, :-1].sum()),
            penalty=float(cost[0, -1]),
            effective=_effective(data, prior),
        )

    def at_values(self, diagram: Diagram, values: Values) -> Refit:
        """A diagram at values by name; what they lack is the nominal or the typical value."""
        problem = self.problem(diagram)
        return self.at(diagram, Penalised(problem, self.prior).start(values))

    def _moved(self, x: np.ndarray, penalised: Penalised, number: int, spread: float) -> np.ndarray:
        base = x[self.rng.integers(len(x), size=number)]
        coordinates, nominal = penalised.coordinates, penalised.beliefs.nominal
        slope = penalised.slope(nominal)
        width = np.where(slope > 0, 1.0 / np.where(slope > 0, slope, 1.0), DECADE)
        moved = base + spread * width * self.rng.standard_normal(base.shape)
        return np.clip(moved, coordinates.x_low, coordinates.x_high)


def _effective(data: np.ndarray, prior: np.ndarray) -> float:
    """Trace of data (data + prior)^-1: how many parameters the data decide. data, prior : (P, P)."""
    if not len(data) or not np.isfinite(data).all():
        return float(len(data))
    scale = np.sqrt(np.maximum(np.diag(data + prior), 1e-300))
    whole, part = (data + prior) / np.outer(scale, scale), data / np.outer(scale, scale)
    return float(np.trace(np.linalg.pinv(whole, rcond=1e-12, hermitian=True) @ part))
