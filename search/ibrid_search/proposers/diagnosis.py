"""The default: asks the data what the parent lacks, and proposes the edit that explains most of what is left."""

from collections.abc import Callable, Iterator
from math import log

import numpy as np

from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text
from ibrid.study import Study
from ibrid_search.diagnosis import Edited, Looker, RankedEdit, Values, anywhere_of, effects_of, ideas_of, itself_of
from ibrid_search.edits import edit_between
from ibrid_search.merit import criterion
from ibrid_search.proposal import Context, Proposal, Proposer, TakesPart
from ibrid_search.proposers.edited import new_structure
from ibrid_search.proposers.pruning import Pruning
from ibrid_search.proposers.rules import Rules
from ibrid_search.settings import SearchSettings

#: Share of the proposals that are rules' instead, so that structures remain that no look speaks for.
CURIOSITY = 0.15
#: An error of a look up to which a fit may be exact.
LOOKED_EXACT = 1e-5
#: Gain in ln(error), prices paid, from which a look is proposed before more is looked at.
PROMISES = 0.7
#: Single edits, of least error, from which pairs are looked at when no single one promises anything.
AHEAD = 3
#: Rankings that are kept: a parent is asked about more than once.
REMEMBERED = 400


class Diagnosis(TakesPart):
    """Edits by what a few warm steps say of every edit that control practice knows (`ibrid_search.diagnosis`).

    The edit of the parent that ranks first and was not tried; where no single one promises to pay, two effects at once; else a
    block or a wire anywhere. What does not pay is taken away in the order of the same looks.
    """

    name = "diagnosis"
    attempts = 1
    window: int | None = 2
    settled = 12

    def __init__(self) -> None:
        self.rules = Rules()
        self._looker: Looker | None = None
        self._known: dict[str, list[RankedEdit]] = {}

    def remover(self, *, thorough: bool) -> Proposer:
        """Takes away what a look can do without."""
        return Pruning(thorough=thorough, loss=self._loss)

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of the parent that leads to a structure which the run has not met."""
        if rng.random() < CURIOSITY:
            return self.rules.propose(context, rng)
        best: RankedEdit | None = None
        record, looker = context.parent.record, self._of(context)
        error = looker.criterion.floor.error(record)
        worth = looker.worth(error, record.free_parameters)
        to_gain = log(max(error / looker.criterion.floor.most, 1.0))
        for looks in self._stages(context):
            new = next((look for look in looks if new_structure(look.edit.diagram, context)), None)
            best = min((look for look in (best, new) if look is not None), key=_worth, default=None)
            if best is not None and best.worth < worth - min(PROMISES, to_gain / 2):
                break
        return self.rules.propose(context, rng) if best is None else _proposal(context, best)

    def _loss(self, context: Context, diagram: Diagram) -> float:
        """What the parent loses when something is taken away, in ln(error) above the floor, by a look."""
        without = self._ranked(context, diagram, _values(context), itself_of)
        floor = self._of(context).criterion.floor
        least = floor.most if floor.known else LOOKED_EXACT
        return log(max(without[0].error, least) / max(floor.error(context.parent.record), least))

    def _stages(self, context: Context) -> Iterator[list[RankedEdit]]:
        """Looks at effects, at other ideas, at pairs of effects, at blocks and wires anywhere; each the best first."""
        parent, values = context.parent, _values(context)
        effects = self._ranked(context, parent.diagram, values, effects_of)
        yield effects
        ideas = self._ranked(context, parent.diagram, values, ideas_of)
        yield ideas
        pairs: list[RankedEdit] = []
        for first in sorted([*effects, *ideas], key=lambda look: look.error)[:AHEAD]:
            for second in self._ranked(context, first.edit.diagram, first.values, effects_of):
                words = f"{first.edit.words}; {second.edit.words}"
                both = Edited(second.edit.diagram, words, f"{first.edit.part} + {second.edit.part}", {})
                pairs.append(RankedEdit(both, second.error, second.free, second.worth, second.values))
        yield sorted(pairs, key=_worth)
        yield self._ranked(context, parent.diagram, values, anywhere_of)

    def _ranked(
        self, context: Context, diagram: Diagram, values: Values, edits: Callable[[Diagram, Study], list[Edited]]
    ) -> list[RankedEdit]:
        """Edits of a diagram with fitted values, by looks; the last ones are kept."""
        key = f"{edits.__name__} {context.study.hash_of(diagram)} {[sorted(one.items()) for one in values]}"
        if key not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[key] = self._of(context).ranked(edits(diagram, context.study), values)
        return self._known[key]

    def _of(self, context: Context) -> Looker:
        if self._looker is None or self._looker.study is not context.study:
            self._looker, self._known = Looker(context.study, criterion(context.study, SearchSettings())), {}
        return self._looker


def _values(context: Context) -> Values:
    return [context.parent.record.parameters[name] for name in context.study.fitted.names]


def _worth(look: RankedEdit) -> float:
    return look.worth


def _proposal(context: Context, look: RankedEdit) -> Proposal:
    edit = edit_between(program_text(context.parent.diagram), program_text(look.edit.diagram))
    said = f"a first look leads to an error of {look.error:.3g} with {look.free} free numbers"
    return Proposal(edit, note=look.edit.words, diagnosis=said, usage={"family": look.edit.part})
