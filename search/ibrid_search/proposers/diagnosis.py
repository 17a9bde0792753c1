"""The default: asks the data what the parent lacks, and proposes the edit that explains most of
what is left.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ibrid_search.archives.experience import Experience
from ibrid_search.proposal import Context, Origin, Proposal, Proposer, TakesPart
from ibrid_search.proposers.pruning import Pruning
from ibrid_search.proposers.rules import Rules
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.edit_screening import ScreeningFit

#: Share of the proposals that are rules' instead, so that structures remain that no look speaks
#: for.
CURIOSITY = 0.15
#: Edits among which an experience chooses.
AHEAD = 5


class Diagnosis(TakesPart):
    """Edits by what a few warm steps say of every edit that control practice knows
    (`ibrid_search.screening.edit_rankings`).

    The edit of the parent that ranks first and was not tried; with an experience of other searches,
    of the first `AHEAD` the one that ranks first with what these teach. What does not pay is taken
    away in the order of the same looks.
    """

    name = "diagnosis"
    attempts = 1
    window: int | None = 2
    settled = 8

    def __init__(self, experience: Experience | None = None) -> None:
        self.rules, self.experience = Rules(), experience

    def remover(self, *, thorough: bool) -> Proposer:
        """Takes away what a look can do without."""
        return Pruning(
            thorough=thorough,
            loss=lambda one, less: rankings_for(one.study).removal_loss(one.parent, less),
        )

    def origin(self, number: int) -> Origin:
        """Every other question is about the best candidate, so that parts follow each other; the
        rest keep other ways open.
        """
        return Origin(number, leading=number % 2 == 0)

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of the parent that leads to a structure which the run has not met; one by rules
        where nothing can be ranked.
        """
        if rng.random() < CURIOSITY:
            return self.rules.propose(context, rng)
        best = self._ranked(context)
        if not best:
            why = (
                "no edit that is new has a response near the values of the parent, so this one is "
                "by rules"
            )
            return replace(self.rules.propose(context, rng), diagnosis=why)
        return handed_in(best[0], context)

    def _ranked(self, context: Context) -> list[ScreeningFit]:
        if (known := self.experience) is None:
            return context.lacks()
        return sorted(
            context.lacks(AHEAD), key=lambda look: look.score - known.bonus(look.edit.source)
        )


def handed_in(look: ScreeningFit, context: Context, **usage: Any) -> Proposal:
    """An edit of the diagnosis of the parent as a proposal."""
    said = f"a first look leads to an error of {look.error:.3g} with {look.free} free numbers"
    told = {"family": look.edit.source, "look": look.error, **usage}
    return Proposal.between(
        context.parent.diagram, look.edit.diagram, look.edit.description, diagnosis=said, usage=told
    )
