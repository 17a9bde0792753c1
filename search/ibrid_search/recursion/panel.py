"""The proposers of a run: who is asked next, who takes away what does not pay, and what all of them
are told.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ibrid_search.proposal import Context, Origin, Proposal, Proposer, TakesPart
from ibrid_search.proposers.pruning import Pruning
from ibrid_search.run.store import Store
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.step import SHIPPED, Step


class Panel:
    """What the loop knows of its proposers, which is their interface alone
    (`ibrid_search.proposal`).

    `proposers` : with their weights. `starts` : further diagrams to begin from, each a step before
    anybody is asked; none where a proposer wants to be undisturbed. `pruning` : takes something
    away from the best now and then; a step in which it finds nothing is an ordinary one. `tidying`
    : does so thoroughly, at the end.
    """

    def __init__(
        self, proposers: Sequence[tuple[Proposer, float]], starts: Sequence[CandidateEdit] = ()
    ) -> None:
        self.proposers = tuple(proposers)
        self.starts = Shipped(() if self.undisturbed else starts)
        self.pruning = self._remover(thorough=False) or Pruning()
        self.tidying = self._remover(thorough=True) or Pruning(thorough=True)

    def _remover(self, *, thorough: bool) -> Proposer | None:
        found = (one.remover(thorough=thorough) for one in self.taking_part)
        return next((one for one in found if one is not None), None)

    @cached_property
    def taking_part(self) -> tuple[TakesPart, ...]:
        """Those that are told what happens."""
        return tuple(one for one, _ in self.proposers if isinstance(one, TakesPart))

    @property
    def terms(self) -> tuple[str, ...]:
        """What those who ask language models may spend, in sentences."""
        return tuple(one.terms for one in self.taking_part if one.terms)

    def tell(self, aside: Callable[[str], None]) -> None:
        """Where proposers say what keeps them."""
        for one in self.taking_part:
            one.tell = aside

    @property
    def names(self) -> str:
        """As a user gives them: "rules:0.7,random:0.3"."""
        return ",".join(f"{one.name}:{weight:g}" for one, weight in self.proposers)

    @property
    def undisturbed(self) -> bool:
        """True where nothing may be taken away between the steps of one of them."""
        return any(one.undisturbed for one in self.taking_part)

    @property
    def exhausted(self) -> bool:
        """True when nobody answers any more."""
        return len(self.taking_part) == len(self.proposers) and all(
            one.exhausted for one in self.taking_part
        )

    @property
    def broken(self) -> str:
        """Why one of them gives no answer any more; "" while all work."""
        return next((why for one in self.taking_part if (why := one.broken)), "")

    def window(self, usual: int) -> int:
        """Proposal k sees the results up to k - window."""
        return min([usual, *(one.window for one, _ in self.proposers if one.window is not None)])

    def history(self, usual: int | None) -> int:
        """Best candidates and last failures that a proposer sees."""
        return (
            max((one.remembers for one in self.taking_part), default=0) if usual is None else usual
        )

    def settled(self, usual: int) -> int:
        """Steps for which the best must stay the best before a noise floor ends the search."""
        return min([usual, *(one.settled for one in self.taking_part if one.settled is not None)])

    def horizon(self, usual: int) -> int:
        """The last step whose result the next proposal sees: `usual`, unless a proposer says
        another.
        """
        said = [found for one in self.taking_part if (found := one.horizon()) is not None]
        return max(*said, 0) if said else max(usual, 0)

    def begin(self, store: Store, folder: Path) -> None:
        """Tell everybody where the run lives, before its first step and after each interruption."""
        for one in self.taking_part:
            one.begin(store, folder)

    def note(self, step: Step) -> None:
        """Tell everybody of a step."""
        for one in self.taking_part:
            one.note(step)

    def learn(self, steps: Sequence[Step], context: Callable[[Step], Context]) -> None:
        """Let everybody learn from the results up to the horizon."""
        for one in self.taking_part:
            one.learn(steps, context)

    def drawn(self, rng: np.random.Generator, number: int) -> tuple[Proposer, Origin]:
        """Whom step `number` asks, a further start or by the weights, and where its parent comes
        from.
        """
        if number <= len(self.starts):
            return self.starts, Origin(number, like=0)
        weights = np.array([weight for _, weight in self.proposers])
        proposer = self.proposers[int(rng.choice(len(weights), p=weights / weights.sum()))][0]
        return proposer, proposer.origin(number) if isinstance(proposer, TakesPart) else Origin(
            number
        )


class Shipped(Proposer):
    """Proposes the first of some diagrams that the run has not met, whatever the parent is."""

    name = SHIPPED

    def __init__(self, starts: Sequence[CandidateEdit]) -> None:
        self.starts = tuple(starts)

    def __len__(self) -> int:
        return len(self.starts)

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit that turns the parent into that diagram."""
        for start in self.starts:
            if context.is_new(start.diagram):
                return Proposal.between(context.parent.diagram, start.diagram, start.description)
        return Proposal(
            "", failure="every shipped diagram that a first look speaks for has been tried"
        )
