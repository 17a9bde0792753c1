"""Looks at diagrams where records of events are all there is.

Shipped diagrams, of which no values are known, race by predictions: their states are led by the measured current, so that a
wrong model cannot drift away. Edits of a fitted diagram race on whole records, which the fit is near: predictions are much alike.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf, sqrt

import numpy as np

from ibrid.gap.event_misfit import Descending, EventMisfit
from ibrid.gap.event_question import asked_of
from ibrid.gap.joint_fit import begun, near_typical
from ibrid.gap.limit_race import in_front
from ibrid.gap.port_map import PortFit
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid_search.diagnosis import Edited, Looker, RankedEdit, Values, effects_of, ideas_of
from ibrid_search.merit import Criterion, criterion
from ibrid_search.oddities import Oddities, absurd
from ibrid_search.proposal import Evaluated
from ibrid_search.rankings import Rankings
from ibrid_search.settings import SearchSettings

#: Draws of each shipped diagram that race, and the heats: rounds, steps, how many go on.
FOLLOWED, HEATS = 3, ((1, 1, 30), (1, 2, 15), (2, 2, 15))
#: What a shipped diagram may leave, over what the best leaves, to be begun from: a fit to records takes a minute.
CLOSE = 5.0
#: Edits that race: what is missing has bent the rest of the model, so that a glance ranks it among the first thirty and no
#: higher; and the heats.
RACED, EDIT_HEATS = 32, ((1, 4, 24), (3, 2, 8))


class EventLooker(Looker):
    """Looks at diagrams against the records of one study. A glance is a step on the loudest record alone."""

    def __init__(self, study: Study, criterion: Criterion) -> None:
        self.study, self.criterion = study.blind, criterion
        records = self.study.events.records if self.study.events else ()
        self._loudest = max(records, key=lambda one: float(np.mean(np.abs(one.i - one.i_rest) ** 2))).name

    def textbooks(self, devices: int = 1, tell: Tell = lambda words, share: None) -> tuple[RankedEdit, ...]:
        """The shipped diagrams in the order of a race from draws of their numbers."""
        runners = []
        for edit, typical in self.shipped(devices, lambda words, share: tell(words, 0.5 * share)):
            question = asked_of(edit.diagram, self.study)
            runners += [(edit, one) for one in begun(question, near_typical(question, typical), typical, FOLLOWED)]
        for place, heat in enumerate(HEATS):
            tell(f"{len(runners)} starts race", 0.5 + 0.5 * place / len(HEATS))
            runners = in_front(runners, [heat])
        first: dict[str, RankedEdit] = {}
        for edit, one in runners:
            first.setdefault(edit.part, self._seen(edit, one))
        least = min((look.error for look in first.values()), default=0.0)
        return tuple(sorted((one for one in first.values() if one.error <= CLOSE * least), key=lambda look: look.worth))

    def raced(self, edits: Sequence[Edited], values: Values) -> list[RankedEdit]:
        """Edits of a diagram from its values: of those that lead far at a glance the ones in front of a race, the best first."""
        glances = [(edit, one) for edit in edits if (one := self._begun(edit, values, glance=True)) is not None]
        glances = sorted(((edit, one.go(1, 1)) for edit, one in glances), key=lambda pair: pair[1].cost)[:RACED]
        runners = [(edit, self._misfit(edit.diagram).begun(one.x)) for edit, one in glances]
        front = [self._seen(edit, one) for edit, one in in_front(runners, EDIT_HEATS)]
        return sorted(front, key=lambda look: look.worth)

    def look(self, edit: Edited, values: Values, *, glance: bool = False) -> RankedEdit:
        """An edit that races alone; worthless where it has no answer."""
        return next(iter(self.raced([edit], values)), RankedEdit(edit, inf, 0, inf))

    def _begun(self, edit: Edited, values: Values, *, glance: bool = False) -> Descending | None:
        """The best of the usual strengths; None where none has an answer, whatever the code of a user's own kind raises."""
        length = max((len(bank) for bank in edit.strengths.values()), default=1)
        banks = [{name: bank[min(j, len(bank) - 1)] for name, bank in edit.strengths.items()} for j in range(length)]
        try:
            found = self._misfit(edit.diagram, glance=glance).best_of([{**values[0], **bank} for bank in banks], 1)
        except (Exception, SystemExit):
            return None
        return found[0] if found else None

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

    looker: EventLooker

    def __init__(self, study: Study) -> None:
        super().__init__(study)
        self.looker = EventLooker(study, criterion(study, SearchSettings()))
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
            self._raced[key] = self.looker.raced(edits(diagram, self.study), values)
        return self._raced[key]
