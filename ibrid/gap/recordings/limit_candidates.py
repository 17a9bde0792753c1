"""Screening of candidates for a missing limit by successive halving.

A missing limit biases all parameters, and a full fit of every candidate takes minutes. Prediction
errors rank them: the cost after some descent steps distinguishes limits that the cost before any
step does not. The survivors are fitted to the whole recordings; the others are then fitted from the
values that the best survivor found for the rest of the model.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.recordings.cessation import (
    holds_from_release_times,
    release_times_from_hold,
    with_release_times,
)
from ibrid.gap.recordings.event_fitter import WORTH, EventFit, EventFitter
from ibrid.gap.recordings.event_misfit import SIMULATION_EFFORT, EventDescent, EventMisfit
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.recordings.successive_halving import Entrant, rank_entrants, run_rungs
from ibrid.gap.refitting.model import Values
from ibrid.playback.limits import UNTIL, Limit


@dataclass(frozen=True, eq=False)
class LimitCandidate:
    """A model with one limit added or removed, as it is screened.

    Parameters
    ----------
    edit : LimitEdit
        The edit that leads to it.
    limits : tuple of Limit
        All limits of the model with the edit.
    misfit : EventMisfit
        Of that model; a momentary cessation is screened by its release times.
    starts : tuple of mapping
        Initial values of the limit's own parameters.
    """

    edit: LimitEdit
    limits: tuple[Limit, ...]
    misfit: EventMisfit
    starts: tuple[Values, ...]

    def start_predictions(self, origins: Sequence[Values], number: int) -> list[EventDescent]:
        """Return the best descents on prediction errors, best first.

        origins : values of the other parameters.
        """
        return self._start_descents(self.misfit.prediction.coarse, origins, number)

    def start_simulations(self, origins: Sequence[Values]) -> list[EventDescent]:
        """Return the best descent on whole recordings."""
        return self._start_descents(self.misfit, origins, 1)

    def _start_descents(
        self, misfit: EventMisfit, origins: Sequence[Values], number: int
    ) -> list[EventDescent]:
        values: list[Values] = [{**origin, **start} for start in self.starts for origin in origins]
        if len(self.starts) > SCREENING.most_grid_starts:
            values = self._thin_grid(misfit, values)
        return misfit.start_descents_from(values, number)

    def _thin_grid(self, misfit: EventMisfit, values: list[Values]) -> list[Values]:
        """Try the last parameter of the limit only near the best values of the others."""
        last = f"{self.edit.effect}.{list(self.misfit.limits[-1].parameters)[-1]}"
        levels = sorted({start[last] for start in self.starts})
        middle = levels[len(levels) // 2]
        at_middle = [start for start in values if start[last] == middle]
        best = misfit.start_descents_from(at_middle, SCREENING.kept_grid_starts)
        return [{**descent.values, last: level} for descent in best for level in levels]

    def fit_at(self, fitter: EventFitter, x: np.ndarray) -> EventFit | None:
        """Return the fit of the model at x (P,); None where no record shows a hold time."""
        diagram = self.edit.diagram
        if UNTIL not in self.misfit.limits:
            return fitter.at(diagram, self.limits, x)
        misfit = fitter.misfit(diagram, self.limits)
        for descent in misfit.start_descents_from(holds_from_release_times(self.misfit, x), 1):
            if not descent.is_far:
                descent.run(*SCREENING.beside_effort)
            return fitter.at(diagram, self.limits, descent.x)
        return None


LimitEntrant = Entrant[LimitCandidate]


def screen_limits(
    fitter: EventFitter,
    edits: Sequence[LimitEdit],
    limits_with: Callable[[LimitEdit], tuple[Limit, ...]],
    origins: Sequence[Values],
    *,
    predict_first: bool = True,
) -> list[EventFit | None]:
    """Fit a model with each of several limits and return the fits; None without a simulation.

    Parameters
    ----------
    limits_with : callable
        All limits of the model with an edit.
    origins : sequence of mapping
        Values of the other parameters.
    predict_first : bool
        False where the model explains the data already, and no candidate is followed far.
    """
    built = [_build_candidate(fitter, edit, limits_with(edit)) for edit in edits]
    candidates = [candidate for candidate in built if candidate is not None]
    baseline = _prediction_cost_without_limit(fitter, edits, limits_with, origins)
    if not predict_first:
        others = _fit_briefly(candidates, origins, baseline)
        return _collect_fits(fitter, edits, others)
    entrants = _enter_candidates(candidates, origins)
    survivors = _run_prediction_rungs(entrants, baseline)
    if not survivors:  # no limit is missing
        return _collect_fits(fitter, edits, entrants)
    hopeless = _list_hopeless(entrants, survivors[0].descent.cost)
    simulated = [
        Entrant(candidate, candidate.misfit.start_descent(descent.x))
        for candidate, descent in survivors
    ]
    simulated = rank_entrants(simulated, len(simulated))
    winner = _simulate_best(simulated)
    others = _fit_others(candidates, winner, origins, hopeless)
    return _collect_fits(fitter, edits, [*simulated, *others])


def _list_hopeless(entrants: Sequence[LimitEntrant], least_cost: float) -> set[LimitEdit]:
    """List the edits whose best entrant is far worse than the best of all."""
    limit = SCREENING.hopeless_cost * least_cost
    return {
        edit for edit, entrant in _best_by_edit(entrants).items() if entrant.descent.cost > limit
    }


def _simulate_best(ranked: Sequence[LimitEntrant]) -> LimitEntrant | None:
    """Descend the ranked entrants on whole recordings until one explains them; return the best."""
    worth = [
        entrant for entrant in ranked if entrant.descent.cost <= WORTH * ranked[0].descent.cost
    ]  # selected before any descends
    for entrant in worth:
        if entrant.descent.run(*SIMULATION_EFFORT).explains:
            break
    winner = next(iter(rank_entrants(worth, 1)), None)
    if winner is not None:
        winner.descent.restart_while_improving()
    return winner


def _fit_others(
    candidates: Sequence[LimitCandidate],
    winner: LimitEntrant | None,
    origins: Sequence[Values],
    hopeless: set[LimitEdit],
) -> list[LimitEntrant]:
    """Fit the other candidates from the values that the winner found for the rest of the model."""
    explained = winner is not None and winner.descent.explains
    values = origins if winner is None else [winner.descent.values]
    entrants: list[LimitEntrant] = []
    for candidate in candidates:
        if winner is not None and candidate is winner.candidate:
            continue
        effort = SCREENING.beside_effort
        if candidate.edit in hopeless:
            effort = SCREENING.brief_effort
        predictions = candidate.start_predictions(values, 1)
        for descent in _start_simulations(candidate, predictions, values):
            if not (explained and descent.is_far):
                descent.run(*effort)
            entrants.append(Entrant(candidate, descent))
    return entrants


def _fit_briefly(
    candidates: Sequence[LimitCandidate], origins: Sequence[Values], baseline: float
) -> list[LimitEntrant]:
    """Fit candidates briefly; a limit that does not change the predictions is left as it is."""
    entrants: list[LimitEntrant] = []
    for candidate in candidates:
        predictions = candidate.start_predictions(origins, 1)
        tolerance = SCREENING.inactive_change * baseline
        never_acts = all(abs(start.cost - baseline) <= tolerance for start in predictions)
        is_inactive = np.isfinite(baseline) and never_acts
        for descent in _start_simulations(candidate, predictions, origins):
            if not is_inactive:
                descent.run(*SCREENING.brief_effort)
            entrants.append(Entrant(candidate, descent))
    return entrants


def _start_simulations(
    candidate: LimitCandidate, predictions: Sequence[EventDescent], values: Sequence[Values]
) -> list[EventDescent]:
    """Begin on whole recordings where predictions end; where that diverges, from the values."""
    descents = [candidate.misfit.start_descent(prediction.x) for prediction in predictions]
    simulated = [descent for descent in descents if np.isfinite(descent.cost)]
    return simulated or candidate.start_simulations(values)


def refit_by_predictions(
    fit: EventFit, fitter: EventFitter, loose: EventFitter, names: Iterable[str]
) -> EventFit:
    """Refit a model with a limit by prediction errors in looser weights, and return the better fit.

    Screening has biased the rest of the model, and by sharp weights a descent stops in the next
    local minimum.

    Parameters
    ----------
    loose : EventFitter
        Of the same records, in looser weights.
    names : iterable of str
        Parameters of the rest of the model, which begin at their nominal values, too.
    """
    names = set(names)
    own_values = {name: value for name, value in fit.values.items() if name not in names}
    fits = [loose.fit(fit.diagram, fit.limits, [start]) for start in (own_values, fit.values)]
    starts = [loose_fit.values for loose_fit in fits if loose_fit is not None]
    if not starts:
        return fit
    refit = fitter.fit(fit.diagram, fit.limits, starts, predict_first=False)
    return fit if refit is None or refit.cost >= fit.cost else refit


def _enter_candidates(
    candidates: Sequence[LimitCandidate], origins: Sequence[Values]
) -> list[LimitEntrant]:
    """Begin every candidate from every origin, by prediction errors."""
    entrants: list[LimitEntrant] = []
    for candidate in candidates:
        for number, origin in enumerate(origins):
            starts = SCREENING.limit_starts if number else SCREENING.limit_starts_first_origin
            descents = candidate.start_predictions([origin], starts)
            entrants += [Entrant(candidate, descent) for descent in descents]
    return entrants


def _run_prediction_rungs(entrants: list[LimitEntrant], baseline: float) -> list[LimitEntrant]:
    """Run all rungs and return the survivors; [] where no limit predicts clearly better than none.

    baseline : prediction cost of the model without a limit.
    """
    first, second, *others = SCREENING.limit_rungs
    for rung, part in ((first, SCREENING.first_rung_cost), (second, SCREENING.second_rung_cost)):
        entrants = run_rungs(entrants, [rung])
        if not entrants or entrants[0].descent.cost > part * baseline:
            return []
    return run_rungs(entrants, others)


def _prediction_cost_without_limit(
    fitter: EventFitter,
    edits: Sequence[LimitEdit],
    limits_with: Callable[[LimitEdit], tuple[Limit, ...]],
    origins: Sequence[Values],
) -> float:
    """Return the least prediction cost of the model without a further limit."""
    added = next((edit for edit in edits if edit.change == "add"), None)
    if added is None:
        return np.inf
    without = tuple(limit for limit in limits_with(added) if limit is not added.limit)
    misfit = fitter.misfit(added.diagram, without).prediction.coarse
    descents = misfit.start_descents_from(origins, 1)
    return min((descent.cost for descent in descents), default=np.inf)


def _collect_fits(
    fitter: EventFitter, edits: Sequence[LimitEdit], entrants: Sequence[LimitEntrant]
) -> list[EventFit | None]:
    """Return the fit of the best entrant of each edit; None where it has none."""
    best = _best_by_edit(entrants)
    fits: list[EventFit | None] = []
    for edit in edits:
        entrant = best.get(edit)
        fit = None
        if entrant is not None:
            fit = entrant.candidate.fit_at(fitter, entrant.descent.x)
        fits.append(fit)
    return fits


def _best_by_edit(entrants: Sequence[LimitEntrant]) -> dict[LimitEdit, LimitEntrant]:
    """Return the entrant of least cost of each edit."""
    worst_first = reversed(rank_entrants(entrants, len(entrants)))
    return {entrant.candidate.edit: entrant for entrant in worst_first}


def _build_candidate(
    fitter: EventFitter, edit: LimitEdit, limits: tuple[Limit, ...]
) -> LimitCandidate | None:
    """Build the candidate of an edit; None where the diagram has no matrices."""
    is_cessation = edit.change == "add" and edit.limit.id == UNTIL.id
    try:
        if not is_cessation:
            return LimitCandidate(edit, limits, fitter.misfit(edit.diagram, limits), edit.starts)
        events = fitter.noise.events
        misfit = fitter.misfit(edit.diagram, with_release_times(limits))
        starts = [
            values for start in edit.starts for values in release_times_from_hold(start, events)
        ]
        return LimitCandidate(edit, limits, misfit, tuple(starts))
    except IbridError:
        return None
