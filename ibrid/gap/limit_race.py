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
from ibrid.gap.event_fit import PLAIN, WORTH, Descending, EventFit, EventFitter, EventMisfit
from ibrid.gap.event_places import LimitPlace
from ibrid.playback.limits import Limit

#: Starts from which a form sets out, about the first origin and about each other one.
FOLLOWED = (2, 1)
#: Rounds of a heat by predictions, steps of each, and how many go on.
HEATS = ((1, 1, 24), (1, 3, 12), (3, 2, 6), (5, 2, 4))
#: Rounds beside what the first found, steps of each.
BESIDE = (2, 3)


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
    forms = [_misfit(fitter, place, beside(place)) for place in places]

    def fitted(runner: Runner) -> EventFit:
        place = places[runner.form]
        return fitter.at(place.diagram, beside(place), runner.descending.x)

    front = _heats(forms, places, origins) if led else []
    whole = _first((_whole(forms, one) for one in front), len(front))
    worth = [
        one for one in whole if one.descending.cost <= WORTH * whole[0].descending.cost
    ]  # all before any is descended
    for runner in worth:
        runner.descending.go(*PLAIN)
    ended = _first(worth, 1)
    for runner in ended:
        runner.descending.to_its_end()
    others = [fitted(runner).values for runner in ended] or origins
    first = {runner.form for runner in ended}
    for number, misfit in enumerate(forms):
        if misfit is not None and number not in first:
            whole += [Runner(number, one.go(*BESIDE)) for one in _starts(misfit, places[number], others, 1)]
    found = {one.form: fitted(one) for one in reversed(_first(whole, len(whole)))}
    return [found.get(number) for number in range(len(places))]


def _heats(
    forms: Sequence[EventMisfit | None], places: Sequence[LimitPlace], origins: Sequence[Values]
) -> list[Runner]:
    """Those in front after all heats, the first form first."""
    runners = [
        Runner(number, one)
        for number, (misfit, place) in enumerate(zip(forms, places, strict=True))
        for k, origin in enumerate(origins)
        for one in (_starts(misfit.predicting, place, [origin], FOLLOWED[min(k, 1)]) if misfit else ())
    ]
    for rounds, steps, number in HEATS:
        for runner in runners:
            runner.descending.go(rounds, steps)
        runners = _first(runners, number)
    return runners


def _misfit(fitter: EventFitter, place: LimitPlace, limits: tuple[Limit, ...]) -> EventMisfit | None:
    try:
        return fitter.misfit(place.diagram, limits)
    except IbridError:
        return None


def _starts(misfit: EventMisfit, place: LimitPlace, origins: Sequence[Values], number: int) -> list[Descending]:
    values = [{**origin, **start} for start in place.starts for origin in origins]
    return misfit.best(np.unique(np.array([misfit.beliefs.start(one) for one in values]), axis=0), number)


def _whole(forms: Sequence[EventMisfit | None], runner: Runner) -> Runner:
    """The same on whole records."""
    misfit = forms[runner.form]
    return runner if misfit is None else Runner(runner.form, misfit.begun(runner.descending.x))


def _first(runners: Iterable[Runner], number: int) -> list[Runner]:
    """Those in front, by the cost of where they are; what has no answer is out."""
    running = (one for one in runners if np.isfinite(one.descending.cost))
    return sorted(running, key=lambda one: one.descending.cost)[:number]
