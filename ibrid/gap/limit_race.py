"""Which of many forms of a missing limit explain records: all set out, and heat by heat those that lag behind stay.

A limit that is missing has bent the rest of a model, and a fit of every form to its end takes minutes. So predictions rank
them: where the values of a form are led by some steps tells apart what costs before any step do not. Those in front go on to
the whole record; the others are tried beside what the first of them found for the rest of the model.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.data import Values
from ibrid.gap.event_fit import LEFT, PLAIN, WORTH, Descending, EventFit, EventFitter, EventMisfit
from ibrid.gap.event_places import LimitPlace
from ibrid.gap.release import by_holds, by_moments
from ibrid.playback.limits import UNTIL, Limit

#: Starts from which a form sets out, about the first origin and about each other one.
FOLLOWED = (2, 1)
#: Starts of a form beyond which they are tried in two turns, and how many are kept in between.
MANY, NEAR = 100, 4
#: Rounds of a heat by predictions, steps of each, and how many go on.
HEATS = ((1, 1, 24), (1, 3, 12), (3, 2, 6), (5, 2, 4))
#: Rounds beside what the first found, steps of each.
BESIDE = (2, 3)


@dataclass(frozen=True, eq=False)
class Form:
    """A form as it is followed: `misfit`, and the `starts` of its own numbers; `place` and all `limits` of the model with it.

    A cessation is followed by its moments of release.
    """

    place: LimitPlace
    limits: tuple[Limit, ...]
    misfit: EventMisfit
    starts: tuple[Values, ...]

    def begun(self, origins: Sequence[Values], number: int, *, predicting: bool = False) -> list[Descending]:
        """The best starts about values of the other parameters."""
        misfit = self.misfit.predicting if predicting else self.misfit
        starts: Sequence[Values] = self.starts
        if len(starts) > MANY:  # the last number of the form is tried where the others lead
            last = f"{self.place.effect}.{list(self.misfit.limits[-1].parameters)[-1]}"
            levels = sorted({one[last] for one in starts})
            starts = [one for one in starts if one[last] == levels[len(levels) // 2]]
            near = _best(misfit, [{**origin, **start} for start in starts for origin in origins], NEAR)
            return _best(misfit, [{**one.values, last: level} for one in near for level in levels], number)
        return _best(misfit, [{**origin, **start} for start in starts for origin in origins], number)

    def fitted(self, fitter: EventFitter, x: np.ndarray) -> EventFit | None:
        """The model with this form; None where no record shows a hold."""
        if UNTIL not in self.misfit.limits:
            return fitter.at(self.place.diagram, self.limits, x)
        held = fitter.misfit(self.place.diagram, self.limits)
        starts = np.array([held.beliefs.start(one) for one in by_holds(self.misfit, x)])
        ends = [one.go(*BESIDE) for one in held.best(starts, 1)] if len(starts) else []
        return fitter.at(self.place.diagram, self.limits, ends[0].x) if ends else None


@dataclass(frozen=True, eq=False)
class Runner:
    """A form, by its number, and how far it has come."""

    form: int
    descending: Descending


def race(
    fitter: EventFitter,
    places: Sequence[LimitPlace],
    beside: Callable[[LimitPlace], tuple[Limit, ...]],
    origins: Sequence[Values],
    *,
    led: bool = True,
) -> list[EventFit | None]:
    """The fit of each form, None where it has no answer.

    beside : all limits of a model with a form. origins : values of the other parameters. led : False where a model explains the
    records already, and no form is followed far.
    """
    forms = [_form(fitter, place, beside(place)) for place in places]
    running = [(number, form) for number, form in enumerate(forms) if form is not None]

    front = _heats(running, origins) if led else []
    whole = _first((_whole(forms, one) for one in front), len(front))
    worth = [
        one for one in whole if one.descending.cost <= WORTH * whole[0].descending.cost
    ]  # all before any is descended
    for runner in worth:
        runner.descending.go(*PLAIN)
    ended = _first(worth, 1)
    for runner in ended:
        runner.descending.to_its_end()
    others = [runner.descending.values for runner in ended] or origins
    first = {runner.form for runner in ended}
    for number, form in running:
        if number not in first:
            whole += [Runner(number, one.go(*BESIDE)) for one in form.begun(others, 1)]
    best = {one.form: one.descending.x for one in reversed(_first(whole, len(whole)))}
    found = {number: form.fitted(fitter, best[number]) for number, form in running if number in best}
    return [found.get(number) for number in range(len(places))]


def _heats(running: Sequence[tuple[int, Form]], origins: Sequence[Values]) -> list[Runner]:
    """Those in front after all heats, the first form first."""
    runners = [
        Runner(number, one)
        for number, form in running
        for k, origin in enumerate(origins)
        for one in form.begun([origin], FOLLOWED[min(k, 1)], predicting=True)
    ]
    for rounds, steps, number in HEATS:
        for runner in runners:
            runner.descending.go(rounds, steps)
        runners = _first(runners, number)
        first = runners[0].descending if runners else None
        if first is not None and first.cost <= LEFT * first.misfit.count:  # what leaves noise alone has won
            return [one for one in runners if one.descending.cost <= WORTH * first.cost]
    return runners


def _form(fitter: EventFitter, place: LimitPlace, limits: tuple[Limit, ...]) -> Form | None:
    try:
        if place.change != "add" or place.limit.id != UNTIL.id:
            return Form(place, limits, fitter.misfit(place.diagram, limits), place.starts)
        events = fitter.noise.events
        misfit = fitter.misfit(place.diagram, [UNTIL if one is place.limit else one for one in limits])
        return Form(place, limits, misfit, tuple(by_moments(one, events) for one in place.starts))
    except IbridError:
        return None


def _best(misfit: EventMisfit, values: Sequence[Values], number: int) -> list[Descending]:
    return misfit.best(np.unique(np.array([misfit.beliefs.start(one) for one in values]), axis=0), number)


def _whole(forms: Sequence[Form | None], runner: Runner) -> Runner:
    """The same on whole records."""
    form = forms[runner.form]
    return runner if form is None else Runner(runner.form, form.misfit.begun(runner.descending.x))


def _first(runners: Iterable[Runner], number: int) -> list[Runner]:
    """Those in front, by the cost of where they are; what has no answer is out."""
    running = (one for one in runners if np.isfinite(one.descending.cost))
    return sorted(running, key=lambda one: one.descending.cost)[:number]
