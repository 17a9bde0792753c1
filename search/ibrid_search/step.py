"""One step of a search: a proposal, what became of it, and the words for every way it can end."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ibrid.frozen import Frozen

#: The proposer of further starts.
SHIPPED = "shipped"


class Status(StrEnum):
    """How a proposal ended.

    Every refusal has a word of its own, in the order in which they are asked.
    """

    NO_ANSWER = "no answer"  # the proposer's server gave nothing usable
    NO_EDIT = "no edit"  # an answer without a SEARCH/REPLACE block
    NO_MATCH = "no match"  # a block whose search text is not in the program
    AMBIGUOUS = "ambiguous"  # a block whose search text is there more than once
    UNREADABLE = "unreadable"  # the edited text is no program
    ILLEGAL = "illegal"  # the grammar refuses the diagram
    UNCHANGED = "unchanged"  # the same structure as its parent
    DUPLICATE = "duplicate"  # a structure met before in this run; its evaluation stands
    IMPLAUSIBLE = "implausible"  # a cheap physical gate refuses it
    PENDING = "pending"  # waits for its evaluation
    OK = "ok"
    FAILED = "failed"  # no fit exists
    # ended from outside by the safety net of processor time; "timeout" in old runs
    UNFINISHED = "unfinished"
    LOST = "lost"  # its workers died, several times: not the candidate's fault
    REQUIRED = "required"  # fitted, but not what --require asks for

    @classmethod
    def _missing_(cls, value: object) -> "Status | None":
        return cls.UNFINISHED if value == "timeout" else None


#: Answers that make no text of a program, and texts that are no diagram.
_NO_TEXT = (Status.NO_ANSWER, Status.NO_EDIT, Status.NO_MATCH, Status.AMBIGUOUS)
_NO_DIAGRAM = (Status.UNREADABLE, Status.ILLEGAL)
#: Ends of a proposal before any evaluation.
REFUSED = (*_NO_TEXT, *_NO_DIAGRAM, Status.IMPLAUSIBLE)
#: Ends that have an evaluation of their own.
EVALUATED = (Status.OK, Status.FAILED, Status.UNFINISHED, Status.LOST, Status.REQUIRED)

#: Ends that say nothing of the candidate: it is evaluated again when the run goes on.
OPEN_AGAIN = (Status.LOST, Status.UNFINISHED)

#: Ends of a start that can be searched from: it need not be what is required of the answer.
USABLE = (Status.OK, Status.REQUIRED)

#: `rl_reward` of what is not valid (contract of the project); a valid one has max(reward, 0), a
#: lost one none.
_PENALTY = {
    **dict.fromkeys(_NO_TEXT, -0.4),
    **dict.fromkeys(_NO_DIAGRAM, -0.25),
    **dict.fromkeys((Status.UNCHANGED, Status.DUPLICATE), -0.3),
    **dict.fromkeys((Status.IMPLAUSIBLE, Status.FAILED, Status.UNFINISHED, Status.REQUIRED), -0.2),
}


def rl_reward(status: Status, reward: float | None) -> float | None:
    """The reward that learning uses: max(reward, 0) when valid, a fixed penalty otherwise, None
    when nothing is known.
    """
    if status is Status.OK and reward is not None:
        return max(reward, 0.0)
    return _PENALTY.get(status)


@dataclass(frozen=True)
class Step(Frozen):
    """A row of the store.

    `number` : 0 for the start, then one for every proposal. `parent` : number of the parent's step.
    `scale` : of the edit asked for. `note` : what changes, in a line. `edit` : SEARCH/REPLACE
    blocks. `reply` : the whole answer of a language model. `diagnosis` : a paragraph an agent
    wrote. `usage` : tokens, cost, seconds, retries. `reason` : why it was refused. `hash` : of the
    structure. `same_as` : the step with the same structure. `program` : text after the edit.
    `nrmse`, `reward`, `stable`, `order`, `free` : of its evaluation.
    """

    number: int
    parent: int | None = None
    island: int = 0
    scale: str = ""
    proposer: str = ""
    note: str = ""
    edit: str = ""
    reply: str = ""
    diagnosis: str = ""
    usage: Mapping[str, Any] = field(default_factory=dict)
    status: Status = Status.PENDING
    reason: str = ""
    hash: str = ""
    same_as: int | None = None
    program: str = ""
    nrmse: float | None = None
    reward: float | None = None
    stable: bool | None = None
    order: int | None = None
    free: int | None = None
    seconds: float = 0.0

    @property
    def edited(self) -> int | None:
        """The step whose program it edits; None for the start and for a further shipped diagram,
        which replaces all of it.
        """
        return None if self.proposer == SHIPPED else self.parent


def line(steps: Mapping[int, Step], number: int | None) -> list[Step]:
    """A step behind those it comes from by edits, the oldest first; it begins later where one is
    not among the steps.
    """
    path: list[Step] = []
    while number is not None and (here := steps.get(number)) is not None and here not in path:
        path.insert(0, here)
        number = here.edited
    return path
