"""Looks at diagrams where records of events are all there is.

Shipped diagrams, of which no values are known, race by predictions: their states are led by the measured current, so that a
wrong model cannot drift away. Edits of a fitted diagram race on whole records, which the fit is near: predictions are much alike.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf, sqrt
from types import MappingProxyType

import numpy as np

from ibrid.evaluation.time_limit import time_limit
from ibrid.gap.event_misfit import Descending, EventMisfit
from ibrid.gap.event_question import asked_of
from ibrid.gap.joint_fit import drawn_starts, near_typical
from ibrid.gap.limit_race import ahead, in_front
from ibrid.gap.port_map import PortFit
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid_search.diagnosis import Edited, Looks, RankedEdit, Values, effects_of, ideas_of
from ibrid_search.merit import Criterion
from ibrid_search.oddities import Oddities, absurd
from ibrid_search.proposal import Evaluated
from ibrid_search.rankings import Rankings

#: Draws of each shipped diagram that race, and the heats: rounds, steps, how many go on.
FOLLOWED, HEATS = 3, ((1, 1, 30), (1, 2, 15), (2, 2, 15))
#: Seconds after which an edit is given up in a heat; it takes one or two.
LIMIT = 60.0
#: What a shipped diagram may leave, over what the best leaves, to be begun from: a fit to records takes a minute.
CLOSE = 5.0
#: Edits that race: what is missing has bent the rest of the model, so that a glance ranks it among the first thirty and no
#: higher; and the heats.
RACED, EDIT_HEATS = 32, ((1, 4, 24), (3, 2, 8))


class EventLooker(Looks):
    """Looks at diagrams against the records of a study."""

    def __init__(self, study: Study, criterion: Criterion) -> None:
        super().__init__(study.blind, criterion)
        records = self.study.events.records if self.study.events else ()
        self._loudest = max(records, key=lambda one: float(np.mean(np.abs(one.i - one.i_rest) ** 2))).name

    def textbooks(self, devices: int = 1, tell: Tell = lambda words, share: None) -> tuple[RankedEdit, ...]:
        """The shipped diagrams in the order of a race from draws of their numbers."""
        runners = []
        for edit, typical in self.shipped(devices, lambda words, share: tell(words, 0.5 * share)):
            runners += self._drawn(edit, typical)
        for place, heat in enumerate(HEATS):
            tell(f"{len(runners)} starts race", 0.5 + 0.5 * place / len(HEATS))
            runners = in_front(runners, [heat])
        first: dict[str, RankedEdit] = {}
        for edit, one in runners:
            first.setdefault(edit.part, self._seen(edit, one))
        least = min((look.error for look in first.values()), default=0.0)
        return tuple(sorted((one for one in first.values() if one.error <= CLOSE * least), key=lambda look: look.worth))

    def fresh(self, edit: Edited, typical: Mapping[str, float] = MappingProxyType({})) -> RankedEdit:
        """By a race of its draws alone."""
        front = in_front(self._drawn(edit, typical), HEATS)
        return self._seen(*front[0]) if front else RankedEdit(edit, inf, 0, inf)

    def _drawn(self, edit: Edited, typical: Mapping[str, float]) -> list[tuple[Edited, Descending]]:
        question = asked_of(edit.diagram, self.study)
        return [(edit, one) for one in drawn_starts(question, near_typical(question, typical), typical, FOLLOWED)]

    def look(self, edit: Edited, values: Values, *, glance: bool = False) -> RankedEdit:
        """An edit that races alone; worthless where it has no answer."""
        return next(iter(self.raced([edit], values)), RankedEdit(edit, inf, 0, inf))

    def raced(self, edits: Sequence[Edited], values: Values) -> list[RankedEdit]:
        """Edits of a diagram from its values: of those that lead far at a glance the ones in front of a race, the best first."""
        glances = [(edit, one) for edit in edits for one in _tried(partial(self._glance, edit, values))]
        near = ahead(glances, RACED)
        runners = [(edit, one) for edit, at in near for one in _tried(partial(self._misfit(edit.diagram).begun, at.x))]
        for rounds, steps, number in EDIT_HEATS:
            gone = [(edit, one) for edit, at in runners for one in _tried(partial(at.go, rounds, steps))]
            runners = ahead(gone, number)
        return sorted((self._seen(edit, one) for edit, one in runners), key=lambda look: look.worth)

    def _glance(self, edit: Edited, values: Values) -> Descending:
        """A step from the best of the usual strengths, on the loudest record alone."""
        length = max((len(bank) for bank in edit.strengths.values()), default=1)
        banks = [{name: bank[min(j, len(bank) - 1)] for name, bank in edit.strengths.items()} for j in range(length)]
        return self._misfit(edit.diagram, glance=True).best_of([{**values[0], **bank} for bank in banks], 1)[0].go(1, 1)

    def _misfit(self, diagram: Diagram, *, glance: bool = False) -> EventMisfit:
        question = asked_of(diagram, self.study)
        if glance:
            question = replace(question, events=question.events.only(self._loudest))
        return near_typical(question, {}).fitter.misfit(question.diagram, ()).coarse

    def _seen(self, edit: Edited, found: Descending) -> RankedEdit:
        error, free = sqrt(found.cost / found.misfit.count) * self.criterion.floor.level, len(found.x)
        odd = Oddities(absurd=absurd(edit.diagram, found.values, self.study.kinds))
        values = (found.values,) * len(self.study.fitted.names)
        return RankedEdit(edit, error, free, self.worth(error, free, odd), values)


class EventRankings(Rankings):
    """The rankings of the candidates of a study of records: effects of the catalogue, then other ideas."""

    def __init__(self, study: Study, looker: EventLooker) -> None:
        super().__init__(study, looker)
        self._racing = looker
        self._raced: dict[str, list[RankedEdit]] = {}

    def _explaining(self, parent: Evaluated) -> Iterator[PortFit]:
        """No transfer at a port stands for what records lack."""
        return iter(())

    def _stages(self, parent: Evaluated) -> Iterator[list[RankedEdit]]:
        yield self._ranked(parent.diagram, self._values(parent), effects_of)
        yield self._ranked(parent.diagram, self._values(parent), ideas_of)

    def _ranked(
        self, diagram: Diagram, values: Values, edits: Callable[[Diagram, Study], list[Edited]]
    ) -> list[RankedEdit]:
        key = f"{edits.__name__} {program_text(diagram)} {[sorted(point.items()) for point in values]}"
        if key not in self._raced:
            self._raced[key] = self._racing.raced(edits(diagram, self.study), values)
        return self._raced[key]


def _tried(work: Callable[[], Descending]) -> Iterator[Descending]:
    """What some work gives; nothing where it takes too long, or the code of a user's own kind raises whatever it does."""
    try:
        with time_limit(LIMIT):
            found = work()
    except (Exception, SystemExit):
        return
    yield found
