"""What a diagram with limits leaves of records of events, and of a sweep beside them; and descents
on it.

cost(x) = sum over the samples of ((i_model - i) / sigma)^2, less what errors that samples share
explain, + chi2 of the sweep + the squared standard deviations of the prior. Slopes are differences
of simulations that take the same steps as the one they are taken at.

A resonance that is off by some per cent rings out of step within a few periods, and the cost has a
minimum at each of them. So a fit begins with predictions: the states are led by the measured
current, errors die away, and the cost has one valley. And until the model explains the data what is
left over counts as noise, so that the prior holds what they do not tell; of predictions the median
of it, and samples far beyond weigh less: a limit acts for a while, the rest of the record is right.
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
from ibrid.gap.refitting.prior import Beliefs, Prior
from ibrid.measurement.recordings.events import EventRecord
from ibrid.playback.limits import Limit
from ibrid.playback.player import Player
from ibrid.playback.steps import ORDER_5, ORDER_8

#: Step of a coordinate for a slope where noise is left, and at most: far from there, and of what
#: jumps, slopes are chords.
SLOPE, WIDEST = 3e-5, 1e-2
#: Steps of a simulation times the fastest mode; of predictions, whose errors die away.
STEP, LED_STEP = 1.0, 2.0
#: Rounds, and steps of each, of a descent by predictions and of the whole record.
LED, PLAIN = (10, 2), (12, 3)
#: To which part what is left over must fall in a round: far from the noise of whole records, else
#: `ENOUGH`; and what is far.
STILL, ENOUGH, NEARLY = 0.85, 0.98, 6.0
#: Deviations of the noise that are left beyond which decimated records serve: of noise below a part
#: of what happens, and of more, which hides the error of decimation.
FAR, HIDES = (6.0, 1.5), 5e-3
#: Part of what happens that is left beyond which the error of decimation does not matter.
TELLING = 0.05
#: Rounds in turn that gain less than that, after which a descent ends.
IDLE = 3
#: To which part of what noise does not leave a descent begun again must come, or it was at its end;
#: cost of a number of noise.
HELPS, LEFT = 0.8, 1.1
#: Cost of a number of noise beyond which a model is no rival of one that explains the records.
FAR_BEHIND = 30.0
#: By how much a number at which the model jumps is moved, either way, to begin again: its slope is
#: a chord, which knows nothing of a valley a thousandth away. How many such starts take a round of
#: some steps.
NUDGES, NUDGED, TRIED = (2.5e-4, 1e-3, 4e-3, 1.6e-2), 6, (1, 3)
#: Median of the size of a standard normal number, and multiples of what is left over from which on
#: a sample weighs less.
MEDIAN, FAR_OFF = 0.6745, 3.0
#: Sum of squares, in standard deviations, below which a difference moves no number by a tenth of
#: its own.
NEGLIGIBLE = 1e-2
#: Parameter sets that are simulated together at most; single ones that are kept.
TOGETHER, KNOWN = 32, 4
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
    """A diagram with limits (what `player` plays), records and perhaps a sweep, as a
    `SumOfSquares`.
    """

    def __init__(
        self,
        player: Player,
        limits: Sequence[Limit],
        noise: EventNoise,
        prior: Prior,
        sweep: Misfit | None,
    ) -> None:
        self.player, self.limits = player, tuple(limits)
        self.led, self.rule, self.scale, self.weight = False, ORDER_8, 1.0, np.ones(1)
        self._known: dict[
            tuple[bytes, bool], np.ndarray
        ] = {}  # residuals of the last few x alone, asked for again
        self._normals: dict[
            bytes, tuple[np.ndarray, np.ndarray]
        ] = {}  # of the last x, asked again where a step fails
        self.noise, self.sweep = noise, sweep
        self._each = {f"{one.id}.{name}" for one in limits for name in one.each}
        own_of = {
            name: [of_record(name, record) for record in noise.events.names] for name in self._each
        }
        parameters = [
            replace(one, name=name)
            for one in self.player.parameters
            for name in own_of.get(one.name, [one.name])
        ]
        self.numbers = [FreeNumber(one) for one in parameters]
        self.beliefs = Beliefs(parameters, prior)
        self.coordinates = self.beliefs.coordinates
        self.box = self.coordinates.x_low, self.coordinates.x_high
        own = {one.name: k for k, one in enumerate(parameters)}
        jumps = {f"{one.id}.{name}" for one in limits for name in one.jumps}
        self.jumping = np.array([one.name in jumps for one in parameters])
        self._place = np.array(
            [own[one.name] for one in sweep.problem.numbers] if sweep else [], dtype=int
        )

    @cached_property
    def predicting(self) -> "EventMisfit":
        """The same of predictions: the states are led by the measured current."""
        return self._with(led=True, noise=self.noise.for_predictions)

    @cached_property
    def decimated(self) -> "EventMisfit":
        """The same of decimated records, for descents far from the noise; itself where there are
        few samples.
        """
        noise = self.noise.decimated
        return self if noise is self.noise else self._with(noise=noise)

    @cached_property
    def coarse(self) -> "EventMisfit":
        """The same by steps of order five, in half the time."""
        return self if self.rule is ORDER_5 else self._with(rule=ORDER_5)

    def until(self, seconds: float) -> "EventMisfit":
        """The same of records that end so long after their events begin."""
        return self._with(noise=self.noise.until(seconds))

    def _with(self, **changed: Any) -> "EventMisfit":
        """The same but for this, of which nothing is known yet."""
        other = copy(self)
        for derived in ("coarse", "decimated", "predicting"):
            vars(other).pop(derived, None)
        vars(other).update({"_known": {}, "_normals": {}} | changed)
        return other

    def coarse_differs(self, x: np.ndarray, scale: float) -> bool:
        """Whether coarse steps at x (P,) make a difference, with so much of the noise left over."""
        apart = (self.coarse.played(x[None]) - self.played(x[None])) / scale
        return not (apart**2).sum() < NEGLIGIBLE

    def scaled(self, x: np.ndarray) -> "EventMisfit":
        """The same with what is left over at x (P,) as the noise, where that is more."""
        other = self._with(scale=1.0, weight=np.ones(1), _known=self._known)
        if self.led:
            residual = other.played(x[None])[0]
            size = max(float(np.median(np.abs(residual))) / MEDIAN, 1.0)
            other.weight = 1.0 / np.hypot(1.0, np.nan_to_num(residual) / (FAR_OFF * size))
        cost = float(other.at(x[None]).cost[0] - self.beliefs.pull(x)[0])
        other.scale = float(np.sqrt(max(cost / self.count, 1.0))) if np.isfinite(cost) else 1.0
        return other

    @property
    def measured(self) -> int:
        """Measured real numbers."""
        return sum(2 * len(record.time) for record in self.noise.events.records) + self._swept

    @property
    def count(self) -> float:
        """Independent numbers among them: what noise and sampling alone are expected to leave of
        chi2.
        """
        return self.noise.count + self._swept

    @cached_property
    def far(self) -> float:
        """Deviations of the noise that are left beyond which decimated records serve."""
        return FAR[self.noise.of_current > HIDES]

    @property
    def _swept(self) -> int:
        return (
            0
            if self.sweep is None
            else sum(2 * point.admittance.size for point in self.sweep.problem.points)
        )

    def values(self, x: np.ndarray) -> dict[str, float]:
        """By name, of x (P,)."""
        theta = self.coordinates.to_theta(x)
        return {name: float(value) for name, value in zip(self.beliefs.names, theta, strict=True)}

    def values_in(self, record: EventRecord, x: np.ndarray) -> dict[str, float]:
        """The same in a record, with the numbers that it has of its own."""
        return (values := self.values(x)) | {
            name: values[of_record(name, record.name)] for name in self._each
        }

    def played(self, x: np.ndarray) -> np.ndarray:
        """Whitened residuals (S, R) of all records at x (S, P), NaN where a simulation left."""
        if len(x) > 1:
            return self._simulated(x) * self.weight
        key = x.tobytes(), self._sharp
        if key not in self._known:
            if len(self._known) >= KNOWN:
                self._known.clear()
            self._known[key] = self._simulated(x)
        return self._known[key] * self.weight

    @property
    def _sharp(self) -> bool:
        """Whether steps are divided at kinks, which limits make: only near the noise is that worth
        it.

        Also True, at any distance, of a model without kinks, led or without limits: so its answers
        are known by one key.
        """
        has_kinks = bool(self.limits) and not self.led
        return self.scale < NEARLY or not has_kinks

    def _simulated(self, x: np.ndarray) -> np.ndarray:
        """The same without weights."""
        parts = []
        for record in self.noise.events.records:
            values, noise = [self.values_in(record, one) for one in x], self.noise.of[record.name]
            currents: list[np.ndarray] = []
            for first in range(0, len(values), TOGETHER):
                some = values[first : first + TOGETHER]
                try:
                    step = LED_STEP if self.led else STEP
                    played = self.player.play(
                        record, some, step=step, led=self.led, rule=self.rule, sharp=self._sharp
                    )
                    currents += [one.current for one in played]
                except IbridError:  # none of them has a rest
                    currents += [np.full(record.i.shape, np.nan)] * len(some)
            error = np.array(currents) - record.i
            parts.append(
                (error / noise.sigma).reshape(len(values), -1)
                if self.led
                else noise.whitened(error)
            )
        return np.concatenate(parts, axis=1)

    def answered(self, x: np.ndarray) -> np.ndarray:
        """Whitened currents (R,) of all records at x (P,), as exact as an answer is."""
        records = self.noise.events.records
        pairs = [
            (one, self.player.play(one, [self.values_in(one, x)])[0].current) for one in records
        ]
        return np.concatenate(
            [self.noise.of[record.name].whitened(current[None])[0] for record, current in pairs]
        )

    def left(self, x: np.ndarray) -> float:
        """Norm of i_model - i of all samples at x (P,), per unit; infinite where a simulation
        left.
        """
        played = (
            self.player.play(one, [self.values_in(one, x)])[0].current - one.i
            for one in self.noise.events.records
        )
        norm = float(np.sqrt(sum(float((error**2).sum()) for error in played)))
        return norm if np.isfinite(norm) else np.inf

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P)."""
        residual = self.played(x)
        cost = (residual**2).sum(axis=1)
        if self.sweep is not None:
            cost = cost + self.sweep.at(x[:, self._place]).cost
        cost = cost / self.scale**2 + self.beliefs.pull(x)[0]
        return Points(x, np.where(np.isfinite(cost), cost, np.inf), carried(residual))

    def best(self, x: np.ndarray, number: int) -> "list[Descending]":
        """Of starts x (S, P) those of least cost, the best first; fewer where fewer have an
        answer.
        """
        points = self.at(x)
        order = [
            k
            for k in np.argsort(points.cost, kind="stable")[:number]
            if np.isfinite(points.cost[k])
        ]
        return [Descending(self, points.x[k], float(points.cost[k])) for k in order]

    def best_of(self, starts: Sequence[Values], number: int) -> "list[Descending]":
        """The same of starts by name, each tried once."""
        x = [self.beliefs.start(values) for values in starts]
        return self.best(np.unique(np.array(x), axis=0), number) if x else []

    def begun(self, x: np.ndarray) -> "Descending":
        """A start at x (P,)."""
        return Descending(self, x, float(self.at(x[None]).cost[0]))

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g and H."""
        pairs = [
            self._normal(x, residual)
            for x, residual in zip(points.x, points.carried[0], strict=True)
        ]
        return np.array([gradient for gradient, _ in pairs]), np.array(
            [hessian for _, hessian in pairs]
        )

    def _normal(self, x: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = x.tobytes()
        if key not in self._normals:
            slopes = self.record_slopes(x)
            gradient, hessian = slopes.T @ residual, slopes.T @ slopes
            if self.sweep is not None:
                one, two = self.sweep.normal(self.sweep.at(x[None, self._place]))
                gradient[self._place] += one[0]
                hessian[np.ix_(self._place, self._place)] += two[0]
            self._normals = {key: (gradient, hessian)}
        gradient, hessian = self._normals[key]
        _, down, hold = self.beliefs.pull(x)
        return gradient / self.scale**2 + down, hessian / self.scale**2 + np.diag(hold)

    def valued(self, x: np.ndarray) -> Valued:
        """Half of the cost at x (P,), with its gradient, and its Hessian by Gauss and Newton."""
        points = self.at(x[None])
        return 0.5 * float(points.cost[0]), lambda: self._normal(x, points.carried[0][0])

    def record_slopes(self, x: np.ndarray) -> np.ndarray:
        """(R, P) of the records."""
        size = np.where(self.jumping, WIDEST, min(SLOPE * self.scale, WIDEST))
        step = np.where(x + size <= self.box[1], size, -size)
        found = self.played(np.concatenate([x[None], x + np.diag(step)]))
        return np.nan_to_num((found[1:] - found[0]) / step[:, None]).T

    def _central_slopes(self, x: np.ndarray) -> np.ndarray:
        """The same to the square of the step, so that a direction that nothing sees has no slope.

        Beyond the box by a step.
        """
        size = np.where(self.jumping, WIDEST, SLOPE)
        ends = self.played(np.concatenate([x + sign * np.diag(size) for sign in (1.0, -1.0)]))
        return np.nan_to_num((ends[: len(x)] - ends[len(x) :]) / (2.0 * size[:, None])).T

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Slopes of all whitened numbers, the prior's below."""
        parts = [self._central_slopes(x)]
        if self.sweep is not None:
            deviations = (np.asarray(point.sigma) for point in self.sweep.problem.points)
            white = self.sweep.problem.white_slopes(x[self._place], deviations)
            whole = np.zeros((len(white), len(x)))
            whole[:, self._place] = white
            parts.append(whole)
        return np.concatenate([*parts, np.diag(self.beliefs.x_slope(x))])

    def white(self, x: np.ndarray) -> list[np.ndarray]:
        """Residual of each record, d + j q."""
        pairs = self.played(x[None])[0].reshape(-1, 2) @ [1, 1j]
        return np.split(
            pairs, np.cumsum([len(record.time) for record in self.noise.events.records])[:-1]
        )

    def white_sweep(self, x: np.ndarray) -> list[np.ndarray]:
        """Residual of each operating point of the sweep."""
        if self.sweep is None:
            return []
        problem = self.sweep.problem
        pairs = zip(problem.responses(x[self._place]), problem.points, strict=True)
        return [
            (response - point.admittance) / np.asarray(point.sigma) for response, point in pairs
        ]


@dataclass
class Descending:
    """A start under way: rounds of some steps, each with what is left over as the noise, until that
    is the noise or rounds in turn gain little.

    The damping goes on from round to round: a limit makes valleys in which every first step of a
    fresh one fails. `cost` : at x.
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
        """By name."""
        return self.misfit.values(self.x)

    @property
    def explains(self) -> bool:
        """True where no more than noise is left."""
        return self.cost <= LEFT * self.misfit.count

    @property
    def is_far(self) -> bool:
        """True where so much is left that it is no rival of what explains, to whom the last steps
        matter.
        """
        return self.cost > FAR_BEHIND * self.misfit.count

    def go(self, rounds: int, steps: int) -> "Descending":
        """So many rounds more; far from the noise on decimated records, and by coarse steps until
        these make a difference.
        """
        if (
            self._left > self.misfit.far
            and self.misfit.decimated is not self.misfit
            and not self._go_decimated(rounds, steps)
        ):
            return self
        misfit, before, left = self.misfit, (self.idle, self.over, self.damping), self._left
        fine = misfit.coarse_differs(self.x, left)
        if not fine:
            self._rounds(misfit.coarse, rounds, steps)
            if fine := misfit.coarse_differs(self.x, self.scale):
                self.idle, self.over, self.damping = before
        if fine:
            self._rounds(misfit, rounds, steps)
        self.cost = float(misfit.at(self.x[None]).cost[0])
        return self

    @property
    def _left(self) -> float:
        """What is left over, in deviations of the noise, 1 at least."""
        return float(np.sqrt(max(self.cost / self.misfit.count, 1.0)))

    def _go_decimated(self, rounds: int, steps: int) -> bool:
        """So many rounds on decimated records, and back where these led nowhere.

        Returns whether all samples are to go on: near the noise, or where the decimated records are
        at their end and their error may matter.
        """
        x, cost, before = self.x, self.cost, (self.idle, self.over, self.damping)
        self._rounds(self.misfit.decimated.coarse, rounds, steps)
        self.cost = float(self.misfit.at(self.x[None]).cost[0])
        if not self.cost < cost:
            self.x, self.cost = x, cost
        ended = self.over and self._left * self.misfit.noise.of_current < TELLING
        go_on = ended or self._left <= self.misfit.far
        if go_on:
            self.idle, self.over, self.damping = before
        return go_on

    def _rounds(self, misfit: EventMisfit, rounds: int, steps: int) -> None:
        for _ in range(rounds):
            if self.over:
                break
            self._round(misfit, steps)

    def to_its_end(self) -> None:
        """Begun again while that helps much: from here, and from elsewhere where more than noise is
        left.
        """
        while self._again(self.x) or (
            not self.explains and any(self._again(x) for x in self._elsewhere())
        ):
            pass

    def _elsewhere(self) -> Iterator[np.ndarray]:
        """With what jumps moved by a little; with what went far from what is believed put back (a
        zero at 0, for which a resistance makes up: no slope leads back), and where predictions
        lead.
        """
        moves = np.eye(len(self.x))[self.misfit.jumping]
        nudged = [
            self.x + size * move for move in moves for nudge in NUDGES for size in (nudge, -nudge)
        ]
        if nudged:
            begun = self.misfit.best(np.clip(nudged, *self.misfit.box), NUDGED)
            yield min((one.go(*TRIED) for one in begun), key=lambda one: one.cost, default=self).x
        near = self.misfit.beliefs.put_back(self.x)
        for x in (near, self.x) if np.any(near != self.x) else (self.x,):
            yield from (one.go(*LED).x for one in self.misfit.predicting.best(x[None], 1))
        yield near

    def _again(self, x: np.ndarray) -> bool:
        """Whether a descent from x helped; not where there is no answer."""
        before = self.cost
        for again in self.misfit.best(x[None], 1):
            if again.go(*PLAIN).cost < before:
                self.x, self.cost = again.x, again.cost
        was, left = (cost - self.misfit.count for cost in (before, self.cost))
        return was > 0 and left < HELPS * was

    def _round(self, misfit: EventMisfit, steps: int) -> None:
        scaled = misfit.scaled(self.x)
        part = STILL if self.scale > NEARLY and not misfit.led else ENOUGH
        little = scaled.scale**2 - 1 > part**2 * (self.scale**2 - 1)  # of what noise does not leave
        self.idle = self.idle + 1 if little and self.scale > 1.02 else 0
        if self.idle == IDLE:
            self.over = True
            return
        self.scale = min(scaled.scale, self.scale)
        begun = DESCENT.begin(scaled, self.x[None])
        batch = DESCENT.go(
            scaled, begun if self.damping is None else replace(begun, damping=self.damping), steps
        )
        ended = bool(batch.ended[0])
        self.x, self.over = batch.x[0], self.scale == 1.0 and ended and self.damping is None
        self.damping = None if ended else batch.damping  # a step that damping makes short is no end


def of_record(name: str, record: str) -> str:
    """Name of a number that each record has of its own."""
    return f"{name} of {record}"
