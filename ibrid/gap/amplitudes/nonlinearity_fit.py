"""The fit of one nonlinearity at one port: its threshold and the parameters of the model, over all
amplitudes together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.least_squares import Descent, Points, carried
from ibrid.gap.amplitudes.amplitude_data import AmplitudeData
from ibrid.gap.amplitudes.harmonic_balance import (
    LinearPart,
    PeriodicMotion,
    build_linear_part,
    evaluate_at_harmonics,
    extrapolate_leaving,
    response,
    solve_balance,
)
from ibrid.gap.amplitudes.nonlinearity_edits import NonlinearityEdit, values_at_rest
from ibrid.gap.ports.open_port import OpenPort
from ibrid.gap.refitting.model import FitResult
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram

#: Thresholds to begin with, and their box: of a dead zone or saturation per unit; of a limit its
#: distance from the largest value at rest, relative to that.
BANK = tuple(np.geomspace(3e-4, 0.1, 9))
BOX = (1e-5, 1.0)
#: Starts that are descended, steps of each and of the best, and the step of numeric slopes.
KEPT, FIRST_STEPS, MOST_STEPS, SLOPE = 2, 8, 40, 1e-5
DESCENT = Descent(
    marquardt=True, damping=1e-3, greatest=1e7, largest=1.0, enough=1e-4, small=1e-3, trusted=np.inf
)


@dataclass(frozen=True, eq=False)
class NonlinearityPoint:
    """A point of the search. `x` : (P + 1,), the last is ln of the threshold as it is searched for.
    `chi2` : of the data,
    `cost` : with the prior. `Y` : (K, M, L, 2, 2). `rest` : (M, r). `linear`, `motion` : of all
    cells.
    """

    x: np.ndarray
    threshold: float
    chi2: float
    cost: float
    Y: np.ndarray
    rest: np.ndarray
    linear: LinearPart
    motion: PeriodicMotion


@dataclass(frozen=True, eq=False)
class NonlinearityFit(FitResult):
    """A nonlinearity at its best threshold and parameters.

    `interval` : of the threshold, 95 %. `state` : the motion there.
    """

    place: NonlinearityEdit
    threshold: float
    interval: tuple[float, float]
    state: NonlinearityPoint

    @property
    def seen(self) -> bool:
        """True where the data hold the threshold inside its box, and every motion is balanced."""
        low, high = self.interval
        inside = np.isfinite(high) and high < 10.0 * self.threshold and low > 0.1 * self.threshold
        return bool(inside and self.state.motion.converged.all())


class NonlinearityFitter:
    """The fits of one place to one set of data."""

    def __init__(
        self,
        place: NonlinearityEdit,
        diagram: Diagram,
        kinds: Vocabulary,
        data: AmplitudeData,
        prior: Prior,
    ) -> None:
        self.place, self.diagram, self.kinds, self.data = place, diagram, kinds, data
        self.model = evaluate_at_harmonics(OpenPort(place.port, kinds, data.sweep), data.frequency)
        self.parameters = self.model.symbolic.parameters
        self.coordinates = self.model.coordinates
        self.parameter_prior = ParameterPrior(self.parameters, prior)
        self._slopes_of: WeakKeyDictionary[NonlinearityPoint, np.ndarray] = WeakKeyDictionary()
        low, high = np.log(BOX)  # of the threshold
        self.box = np.append(self.coordinates.x_low, low), np.append(self.coordinates.x_high, high)

    def best(self, starts: Sequence[Mapping[str, float]]) -> NonlinearityFit | None:
        """The best fit from parameter values, each with every threshold of the bank; None where
        nothing has a response.
        """
        begun: list[NonlinearityPoint] = []
        for start in starts:
            x = self.parameter_prior.start(start)
            beside = self._open_model(x)
            states = (
                []
                if beside is None
                else [self._solve_point(np.append(x, np.log(one)), beside) for one in BANK]
            )
            begun += [state for state in states if state is not None]
        if not begun:
            return None
        begun.sort(key=lambda one: one.cost)
        first = begun[:KEPT]
        points = Points(
            np.array([one.x for one in first]),
            np.array([one.cost for one in first]),
            carried(first),
        )
        best = DESCENT.go(self, DESCENT.start(points), FIRST_STEPS).best(1)
        best = DESCENT.go(self, DESCENT.start(best.points), MOST_STEPS)
        return self._summarise(best.points.carried[0][0])

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P + 1), the motions from those near."""
        before = (
            [None] * len(x)
            if near is None
            else [state.motion.entering for state in near.carried[0]]
        )
        states = [self.state(*pair) for pair in zip(x, before, strict=True)]
        return Points(
            x,
            np.array([np.inf if state is None else state.cost for state in states]),
            carried(states),
        )

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g and H; slopes are taken once for each state."""
        pairs = [self._normal(state) for state in points.carried[0]]
        return np.array([gradient for gradient, _ in pairs]), np.array(
            [hessian for _, hessian in pairs]
        )

    def _normal(self, state: NonlinearityPoint) -> tuple[np.ndarray, np.ndarray]:
        jacobian = self._jacobian(state)
        misfit = self.data.weight * (state.Y - self.data.admittance)
        _, down, hold = self.parameter_prior.penalty_terms(state.x[:-1])
        gradient = jacobian.T @ np.concatenate([np.real(misfit).ravel(), np.imag(misfit).ravel()])
        return gradient + np.append(down, 0.0), jacobian.T @ jacobian + np.diag(
            np.append(hold, 0.0)
        )

    def state(self, x: np.ndarray, start: np.ndarray | None = None) -> NonlinearityPoint | None:
        """The motion at x, begun from another one's `entering`; None where there is none."""
        beside = self._open_model(x[:-1])
        return None if beside is None else self._solve_point(x, beside, start)

    def _solve_point(
        self, x: np.ndarray, beside: tuple[LinearPart, np.ndarray], start: np.ndarray | None = None
    ) -> NonlinearityPoint | None:
        linear, rest = beside
        threshold = self._threshold(x[-1], rest)
        motion = solve_balance(
            linear, self.place.shape, self.data.spread_to_cells(rest), threshold, start
        )
        if start is not None and not motion.converged.all():
            motion = solve_balance(
                linear, self.place.shape, self.data.spread_to_cells(rest), threshold
            )
        Y = self.data.matrices(response(linear, motion.leaving))
        misfit = self.data.weight * (Y - self.data.admittance)
        chi2 = float((np.abs(misfit) ** 2).sum())
        if not np.isfinite(chi2):
            return None
        cost = chi2 + float(self.parameter_prior.penalty_terms(x[:-1])[0])
        return NonlinearityPoint(x, threshold, chi2, cost, Y, rest, linear, motion)

    def _open_model(self, x: np.ndarray) -> tuple[LinearPart, np.ndarray] | None:
        """What the model does beside the port, and the value at rest (M, r), at parameters x (P,);
        None where it has none.
        """
        theta = self.coordinates.to_theta(x)
        with np.errstate(all="ignore"):
            opened = self.model.at(theta)
        if opened is None:
            return None
        linear = build_linear_part(opened, self.data.amplitude)
        rest = np.zeros((self.data.amplitude.shape[1], opened.z_u.shape[-2]))
        if self.place.resting:
            values = {one.name: float(theta[k]) for k, one in enumerate(self.parameters)}
            try:
                rest = values_at_rest(self.place, self.diagram, self.kinds, self.data.sweep, values)
            except IbridError:
                return None
        finite = (
            np.isfinite(linear.back).all()
            and np.isfinite(linear.drive).all()
            and np.isfinite(rest).all()
        )
        return (linear, rest) if finite else None

    def _threshold(self, x: float, rest: np.ndarray) -> float:
        """Per unit, of the coordinate that is searched; a limit counts from the largest value at
        rest.
        """
        excess = float(np.exp(x))
        return (
            float(self.place.shape.rest_size(rest).max() * (1.0 + excess))
            if self.place.shape.limits
            else excess
        )

    def _jacobian(self, state: NonlinearityPoint) -> np.ndarray:
        """The slopes at a state, taken once."""
        if state not in self._slopes_of:
            self._slopes_of[state] = self._slopes(state)
        return self._slopes_of[state]

    def _slopes(self, state: NonlinearityPoint) -> np.ndarray:
        """White dY/dx, (2 N, P + 1) real rows; exact to first order without solving the balance
        anew.
        """
        columns = []
        for k in range(len(state.x)):
            x = state.x.copy()
            step = SLOPE if x[k] + SLOPE <= self.box[1][k] else -SLOPE
            x[k] += step
            beside = (state.linear, state.rest) if k == len(x) - 1 else self._open_model(x[:-1])
            if beside is None:
                columns.append(np.zeros(2 * state.Y.size))
                continue
            linear, rest = beside
            threshold = self._threshold(x[-1], rest)
            if threshold == state.threshold and np.array_equal(rest, state.rest):
                leaving = extrapolate_leaving(state.motion, linear)
            else:
                again = solve_balance(
                    linear,
                    self.place.shape,
                    self.data.spread_to_cells(rest),
                    threshold,
                    state.motion.entering,
                )
                leaving = again.leaving
            white = (
                self.data.weight * (self.data.matrices(response(linear, leaving)) - state.Y) / step
            )
            columns.append(np.concatenate([np.real(white).ravel(), np.imag(white).ravel()]))
        return np.nan_to_num(np.array(columns).T)

    def _summarise(self, state: NonlinearityPoint) -> NonlinearityFit:
        jacobian = self._jacobian(state)
        low, high = self.box
        box = (high - low) ** -2.0
        data, prior = (
            jacobian.T @ jacobian,
            np.diag(np.append(self.parameter_prior.penalty_terms(state.x[:-1])[2], 0.0) + box),
        )
        unit = np.diag(data + prior) ** -0.5
        covariance = (
            unit[:, None]
            * np.linalg.pinv(unit[:, None] * (data + prior) * unit, hermitian=True)
            * unit
        )
        effective = float(np.trace(covariance @ data))
        spread = 1.96 * float(np.sqrt(max(covariance[-1, -1], 0.0)))
        ends = [
            self._threshold(np.clip(state.x[-1] + one, -50.0, 50.0), state.rest)
            for one in (-spread, spread)
        ]
        # products of signals shift the mean in front of a limit by a^2/2, which no linear model
        # tells
        shift = float(self.data.amplitude.max()) ** 2 / 2.0 if self.place.shape.limits else 0.0
        low, high = (
            state.threshold
            + np.copysign(np.hypot(one - state.threshold, shift), one - state.threshold)
            for one in ends
        )
        theta = self.coordinates.to_theta(state.x[:-1])
        return NonlinearityFit(
            values={one.name: float(theta[k]) for k, one in enumerate(self.parameters)},
            chi2=state.chi2,
            penalty=state.cost - state.chi2,
            dof=max(self.data.measurement_count - effective, 1.0),
            measurement_count=self.data.measurement_count,
            parameter_count=len(state.x),
            place=self.place,
            threshold=state.threshold,
            interval=(float(low), float(high)),
            state=state,
        )
