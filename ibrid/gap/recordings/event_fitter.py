"""The fit of one diagram with its limits to recordings, and to a sweep where there is one.

One parameter set for all data. A fit begins with prediction errors (see `event_misfit`), goes on
with simulations, and may follow the records as they grow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.ipopt import minimise
from ibrid.fit.problem import Misfit
from ibrid.gap.recordings.cessation import (
    holds_from_release_times,
    release_times_from_hold,
    with_release_times,
)
from ibrid.gap.recordings.event_misfit import (
    PREDICTION_EFFORT,
    SIMULATION_EFFORT,
    EventDescent,
    EventMisfit,
)
from ibrid.gap.recordings.event_noise import NOMINAL_PULSE_ERROR, EventNoise
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import FitResult, Values
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.modules.vocabulary import Vocabulary
from ibrid.playback.limits import Limit
from ibrid.playback.player import Player
from ibrid.structure.diagrams.diagram import Diagram

#: Starts that are followed by prediction errors.
MOST_PREDICTED = 3
#: Factor on the least simulation cost of several starts up to which one is descended.
WORTH = 30.0
#: Lengths of growing records, s after the events begin, before the whole of them: far from the
#: right values a simulation diverges, or loses synchronism, only later.
GROWING_LENGTHS = (0.003, 0.01, 0.03, 0.1)
#: Iterations of Ipopt at most, the relative gain of the last ones, and how far it goes in search
#: coordinates: directions that are not identifiable lead anywhere.
IPOPT_ITERATIONS = 20
IPOPT_GAIN = 1e-5
IPOPT_RADIUS = 0.3
#: Diagrams with limits whose compiled equations are kept.
MOST_KEPT = 150


@dataclass(frozen=True, eq=False)
class EventFit(FitResult):
    """A diagram with limits at its best parameters.

    Parameters
    ----------
    limits : tuple of Limit
        Beside the diagram.
    misfit : EventMisfit
        What was minimised.
    x : ndarray
        (P,) in search coordinates.
    """

    diagram: Diagram
    limits: tuple[Limit, ...]
    misfit: EventMisfit
    prior: Prior
    x: np.ndarray

    @property
    def problem(self) -> EventMisfit:
        """The fitting problem, which lists the free parameters."""
        return self.misfit

    @property
    def moved(self) -> dict[str, float]:
        """Deviation of each parameter with a nominal value from that, in tolerances."""
        return self.misfit.parameter_prior.moved(self.x)

    @cached_property
    def residuals(self) -> list[np.ndarray]:
        """Whitened residuals: d + j q (N,) of each record, then those of the sweep's points."""
        return [*self.misfit.complex_residuals(self.x), *self.misfit.sweep_residuals(self.x)]

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom of the estimate of the noise."""
        return self.misfit.noise.noise_dof

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Derivative of all whitened residuals by x, those of the prior last: (R + P, P)."""
        return self.misfit.whitened_jacobian(self.x)


class EventFitter:
    """Fits diagrams with limits to the same recordings, and to a sweep where there is one.

    Parameters
    ----------
    noise : EventNoise
        Of the recordings; holds these.
    kinds : Vocabulary
        Module kinds of the diagrams.
    prior : Prior
        Nominal values with tolerances.
    sweep_fitter : SweepFitter or None
        Of the sweep; None without one.
    """

    def __init__(
        self, noise: EventNoise, kinds: Vocabulary, prior: Prior, sweep_fitter: SweepFitter | None
    ) -> None:
        self.noise = noise
        self.kinds = kinds
        self.prior = prior
        self.sweep_fitter = sweep_fitter
        self._misfits = DiagramCache[EventMisfit](MOST_KEPT)
        self._players = DiagramCache[Player](MOST_KEPT)

    def with_noise(self, noise: EventNoise) -> "EventFitter":
        """Return the fitter of other recordings or weights; compiled equations are shared."""
        other = EventFitter(noise, self.kinds, self.prior, self.sweep_fitter)
        other._players = self._players
        return other

    def noise_for_model(
        self,
        diagram: Diagram,
        limits: Sequence[Limit],
        values: Values,
        pulse_error: float = NOMINAL_PULSE_ERROR,
    ) -> EventNoise:
        """Return the noise with what a model makes of the unknown voltage between samples.

        Unchanged where the model has no equilibrium.
        """
        try:
            misfit = self.misfit(diagram, limits)
            x = misfit.parameter_prior.start(values)
            values_by_record = {
                record.name: misfit.values_for_event(record, x)
                for record in self.noise.events.records
            }
            return self.noise.for_model(misfit.player, values_by_record, pulse_error)
        except IbridError:
            return self.noise

    def misfit(self, diagram: Diagram, limits: Sequence[Limit]) -> EventMisfit:
        """Return the misfit of a diagram; DiagramError where that has no matrices."""
        return self._misfits.get_or_make(
            diagram, lambda: self._build_misfit(diagram, limits), tuple(limits)
        )

    def _build_misfit(self, diagram: Diagram, limits: Sequence[Limit]) -> EventMisfit:
        sweep_misfit = None
        if self.sweep_fitter is not None:
            sweep_misfit = Misfit(self.sweep_fitter.problem(diagram), "chi2")
        player = self._player(diagram, limits)
        return EventMisfit(player, limits, self.noise, self.prior, sweep_misfit)

    def _player(self, diagram: Diagram, limits: Sequence[Limit]) -> Player:
        omega_0 = self.noise.events.omega_0
        return self._players.get_or_make(
            diagram, lambda: Player(diagram, self.kinds, limits, omega_0), tuple(limits)
        )

    def fit(
        self,
        diagram: Diagram,
        limits: Sequence[Limit],
        starts: Sequence[Values],
        *,
        predict_first: bool = True,
        growing: bool = False,
    ) -> EventFit | None:
        """Descend from the best start and return the fit.

        Parameters
        ----------
        starts : sequence of mapping
            Initial values by name; what they lack is the nominal value.
        predict_first : bool
            Follow prediction errors before simulations; not needed from values that are nearly
            right.
        growing : bool
            Follow the records as they grow from their first milliseconds instead. No simulation
            diverges where nothing has happened yet, and where nothing is missing in the model this
            leads further than predictions; these serve a momentary cessation all the same.

        Returns
        -------
        EventFit or None
            None where no start can be simulated, or the diagram has no matrices.
        """
        try:
            misfit = self.misfit(diagram, limits)
            release_misfit = self.misfit(diagram, with_release_times(limits))
        except IbridError:
            return None
        if release_misfit is misfit:
            if growing:
                starts = _follow_growing_records(misfit, starts)
            descent = _descend_best_start(misfit, starts, predict_first=predict_first)
        else:
            predict_first = predict_first or growing
            descent = self._descend_cessation(misfit, release_misfit, starts, predict_first)
        return None if descent is None else self.at(diagram, limits, descent.x)

    def _descend_cessation(
        self,
        misfit: EventMisfit,
        release_misfit: EventMisfit,
        starts: Sequence[Values],
        predict_first: bool,
    ) -> EventDescent | None:
        """Descend with a momentary cessation, by its release times first.

        From the starts themselves where no record shows a hold time.
        """
        complete = [misfit.values(misfit.parameter_prior.start(values)) for values in starts]
        events = self.noise.events
        release_starts: list[Values] = [
            start for values in complete for start in release_times_from_hold(values, events)
        ]
        released = _descend_best_start(release_misfit, release_starts, predict_first=predict_first)
        holds = [] if released is None else holds_from_release_times(release_misfit, released.x)
        for descent in misfit.start_descents_from(holds, 1):
            return descent.run(*SIMULATION_EFFORT)
        return _descend_best_start(misfit, starts, predict_first=predict_first)

    def fit_predictions(
        self, diagram: Diagram, limits: Sequence[Limit], starts: Sequence[Values]
    ) -> Values:
        """Descend on prediction errors from the best start and return the values.

        The first start where none can be predicted from.
        """
        misfit = self.misfit(diagram, limits).prediction
        for descent in misfit.start_descents_from(starts, 1):
            return descent.run(*PREDICTION_EFFORT).values
        return misfit.values(misfit.parameter_prior.start(starts[0]))

    def screen(
        self, diagram: Diagram, limits: Sequence[Limit], starts: Sequence[Values]
    ) -> EventDescent | None:
        """Take one step on prediction errors from the best start; None without a response."""
        try:
            misfit = self.misfit(diagram, limits).prediction.coarse
        except IbridError:
            return None
        for descent in misfit.start_descents_from(starts, 1):
            return descent.run(1, 1)
        return None

    def at(self, diagram: Diagram, limits: Sequence[Limit], x: np.ndarray) -> EventFit:
        """Evaluate a diagram at search coordinates x (P,)."""
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
        """Take a fit to its minimum by Ipopt.

        Unchanged where the model is discontinuous in a parameter, which Ipopt cannot treat.
        """
        if fit.misfit.is_discontinuous.any():
            return fit
        low, high = fit.misfit.box
        bounds = (np.maximum(low, fit.x - IPOPT_RADIUS), np.minimum(high, fit.x + IPOPT_RADIUS))
        objective = fit.misfit.evaluate_objective
        x, *_ = minimise(objective, bounds, fit.x, iterations=IPOPT_ITERATIONS, gain=IPOPT_GAIN)
        polished = self.at(fit.diagram, fit.limits, x)
        return min((fit, polished), key=lambda candidate: candidate.cost)

    def evaluate_values(
        self, diagram: Diagram, limits: Sequence[Limit], values: Values
    ) -> EventFit:
        """Evaluate a diagram at values by name; what they lack is the nominal or typical value."""
        return self.at(diagram, limits, self.misfit(diagram, limits).parameter_prior.start(values))


def _descend_best_start(
    misfit: EventMisfit, starts: Sequence[Values], *, predict_first: bool
) -> EventDescent | None:
    """Descend on simulations from the best start and from those nearly as good.

    predict_first : also from where prediction errors lead the best starts.
    """
    candidates = [descent.x for descent in misfit.start_descents_from(starts, 1)]
    if predict_first:
        predictions = misfit.prediction.start_descents_from(starts, MOST_PREDICTED)
        candidates += [descent.run(*PREDICTION_EFFORT).x for descent in predictions]
    if not candidates:
        return None
    descents = misfit.start_descents(np.array(candidates), len(candidates))
    # all are selected before any is descended
    worth = [descent for descent in descents if descent.cost <= WORTH * descents[0].cost]
    ends = [descent.run(*SIMULATION_EFFORT) for descent in worth]
    return min(ends, key=lambda end: end.cost, default=None)


def _follow_growing_records(misfit: EventMisfit, starts: Sequence[Values]) -> Sequence[Values]:
    """Descend on the records as they grow, and return where that leads the best start.

    The starts themselves where none can be simulated, and of the frames of an estimator, whose
    windows show nothing of the first milliseconds.
    """
    records = misfit.noise.events.records
    if any(record.smeared for record in records):
        return starts
    longest = max(float(record.time[-1]) - record.rest_end for record in records)
    for seconds in GROWING_LENGTHS:
        if seconds >= longest:
            continue
        descent = _descend_best_start(misfit.until(seconds), starts, predict_first=False)
        starts = [descent.values] if descent else starts
    return starts


def select_events(noise: EventNoise, name: str, *, hold: bool = False) -> EventNoise:
    """Return the noise of all records but one; with `hold`, of that one alone."""
    names = [event for event in noise.events.names if (event == name) is hold]
    return noise.only(*names)
