"""What an agent's tools see of a run: the candidates of the context, and the store's where there is one."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.structure.diagram import Diagram
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.step import Status, Step


class History(Protocol):
    """The part of `ibrid_search.store.Store` that an agent reads."""

    def steps(self, after: int = -1) -> Iterator[Step]:
        """Steps in order."""
        ...

    def record(self, number: int, vocabulary: Any = ...) -> Record:
        """The record of a step; IbridError when it has none."""
        ...


class View:
    """Steps and records at one moment; the `Steps` of `ibrid_search.tools`.

    `remembered` : steps that the agent has seen itself, for a run without a history.
    """

    def __init__(self, context: Context, history: History | None = None, remembered: Sequence[Step] = ()) -> None:
        self._context, self._history = context, history
        self._near = {one.step: one for one in (*reversed(context.best), context.parent)}
        own = history.steps() if history is not None else remembered
        found = {number: _step_of(one) for number, one in self._near.items()}
        found |= {one.number: one for one in own if one.status is not Status.PENDING}
        self.steps = tuple(found[number] for number in sorted(found))

    def record(self, number: int) -> Record:
        """The record of a step that the context or the history has; IbridError otherwise."""
        if number in self._near:
            return self._near[number].record
        if self._history is None:
            known = ", ".join(map(str, sorted(self._near)))
            raise IbridError(f"the record of step {number} is not at hand; those of steps {known} are")
        return self._history.record(number, self._context.study.kinds)

    def best(self, count: int) -> tuple[Evaluated, ...]:
        """The best fitted steps, stable ones first."""
        fitted = [one for one in self.steps if one.status is Status.OK and one.nrmse is not None]
        ranked = sorted(fitted, key=lambda one: (not one.stable, one.nrmse, one.free or 0, one.number))
        return tuple(self._evaluated(one.number) for one in ranked if self._at_hand(one.number))[:count]

    def met(self, diagram: Diagram) -> str | None:
        """Whether the run has met a structure."""
        study = self._context.study
        digest = study.hash_of(diagram)
        same = next((one.number for one in self.steps if one.hash == digest), None)
        if same is not None:
            return f"step {same}"
        return "yes" if self._context.seen(digest) else None

    def _at_hand(self, number: int) -> bool:
        return number in self._near or self._history is not None

    def _evaluated(self, number: int) -> Evaluated:
        if number in self._near:
            return self._near[number]
        record = self.record(number)
        return Evaluated(number, record.diagram, record)


def _step_of(one: Evaluated) -> Step:
    """A step with what a candidate tells; who proposed it and why is not known."""
    record = one.record
    return Step(
        one.step,
        status=Status.OK,
        program=record.program,
        nrmse=record.nrmse,
        reward=record.reward,
        stable=all(record.stable.values()),
        order=record.order,
        free=record.free_parameters,
    )
