"""What the fitted steps of a run are worth: their records, errors and oddities, and by that their
order.
"""

from collections.abc import Collection
from functools import lru_cache
from math import inf

from ibrid.evaluation.record import Record
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.view import View, views_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import split_port
from ibrid_search.archives.ranking import Entry
from ibrid_search.run.parsed import parsed
from ibrid_search.run.store import Store
from ibrid_search.screening.plausibility import PlausibilityIssues, count_issues
from ibrid_search.screening.selection_criterion import SelectionCriterion
from ibrid_search.step import Step

#: Records that are kept at hand.
RECORDS = 256
#: Decimals to which two candidates are worth the same: two drawings of one thing, fitted, agree to
#: more.
DECIMALS = 6
#: What a diagram that nobody published must gain over one that ships, in free numbers: there are
#: many exact twins of a published control with a number less, and few inverters that have them.
UNPUBLISHED = 1.5
#: What an impossible value costs a candidate as the answer, in ln(error): more than any two fits
#: differ by.
IMPOSSIBLE = 1e3


class Appraisal:
    """Reads each record from the store when it is needed, and remembers what it says.

    `published` : hashes of structures that are more likely than others; none: all are alike.
    """

    def __init__(
        self,
        store: Store,
        criterion: SelectionCriterion,
        kinds: Vocabulary,
        published: Collection[str] = frozenset(),
    ) -> None:
        self.criterion, self.published = criterion, published
        self._kinds = kinds
        self._stored = lru_cache(RECORDS)(lambda number: store.record(number, kinds))
        self.longer: dict[int, Record] = {}  # of steps that were fitted again with full effort
        self._issues: dict[int, PlausibilityIssues] = {}
        self._error: dict[int, float] = {}

    def record(self, number: int) -> Record:
        """The record of a step; IbridError when it has none."""
        return self.longer[number] if number in self.longer else self._stored(number)

    def fitted_longer(self, number: int, record: Record) -> None:
        """From now on the record of a step is this one, of a longer fit."""
        self.longer[number] = record
        self._error.pop(number, None)
        self._issues.pop(number, None)

    def error(self, number: int) -> float:
        """Error of a fitted step, as the run measures it."""
        if number not in self._error:
            self._error[number] = self.criterion.floor.error_of(self.record(number))
        return self._error[number]

    def issues_of(self, step: Step) -> PlausibilityIssues:
        """Return the plausibility issues of a fitted step."""
        if step.number not in self._issues:
            self._issues[step.number] = count_issues(
                parsed(step.program), self.record(step.number), self._kinds
            )
        return self._issues[step.number]

    def at_floor(self, step: Step) -> bool:
        """True when it fits as well as the noise allows, without an absurd plant or an impossible
        value.
        """
        issues = self.issues_of(step)
        if issues.absurd or issues.impossible:
            return False
        return self.criterion.floor.explains(self.error(step.number), int(step.free or 0))

    def rank(self, step: Step, *, alike: bool = False) -> tuple[float, int, int]:
        """Of eligible steps the least is the best, of equals the one with fewer states; what has an
        impossible value comes behind
        all that has none. alike : published or not is the same.
        """
        issues = self.issues_of(step)
        value = self.criterion.score(self.error(step.number), int(step.free or 0), issues)
        value += IMPOSSIBLE if issues.impossible else 0.0
        if self.published and not alike and step.hash not in self.published:
            value += UNPUBLISHED * self.criterion.parameter_cost
        return round(value, DECIMALS), int(step.order or 0), step.number

    def entry(self, step: Step) -> Entry:
        """The step as the archive keeps it."""
        error, free, issues = self.error(step.number), int(step.free or 0), self.issues_of(step)
        return Entry(
            step=step.number,
            hash=step.hash,
            parent=step.parent,
            island=step.island,
            reward=self.criterion.parent_reward(error, free, issues),
            nrmse=inf if step.nrmse is None else step.nrmse,
            order=int(step.order or 0),
            free=free,
            stable=bool(step.stable),
            program=step.program,
            value=self.criterion.parent_reward(error, 0, issues),
            sort=sort_of_control(parsed(step.program), self._kinds)
            + ", absurd plant" * bool(issues.absurd),
        )


def sort_of_control(diagram: Diagram, kinds: Vocabulary) -> str:
    """By what the frequency follows (phase, power, oscillator, several or nothing), and whether the
    voltage is controlled; of two devices both. Empty where the roles of none can be told.
    """
    return " beside ".join(sorted(_sort(view) for view in views_of(diagram, kinds)))


def _sort(view: View) -> str:
    draft, roles = view.draft, view.roles
    makers = draft.upstream(f"{roles.plant}.delta_omega", without=roles.plant)
    locked = {split_port(target)[0] for target in draft.targets(f"{roles.plant}.e_q")}
    phase = locked.union(draft.having(Element.PLL)) & makers
    power, oscillator = makers & set(roles.power), makers & set(draft.having(Element.OSCILLATOR))
    follows = [
        name
        for name, found in (("phase", phase), ("power", power), ("oscillator", oscillator))
        if found
    ]
    return " and ".join(follows or ["nothing"]) + (", voltage loop" if roles.voltage_loop else "")
