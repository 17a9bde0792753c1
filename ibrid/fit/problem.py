"""A fitting problem: a symbolic model, the measured operating points, and the free numbers in their
coordinates.

Positive boxes are searched in logarithms, wide signed ones in asinh, others as they are; all in one
vector x shared by the operating points, of which each takes its own part.
"""

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import casadi as ca
import numpy as np

from ibrid.assembly.symbolic import Pattern, SymbolicModel
from ibrid.fit import kernel
from ibrid.fit.lane_response import plan_elimination
from ibrid.fit.least_squares import Points, carried
from ibrid.fit.objective import Residual, residuals
from ibrid.fit.thinning import representative_frequencies
from ibrid.measurement.sweeps.sweep import PointSweep, measured_numbers
from ibrid.structure.reading.parameters import Parameter

#: Squared relative noise of the data that what is known beforehand is weighed against where the
#: objective knows none.
KNOWN_NOISE = 1e-4
#: Part of a box's width within which a value counts as at the bound.
AT_BOUND = 1e-6
#: A signed box wider than this is searched in asinh(value / SIGNED_SCALE).
WIDE_SIGNED_BOX, SIGNED_SCALE = 10.0, 0.1


@dataclass(frozen=True)
class FreeNumber:
    """One entry of x: a parameter, and the operating point that it belongs to when it is not
    shared.
    """

    parameter: Parameter
    point: int | None = None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name


class Coordinates:
    """theta <-> x, entry by entry."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.low = np.array([one.low for one in parameters], dtype=float)
        self.high = np.array([one.high for one in parameters], dtype=float)
        self.logarithmic = self.low > 0
        self.signed = ~self.logarithmic & (np.maximum(-self.low, self.high) > WIDE_SIGNED_BOX)
        self._some_signed = bool(self.signed.any())
        self.x_low, self.x_high = self.to_x(self.low), self.to_x(self.high)

    def to_x(self, theta: np.ndarray) -> np.ndarray:
        """Search coordinates of physical values (..., P)."""
        safe = np.where(self.logarithmic, np.maximum(theta, np.finfo(float).tiny), 1.0)
        x = np.where(self.logarithmic, np.log(safe), theta)
        return np.where(
            self.signed, np.arcsinh(np.where(self.signed, theta, 0.0) / SIGNED_SCALE), x
        )

    def to_theta(self, x: np.ndarray) -> np.ndarray:
        """Physical values, inside the boxes (..., P)."""
        theta = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, x, 0.0)), x)
        if self._some_signed:
            theta = np.where(
                self.signed, SIGNED_SCALE * np.sinh(np.where(self.signed, x, 0.0)), theta
            )
        return np.minimum(np.maximum(theta, self.low), self.high)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """d theta / d x (..., P)."""
        slope = np.where(self.logarithmic, theta, 1.0)
        return (
            np.where(self.signed, np.hypot(theta, SIGNED_SCALE), slope)
            if self._some_signed
            else slope
        )


#: Slopes of the residuals of one operating point by physical values, (P, N), and of those values by
#: x, (P,).
ScaledSlopes: TypeAlias = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Hold the costs of starts, and what their sums of squares are made of.

    cost : (S, M), squared error at each operating point; infinite where there is no response.
    gradient, hessian : J'r (S, M, P) and J'J (S, M, P, P), by x. residuals : r (S, N) of each
    operating point. slopes : J (P, N) of each start, by operating point. What was not asked for is
    empty.
    """

    cost: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    residuals: tuple[np.ndarray, ...]
    slopes: tuple[tuple[ScaledSlopes, ...], ...]

    @property
    def sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return cost, gradient and hessian, summed over the operating points."""
        return self.cost.sum(axis=1), self.gradient.sum(axis=1), self.hessian.sum(axis=1)


class Problem:
    """Model and data, ready to be evaluated for many parameter vectors: of the diagram it keeps
    numbers alone.

    model : from `symbolic_model`. points : measured operating points.
    numbers : the `size` entries of x. One value of a parameter holds for all points, unless it is
    local (E0d, I0d, delta_eq).
    parameters : of the model; index : (M, number of them), the entry of x that each takes at each
    operating point.
    typical : (P,) x of the typical values. hold : (P,), 1 / tolerance^2 of what is known
    beforehand, which every cost includes.
    """

    def __init__(self, model: SymbolicModel, points: Sequence[PointSweep]) -> None:
        self.parameters = model.parameters
        self.pattern: Pattern = model.pattern
        self.states = len(model.states)
        self.numbers: list[FreeNumber] = []
        self.index = np.zeros((len(points), len(model.parameters)), dtype=np.int64)
        for local, parameter in enumerate(model.parameters):
            for point in range(len(points)):
                if point == 0 or parameter.local:
                    self.numbers.append(FreeNumber(parameter, point if parameter.local else None))
                self.index[point, local] = len(self.numbers) - 1
        self.size = len(self.numbers)
        every = (slice(None),) * 3  # quicker than numbers
        whole = np.arange(self.size)
        self._places = [
            every if np.array_equal(one, whole) else (one, one[:, None], one) for one in self.index
        ]
        self.coordinates = Coordinates([one.parameter for one in self.numbers])
        self._set_data(points)
        values, derivatives = len(self.pattern.rows), len(self.pattern.derivative_entry)
        self._plan = plan_elimination(
            self.pattern.rows,
            self.pattern.columns,
            self.pattern.derivative_entry,
            self.pattern.size,
        )
        self._entries = _Caller(model.entries, len(model.parameters), (values, derivatives))
        self._values = _Caller(model.values_only, len(model.parameters), (values,))
        self.evaluations = 0
        self.typical = self.coordinates.to_x(
            np.array([one.parameter.typical for one in self.numbers], dtype=float)
        )
        self.hold = (
            np.array([one.parameter.tolerance or np.inf for one in self.numbers], dtype=float)
            ** -2.0
        )

    def _set_data(self, points: Sequence[PointSweep]) -> None:
        """Set the measured operating points."""
        self.points = tuple(points)
        self.line = [np.ascontiguousarray(point.line) for point in points]
        self._excitation = [kernel.excited(point.excitation, point.line) for point in points]
        self.data = [np.ascontiguousarray(point.admittance, dtype=complex) for point in points]
        self._fields = [np.array([one.op.p, one.op.q, one.op.v], dtype=float) for one in points]
        self._residuals: dict[str, list[Residual]] = {}

    def thinned(self, frequencies: int) -> "Problem":
        """Return the problem on so many frequencies of each operating point at most
        (`ibrid.fit.thinning`); itself where no point has half as many again.
        """
        if all(len(point.frequency) < 1.5 * frequencies for point in self.points):
            return self
        thinned = copy(self)
        thinned.evaluations = 0
        thinned._set_data(
            [one.at(representative_frequencies(one, frequencies)) for one in self.points]
        )
        return thinned

    def residuals(self, objective: str) -> list[Residual]:
        """Weights of every operating point under an objective."""
        if objective not in self._residuals:
            self._residuals[objective] = residuals(self.points, objective)
        return self._residuals[objective]

    def costs(self, x: np.ndarray, objective: str) -> np.ndarray:
        """Squared error of each start at each operating point: x (S, P) -> (S, M)."""
        return self._evaluate(x, objective, False).cost

    def normal_equations(
        self,
        x: np.ndarray,
        objective: str,
        most: np.ndarray | None = None,
        *,
        with_slopes: bool = False,
    ) -> "NormalEquations":
        """Costs with their derivatives by x (S, P).

        most : (S,), total costs beyond which one is of no interest, and infinite. with_slopes :
        keep J too, for `projected`.
        """
        return self._evaluate(x, objective, True, most, with_slopes=with_slopes)

    def projected(
        self, x: np.ndarray, objective: str, slopes: Sequence[tuple[ScaledSlopes, ...]]
    ) -> np.ndarray:
        """Return J'r (S, P) of the residuals r at x (S, P) and of slopes J taken elsewhere.

        slopes : `NormalEquations.slopes`. Not a number where there is no response.
        """
        equations = self._evaluate(x, objective, False)
        product = self._held(objective) * len(self.points) * (x - self.typical)
        for start, by_point in enumerate(slopes):
            for residual, index, (slope, scale) in zip(
                equations.residuals, self.index, by_point, strict=True
            ):
                product[start, index] += slope @ residual[start] * scale
        product[~np.isfinite(equations.cost.sum(axis=1))] = np.nan
        return product

    def _held(self, objective: str) -> np.ndarray:
        """Return the weight (P,) of what is known beforehand in the cost of one operating point."""
        if objective == "chi2":
            return self.hold / len(self.points)
        noise = 1.0 if objective == "sigma" else KNOWN_NOISE
        return self.hold / measured_numbers(self.points) * noise

    def _evaluate(
        self,
        x: np.ndarray,
        objective: str,
        derivatives: bool,
        most: np.ndarray | None = None,
        *,
        with_slopes: bool = False,
    ) -> "NormalEquations":
        pattern, starts, local = self.pattern, len(x), len(self.parameters)
        theta_all = self.coordinates.to_theta(x)
        slope_all = self.coordinates.slope(theta_all) if derivatives else None
        cost = np.zeros((starts, len(self.points)))
        gradient = np.zeros((starts, len(self.points), self.size)) if derivatives else np.zeros(0)
        hessian = (
            np.zeros((starts, len(self.points), self.size, self.size))
            if derivatives
            else np.zeros(0)
        )
        residuals: list[np.ndarray] = []
        slopes: list[list[ScaledSlopes]] = []
        self.evaluations += starts
        held = self._held(objective)
        caller = self._entries if derivatives else self._values
        for m, weights in enumerate(self.residuals(objective)):
            index, row, column = self._places[m]
            theta = np.ascontiguousarray(theta_all[:, index])
            outputs = caller(theta, self._fields[m])
            part = kernel.normal_equations(
                outputs[0],
                outputs[1] if derivatives else np.zeros((starts, 0)),
                pattern.rows,
                pattern.columns,
                pattern.derivative_entry,
                pattern.derivative_parameter,
                pattern.delay_parameter,
                pattern.delays(theta),
                self.line[m],
                self._excitation[m],
                self.data[m],
                weights.weight,
                weights.logarithmic,
                pattern.size,
                local if derivatives else 0,
                derivatives,
                np.full(starts, np.inf) if most is None else most - cost.sum(axis=1),
                with_slopes,
                self._plan,
            )
            cost[:, m] = part[0]
            residuals.append(part[3])
            if slope_all is not None:
                scale = slope_all[:, index]
                gradient[:, m, index] = part[1] * scale
                hessian[:, m, row, column] = part[2] * scale[:, :, None] * scale[:, None, :]
                if with_slopes:
                    slopes.append([*zip(part[4], scale, strict=True)])
            if held.any():
                cost[:, m] += (held * (x - self.typical) ** 2).sum(axis=1)
                if slope_all is not None:
                    gradient[:, m] += held * (x - self.typical)
                    hessian[:, m, range(self.size), range(self.size)] += held
        return NormalEquations(
            cost, gradient, hessian, tuple(residuals), tuple(zip(*slopes, strict=True))
        )

    def responses(self, x: np.ndarray) -> list[np.ndarray]:
        """What each operating point measured: x (P,) -> list of (K, 2, 2)."""
        return [self._response(x, m, line, self._excitation[m]) for m, line in enumerate(self.line)]

    def response(self, x: np.ndarray, point: int, omega: np.ndarray) -> np.ndarray:
        """Admittance at one operating point and any frequencies (rad/s): (K, 2, 2)."""
        line = 1j * np.asarray(omega)
        return self._response(x, point, line, kernel.excited(None, line))

    def _response(
        self, x: np.ndarray, point: int, line: np.ndarray, excitation: np.ndarray
    ) -> np.ndarray:
        pattern = self.pattern
        theta = np.ascontiguousarray(self.coordinates.to_theta(x)[self.index[point]])[None]
        (values,) = self._values(theta, self._fields[point])
        delays = pattern.delays(theta)[0]
        return kernel.answer(
            values[0], pattern.rows, pattern.columns, delays, line, excitation, pattern.size
        )

    def jacobians(self, x: np.ndarray) -> list[np.ndarray]:
        """Slopes of `responses` by x: x (P,) -> list of (K, 2, 2, P) complex."""
        pattern, matrices = self.pattern, []
        theta_all = self.coordinates.to_theta(x)
        slope_all = self.coordinates.slope(theta_all)
        for m, index in enumerate(self.index):
            theta = np.ascontiguousarray(theta_all[index])[None]
            values, derivatives = self._entries(theta, self._fields[m])
            _, slope = kernel.respond_with_derivatives(
                values[0],
                derivatives[0],
                pattern.rows,
                pattern.columns,
                pattern.derivative_entry,
                pattern.derivative_parameter,
                pattern.delay_parameter,
                pattern.delays(theta)[0],
                self.line[m],
                self._excitation[m],
                pattern.size,
                len(self.parameters),
            )
            whole = np.zeros((*slope.shape[:3], self.size), dtype=complex)
            whole[..., index] = slope * slope_all[index]
            matrices.append(whole)
        return matrices

    def white_slopes(self, x: np.ndarray, deviations: Iterable[np.ndarray]) -> np.ndarray:
        """Those slopes over a deviation of each number, as real rows (2 N, P): of each point real
        parts, then imaginary ones.
        """
        rows = []
        for slope, deviation in zip(self.jacobians(x), deviations, strict=True):
            white = (slope / deviation[..., None]).reshape(-1, self.size)
            rows += [white.real, white.imag]
        return np.concatenate(rows)

    def state_matrices(self, x: np.ndarray, point: int) -> np.ndarray:
        """State matrices of starts x (S, P) at one operating point, delayed signals left out: (S,
        n, n).
        """
        pattern, states = self.pattern, self.states
        theta = np.ascontiguousarray(self.coordinates.to_theta(x)[:, self.index[point]])
        (values,) = self._values(theta, self._fields[point])
        inside = (pattern.rows < states) & (pattern.columns < states)
        matrices = np.zeros((len(x), states, states))
        matrices[:, pattern.rows[inside], pattern.columns[inside]] = np.nan_to_num(
            values[:, inside]
        )
        return matrices

    def at_bound(self, x: np.ndarray) -> np.ndarray:
        """True for entries of x at the ends of their boxes."""
        low, high = self.coordinates.x_low, self.coordinates.x_high
        return np.minimum(x - low, high - x) <= AT_BOUND * (high - low)

    def values_at(self, x: np.ndarray, point: int) -> dict[str, float]:
        """Free name -> physical value at one operating point."""
        theta = self.coordinates.to_theta(x)[self.index[point]]
        return {one.name: float(value) for one, value in zip(self.parameters, theta, strict=True)}


class Believed(Protocol):
    """What is believed of free numbers, beside the data."""

    def penalty_terms(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost (S,), half its gradient (S, P) and its curvature (S, P) at x (S, P)."""
        ...


class Misfit:
    """A problem under one objective as a `SumOfSquares`, what is believed of its numbers included.

    Beliefs are in standard deviations, as chi2 is; beside a relative objective they weigh 1 /
    number of measured numbers.
    `noise` : chi2 of one in the total cost; None where the objective does not know the noise.
    `curved` : the slopes at each point are kept, so that it is a `CurvedSumOfSquares`.
    """

    def __init__(
        self,
        problem: Problem,
        objective: str,
        believed: Believed | None = None,
        *,
        curved: bool = False,
    ) -> None:
        self.problem, self.objective, self.believed = problem, objective, believed
        self.curved = curved
        self.box = problem.coordinates.x_low, problem.coordinates.x_high
        number = measured_numbers(problem.points)
        self.noise = {"chi2": 1.0, "sigma": len(problem.points) / number}.get(objective)
        self._scale = self.noise or 1.0 / number

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P); a cost beyond that of the point near by is infinite."""
        most = None if near is None else near.cost
        equations = self.problem.normal_equations(x, self.objective, most, with_slopes=self.curved)
        cost, gradient, hessian = equations.sums
        if self.believed is not None:
            pull, down, curved = self.believed.penalty_terms(x)
            cost += self._scale * pull
            gradient += self._scale * down
            np.einsum("sii->si", hessian)[:] += self._scale * curved
        cost[~np.isfinite(cost)] = np.inf
        slopes = carried(equations.slopes) if self.curved else ()
        return Points(x, cost, (gradient, hessian, *slopes))

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g and H, which come with the cost."""
        gradient, hessian, *_ = points.carried
        return gradient, hessian

    def projected(self, x: np.ndarray, points: Points) -> np.ndarray:
        """J'r (S, P) of the residuals at x (S, P) and the slopes J at points near by."""
        product = self.problem.projected(x, self.objective, points.carried[2].tolist())
        if self.believed is not None:
            product += self._scale * self.believed.penalty_terms(x)[1]
        return product

    def parts(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost (S, M), gradient (S, M, P) and Gauss-Newton matrix (S, M, P, P) by operating point;
        the last part is what is believed, where anything is.
        """
        equations = self.problem.normal_equations(x, self.objective)
        cost, gradient, hessian = equations.cost, equations.gradient, equations.hessian
        if self.believed is None:
            return cost, gradient, hessian
        own = tuple(self._scale * part for part in self.believed.penalty_terms(x))
        curved = own[2][:, None, :, None] * np.eye(x.shape[1])
        return (
            np.concatenate([cost, own[0][:, None]], axis=1),
            np.concatenate([gradient, own[1][:, None]], axis=1),
            np.concatenate([hessian, curved], axis=1),
        )


class _Caller:
    """A CasADi function called row by row through fixed buffers, without the cost of its Python
    interface.
    """

    def __init__(self, function: ca.Function, parameters: int, outputs: tuple[int, ...]) -> None:
        buffer, self._run = function.buffer()
        self._buffer: Any = buffer
        self._theta, self._point = np.zeros(parameters), np.zeros(3)
        self._outputs = [np.zeros(size) for size in outputs]
        if parameters:
            self._buffer.set_arg(0, memoryview(self._theta))
        self._buffer.set_arg(1, memoryview(self._point))
        for index, output in enumerate(self._outputs):
            if output.size:
                self._buffer.set_res(index, memoryview(output))

    def __call__(self, theta: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, ...]:
        self._point[:] = point
        results = tuple(np.empty((len(theta), output.size)) for output in self._outputs)
        for row, values in enumerate(theta):
            self._theta[:] = values
            self._run()
            for result, output in zip(results, self._outputs, strict=True):
                result[row] = output
        return results
