"""The fit of one diagram with its limits to records of events, and to a sweep beside them: one parameter set.

cost(x) = sum over the samples of ((i_model - i) / sigma)^2 + chi2 of the sweep + the squared standard deviations of the prior.
Slopes are differences of simulations that take the same steps as the one they are taken at.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import f as f_law

from ibrid.errors import IbridError
from ibrid.fit.least_squares import Descent, Points, carried
from ibrid.fit.problem import FreeNumber, Misfit
from ibrid.gap.data import Fitted, Values
from ibrid.gap.event_noise import EventNoise
from ibrid.gap.prior import Beliefs, Prior
from ibrid.gap.refit import Refitter
from ibrid.modules.vocabulary import Vocabulary
from ibrid.playback.limits import Limit
from ibrid.playback.player import Player
from ibrid.structure.diagram import Diagram

#: Step of a coordinate for a slope; steps of a simulation times the fastest mode.
SLOPE, STEP = 3e-4, 1.0
#: Parameter sets that are simulated together at most.
TOGETHER = 32
DESCENT = Descent(
    marquardt=True, damping=1e-3, greatest=1e7, largest=1.0, stall=1e-4, enough=1e-5, small=0.02, trusted=np.inf
)


@dataclass(frozen=True, eq=False)
class EventFit(Fitted):
    """A diagram with limits at its best parameters. `x` : (P,) in search coordinates."""

    diagram: Diagram
    limits: tuple[Limit, ...]
    misfit: "EventMisfit"
    prior: Prior
    x: np.ndarray

    @property
    def problem(self) -> "EventMisfit":
        """What has the free numbers."""
        return self.misfit

    @property
    def moved(self) -> dict[str, float]:
        """Parameter with a nominal value -> how far it is from that, in standard deviations of its tolerance."""
        beliefs = self.misfit.beliefs
        sigmas = beliefs.sigmas(beliefs.coordinates.to_theta(self.x))
        rows = zip(beliefs.names, sigmas, beliefs.known, strict=True)
        return {name: float(away) for name, away, known in rows if known}

    @cached_property
    def residuals(self) -> list[np.ndarray]:
        """(i_model - i) / sigma, d + j q, (N,) of each record; then those of the sweep's points."""
        return [*self.misfit.white(self.x), *self.misfit.white_sweep(self.x)]

    def p_value(self, scale: float = 1.0) -> float:
        """Of so large a misfit by noise alone, which is as sure as the rest that it was told by."""
        told_by = self.misfit.noise.told_by
        if not np.isfinite(told_by):
            return super().p_value(scale)
        return float(f_law.sf(self.chi2 / scale**2 / self.dof, self.dof, told_by))

    @cached_property
    def slopes(self) -> np.ndarray:
        """Whitened slopes of all numbers by x, the prior's below: (R + P, P)."""
        return self.misfit.rows(self.x)


class EventMisfit:
    """A diagram with limits, records and perhaps a sweep, as a `SumOfSquares`."""

    def __init__(
        self,
        diagram: Diagram,
        limits: Sequence[Limit],
        noise: EventNoise,
        kinds: Vocabulary,
        prior: Prior,
        sweep: Misfit | None,
    ) -> None:
        self.player, self.led = Player(diagram, kinds, limits, noise.events.omega_0), False
        self.noise, self.sweep = noise, sweep
        self.numbers = [FreeNumber(one) for one in self.player.parameters]
        self.beliefs = Beliefs(self.player.parameters, prior)
        self.coordinates = self.beliefs.coordinates
        own = {one.name: k for k, one in enumerate(self.player.parameters)}
        self._place = np.array([own[one.name] for one in sweep.problem.numbers] if sweep else [], dtype=int)

    @cached_property
    def predicting(self) -> "EventMisfit":
        """The same of predictions, each from the current measured just before: an error of a resonance does not ring on."""
        other = copy(self)
        other.led = True
        return other

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the coordinates."""
        return self.coordinates.x_low, self.coordinates.x_high

    @property
    def count(self) -> int:
        """Measured real numbers."""
        events = sum(2 * len(record.time) for record in self.noise.events.records)
        sweep = 0 if self.sweep is None else sum(2 * point.admittance.size for point in self.sweep.problem.points)
        return events + sweep

    def values(self, x: np.ndarray) -> dict[str, float]:
        """By name, of x (P,)."""
        theta = self.coordinates.to_theta(x)
        return {name: float(value) for name, value in zip(self.beliefs.names, theta, strict=True)}

    def played(self, x: np.ndarray) -> np.ndarray:
        """Whitened residuals (S, R) of all records at x (S, P), NaN where a simulation left."""
        values, parts = [self.values(one) for one in x], []
        for record in self.noise.events.records:
            sigma = self.noise.sigma[record.name][:, None]
            found = []
            for first in range(0, len(values), TOGETHER):
                some = values[first : first + TOGETHER]
                try:
                    found += [
                        ((one.current - record.i) / sigma).ravel()
                        for one in self.player.play(record, some, step=STEP, led=self.led)
                    ]
                except IbridError:  # the first has no rest
                    found += self._one_by_one(record, some, sigma)
            parts.append(np.array(found))
        return np.concatenate(parts, axis=1)

    def _one_by_one(self, record, some: Sequence[Mapping[str, float]], sigma: np.ndarray) -> list[np.ndarray]:
        found = []
        for one in some:
            try:
                (played,) = self.player.play(record, [one], step=STEP, led=self.led)
                found.append(((played.current - record.i) / sigma).ravel())
            except IbridError:
                found.append(np.full(2 * len(record.time), np.nan))
        return found

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """Evaluate x (S, P)."""
        residual = self.played(x)
        cost = (residual**2).sum(axis=1) + self.beliefs.pull(x)[0]
        if self.sweep is not None:
            cost = cost + self.sweep.at(x[:, self._place]).cost
        return Points(x, np.where(np.isfinite(cost), cost, np.inf), carried(residual))

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """g and H."""
        pairs = [self._normal(x, residual) for x, residual in zip(points.x, points.carried[0], strict=True)]
        return np.array([gradient for gradient, _ in pairs]), np.array([hessian for _, hessian in pairs])

    def _normal(self, x: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slopes = self._slopes(x)
        _, down, hold = self.beliefs.pull(x)
        gradient, hessian = slopes.T @ residual + down, slopes.T @ slopes + np.diag(hold)
        if self.sweep is not None:
            one, two = self.sweep.normal(self.sweep.at(x[None, self._place]))
            gradient[self._place] += one[0]
            hessian[np.ix_(self._place, self._place)] += two[0]
        return gradient, hessian

    def _slopes(self, x: np.ndarray) -> np.ndarray:
        """(R, P) of the records."""
        high = self.box[1]
        step = np.where(x + SLOPE <= high, SLOPE, -SLOPE)
        found = self.played(np.concatenate([x[None], x + np.diag(step)]))
        return np.nan_to_num((found[1:] - found[0]) / step[:, None]).T

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Slopes of all whitened numbers, the prior's below."""
        parts = [self._slopes(x)]
        if self.sweep is not None:
            problem = self.sweep.problem
            for slope, point in zip(problem.jacobians(x[self._place]), problem.points, strict=True):
                white = (slope / np.asarray(point.sigma)[..., None]).reshape(-1, problem.size)
                whole = np.zeros((len(white), len(x)), dtype=complex)
                whole[:, self._place] = white
                parts += [whole.real, whole.imag]
        return np.concatenate([*parts, np.diag(self.beliefs.x_slope(x))])

    def white(self, x: np.ndarray) -> list[np.ndarray]:
        """Residual of each record, d + j q."""
        pairs = self.played(x[None])[0].reshape(-1, 2) @ [1, 1j]
        return np.split(pairs, np.cumsum([len(record.time) for record in self.noise.events.records])[:-1])

    def white_sweep(self, x: np.ndarray) -> list[np.ndarray]:
        """Residual of each operating point of the sweep."""
        if self.sweep is None:
            return []
        problem = self.sweep.problem
        pairs = zip(problem.responses(x[self._place]), problem.points, strict=True)
        return [(response - point.admittance) / np.asarray(point.sigma) for response, point in pairs]


class EventFitter:
    """Fits diagrams with limits to the same records, and to a sweep where there is one."""

    def __init__(self, noise: EventNoise, kinds: Vocabulary, prior: Prior, refitter: Refitter | None) -> None:
        self.noise, self.kinds, self.prior, self.refitter = noise, kinds, prior, refitter
        self._misfits: dict[tuple[int, tuple[Limit, ...]], tuple[Diagram, EventMisfit]] = {}

    def of(self, noise: EventNoise) -> "EventFitter":
        """The same for other records."""
        return EventFitter(noise, self.kinds, self.prior, self.refitter)

    def misfit(self, diagram: Diagram, limits: Sequence[Limit]) -> EventMisfit:
        """Raises DiagramError where the diagram has no matrices."""
        key = id(diagram), tuple(limits)
        if key not in self._misfits:
            if len(self._misfits) > 100:
                self._misfits.clear()
            sweep = None
            if self.refitter is not None:
                sweep = Misfit(self.refitter.problem(diagram), "chi2")
            self._misfits[key] = diagram, EventMisfit(diagram, limits, self.noise, self.kinds, self.prior, sweep)
        return self._misfits[key][1]

    def fit(
        self, diagram: Diagram, limits: Sequence[Limit], starts: Sequence[Values], steps: int, kept: int = 1
    ) -> EventFit | None:
        """The best of starts, of which `kept` are descended; None where none has an answer or the diagram no matrices."""
        try:
            misfit = self.misfit(diagram, limits)
        except IbridError:
            return None
        x = np.unique(np.array([misfit.beliefs.start(values) for values in starts]), axis=0)
        begun = DESCENT.begin(misfit, x)
        if not np.isfinite(begun.cost).any():
            return None
        best = DESCENT.go(misfit, begun.best(kept), steps).best(1)
        return self.at(diagram, limits, best.x[0])

    def at(self, diagram: Diagram, limits: Sequence[Limit], x: np.ndarray) -> EventFit:
        """A diagram at given search coordinates."""
        misfit = self.misfit(diagram, limits)
        penalty = float(misfit.beliefs.pull(x)[0])
        cost = float(misfit.at(x[None]).cost[0])
        return EventFit(
            values=misfit.values(x),
            chi2=cost - penalty,
            penalty=penalty,
            dof=max(float(misfit.count - len(x)), 1.0),
            numbers=misfit.count,
            free=len(x),
            diagram=diagram,
            limits=tuple(limits),
            misfit=misfit,
            prior=self.prior,
            x=x,
        )

    def at_values(self, diagram: Diagram, limits: Sequence[Limit], values: Values) -> EventFit:
        """A diagram at values by name; what they lack is the nominal or the typical value."""
        return self.at(diagram, limits, self.misfit(diagram, limits).beliefs.start(values))


def without(noise: EventNoise, name: str, *, hold: bool = False) -> EventNoise:
    """All records but one; or that one alone."""
    names = [one for one in noise.events.names if (one == name) is hold]
    return replace(noise, events=noise.events.only(*names))
