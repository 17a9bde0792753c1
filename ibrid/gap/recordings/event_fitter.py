"""The fit of one diagram with its limits to records of events, and to a sweep beside them: one
parameter set.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.ipopt import minimise
from ibrid.fit.problem import Misfit
from ibrid.gap.recordings.cessation import (
    holds_from_moments,
    moments_from_hold,
    with_release_moments,
)
from ibrid.gap.recordings.event_misfit import (
    PREDICTION_EFFORT,
    SIMULATION_EFFORT,
    EventDescent,
    EventMisfit,
)
from ibrid.gap.recordings.event_noise import NOMINAL, EventNoise
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import FitResult, Values
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.modules.vocabulary import Vocabulary
from ibrid.playback.limits import Limit
from ibrid.playback.player import Player
from ibrid.structure.diagrams.diagram import Diagram

#: Starts that predictions are followed from, and the factor on the best cost up to which where they
#: led is descended on.
FOLLOWED, WORTH = 3, 30.0
#: Ends of growing records, s after their events begin, before the whole of them: far from the right
#: values a simulation leaves, or falls out of step, later than that.
GROWING = (0.003, 0.01, 0.03, 0.1)
#: Of the solver of record at most, gain of its last steps, and how far it goes: what nothing sees
#: leads anywhere.
ITERATIONS, STEPS_GAIN, WITHIN = 20, 1e-5, 0.3
#: Diagrams with limits whose laws are kept.
MOST_KEPT = 150


@dataclass(frozen=True, eq=False)
class EventFit(FitResult):
    """A diagram with limits at its best parameters. `x` : (P,) in search coordinates."""

    diagram: Diagram
    limits: tuple[Limit, ...]
    misfit: EventMisfit
    prior: Prior
    x: np.ndarray

    @property
    def problem(self) -> EventMisfit:
        """What has the free numbers."""
        return self.misfit

    @property
    def moved(self) -> dict[str, float]:
        """Parameter with a nominal value -> how far it is from that, in standard deviations of its
        tolerance.
        """
        return self.misfit.parameter_prior.moved(self.x)

    @cached_property
    def residuals(self) -> list[np.ndarray]:
        """(i_model - i) / sigma, d + j q, (N,) of each record; then those of the sweep's points."""
        return [*self.misfit.complex_residuals(self.x), *self.misfit.sweep_residuals(self.x)]

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom of the estimate of the noise."""
        return self.misfit.noise.noise_dof

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Whitened slopes of all numbers by x, the prior's below: (R + P, P)."""
        return self.misfit.whitened_jacobian(self.x)


class EventFitter:
    """Fits diagrams with limits to the same records, and to a sweep where there is one."""

    def __init__(
        self, noise: EventNoise, kinds: Vocabulary, prior: Prior, refitter: SweepFitter | None
    ) -> None:
        self.noise, self.kinds, self.prior, self.refitter = noise, kinds, prior, refitter
        self._misfits, self._players = (
            DiagramCache[EventMisfit](MOST_KEPT),
            DiagramCache[Player](MOST_KEPT),
        )

    def of(self, noise: EventNoise) -> "EventFitter":
        """The same for other records; laws are joined once for all."""
        other = EventFitter(noise, self.kinds, self.prior, self.refitter)
        other._players = self._players
        return other

    def noise_for_model(
        self,
        diagram: Diagram,
        limits: Sequence[Limit],
        values: Values,
        pulse_error: float = NOMINAL,
    ) -> EventNoise:
        """The noise with what a diagram makes of the voltage between samples; as it is where the
        diagram has no rest.
        """
        try:
            misfit = self.misfit(diagram, limits)
            x = misfit.parameter_prior.start(values)
            own = {
                record.name: misfit.values_for_event(record, x)
                for record in self.noise.events.records
            }
            return self.noise.for_model(misfit.player, own, pulse_error)
        except IbridError:
            return self.noise

    def misfit(self, diagram: Diagram, limits: Sequence[Limit]) -> EventMisfit:
        """Raises DiagramError where the diagram has no matrices."""
        return self._misfits.of(diagram, lambda: self._misfit(diagram, limits), tuple(limits))

    def _misfit(self, diagram: Diagram, limits: Sequence[Limit]) -> EventMisfit:
        sweep = None if self.refitter is None else Misfit(self.refitter.problem(diagram), "chi2")
        return EventMisfit(self._player(diagram, limits), limits, self.noise, self.prior, sweep)

    def _player(self, diagram: Diagram, limits: Sequence[Limit]) -> Player:
        omega_0 = self.noise.events.omega_0
        return self._players.of(
            diagram, lambda: Player(diagram, self.kinds, limits, omega_0), tuple(limits)
        )

    def fit(
        self,
        diagram: Diagram,
        limits: Sequence[Limit],
        starts: Sequence[Values],
        *,
        led: bool = True,
        growing: bool = False,
    ) -> EventFit | None:
        """The best start descended, by predictions first; None where none has an answer or the
        diagram no matrices.

        led : False from values that are nearly right. growing : on the first milliseconds first,
        and on and on: no simulation leaves where nothing has happened yet, and where nothing is
        missing that leads further than predictions, which serve a cessation all the same.
        """
        try:
            misfit = self.misfit(diagram, limits)
            followed = self.misfit(diagram, with_release_moments(limits))
        except IbridError:
            return None
        if followed is misfit:
            descent = _descend_best_start(
                misfit, _follow_growing_records(misfit, starts) if growing else starts, led=led
            )
        else:
            whole = [misfit.values(misfit.parameter_prior.start(values)) for values in starts]
            moments = [
                moved for values in whole for moved in moments_from_hold(values, self.noise.events)
            ]
            seen = _descend_best_start(followed, moments, led=led or growing)
            held = misfit.start_descents_from(
                holds_from_moments(followed, seen.x) if seen else [], 1
            )
            descent = (
                held[0].run(*SIMULATION_EFFORT)
                if held
                else _descend_best_start(misfit, starts, led=led or growing)
            )
        return self.at(diagram, limits, descent.x) if descent else None

    def fit_predictions(
        self, diagram: Diagram, limits: Sequence[Limit], starts: Sequence[Values]
    ) -> Values:
        """Values to which predictions lead the best start; the first start where none has an
        answer.
        """
        misfit = self.misfit(diagram, limits).prediction
        best = misfit.start_descents_from(starts, 1)
        return (
            best[0].run(*PREDICTION_EFFORT).values
            if best
            else misfit.values(misfit.parameter_prior.start(starts[0]))
        )

    def screen(
        self, diagram: Diagram, limits: Sequence[Limit], starts: Sequence[Values]
    ) -> EventDescent | None:
        """The best start by predictions after a step; None where none has an answer."""
        try:
            misfit = self.misfit(diagram, limits).prediction.coarse
        except IbridError:
            return None
        begun = misfit.start_descents_from(starts, 1)
        return begun[0].run(1, 1) if begun else None

    def at(self, diagram: Diagram, limits: Sequence[Limit], x: np.ndarray) -> EventFit:
        """A diagram at given search coordinates."""
        misfit = self.misfit(diagram, limits)
        penalty = float(misfit.parameter_prior.penalty_terms(x)[0])
        cost = float(misfit.at(x[None]).cost[0])
        return EventFit(
            values=misfit.values(x),
            chi2=cost - penalty,
            penalty=penalty,
            dof=max(misfit.count - len(x), misfit.count / 2),
            measurement_count=misfit.measurement_count,
            parameter_count=len(x),
            diagram=diagram,
            limits=tuple(limits),
            misfit=misfit,
            prior=self.prior,
            x=x,
        )

    def polish(self, fit: EventFit) -> EventFit:
        """A fit as the solver of record leaves it; as it is where the model jumps, for which Ipopt
        has no slopes.
        """
        if fit.misfit.is_discontinuous.any():
            return fit
        low, high = fit.misfit.box
        box = np.maximum(low, fit.x - WITHIN), np.minimum(high, fit.x + WITHIN)
        x, *_ = minimise(
            fit.misfit.evaluate_objective, box, fit.x, iterations=ITERATIONS, gain=STEPS_GAIN
        )
        return min((fit, self.at(fit.diagram, fit.limits, x)), key=lambda one: one.cost)

    def evaluate_values(
        self, diagram: Diagram, limits: Sequence[Limit], values: Values
    ) -> EventFit:
        """A diagram at values by name; what they lack is the nominal or the typical value."""
        return self.at(diagram, limits, self.misfit(diagram, limits).parameter_prior.start(values))


def _descend_best_start(
    misfit: EventMisfit, starts: Sequence[Values], *, led: bool
) -> EventDescent | None:
    """The best start at its end, by predictions first."""
    ends = [one.x for one in misfit.start_descents_from(starts, 1)]
    if led:
        ends += [
            one.run(*PREDICTION_EFFORT).x
            for one in misfit.prediction.start_descents_from(starts, FOLLOWED)
        ]
    plain = misfit.start_descents(np.array(ends), len(ends)) if ends else []
    worth = [
        one for one in plain if one.cost <= WORTH * plain[0].cost
    ]  # all of them before any is descended
    return min(
        (one.run(*SIMULATION_EFFORT) for one in worth), key=lambda one: one.cost, default=None
    )


def _follow_growing_records(misfit: EventMisfit, starts: Sequence[Values]) -> Sequence[Values]:
    """Where the records lead the best start as they grow.

    The starts themselves where none has an answer, and of frames of an estimator, whose windows
    tell nothing of the first milliseconds.
    """
    if any(one.smeared for one in misfit.noise.events.records):
        return starts
    longest = max(float(one.time[-1]) - one.rest_end for one in misfit.noise.events.records)
    for seconds in (one for one in GROWING if one < longest):
        descent = _descend_best_start(misfit.until(seconds), starts, led=False)
        starts = [descent.values] if descent else starts
    return starts


def select_events(noise: EventNoise, name: str, *, hold: bool = False) -> EventNoise:
    """All records but one; or that one alone."""
    names = [one for one in noise.events.names if (one == name) is hold]
    return noise.only(*names)
