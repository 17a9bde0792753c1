"""The fit of one nonlinearity at one port: its threshold and the parameters of the model, to all
amplitudes together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.least_squares import Descent, Points, carried, evaluated
from ibrid.gap.amplitudes.amplitude_data import AmplitudeData
from ibrid.gap.amplitudes.harmonic_balance import (
    LinearPart,
    PeriodicMotion,
    admittance_columns,
    build_linear_part,
    evaluate_at_harmonics,
    extrapolate_leaving,
    solve_balance,
)
from ibrid.gap.amplitudes.nonlinearity_edits import NonlinearityEdit, operating_values
from ibrid.gap.ports.open_port import OpenPort
from ibrid.gap.refitting.model import FitResult
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram

#: Initial thresholds and their bounds: of a dead zone or saturation per unit; of a limit its
#: distance from the largest operating value, relative to that.
INITIAL_THRESHOLDS = tuple(np.geomspace(3e-4, 0.1, 9))
THRESHOLD_BOUNDS = (1e-5, 1.0)
#: Starts that are descended, steps of each, and of the best.
DESCENDED_STARTS = 2
FIRST_STEPS = 8
MOST_STEPS = 40
#: Finite-difference step in search coordinates.
SLOPE_STEP = 1e-5
#: Factor on a threshold within which its 95 % interval must lie for it to be identifiable.
IDENTIFIABLE_FACTOR = 10.0
#: 97.5 % quantile of the normal distribution.
NORMAL_97 = 1.96
DESCENT = Descent(
    marquardt=True, damping=1e-3, greatest=1e7, largest=1.0, enough=1e-4, small=1e-3, trusted=np.inf
)

#: The linear part of a model, and the operating value (M, r) at the port.
OpenedAtPort = tuple[LinearPart, np.ndarray]


@dataclass(frozen=True, eq=False)
class NonlinearityPoint:
    """The model evaluated at one point of the search.

    Parameters
    ----------
    x : ndarray
        (P + 1,) search coordinates; the last is the logarithm of the threshold's coordinate.
    threshold : float
        Per unit.
    chi2, cost : float
        Of the data, and with the prior penalty.
    Y : ndarray
        (K, M, L, 2, 2) admittances.
    steady : ndarray
        (M, r) operating value at the port.
    linear : LinearPart
        Of the model at its parameters, for all cells.
    motion : PeriodicMotion
        The balanced harmonics of all cells.
    """

    x: np.ndarray
    threshold: float
    chi2: float
    cost: float
    Y: np.ndarray
    steady: np.ndarray
    linear: LinearPart
    motion: PeriodicMotion


@dataclass(frozen=True, eq=False)
class NonlinearityFit(FitResult):
    """A nonlinearity at its best threshold and parameters.

    Parameters
    ----------
    edit : NonlinearityEdit
        The nonlinearity and its port.
    threshold : float
        Per unit, with its 95 % confidence `interval`.
    point : NonlinearityPoint
        The model there.
    """

    edit: NonlinearityEdit
    threshold: float
    interval: tuple[float, float]
    point: NonlinearityPoint

    @property
    def is_identifiable(self) -> bool:
        """Whether the data determine the threshold and all motions are balanced."""
        low, high = self.interval
        is_bounded_above = np.isfinite(high) and high < IDENTIFIABLE_FACTOR * self.threshold
        is_bounded_below = low > self.threshold / IDENTIFIABLE_FACTOR
        return bool(is_bounded_above and is_bounded_below and self.point.motion.converged.all())


class NonlinearityFitter:
    """Fits one nonlinearity to sweeps at several amplitudes.

    A `SumOfSquares` over the search coordinates x (P + 1,).

    Parameters
    ----------
    edit : NonlinearityEdit
        The nonlinearity and its port.
    diagram : Diagram
        The linear model.
    kinds : Vocabulary
        Its module kinds.
    data : AmplitudeData
        The measured data.
    prior : Prior
        Nominal values with tolerances.
    """

    def __init__(
        self,
        edit: NonlinearityEdit,
        diagram: Diagram,
        kinds: Vocabulary,
        data: AmplitudeData,
        prior: Prior,
    ) -> None:
        self.edit = edit
        self.diagram = diagram
        self.kinds = kinds
        self.data = data
        open_port = OpenPort(edit.port, kinds, data.sweep)
        self.model = evaluate_at_harmonics(open_port, data.frequency)
        self.parameters = self.model.symbolic.parameters
        self.coordinates = self.model.coordinates
        self.parameter_prior = ParameterPrior(self.parameters, prior)
        self._jacobians: WeakKeyDictionary[NonlinearityPoint, np.ndarray] = WeakKeyDictionary()
        low, high = np.log(THRESHOLD_BOUNDS)
        x_low = np.append(self.coordinates.x_low, low)
        x_high = np.append(self.coordinates.x_high, high)
        self.box = x_low, x_high

    def fit(self, starts: Sequence[Mapping[str, float]]) -> NonlinearityFit | None:
        """Fit from parameter values by name, each with every initial threshold.

        None where none has a response.
        """
        points: list[NonlinearityPoint] = []
        for start in starts:
            x = self.parameter_prior.start(start)
            opened = self._open_model(x)
            if opened is None:
                continue
            for threshold in INITIAL_THRESHOLDS:
                point = self._solve_point(np.append(x, np.log(threshold)), opened)
                if point is not None:
                    points.append(point)
        if not points:
            return None
        points.sort(key=lambda point: point.cost)
        first = points[:DESCENDED_STARTS]
        x = np.array([point.x for point in first])
        cost = np.array([point.cost for point in first])
        batch = DESCENT.start(Points(x, cost, carried(first)))
        best = DESCENT.go(self, batch, FIRST_STEPS).best(1)
        best = DESCENT.go(self, DESCENT.start(best.points), MOST_STEPS)
        return self._summarise(best.points.carried[0][0])

    # --- the sum of squares

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate the cost at x (S, P + 1), with motions that begin at those of `near`."""
        motions = None if near is None else [one.motion.entering for one in near.carried[0]]
        return evaluated(x, self.evaluate, motions)

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return half the gradient (S, P + 1) and the Gauss-Newton Hessian (S, P + 1, P + 1)."""
        pairs = [self._normal(point) for point in points.carried[0]]
        gradients = np.array([gradient for gradient, _ in pairs])
        return gradients, np.array([hessian for _, hessian in pairs])

    def _normal(self, point: NonlinearityPoint) -> tuple[np.ndarray, np.ndarray]:
        """Return J'e and J'J of one point, with the terms of the prior."""
        jacobian = self._jacobian(point)
        misfit = self.data.weight * (point.Y - self.data.admittance)
        _, slope, curvature = self.parameter_prior.penalty_terms(point.x[:-1])
        gradient = jacobian.T @ np.concatenate([np.real(misfit).ravel(), np.imag(misfit).ravel()])
        hessian = jacobian.T @ jacobian + np.diag(np.append(curvature, 0.0))
        return gradient + np.append(slope, 0.0), hessian

    def evaluate(
        self, x: np.ndarray, entering: np.ndarray | None = None
    ) -> NonlinearityPoint | None:
        """Evaluate the model at x (P + 1,); None where it has no response.

        entering : coefficients (C, r, n) of another motion, from which the balance begins.
        """
        opened = self._open_model(x[:-1])
        return None if opened is None else self._solve_point(x, opened, entering)

    def _solve_point(
        self, x: np.ndarray, opened: OpenedAtPort, entering: np.ndarray | None = None
    ) -> NonlinearityPoint | None:
        """Balance the harmonics at x (P + 1,) with the model opened at its parameters."""
        linear, steady = opened
        threshold = self._threshold(x[-1], steady)
        cell_steady = self.data.spread_to_cells(steady)
        nonlinearity = self.edit.nonlinearity
        motion = solve_balance(linear, nonlinearity, cell_steady, threshold, entering)
        if entering is not None and not motion.converged.all():
            motion = solve_balance(linear, nonlinearity, cell_steady, threshold)
        Y = self.data.matrices(admittance_columns(linear, motion.leaving))
        misfit = self.data.weight * (Y - self.data.admittance)
        chi2 = float((np.abs(misfit) ** 2).sum())
        if not np.isfinite(chi2):
            return None
        cost = chi2 + float(self.parameter_prior.penalty_terms(x[:-1])[0])
        return NonlinearityPoint(x, threshold, chi2, cost, Y, steady, linear, motion)

    def _open_model(self, x: np.ndarray) -> OpenedAtPort | None:
        """Open the model at its port, at parameters x (P,); None where it has no response."""
        theta = self.coordinates.to_theta(x)
        with np.errstate(all="ignore"):
            opened = self.model.at(theta)
        if opened is None:
            return None
        linear = build_linear_part(opened, self.data.amplitude)
        steady = np.zeros((self.data.amplitude.shape[1], opened.z_u.shape[-2]))
        if self.edit.channels:
            values = self._values(theta)
            try:
                steady = operating_values(
                    self.edit, self.diagram, self.kinds, self.data.sweep, values
                )
            except IbridError:
                return None
        arrays = (linear.back, linear.drive, steady)
        is_finite = all(np.isfinite(array).all() for array in arrays)
        return (linear, steady) if is_finite else None

    def _values(self, theta: np.ndarray) -> dict[str, float]:
        """Return parameter values by name."""
        return {parameter.name: float(theta[k]) for k, parameter in enumerate(self.parameters)}

    def _threshold(self, x: float, steady: np.ndarray) -> float:
        """Return the threshold per unit of its coordinate x.

        That of a limit counts from the largest operating value, (M, r).
        """
        distance = float(np.exp(x))
        nonlinearity = self.edit.nonlinearity
        if not nonlinearity.is_limit:
            return distance
        return float(nonlinearity.limited_magnitude(steady).max() * (1.0 + distance))

    # --- derivatives and the result

    def _jacobian(self, point: NonlinearityPoint) -> np.ndarray:
        """Return the Jacobian at a point, computed once."""
        if point not in self._jacobians:
            self._jacobians[point] = self._compute_jacobian(point)
        return self._jacobians[point]

    def _compute_jacobian(self, point: NonlinearityPoint) -> np.ndarray:
        """Compute the whitened dY/dx (R, P + 1), real parts first, by finite differences.

        The balance is not solved again where neither threshold nor operating value changes: one
        Newton step is exact to first order.
        """
        columns: list[np.ndarray] = []
        for k in range(len(point.x)):
            x = point.x.copy()
            step = SLOPE_STEP if x[k] + SLOPE_STEP <= self.box[1][k] else -SLOPE_STEP
            x[k] += step
            is_threshold = k == len(x) - 1
            opened = (point.linear, point.steady) if is_threshold else self._open_model(x[:-1])
            if opened is None:
                columns.append(np.zeros(2 * point.Y.size))
                continue
            leaving = self._leaving_near(point, opened, self._threshold(x[-1], opened[1]))
            Y = self.data.matrices(admittance_columns(opened[0], leaving))
            slope = self.data.weight * (Y - point.Y) / step
            columns.append(np.concatenate([np.real(slope).ravel(), np.imag(slope).ravel()]))
        return np.nan_to_num(np.array(columns).T)

    def _leaving_near(
        self, point: NonlinearityPoint, opened: OpenedAtPort, threshold: float
    ) -> np.ndarray:
        """Return the leaving coefficients (C, r, n) of a slightly different model."""
        linear, steady = opened
        if threshold == point.threshold and np.array_equal(steady, point.steady):
            return extrapolate_leaving(point.motion, linear)
        cell_steady = self.data.spread_to_cells(steady)
        entering = point.motion.entering
        motion = solve_balance(linear, self.edit.nonlinearity, cell_steady, threshold, entering)
        return motion.leaving

    def _summarise(self, point: NonlinearityPoint) -> NonlinearityFit:
        """Return the fit at a point, with degrees of freedom and the interval of the threshold."""
        jacobian = self._jacobian(point)
        information = jacobian.T @ jacobian
        covariance = self._covariance(point, information)
        effective = float(np.trace(covariance @ information))
        count = self.data.measurement_count
        return NonlinearityFit(
            values=self._values(self.coordinates.to_theta(point.x[:-1])),
            chi2=point.chi2,
            penalty=point.cost - point.chi2,
            dof=max(count - effective, 1.0),
            measurement_count=count,
            parameter_count=len(point.x),
            edit=self.edit,
            threshold=point.threshold,
            interval=self._threshold_interval(point, float(covariance[-1, -1])),
            point=point,
        )

    def _covariance(self, point: NonlinearityPoint, information: np.ndarray) -> np.ndarray:
        """Return the covariance (P + 1, P + 1) of x by data and prior.

        What neither determines lies within its bounds.
        """
        low, high = self.box
        by_bounds = (high - low) ** -2.0
        curvature = self.parameter_prior.penalty_terms(point.x[:-1])[2]
        prior = np.diag(np.append(curvature, 0.0) + by_bounds)
        unit = np.diag(information + prior) ** -0.5
        scaled = unit[:, None] * (information + prior) * unit
        return unit[:, None] * np.linalg.pinv(scaled, hermitian=True) * unit

    def _threshold_interval(self, point: NonlinearityPoint, variance: float) -> tuple[float, float]:
        """Return the 95 % interval of the threshold, from the variance of its coordinate.

        Products of signals shift the mean in front of a limit by a^2/2, which no linear model
        shows; that widens its interval.
        """
        half_width = NORMAL_97 * float(np.sqrt(max(variance, 0.0)))
        shift = 0.0
        if self.edit.nonlinearity.is_limit:
            shift = float(self.data.amplitude.max()) ** 2 / 2.0
        ends: list[float] = []
        for offset in (-half_width, half_width):
            x = np.clip(point.x[-1] + offset, -50.0, 50.0)
            distance = self._threshold(x, point.steady) - point.threshold
            ends.append(float(point.threshold + np.copysign(np.hypot(distance, shift), distance)))
        return ends[0], ends[1]
