"""The weighted least-squares misfit of a diagram with limits to event records, and descents on it.

cost(x) = sum over the samples of ((i_model - i) / sigma)^2, less what errors common to many samples
explain, + chi2 of a sweep + the prior penalty. Gradients are finite differences of simulations that
take the same time steps.

A resonance that is off by some per cent falls out of phase within a few periods, and the cost has a
local minimum at each of them. A fit therefore begins with the prediction error: the states are
corrected by the measured current (an observer), errors decay, and the cost has one valley. Until a
model explains the data, the residual counts as noise, so that the prior holds what they do not
determine; for predictions the scale is the median residual and large residuals weigh less (a robust
loss), since a missing limit acts for a short time only.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.ipopt import Valued
from ibrid.fit.least_squares import Descent, Points, carried
from ibrid.fit.problem import FreeNumber, Misfit
from ibrid.gap.recordings.event_noise import EventNoise
from ibrid.gap.refitting.model import Values
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.measurement.recordings.events import EventRecord
from ibrid.playback.limits import Limit
from ibrid.playback.player import Player
from ibrid.playback.steps import ORDER_5, ORDER_8

#: Finite-difference step of a coordinate at the noise; it grows with the residual up to the second,
#: which parameters at which the model is discontinuous always have.
SLOPE_STEP = 3e-5
WIDEST_SLOPE_STEP = 1e-2
#: Time step times the fastest mode: of a simulation, and of a prediction, whose errors decay.
STEP = 1.0
PREDICTION_STEP = 2.0
#: Rounds, and steps of each, of a descent on predictions and on whole simulations.
PREDICTION_EFFORT = (10, 2)
SIMULATION_EFFORT = (12, 3)
#: To which part the excess over the noise must fall in a round, or the round is idle: while whole
#: simulations leave more than `NEAR_NOISE` deviations of the noise, and otherwise.
FAR_PROGRESS = 0.85
NEAR_PROGRESS = 0.98
NEAR_NOISE = 6.0
#: Residual, in deviations of the noise, above which decimated records serve: for little noise, and
#: for more than `LITTLE_NOISE` (NRMSE), which hides the error of decimation.
DECIMATION_LIMIT = 6.0
NOISY_DECIMATION_LIMIT = 1.5
LITTLE_NOISE = 5e-3
#: NRMSE of the residual above which the error of decimation does not matter.
DECIMATION_ERROR = 0.05
#: Idle rounds in turn after which a descent ends.
MOST_IDLE = 3
#: Part of its excess over the noise to which a restart must bring a descent to be repeated.
RESTART_GAIN = 0.8
#: Cost per independent number up to which a model explains the records, and above which it cannot
#: compete with one that does.
EXPLAINED_COST = 1.1
HOPELESS_COST = 30.0
#: Offsets, either way, at which a parameter with a discontinuous model is tried again: its slope is
#: a chord and misses a valley a thousandth away. Starts of these that are descended, with rounds
#: and steps of each.
NUDGES = (2.5e-4, 1e-3, 4e-3, 1.6e-2)
MOST_NUDGED = 6
NUDGED_EFFORT = (1, 3)
#: Median of |z| of a standard normal z.
NORMAL_MEDIAN = 0.6745
#: Multiple of the median residual at which the robust weight has fallen to 1 / sqrt(2).
ROBUST_LIMIT = 3.0
#: Sum of squares, in deviations, below which a change moves no parameter by a tenth of its own.
NEGLIGIBLE = 1e-2
#: Parameter sets simulated together at most, and single ones whose residuals are kept.
MOST_TOGETHER = 32
MOST_KNOWN = 4
DESCENT = Descent(
    marquardt=True,
    damping=1e-3,
    greatest=1e7,
    largest=1.0,
    stall=1e-4,
    enough=1e-5,
    small=0.02,
    trusted=np.inf,
)


class EventMisfit:
    """The misfit of one diagram to event records, and to a sweep where there is one.

    A `SumOfSquares` over the search coordinates x (P,).

    Parameters
    ----------
    player : Player
        Simulates the diagram with its limits.
    limits : sequence of Limit
        Those limits; some of their parameters may differ from record to record.
    noise : EventNoise
        Of the records; holds these.
    prior : Prior
        Nominal values with tolerances.
    sweep : Misfit or None
        Misfit of the same diagram to the sweep, without a prior.
    """

    def __init__(
        self,
        player: Player,
        limits: Sequence[Limit],
        noise: EventNoise,
        prior: Prior,
        sweep: Misfit | None,
    ) -> None:
        self.player = player
        self.limits = tuple(limits)
        self.noise = noise
        self.sweep = sweep
        self.is_predicting = False
        self.rule = ORDER_8
        self.scale = 1.0
        self.weight = np.ones(1)
        # residuals of the last few x, and normal equations of the last x: asked for again
        self._known: dict[tuple[bytes, bool], np.ndarray] = {}
        self._normals: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        self._per_event = {f"{limit.id}.{name}" for limit in limits for name in limit.each}
        names_of = {
            name: [event_parameter(name, event) for event in noise.events.names]
            for name in self._per_event
        }
        parameters = [
            replace(parameter, name=name)
            for parameter in self.player.parameters
            for name in names_of.get(parameter.name, [parameter.name])
        ]
        self.numbers = [FreeNumber(parameter) for parameter in parameters]
        self.parameter_prior = ParameterPrior(parameters, prior)
        self.coordinates = self.parameter_prior.coordinates
        self.box = self.coordinates.x_low, self.coordinates.x_high
        jumps = {f"{limit.id}.{name}" for limit in limits for name in limit.jumps}
        self.is_discontinuous = np.array([parameter.name in jumps for parameter in parameters])
        columns = {parameter.name: column for column, parameter in enumerate(parameters)}
        swept = [] if sweep is None else sweep.problem.numbers
        self._sweep_columns = np.array([columns[number.name] for number in swept], dtype=int)

    # --- the same misfit of other data, or to another accuracy

    @cached_property
    def prediction(self) -> "EventMisfit":
        """The prediction error: an observer corrects the states by the measured current."""
        return self._copy_with(is_predicting=True, noise=self.noise.for_predictions)

    @cached_property
    def decimated(self) -> "EventMisfit":
        """The misfit to decimated records, for descents far from the noise.

        Itself where there are few samples.
        """
        noise = self.noise.decimated
        return self if noise is self.noise else self._copy_with(noise=noise)

    @cached_property
    def coarse(self) -> "EventMisfit":
        """The misfit with time steps of order five instead of eight, in half the time."""
        return self if self.rule is ORDER_5 else self._copy_with(rule=ORDER_5)

    def until(self, seconds: float) -> "EventMisfit":
        """Return the misfit to records that end so long after their events begin."""
        return self._copy_with(noise=self.noise.until(seconds))

    def with_residual_as_noise(self, x: np.ndarray) -> "EventMisfit":
        """Return the misfit with the residual at x (P,) as the noise, where that is larger."""
        other = self._copy_with(scale=1.0, weight=np.ones(1), _known=self._known)
        if self.is_predicting:
            residual = other.whitened_residuals(x[None])[0]
            median = max(float(np.median(np.abs(residual))) / NORMAL_MEDIAN, 1.0)
            other.weight = 1.0 / np.hypot(1.0, np.nan_to_num(residual) / (ROBUST_LIMIT * median))
        cost = float(other.at(x[None]).cost[0] - self.parameter_prior.penalty_terms(x)[0])
        other.scale = float(np.sqrt(max(cost / self.count, 1.0))) if np.isfinite(cost) else 1.0
        return other

    def _copy_with(self, **changes: Any) -> "EventMisfit":
        """Return a copy with other attributes, without what was derived from the old ones."""
        other = copy(self)
        for derived in ("coarse", "decimated", "prediction"):
            vars(other).pop(derived, None)
        vars(other).update({"_known": {}, "_normals": {}} | changes)
        return other

    def coarse_steps_matter(self, x: np.ndarray, scale: float) -> bool:
        """Whether coarse time steps change the residuals at x (P,) by more than is negligible.

        scale : residual in deviations of the noise.
        """
        coarse = self.coarse.whitened_residuals(x[None])
        difference = (coarse - self.whitened_residuals(x[None])) / scale
        return not (difference**2).sum() < NEGLIGIBLE

    # --- counts and parameters

    @property
    def measurement_count(self) -> int:
        """Measured real numbers of records and sweep."""
        samples = sum(len(record.time) for record in self.noise.events.records)
        return 2 * samples + self._swept_count

    @property
    def count(self) -> float:
        """Independent numbers among them: the chi2 expected of noise and sampling alone."""
        return self.noise.count + self._swept_count

    @property
    def _swept_count(self) -> int:
        points = [] if self.sweep is None else self.sweep.problem.points
        return sum(2 * point.admittance.size for point in points)

    @cached_property
    def decimation_limit(self) -> float:
        """Residual, in deviations of the noise, above which decimated records serve."""
        is_noisy = self.noise.of_current > LITTLE_NOISE
        return NOISY_DECIMATION_LIMIT if is_noisy else DECIMATION_LIMIT

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return the parameter values at x (P,) by name."""
        theta = self.coordinates.to_theta(x)
        pairs = zip(self.parameter_prior.names, theta, strict=True)
        return {name: float(value) for name, value in pairs}

    def values_for_event(self, record: EventRecord, x: np.ndarray) -> dict[str, float]:
        """Return the values at x (P,) that hold in one record, with its own parameters."""
        values = self.values(x)
        own = {name: values[event_parameter(name, record.name)] for name in self._per_event}
        return values | own

    # --- residuals and cost

    def whitened_residuals(self, x: np.ndarray) -> np.ndarray:
        """Return (i_model - i) / sigma of all records at x (S, P) as (S, R).

        NaN where a simulation diverges or falls out of step. A single x is kept.
        """
        if len(x) > 1:
            return self._simulate_residuals(x) * self.weight
        key = x.tobytes(), self._resolves_kinks
        if key not in self._known:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[key] = self._simulate_residuals(x)
        return self._known[key] * self.weight

    @property
    def _resolves_kinks(self) -> bool:
        """Whether time steps are divided where a limit begins to act: worth it near the noise only.

        Also True, at any distance, where no limit acts: results are then kept under one key.
        """
        has_kinks = bool(self.limits) and not self.is_predicting
        return self.scale < NEAR_NOISE or not has_kinks

    def _simulate_residuals(self, x: np.ndarray) -> np.ndarray:
        """Return whitened residuals (S, R) without robust weights at x (S, P)."""
        parts = []
        for record in self.noise.events.records:
            noise = self.noise.of[record.name]
            values = [self.values_for_event(record, point) for point in x]
            currents: list[np.ndarray] = []
            for first in range(0, len(values), MOST_TOGETHER):
                currents += self._simulate(record, values[first : first + MOST_TOGETHER])
            error = np.array(currents) - record.i
            if self.is_predicting:
                parts.append((error / noise.sigma).reshape(len(values), -1))
            else:
                parts.append(noise.whitened(error))
        return np.concatenate(parts, axis=1)

    def _simulate(self, record: EventRecord, values: list[dict[str, float]]) -> list[np.ndarray]:
        """Return the current (N, 2) of a record at each set of values; NaN without equilibrium."""
        try:
            responses = self.player.play(
                record,
                values,
                step=PREDICTION_STEP if self.is_predicting else STEP,
                led=self.is_predicting,
                rule=self.rule,
                sharp=self._resolves_kinks,
            )
        except IbridError:  # none of them has an equilibrium
            return [np.full(record.i.shape, np.nan)] * len(values)
        return [response.current for response in responses]

    def whitened_currents(self, x: np.ndarray) -> np.ndarray:
        """Return i_model / sigma (R,) of all records at x (P,), with the finest time steps."""
        parts = []
        for record in self.noise.events.records:
            (response,) = self.player.play(record, [self.values_for_event(record, x)])
            parts.append(self.noise.of[record.name].whitened(response.current[None])[0])
        return np.concatenate(parts)

    def residual_norm(self, x: np.ndarray) -> float:
        """Return |i_model - i| over all samples at x (P,), per unit; infinite where it diverges."""
        square = 0.0
        for record in self.noise.events.records:
            (response,) = self.player.play(record, [self.values_for_event(record, x)])
            square += float(((response.current - record.i) ** 2).sum())
        norm = float(np.sqrt(square))
        return norm if np.isfinite(norm) else np.inf

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate the cost at x (S, P)."""
        residual = self.whitened_residuals(x)
        cost = (residual**2).sum(axis=1)
        if self.sweep is not None:
            cost = cost + self.sweep.at(x[:, self._sweep_columns]).cost
        cost = cost / self.scale**2 + self.parameter_prior.penalty_terms(x)[0]
        return Points(x, np.where(np.isfinite(cost), cost, np.inf), carried(residual))

    # --- derivatives

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Return half the gradient (S, P) and the Gauss-Newton Hessian (S, P, P) of the cost."""
        pairs = [
            self._normal(x, residual)
            for x, residual in zip(points.x, points.carried[0], strict=True)
        ]
        gradients = np.array([gradient for gradient, _ in pairs])
        return gradients, np.array([hessian for _, hessian in pairs])

    def _normal(self, x: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return J'e + half the prior's gradient, and J'J + the prior's curvature, at x (P,)."""
        key = x.tobytes()
        if key not in self._normals:
            jacobian = self.event_jacobian(x)
            gradient = jacobian.T @ residual
            hessian = jacobian.T @ jacobian
            if self.sweep is not None:
                columns = self._sweep_columns
                swept = self.sweep.normal(self.sweep.at(x[None, columns]))
                gradient[columns] += swept[0][0]
                hessian[np.ix_(columns, columns)] += swept[1][0]
            self._normals = {key: (gradient, hessian)}
        gradient, hessian = self._normals[key]
        _, slope, curvature = self.parameter_prior.penalty_terms(x)
        return gradient / self.scale**2 + slope, hessian / self.scale**2 + np.diag(curvature)

    def evaluate_objective(self, x: np.ndarray) -> Valued:
        """Return half the cost at x (P,), and what evaluates its gradient and its Hessian."""
        points = self.at(x[None])
        return 0.5 * float(points.cost[0]), lambda: self._normal(x, points.carried[0][0])

    def event_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return d residual / dx (R, P) of the records at x (P,), by one-sided differences."""
        smooth_step = min(SLOPE_STEP * self.scale, WIDEST_SLOPE_STEP)
        size = np.where(self.is_discontinuous, WIDEST_SLOPE_STEP, smooth_step)
        step = np.where(x + size <= self.box[1], size, -size)
        residuals = self.whitened_residuals(np.concatenate([x[None], x + np.diag(step)]))
        return np.nan_to_num((residuals[1:] - residuals[0]) / step[:, None]).T

    def _central_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return d residual / dx (R, P) by central differences, a step beyond the bounds, too.

        Exact to the square of the step, so that a non-identifiable direction has no slope.
        """
        size = np.where(self.is_discontinuous, WIDEST_SLOPE_STEP, SLOPE_STEP)
        steps = np.diag(size)
        residuals = self.whitened_residuals(np.concatenate([x + steps, x - steps]))
        difference = residuals[: len(x)] - residuals[len(x) :]
        return np.nan_to_num(difference / (2.0 * size[:, None])).T

    def whitened_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return d/dx of all residuals at x (P,): of records, sweep and, as last P rows, prior."""
        parts = [self._central_jacobian(x)]
        if self.sweep is not None:
            problem = self.sweep.problem
            deviations = (np.asarray(point.sigma) for point in problem.points)
            of_sweep = problem.white_slopes(x[self._sweep_columns], deviations)
            padded = np.zeros((len(of_sweep), len(x)))
            padded[:, self._sweep_columns] = of_sweep
            parts.append(padded)
        return np.concatenate([*parts, np.diag(self.parameter_prior.deviation_slope_in_x(x))])

    # --- residuals by record and operating point

    def complex_residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Return the whitened residual d + j q (N,) of each record at x (P,)."""
        residual = self.whitened_residuals(x[None])[0].reshape(-1, 2) @ [1, 1j]
        lengths = [len(record.time) for record in self.noise.events.records]
        return np.split(residual, np.cumsum(lengths)[:-1])

    def sweep_residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Return the whitened residual (K, 2, 2) of each operating point of the sweep at x (P,)."""
        if self.sweep is None:
            return []
        problem = self.sweep.problem
        pairs = zip(problem.responses(x[self._sweep_columns]), problem.points, strict=True)
        return [
            (response - point.admittance) / np.asarray(point.sigma) for response, point in pairs
        ]

    # --- starts of descents

    def start_descents(self, x: np.ndarray, number: int) -> "list[EventDescent]":
        """Return descents from the starts x (S, P) of least cost, best first.

        Fewer than `number` where fewer starts can be simulated.
        """
        points = self.at(x)
        order = np.argsort(points.cost, kind="stable")[:number]
        return [
            EventDescent(self, points.x[k], float(points.cost[k]))
            for k in order
            if np.isfinite(points.cost[k])
        ]

    def start_descents_from(self, starts: Sequence[Values], number: int) -> "list[EventDescent]":
        """Return the best descents, as `start_descents`, from starts by name, each tried once."""
        x = [self.parameter_prior.start(values) for values in starts]
        return self.start_descents(np.unique(np.array(x), axis=0), number) if x else []

    def start_descent(self, x: np.ndarray) -> "EventDescent":
        """Return a descent from x (P,)."""
        return EventDescent(self, x, float(self.at(x[None]).cost[0]))


@dataclass
class EventDescent:
    """A descent in rounds of a few Levenberg-Marquardt steps.

    In each round the residual counts as the noise, until it is the noise or rounds in turn gain
    little. The damping is kept from round to round: a limit makes valleys in which the first steps
    of a fresh descent fail.

    Parameters
    ----------
    misfit : EventMisfit
        What is minimised.
    x : ndarray
        (P,) where the descent is, and `cost` there.
    scale : float
        Residual in deviations of the noise, as of the last round.
    idle : int
        Rounds in turn that gained little.
    over : bool
        The descent has converged, or was idle for too long.
    damping : ndarray or None
        (1,) of the last step; None where the last round converged.
    """

    misfit: EventMisfit
    x: np.ndarray
    cost: float
    scale: float = np.inf
    idle: int = 0
    over: bool = False
    damping: np.ndarray | None = None

    @property
    def values(self) -> Values:
        """Parameter values by name."""
        return self.misfit.values(self.x)

    @property
    def explains(self) -> bool:
        """Whether no more than noise is left."""
        return self.cost <= EXPLAINED_COST * self.misfit.count

    @property
    def is_far(self) -> bool:
        """Whether so much is left that last steps cannot make it compete with a right model."""
        return self.cost > HOPELESS_COST * self.misfit.count

    @property
    def _residual_over_noise(self) -> float:
        """The residual in deviations of the noise, 1 at least."""
        return float(np.sqrt(max(self.cost / self.misfit.count, 1.0)))

    def run(self, rounds: int, steps: int) -> "EventDescent":
        """Run so many rounds of so many steps, and return this descent.

        Far from the noise on decimated records; with coarse time steps until they matter.
        """
        misfit = self.misfit
        is_far = self._residual_over_noise > misfit.decimation_limit
        if is_far and misfit.decimated is not misfit and not self._run_decimated(rounds, steps):
            return self
        before = (self.idle, self.over, self.damping)
        needs_fine_steps = misfit.coarse_steps_matter(self.x, self._residual_over_noise)
        if not needs_fine_steps:
            self._run_rounds(misfit.coarse, rounds, steps)
            needs_fine_steps = misfit.coarse_steps_matter(self.x, self.scale)
            if needs_fine_steps:
                self.idle, self.over, self.damping = before
        if needs_fine_steps:
            self._run_rounds(misfit, rounds, steps)
        self.cost = float(misfit.at(self.x[None]).cost[0])
        return self

    def _run_decimated(self, rounds: int, steps: int) -> bool:
        """Run rounds on decimated records; go back where the cost of all samples did not fall.

        Returns
        -------
        bool
            Whether to go on with all samples: near the noise, or where the descent on decimated
            records is over and their error may matter.
        """
        x, cost = self.x, self.cost
        before = (self.idle, self.over, self.damping)
        self._run_rounds(self.misfit.decimated.coarse, rounds, steps)
        self.cost = float(self.misfit.at(self.x[None]).cost[0])
        if not self.cost < cost:
            self.x = x
            self.cost = cost
        residual = self._residual_over_noise
        is_small = residual * self.misfit.noise.of_current < DECIMATION_ERROR
        goes_on = (self.over and is_small) or residual <= self.misfit.decimation_limit
        if goes_on:
            self.idle, self.over, self.damping = before
        return goes_on

    def _run_rounds(self, misfit: EventMisfit, rounds: int, steps: int) -> None:
        for _ in range(rounds):
            if self.over:
                break
            self._run_round(misfit, steps)

    def _run_round(self, misfit: EventMisfit, steps: int) -> None:
        """Run some steps with the residual as the noise; count idle rounds, and see the end."""
        scaled = misfit.with_residual_as_noise(self.x)
        is_simulating_far = self.scale > NEAR_NOISE and not misfit.is_predicting
        progress = FAR_PROGRESS if is_simulating_far else NEAR_PROGRESS
        is_idle = scaled.scale**2 - 1 > progress**2 * (self.scale**2 - 1)
        self.idle = self.idle + 1 if is_idle and self.scale > 1.02 else 0
        if self.idle == MOST_IDLE:
            self.over = True
            return
        self.scale = min(scaled.scale, self.scale)
        batch = DESCENT.begin(scaled, self.x[None])
        if self.damping is not None:
            batch = replace(batch, damping=self.damping)
        batch = DESCENT.go(scaled, batch, steps)
        has_converged = bool(batch.ended[0])
        # a step that the kept damping makes short is no convergence
        self.over = self.scale == 1.0 and has_converged and self.damping is None
        self.x = batch.x[0]
        self.damping = None if has_converged else batch.damping

    def restart_while_improving(self) -> None:
        """Restart while that helps: from x, and elsewhere where more than noise is left."""
        while self._restart_from(self.x) or (
            not self.explains and any(self._restart_from(x) for x in self._alternative_starts())
        ):
            pass

    def _alternative_starts(self) -> Iterator[np.ndarray]:
        """Yield other starts x (P,): parameters with a discontinuous model moved by a little;
        implausible ones reset to nominal (a zero at 0, for which a resistance makes up: no slope
        leads back); and where descents on predictions lead from there.
        """
        directions = np.eye(len(self.x))[self.misfit.is_discontinuous]
        nudged = [
            self.x + signed * direction
            for direction in directions
            for nudge in NUDGES
            for signed in (nudge, -nudge)
        ]
        if nudged:
            inside = np.clip(nudged, *self.misfit.box)
            descents = self.misfit.start_descents(inside, MOST_NUDGED)
            ends = [descent.run(*NUDGED_EFFORT) for descent in descents]
            yield min(ends, key=lambda end: end.cost, default=self).x
        plausible = self.misfit.parameter_prior.reset_implausible(self.x)
        starts = (plausible, self.x) if np.any(plausible != self.x) else (self.x,)
        for x in starts:
            for descent in self.misfit.prediction.start_descents(x[None], 1):
                yield descent.run(*PREDICTION_EFFORT).x
        yield plausible

    def _restart_from(self, x: np.ndarray) -> bool:
        """Descend from x (P,), keep the better end, and return whether it is much better."""
        excess = self.cost - self.misfit.count
        for restarted in self.misfit.start_descents(x[None], 1):
            if restarted.run(*SIMULATION_EFFORT).cost < self.cost:
                self.x = restarted.x
                self.cost = restarted.cost
        return excess > 0 and self.cost - self.misfit.count < RESTART_GAIN * excess


def event_parameter(name: str, event: str) -> str:
    """Return the name of a parameter that each record has of its own."""
    return f"{name} of {event}"
