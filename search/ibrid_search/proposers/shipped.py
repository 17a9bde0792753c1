"""Further starts of a search: the shipped diagrams that a first look finds best, so that other families are in the archive."""

from collections.abc import Sequence

import numpy as np

from ibrid_search.diagnosis import Edited
from ibrid_search.proposal import Context, Proposal
from ibrid_search.step import SHIPPED


class Shipped:
    """Proposes the first of some diagrams that the run has not met, whatever the parent is."""

    name = SHIPPED
    attempts = 1
    window: int | None = None

    def __init__(self, starts: Sequence[Edited]) -> None:
        self.starts = tuple(starts)

    def __len__(self) -> int:
        return len(self.starts)

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit that turns the parent into that diagram."""
        for start in self.starts:
            if context.is_new(start.diagram):
                return Proposal.between(context.parent.diagram, start.diagram, start.words)
        return Proposal("", failure="every shipped diagram that a first look speaks for has been tried")
