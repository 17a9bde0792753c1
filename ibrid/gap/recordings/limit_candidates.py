"""Which of many forms of a missing limit explain records: all set out, and heat by heat those that
lag behind stay.

A limit that is missing has bent the rest of a model, and a fit of every form to its end takes
minutes. So predictions rank them: where the values of a form are led by some steps tells apart what
costs before any step do not. Those in front go on to the whole record; the others are tried beside
what the first of them found for the rest of the model.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.recordings.cessation import (
    holds_from_moments,
    moments_from_hold,
    with_release_moments,
)
from ibrid.gap.recordings.event_fitter import WORTH, EventFit, EventFitter
from ibrid.gap.recordings.event_misfit import SIMULATION_EFFORT, EventDescent, EventMisfit
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.refitting.model import Values
from ibrid.playback.limits import UNTIL, Limit

What = TypeVar("What")

#: Starts from which a form sets out, about the first origin and about each other one.
FOLLOWED = (2, 1)
#: Starts of a form beyond which they are tried in two turns, and how many are kept in between.
MANY, NEAR = 100, 4
#: Rounds of a heat by predictions, steps of each, and how many go on.
FIRST_HEAT, HEATS = (1, 1, 24), ((1, 3, 12), (3, 2, 6), (5, 2, 4))
#: Part of the cost of predictions without a limit, of which the right one leaves less after the
#: first heat and after the second: 0.5 and 0.07 at most in drawn devices, while others leave 0.96
#: and 0.7 where none is missing. Factor on the cost of the first beyond which another form is no
#: rival.
MISSING, HOPELESS = (0.9, 0.5), 10.0
#: Relative change of a cost below which a limit does not act.
IDLE = 1e-9
#: Rounds beside what the first found, steps of each; and beside a model that explains all, where
#: little is to be gained.
BESIDE, BRIEFLY = (2, 3), (1, 2)


@dataclass(frozen=True, eq=False)
class LimitCandidate:
    """A form as it is followed: `misfit`, and the `starts` of its own numbers; `place` and all
    `limits` of the model with it.

    A cessation is followed by its moments of release.
    """

    place: LimitEdit
    limits: tuple[Limit, ...]
    misfit: EventMisfit
    starts: tuple[Values, ...]

    def start_descent(
        self, origins: Sequence[Values], number: int, *, whole: bool = False
    ) -> list[EventDescent]:
        """The best starts about values of the other parameters, by predictions or on `whole`
        records.
        """
        misfit, starts = self.misfit if whole else self.misfit.prediction.coarse, self.starts
        values = [{**origin, **start} for start in starts for origin in origins]
        if len(starts) > MANY:  # the last number of the form is tried where the others lead
            last = f"{self.place.effect}.{list(self.misfit.limits[-1].parameters)[-1]}"
            levels = sorted({one[last] for one in starts})
            near = misfit.start_descents_from(
                [one for one in values if one[last] == levels[len(levels) // 2]], NEAR
            )
            values = [{**one.values, last: level} for one in near for level in levels]
        return misfit.start_descents_from(values, number)

    def fitted(self, fitter: EventFitter, x: np.ndarray) -> EventFit | None:
        """The model with this form; None where no record shows a hold."""
        if UNTIL not in self.misfit.limits:
            return fitter.at(self.place.diagram, self.limits, x)
        held = fitter.misfit(self.place.diagram, self.limits)
        for one in held.start_descents_from(holds_from_moments(self.misfit, x), 1):
            return fitter.at(
                self.place.diagram, self.limits, (one if one.is_far else one.run(*BESIDE)).x
            )
        return None


#: A form, and how far it has come.
Entrant = tuple[LimitCandidate, EventDescent]


def screen_limits(
    fitter: EventFitter,
    places: Sequence[LimitEdit],
    beside: Callable[[LimitEdit], tuple[Limit, ...]],
    origins: Sequence[Values],
    *,
    led: bool = True,
) -> list[EventFit | None]:
    """The fit of each form, None where it has no answer.

    beside : all limits of a model with a form. origins : values of the other parameters. led :
    False where a model explains the records already, and no form is followed far.
    """
    forms = [
        form
        for place in places
        if (form := _build_candidate(fitter, place, beside(place))) is not None
    ]
    lacking = _cost_without_limit(fitter, places, beside, origins)
    runners = _enter_candidates(forms, origins) if led else []
    front = _run_prediction_rungs(runners, lacking)
    if led and not front:  # no limit is what is missing
        return _fit_entrants(fitter, places, runners)
    least = _best_entrants(runners)
    hopeless = {place for place, one in least.items() if one[1].cost > HOPELESS * front[0][1].cost}
    whole = rank_entrants(
        [(form, form.misfit.start_descent(one.x)) for form, one in front], len(front)
    )
    worth = [
        (form, one) for form, one in whole if one.cost <= WORTH * whole[0][1].cost
    ]  # all before any is descended
    for _, descent in worth:
        if descent.run(*SIMULATION_EFFORT).explains:
            break
    ended = rank_entrants(worth, 1)
    for _, descent in ended:
        descent.restart_while_improving()
    others = [one.values for _, one in ended] or origins
    explained = any(one.explains for _, one in ended)
    for form in forms:
        if all(form is not other for other, _ in ended):
            begun = form.start_descent(others, 1)
            led_to = [form.misfit.start_descent(one.x) for one in begun]
            starts = [one for one in led_to if np.isfinite(one.cost)] or form.start_descent(
                others, 1, whole=True
            )
            effort = BRIEFLY if not led or form.place in hopeless else BESIDE
            never_acts = all(abs(one.cost - lacking) <= IDLE * lacking for one in begun)
            idle = not led and np.isfinite(lacking) and never_acts
            whole += [
                (form, one if idle or (explained and one.is_far) else one.run(*effort))
                for one in starts
            ]
    return _fit_entrants(fitter, places, whole)


def refit_by_predictions(
    fit: EventFit, fitter: EventFitter, loose: EventFitter, rest: Iterable[str]
) -> EventFit:
    """The fit of a form, led once more by the weights of another fitter, from where it is and from
    what is believed of the rest of the model, and then by its own; the better of both.

    A race has bent the rest, and by sharp weights a descent stops in the next valley. rest : names
    of its numbers.
    """
    own = {name: value for name, value in fit.values.items() if name not in set(rest)}
    led = [loose.fit(fit.diagram, fit.limits, [values]) for values in (own, fit.values)]
    starts = [one.values for one in led if one is not None]
    again = fitter.fit(fit.diagram, fit.limits, starts, led=False) if starts else None
    return fit if again is None or again.cost >= fit.cost else again


def _enter_candidates(forms: Sequence[LimitCandidate], origins: Sequence[Values]) -> list[Entrant]:
    """All forms set out from all origins."""
    return [
        (form, one)
        for form in forms
        for place, origin in enumerate(origins)
        for one in form.start_descent([origin], FOLLOWED[min(place, 1)])
    ]


def _run_prediction_rungs(runners: list[Entrant], lacking: float) -> list[Entrant]:
    """Run all heats and return those in front; none where no limit predicts clearly better than the
    model without one.

    lacking : cost of predictions without a limit.
    """
    for heat, most in zip((FIRST_HEAT, HEATS[0]), MISSING, strict=True):
        runners = run_rungs(runners, [heat])
        if not runners or runners[0][1].cost > most * lacking:
            return []
    return run_rungs(runners, HEATS[1:])


def _cost_without_limit(
    fitter: EventFitter,
    places: Sequence[LimitEdit],
    beside: Callable[[LimitEdit], tuple[Limit, ...]],
    origins: Sequence[Values],
) -> float:
    """The least cost of predictions of the model that lacks a limit."""
    added = next((one for one in places if one.change == "add"), None)
    if added is None:
        return np.inf
    lacking = tuple(one for one in beside(added) if one is not added.limit)
    misfit = fitter.misfit(added.diagram, lacking).prediction.coarse
    return min((one.cost for one in misfit.start_descents_from(origins, 1)), default=np.inf)


def _fit_entrants(
    fitter: EventFitter, places: Sequence[LimitEdit], runners: Sequence[Entrant]
) -> list[EventFit | None]:
    """The fit of each form where the best of those that ran for it is, on whole records."""
    best = _best_entrants(runners)
    return [
        None if (pair := best.get(one)) is None else pair[0].fitted(fitter, pair[1].x)
        for one in places
    ]


def _best_entrants(runners: Sequence[Entrant]) -> dict[LimitEdit, Entrant]:
    """Place -> the best of those that ran for it."""
    return {form.place: (form, one) for form, one in reversed(rank_entrants(runners, len(runners)))}


def run_rungs(
    runners: list[tuple[What, EventDescent]], heats: Iterable[tuple[int, int, int]] = HEATS
) -> list[tuple[What, EventDescent]]:
    """Those in front after all heats, the first one first."""
    for rounds, steps, number in heats:
        for _, one in runners:
            one.run(rounds, steps)
        runners = rank_entrants(runners, number)
    return runners


def _build_candidate(
    fitter: EventFitter, place: LimitEdit, limits: tuple[Limit, ...]
) -> LimitCandidate | None:
    try:
        if place.change != "add" or place.limit.id != UNTIL.id:
            return LimitCandidate(place, limits, fitter.misfit(place.diagram, limits), place.starts)
        events = fitter.noise.events
        misfit = fitter.misfit(place.diagram, with_release_moments(limits))
        return LimitCandidate(
            place,
            limits,
            misfit,
            tuple(moved for one in place.starts for moved in moments_from_hold(one, events)),
        )
    except IbridError:
        return None


def rank_entrants(
    runners: Iterable[tuple[What, EventDescent]], number: int
) -> list[tuple[What, EventDescent]]:
    """Those in front, by the cost of where they are; what has no answer is out."""
    return sorted(
        (pair for pair in runners if np.isfinite(pair[1].cost)), key=lambda pair: pair[1].cost
    )[:number]
