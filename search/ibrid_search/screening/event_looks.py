"""Looks at diagrams where records of events are all there is.

As far as departures are small the records stand for a sweep, and looks at that rank all diagrams
and edits in no time. Those in front race on whole records, which tell them apart.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from math import inf, sqrt

from ibrid.fit.anchor import Decades
from ibrid.fit.objective import objective_for
from ibrid.fit.problem import Misfit, Problem
from ibrid.gap.recordings.event_misfit import Descending
from ibrid.gap.recordings.event_question import asked_of
from ibrid.gap.recordings.joint_fit import near_typical
from ibrid.gap.recordings.limit_race import ahead
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid_search.screening.diagnosis import (
    DESCENDING,
    SCREENED,
    Edited,
    Looker,
    RankedEdit,
    Values,
)
from ibrid_search.screening.merit import Criterion
from ibrid_search.screening.oddities import Oddities, absurd
from ibrid_search.screening.trying import NO_ANSWER

#: Shipped diagrams and edits that race, and the heats: rounds, steps, how many go on.
SHIPPED, EDITS, HEATS = 16, 24, ((1, 4, 24), (3, 2, 8))
#: What a shipped diagram may leave, over what the best leaves, to be begun from: a fit to records
#: takes a minute.
CLOSE = 5.0


class EventLooker(Looker):
    """Looks at diagrams against the records of a study.

    One direction of Y has more valleys than all of it: more descend.
    """

    screened, descending = 4 * SCREENED, 4 * DESCENDING

    def __init__(self, study: Study, criterion: Criterion) -> None:
        super().__init__(study.blind, criterion)
        self._raced: dict[str, list[RankedEdit]] = {}

    def textbooks(
        self, devices: int = 1, tell: Tell = lambda words, share: None
    ) -> tuple[RankedEdit, ...]:
        """The shipped diagrams in the order of a race."""
        looks = super().textbooks(devices, lambda words, share: tell(words, 0.5 * share))[:SHIPPED]
        tell(f"{len(looks)} of them race", 0.5)
        front = self._race(looks)
        least = min((look.error for look in front), default=0.0)
        return tuple(look for look in front if look.error <= CLOSE * least)

    def ranked(
        self, edits: Iterable[Edited], values: Values, *, settled: bool = False
    ) -> list[RankedEdit]:
        """Of those that lead far at a glance the ones in front of a race, the best first; by the
        glance where nothing is left to explain.
        """
        glances = [self.look(edit, values, glance=True) for edit in edits]
        front = sorted((one for one in glances if one.error < inf), key=lambda look: look.worth)[
            :EDITS
        ]
        if settled:
            return front
        key = (
            f"{[self.study.hash_of(look.edit.diagram) for look in front]} "
            f"{[look.values for look in front]}"
        )
        if key not in self._raced:
            self._raced[key] = self._race(front)
        return self._raced[key]

    def _misfits(self, problem: Problem) -> tuple[Misfit, Misfit]:
        """What small departures leave open is near typical: a mode beyond what was recorded cannot
        be simulated.
        """
        believed = Decades(problem)
        return Misfit(problem, "log", believed), Misfit(
            problem, objective_for(problem.points), believed
        )

    def _race(self, looks: Sequence[RankedEdit]) -> list[RankedEdit]:
        runners = [(one.edit, at) for one in looks for at in _tried(partial(self._begun, one))]
        for rounds, steps, number in HEATS:
            gone = [
                (edit, one) for edit, at in runners for one in _tried(partial(at.go, rounds, steps))
            ]
            runners = ahead(gone, number)
        return sorted((self._seen(edit, one) for edit, one in runners), key=lambda look: look.worth)

    def _begun(self, look: RankedEdit) -> Descending:
        question = asked_of(look.edit.diagram, self.study)
        misfit = (
            near_typical(question, {}, sampled=False).fitter.misfit(question.diagram, ()).coarse
        )
        return misfit.begun(misfit.beliefs.start(look.values[0]))

    def _seen(self, edit: Edited, found: Descending) -> RankedEdit:
        error, free = (
            sqrt(found.cost / found.misfit.count) * self.criterion.floor.level,
            len(found.x),
        )
        odd = Oddities(absurd=absurd(edit.diagram, found.values, self.study.kinds))
        values = (found.values,) * len(self.study.fitted.names)
        return RankedEdit(edit, error, free, self.worth(error, free, odd), values)


def _tried(work: Callable[[], Descending]) -> Iterator[Descending]:
    """What some work gives; nothing where the diagram has no matrices or no rest, or its kind, a
    user's own, breaks off.
    """
    try:
        found = work()
    except NO_ANSWER:
        return
    yield found
