"""With what an agent begins a turn: what it remembers, what its tools see of the run, the rules and
the question.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.structure.diagrams.diagram import Diagram
from ibrid_search.agents.tool import Tool, listed
from ibrid_search.agents.tools import Tools
from ibrid_search.chat.chat import estimated_tokens
from ibrid_search.language_models.context import prompt
from ibrid_search.language_models.language import words
from ibrid_search.language_models.quoting import fenced, quoted
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.run.store import Store, numbers_of
from ibrid_search.step import Status, Step

#: Characters of a diagnosis, and of a reason for a refusal, that are kept.
LONGEST_DIAGNOSIS, LONGEST_REASON = 1_500, 400
#: Share of the tokens of the memory that the notebook of older turns may take.
NOTEBOOK = 0.5

_BEGIN = (
    "Begin. Look at the record of the parent, use the tools where they help, then submit an edit "
    "with a diagnosis."
)


def paragraph(text: str) -> str:
    """A diagnosis as one paragraph of bounded length that cannot speak for another turn."""
    return quoted(text, longest=LONGEST_DIAGNOSIS)


def outcome(step: Step, parent: Step | None = None) -> str:
    """How a step ended, in a sentence; compared with its parent where that is known."""
    which = (
        f"Step {step.number}, an edit of step {step.parent},"
        if step.parent is not None
        else f"Step {step.number}"
    )
    if step.nrmse is None or step.status is not Status.OK:
        why = f": {quoted(step.reason, longest=LONGEST_REASON)}" if step.reason else ""
        return f"{which} ended as {step.status}{why}."
    size = f"order {step.order}, {step.free} free parameters"
    stable = "stable" if step.stable else "UNSTABLE, so no answer"
    return f"{which} has NRMSE {step.nrmse:.4g}{_against(step.nrmse, parent)}; {size}, {stable}."


def remembered(steps: Sequence[Step], limit_tokens: int, *, author: str) -> list[dict[str, str]]:
    """Messages for the turns of `author` among the steps, oldest first, that end with the outcome
    of the last.

    Roles alternate and begin with the user; the caller's question belongs to the last message. At
    most `limit_tokens` tokens as estimated.
    """
    known = {one.number: one for one in steps}
    turns = [one for one in steps if one.proposer == author and one.status is not Status.PENDING]
    budget, recent = limit_tokens * (1 - NOTEBOOK), len(turns)
    for turn in reversed(turns):
        budget -= estimated_tokens(_said(turn)) + estimated_tokens(_result(turn, known))
        if budget < 0:
            break
        recent -= 1
    notebook = _notebook(turns[:recent], known, int(limit_tokens * NOTEBOOK))
    messages = [{"role": "user", "content": notebook or _BEGIN}]
    for turn in turns[recent:]:
        messages.append({"role": "assistant", "content": _said(turn)})
        messages.append({"role": "user", "content": _result(turn, known)})
    return messages


def _against(nrmse: float, parent: Step | None) -> str:
    if parent is None or parent.nrmse is None:
        return ""
    word = (
        "better than"
        if nrmse < parent.nrmse
        else "worse than"
        if nrmse > parent.nrmse
        else "the same as"
    )
    return f", {word} its parent's {parent.nrmse:.4g}"


def _said(turn: Step) -> str:
    diagnosis = paragraph(turn.diagnosis) or "(none)"
    return f"Diagnosis: {diagnosis}\n\n{fenced(turn.edit) if turn.edit.strip() else '(no edit)'}"


def _result(turn: Step, known: Mapping[int, Step]) -> str:
    return outcome(turn, known.get(turn.parent) if turn.parent is not None else None)


def _notebook(turns: Sequence[Step], known: Mapping[int, Step], limit_tokens: int) -> str:
    """Lines of the older turns, oldest first, the newest of them that fit."""
    if not turns:
        return ""
    kept: list[str] = []
    left = limit_tokens - estimated_tokens(_HEAD)
    for turn in reversed(turns):
        line = f"- {_result(turn, known)} Diagnosis: {paragraph(turn.diagnosis) or '(none)'}"
        left -= estimated_tokens(line + "\n")
        if left < 0:
            break
        kept.append(line)
    dropped = len(turns) - len(kept)
    head = _HEAD + (f" ({dropped} older ones left out)" if dropped else "")
    return "\n".join([head + ":", *reversed(kept)])


_HEAD = (
    "Your notebook of earlier turns, oldest first, with the diagnosis that you wrote before you "
    "knew the outcome"
)


class RunView:
    """Steps and records at one moment; the `Steps` of `ibrid_search.agents.tools`.

    `remembered` : steps that the agent has seen itself, for a run without a history.
    """

    def __init__(
        self, context: Context, history: Store | None = None, remembered: Sequence[Step] = ()
    ) -> None:
        self._context, self._history = context, history
        self._near = {one.step: one for one in (*reversed(context.best), context.parent)}
        own = history.steps() if history is not None else remembered
        by_number = {  # who proposed them and why is not known
            number: Step(
                number, status=Status.OK, program=one.record.program, **numbers_of(vars(one.record))
            )
            for number, one in self._near.items()
        }
        by_number |= {one.number: one for one in own if one.status is not Status.PENDING}
        self.steps = tuple(by_number[number] for number in sorted(by_number))

    def record(self, number: int) -> Record:
        """The record of a step that the context or the history has; IbridError otherwise."""
        if number in self._near:
            return self._near[number].record
        if self._history is None:
            known = ", ".join(map(str, sorted(self._near)))
            raise IbridError(
                f"the record of step {number} is not at hand; those of steps {known} are"
            )
        return self._history.record(number, self._context.study.kinds)

    def best(self, count: int) -> tuple[Evaluated, ...]:
        """The best fitted steps, stable ones first."""
        at_hand = (
            one for one in self.steps if self._history is not None or one.number in self._near
        )
        fitted = [one for one in at_hand if one.status is Status.OK and one.nrmse is not None]
        ranked = sorted(
            fitted, key=lambda one: (not one.stable, one.nrmse, one.free or 0, one.number)
        )
        return tuple(self._evaluated(one.number) for one in ranked[:count])

    def met(self, diagram: Diagram) -> str | None:
        """Whether the run has met a structure."""
        digest = self._context.study.hash_of(diagram)
        same = next((one.number for one in self.steps if one.hash == digest), None)
        if same is not None:
            return f"step {same}"
        return "yes" if self._context.seen(digest) else None

    def _evaluated(self, number: int) -> Evaluated:
        if number in self._near:
            return self._near[number]
        record = self.record(number)
        return Evaluated(number, record.diagram, record)


SUBMIT = Tool(
    "submit_edit",
    "Ends the turn: the edit of the parent program is evaluated, and its outcome begins the next "
    "turn.",
    {
        "edit": {
            "type": "string",
            "maxLength": 100_000,
            "description": "SEARCH/REPLACE blocks for the parent program",
        },
        "change": {
            "type": "string",
            "maxLength": 2_000,
            "description": "what changes and why, in a line",
        },
        "diagnosis": {
            "type": "string",
            "maxLength": 20_000,
            "description": "one paragraph: what the record shows, what is missing or wrong, what "
            "the edit changes and what "
            "you expect of it",
        },
    },
    dict,
    ("edit", "diagnosis"),
)


@dataclass(frozen=True)
class AgentSettings:
    """`tokens` : of all that the model is shown, as estimated. `memory`, `context` : shares of them
    for earlier turns and for the parent with its surroundings; the rest is for what happens in the
    turn. `answers` : of the model in a turn.
    `calls` : of tools in a turn. `longest` : characters of a tool's answer.
    """

    tokens: int = 24_000
    memory: float = 0.25
    context: float = 0.5
    answers: int = 12
    calls: int = 12
    longest: int = 5_000

    def __post_init__(self) -> None:
        if min(self.tokens, self.answers, self.longest) < 1 or self.calls < 0:
            raise IbridError(
                "an agent needs at least 1 token, 1 answer, 1 character and 0 calls; leave them "
                "out for the defaults"
            )
        if not (self.memory >= 0 and self.context > 0 and self.memory + self.context < 1):
            raise IbridError(
                "memory and context must be shares that leave room for the turn, found "
                f"{self.memory} and {self.context}"
            )


def question(
    context: Context, view: RunView, settings: AgentSettings, *, author: str
) -> list[dict[str, Any]]:
    """Messages with alternating roles, as some models want them: system, then earlier turns, the
    last with what is asked now.
    """
    tools = listed(Tools(context.study, view).reading)
    rules = f"\n{words('turns.md', calls=settings.calls, tools=tools)}\n"
    system, asked = prompt(
        context, limit_tokens=int(settings.tokens * settings.context) - estimated_tokens(rules)
    )
    *earlier, last = remembered(view.steps, int(settings.tokens * settings.memory), author=author)
    now = {"role": "user", "content": f"{last['content']}\n\n{asked['content']}"}
    return [{"role": "system", "content": f"{system['content']}\n{rules}"}, *earlier, now]
