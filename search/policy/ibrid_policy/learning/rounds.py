"""Which answer of which group a step holds, and which results its proposal may see; both follow
from the steps alone.

The k-th step of the proposer that learns is member k mod group of context k div group; so many
contexts are a batch. Steps of other proposers in between do not count. Where an update needs the
results of its batch, the steps of a batch see those of the batches before and none of their own, so
a run stays the same with any number of workers and when it is resumed.
"""

from dataclasses import dataclass

from ibrid_search.step import Step


@dataclass(frozen=True)
class AnswerPlace:
    """`batch`, `context` (counted through the whole run) and `member` of an answer, all from 0."""

    batch: int
    context: int
    member: int


class Rounds:
    """Fed with every step in order by `add`.

    `proposer` : name of the one that learns. `window` : so many steps of others in a row are no
    longer part of a batch and see the results that they would in an ordinary search; so the taking
    away at the end knows its own. `waits` : whether an update needs the results of its batch;
    without, every step sees what it would in an ordinary search.

    `horizon` : the last step whose result the next proposal sees. `count` : answers so far.
    `numbers` : steps of the batch under way, or of the last one until the next begins.
    """

    def __init__(
        self, proposer: str, contexts: int, group: int, window: int, *, waits: bool = True
    ) -> None:
        self.proposer, self.contexts, self.group, self.window, self.waits = (
            proposer,
            contexts,
            group,
            window,
            waits,
        )
        self.horizon = -1
        self.count = 0
        self.numbers: list[int] = []
        self._others = 0

    def add(self, step: Step) -> None:
        """Take note of the step that was just made."""
        if step.number > 0 and step.proposer == self.proposer:
            if self.count % self.batch == 0:
                self.numbers.clear()
            self.numbers.append(step.number)
            self.count += 1
            self._others = 0
        else:
            self._others += 1
        if self.waits and self.complete and self._others == 0:
            self.horizon = step.number
        elif not self.waits or self._others >= self.window or not self.count:
            self.horizon = max(self.horizon, step.number + 1 - self.window)

    @property
    def batch(self) -> int:
        """Answers of a batch."""
        return self.contexts * self.group

    @property
    def complete(self) -> bool:
        """True from the last answer of a batch to the first of the next."""
        return self.count > 0 and self.count % self.batch == 0

    @property
    def batches(self) -> int:
        """Batches that are complete."""
        return self.count // self.batch

    @property
    def next(self) -> AnswerPlace:
        """Where the next answer belongs."""
        context, member = divmod(self.count, self.group)
        return AnswerPlace(context // self.contexts, context, member)

    @property
    def leader(self) -> int | None:
        """The step whose parent and scale the next answer shares; None when it begins a group."""
        member = self.next.member
        return self.numbers[-member] if member else None
