"""What a proposer is asked and what it answers; the one interface between the loop and whoever has the ideas."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.structure.diagram import Diagram
from ibrid.study import Study
from ibrid_search.step import Step

#: How far an edit reaches: sharing and wires; one component; a plant or a whole sub-loop.
SCALES = ("local", "module", "structural")


@dataclass(frozen=True)
class Evaluated:
    """A valid candidate with its record."""

    step: int
    diagram: Diagram
    record: Record


@dataclass(frozen=True)
class Complaint:
    """An answer to the same question that could not be used, and why: the second attempt sees it."""

    edit: str
    reason: str


@dataclass(frozen=True)
class Context:
    """What a proposer sees.

    `study` : data, physics and words, without what is held out.
    `parent` : the candidate to edit. `scale` : of `SCALES`. `best`, `failures` : the N best candidates and the N last
    refused or failed steps (`--history N`), best and latest first. `last` : the step before this one and how it ended,
    for agents. `remark` : what else is known of the device, for language models. `seen` : structure hash -> True when the
    run has met it. `complaint` : why the first attempt failed.
    """

    study: Study
    parent: Evaluated
    scale: str = "module"
    best: tuple[Evaluated, ...] = ()
    failures: tuple[Step, ...] = ()
    last: Step | None = None
    remark: str = ""
    seen: Callable[[str], bool] = field(default=lambda _: False)
    complaint: Complaint | None = None

    @property
    def task(self) -> Study:
        """The study, under its earlier name."""
        return self.study


@dataclass(frozen=True)
class Proposal:
    """An edit of the parent's program.

    `edit` : SEARCH/REPLACE blocks (`ibrid_search.edits`), "" for none. `note` : what changes, in a line. `reply` : the whole
    answer of a language model, kept and never parsed again. `diagnosis` : a paragraph for the store and the next context.
    `usage` : tokens, cost, seconds, retries. `failure` : one sentence when there is no answer (a dead server).
    """

    edit: str
    note: str = ""
    reply: str = ""
    diagnosis: str = ""
    usage: Mapping[str, Any] = field(default_factory=dict)
    failure: str = ""


@runtime_checkable
class Proposer(Protocol):
    """Anything with a `name` and `propose`.

    `attempts` : how often a question is asked, the later times with the complaint about the first. `window` : the
    loop asks question k only when the results up to k - window are in; None leaves it to the settings. An agent that
    must see every result has 1. All randomness comes from `rng`.
    """

    name: str
    attempts: int
    window: int | None

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of `context.parent`; never raises for what a server or a model does wrong."""
        ...


@runtime_checkable
class LearningProposer(Proposer, Protocol):
    """A proposer that is trained on what its answers were worth.

    `rounds` : which step is which of its answers (`horizon`: the last step whose result the next question sees; `leader`: the
    step whose parent the next question has too; `next.context`: the number of the question). `due` : True when it has
    results to learn from.
    """

    rounds: Any

    @property
    def due(self) -> bool: ...

    def open(self, folder: Path, keep: Callable[[str, str], None]) -> None:
        """Where its files go, and who takes texts for the store; it goes on from what is there."""
        ...

    def add(self, step: Step) -> None:
        """Take note of a step, made now or in an earlier sitting."""
        ...

    def learn(self, steps: Sequence[Step], context: Callable[[Step], Context]) -> Any:
        """Learn from the results; kept on disk before this returns."""
        ...
