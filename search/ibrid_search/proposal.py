"""What a proposer is asked and what it answers; the one interface between the loop and whoever has
the ideas.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid_search.edits import edit_between
from ibrid_search.evaluated import Evaluated
from ibrid_search.run.store import Store
from ibrid_search.screening.plausibility import refusal_reason
from ibrid_search.step import Step

if TYPE_CHECKING:
    from ibrid.gap.ports.port_map import PortFit
    from ibrid_search.screening.edit_screening import ScreeningFit

KEPT = "What was evaluated is kept: mend it and go on with --resume"


@dataclass(frozen=True)
class Complaint:
    """An answer to the same question that could not be used, and why: the second attempt sees
    it.
    """

    edit: str
    reason: str


@dataclass(frozen=True)
class Context:
    """What a proposer sees.

    `study` : data, physics and words, without what is held out.
    `parent` : the candidate to edit. `scale` : of `SCALES`. `best`, `failures` : the N best
    candidates and the N last refused or failed steps (`--history N`), best and latest first. `last`
    : the step before this one and how it ended, for agents. `recent` : the last steps, the latest
    first. `remark` : what else is known of the device, for language models.
    `seen` : structure hash -> True when the run has met it. `complaint` : why the first attempt
    failed. `leading` : False where another candidate ranks higher.
    """

    study: Study
    parent: Evaluated
    scale: str = "module"
    best: tuple[Evaluated, ...] = ()
    failures: tuple[Step, ...] = ()
    last: Step | None = None
    recent: tuple[Step, ...] = ()
    remark: str = ""
    seen: Callable[[str], bool] = field(default=lambda _: False)
    complaint: Complaint | None = None
    leading: bool = True

    def lacks(self, number: int = 1) -> "list[ScreeningFit]":
        """The diagnosis of the parent: edits that explain most of what is left and lead to a legal
        structure that the run has not met, the best first, at most so many
        (`ibrid_search.screening.edit_rankings`). Seconds the first time, then remembered.
        """
        from ibrid_search.screening.edit_rankings import rankings_for

        return rankings_for(self.study).best_edits(
            self.parent, self.is_new, number, thorough=self.leading
        )

    @property
    def ports(self) -> "tuple[PortFit, ...]":
        """What one unknown transfer would explain at each port of the parent, the best first
        (`EditRankings.locate_unknown_transfers`).
        """
        from ibrid_search.screening.edit_rankings import rankings_for

        return rankings_for(self.study).locate_unknown_transfers(self.parent)

    def is_new(self, diagram: Diagram) -> bool:
        """True for a legal, plausible structure that the run has not met."""
        examined = self.study.examined(diagram, program_text(diagram))
        if not examined.hash or self.seen(examined.hash):
            return False
        return not examined.violations and not refusal_reason(examined.warnings)


@dataclass(frozen=True)
class Proposal(Frozen):
    """An edit of the parent's program.

    `edit` : SEARCH/REPLACE blocks (`ibrid_search.edits`), "" for none. `note` : what changes, in a
    line. `reply` : the whole answer of a language model, kept and never parsed again. `diagnosis` :
    a paragraph for the store and the next context.
    `usage` : tokens, cost, seconds, retries. `failure` : one sentence when there is no answer (a
    dead server). `parent` : the step of another candidate that was shown, where the edit is of its
    program.
    """

    edit: str
    note: str = ""
    reply: str = ""
    diagnosis: str = ""
    usage: Mapping[str, Any] = field(default_factory=dict)
    failure: str = ""
    parent: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("edit", "note", "reply", "diagnosis", "failure"):
            if not isinstance(text := getattr(self, name), str):
                raise TypeError(f"{name} of a Proposal must be text, found {type(text).__name__}")

    @classmethod
    def between(cls, parent: Diagram, diagram: Diagram, note: str, **told: Any) -> "Proposal":
        """The edit that turns the parent into another diagram; `told` : further fields."""
        return cls(edit_between(program_text(parent), program_text(diagram)), note, **told)


@runtime_checkable
class Proposer(Protocol):
    """Anything with a `name`, `attempts`, `window` and `propose`; who inherits from it asks once
    and leaves the window open.

    `attempts` : how often a question is asked, the later times with the complaint about the first.
    `window` : the loop asks question k only when the results up to k - window are in; None leaves
    it to the settings. An agent that must see every result has 1. All randomness comes from `rng`.
    One that inherits from `TakesPart` too is told what happens.
    """

    name: str
    attempts: int = 1
    window: int | None = None

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of `context.parent`; never raises for what a server or a model does wrong."""
        ...


def answer_of(proposer: Proposer, context: Context, rng: np.random.Generator) -> Proposal:
    """What a proposer is asked for; IbridError, which names it where it raises anything but that,
    or answers anything else.
    """
    try:
        if isinstance(proposal := proposer.propose(context, rng), Proposal):
            return proposal
        raise TypeError(f"it must answer with a Proposal, found {type(proposal).__name__}")
    except IbridError:
        raise
    except Exception as error:  # other people's code: anything may go wrong in it
        raise IbridError(
            f"the proposer {proposer.name} failed, {type(error).__name__}: {error}. {KEPT}"
        ) from error


@dataclass(frozen=True)
class Origin:
    """Where the parent of a question comes from.

    `turn` : the active island goes round with it. `like` : the step whose parent, island and scale
    the question takes over.
    `leading` : it is the candidate of the archive that ranks highest.
    """

    turn: int
    like: int | None = None
    leading: bool = False


class TakesPart:
    """What a run tells a proposer beside its questions and asks of it; inherit from it, and
    override what matters.

    `undisturbed` : True where nothing is taken away from the best between its steps. `settled` :
    steps for which the best must stay the best before a noise floor ends the search; None leaves it
    to the settings. `remembers` : best and failed candidates that it sees where the settings do not
    say. `tell` : shows for a moment what keeps it.
    """

    undisturbed: bool = False
    settled: int | None = None
    remembers: int = 0
    tell: Callable[[str], None] = staticmethod(lambda words: None)

    def remover(self, *, thorough: bool) -> Proposer | None:
        """Who takes away from the best what does not pay, now and then or `thorough` at the end;
        None: who usually does.
        """
        return None

    def begin(self, store: Store, folder: Path) -> None:
        """A run begins or goes on: the store with its earlier steps, and the folder for files of
        the proposer's own.
        """

    def note(self, step: Step) -> None:
        """A step was made, by whomever, now or in an earlier sitting; its result may be under
        way.
        """

    def horizon(self) -> int | None:
        """The last step whose result the next question must and may see; None: as `window` says."""
        return None

    def origin(self, number: int) -> Origin:
        """Where the parent of its next question, step `number` of the run, comes from."""
        return Origin(number)

    def learn(self, steps: Sequence[Step], context: Callable[[Step], Context]) -> object:
        """Called before every question, with the results up to the horizon. context : the question
        that led to a step, without what was known of other candidates. What is learnt is kept on
        disk before this returns.
        """

    @property
    def terms(self) -> str:
        """What it may spend, as a sentence that a run says before it begins; "" for one that spends
        nothing.
        """
        return ""

    @property
    def exhausted(self) -> bool:
        """True once it answers no more; a run in which that holds of all proposers ends."""
        return False

    @property
    def broken(self) -> str:
        """Why nothing can be expected of it, in the words of whoever says so; the run ends with
        them. "" while it works.
        """
        return ""
