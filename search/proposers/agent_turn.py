"""One turn of an agent: answers and tools in exchange, until an edit is taken or the answers are used up."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrid.report.verdict import verdict
from ibrid.structure.canonical import structure_hash
from search.judging import judge
from search.proposal import Context, Evaluated, Proposal
from search.proposers.agent_calls import Call, Wish, diagnosis_in, read_wish
from search.proposers.agent_memory import paragraph
from search.proposers.agent_question import SUBMIT, AgentSettings
from search.proposers.agent_view import View
from search.proposers.chat import Answer, Chat, ChatError, estimated_tokens, prompt_text
from search.step import Status
from search.tool import call_by_name, failed
from search.tools import Tools

#: Characters that are kept: of the reply in the store, of one answer while the turn lasts, of the note.
LONGEST_REPLY, LONGEST_SAID, LONGEST_NOTE = 200_000, 8_000, 120

_ASK_EDIT = (
    "Your answer had neither a tool call nor whole SEARCH/REPLACE blocks. End the turn: call submit_edit, or write the "
    "blocks and a paragraph that begins with Diagnosis:"
)
_ASK_DIAGNOSIS = (
    "The edit is taken. Now write the diagnosis in one paragraph, without tools or code: what the record shows, which layer "
    "is missing or wrong, what the edit changes and what you expect of it."
)
_LAST = "One answer is left in this turn: end it with an edit and a diagnosis."
_DROPPED = "(left out to stay within the token limit; call the tool again where it is needed)"
_SUMMED = ("prompt_tokens", "completion_tokens", "thinking_tokens", "cost", "seconds", "retries")


class Turn:
    """The messages of a turn grow until it ends; `messages` begins with the question."""

    def __init__(
        self,
        chat: Chat,
        settings: AgentSettings,
        context: Context,
        view: View,
        messages: Sequence[Mapping[str, Any]],
        rng: np.random.Generator,
    ) -> None:
        self.chat, self.settings, self.context, self.rng = chat, settings, context, rng
        self.tools = Tools(context.task, view).reading
        self.messages: list[dict[str, Any]] = [dict(one) for one in messages]
        self._asked = len(self.messages)
        self._edit = self._diagnosis = self._failure = ""
        self._calls, self._native = 0, True
        self._usage: dict[str, Any] = {}
        self._reply: list[str] = []

    def proposal(self) -> Proposal:
        """Ask until the turn has ended."""
        for left in reversed(range(self.settings.answers)):
            answer = self._answer()
            if answer is None or self._ended_by(read_wish(answer)):
                break
            if left == 1:
                self._say(_LAST)
        if self._edit and not self._diagnosis and not self._failure:
            self._say(_ASK_DIAGNOSIS)
            answer = self._answer()
            self._diagnosis = "" if answer is None else diagnosis_in(read_wish(answer).said)
        return Proposal(
            edit=self._edit,
            note=_note(self._diagnosis),
            reply="\n\n".join(self._reply)[:LONGEST_REPLY],
            diagnosis=paragraph(self._diagnosis) or _undiagnosed(self.context.parent),
            usage={**self._usage, "answers": len(self._reply), "tool_calls": self._calls},
            failure="" if self._edit else self._failure,
        )

    def _answer(self) -> Answer | None:
        """The next answer; None when there is none, with the reason kept."""
        self._shorten()
        try:
            answer = self._complete(int(self.rng.integers(2**31)))
        except ChatError as error:
            self._count(error.usage)
            self._failure = str(error)
            return None
        self._count(answer.usage)
        calls = "".join(f"\n[called {one.name} {one.arguments}]" for one in answer.tool_calls)
        self._reply.append(answer.text + calls)
        return answer

    def _complete(self, seed: int) -> Answer:
        """An answer; a server that refuses tools at the first question is asked again without."""
        if self._native:
            try:
                return self.chat.complete(self.messages, tools=self._declared, rng_seed=seed)
            except ChatError as error:
                if len(self.messages) > self._asked or not _refused(error):
                    raise
                self._count(error.usage)
                self._native = False
        return self.chat.complete(self.messages, rng_seed=seed)

    @property
    def _declared(self) -> list[dict[str, Any]]:
        return [
            {
                "type": "function",
                "function": {"name": one.name, "description": one.description, "parameters": one.schema},
            }
            for one in (*self.tools, SUBMIT)
        ]

    def _ended_by(self, wish: Wish) -> bool:
        """Take up what an answer asks for; True when the turn is over."""
        self._repeat(wish)
        if wish.edit:
            wrong = self._taken(wish.edit, wish.diagnosis)
            self._say(wrong)
            return not wrong
        if not wish.calls:
            self._say(_ASK_EDIT)
        ended = False
        for call in wish.calls:  # each is answered, also after the end: servers want it so
            ended = self._called(call, ended) or ended
        return ended

    def _called(self, call: Call, ended: bool) -> bool:
        """Answer a call; True when it ends the turn."""
        if ended:
            answer = failed("the turn has ended")
        elif call.arguments is None:
            answer = failed(f"the arguments of {call.name} are no JSON object; write them again")
        elif call.name == SUBMIT.name:
            answer = SUBMIT.call(call.arguments)
            if "error" not in answer:
                wrong = self._taken(call.arguments["edit"], call.arguments["diagnosis"])
                answer = failed(wrong) if wrong else {"taken": True}
        elif self._calls >= self.settings.calls:
            answer = failed(f"the {self.settings.calls} calls of this turn are used up; end it with {SUBMIT.name}")
        else:
            self._calls += 1
            answer = call_by_name(self.tools, call.name, call.arguments, longest=self.settings.longest)
        text = json.dumps(answer, ensure_ascii=False)
        if call.id:
            self.messages.append({"role": "tool", "tool_call_id": call.id, "content": text})
        else:
            self._say(f"Answer of {call.name[:60]}:\n```json\n{text}\n```")
        return "taken" in answer

    def _taken(self, edit: str, diagnosis: str) -> str:
        """Keep an edit as the turn's; "" when it may be evaluated, else a sentence that says what to mend."""
        self._edit, self._diagnosis = edit, diagnosis
        parent, task = self.context.parent, self.context.task
        own = structure_hash(parent.diagram, task.kinds, equilibrium=task.equilibrium)
        found = judge(Proposal(edit), parent.record.program, own, task, lambda _: None)
        if found.status is not Status.PENDING:
            return f"The edit cannot be evaluated ({found.status}): {found.reason[:2_000]} Mend it, or try another."
        if self.context.seen(found.hash):
            return "The run has evaluated this structure already, so the edit tells nothing new. Try another."
        return ""

    def _repeat(self, wish: Wish) -> None:
        """The answer as a message; calls of the interface must be there for their answers to be understood."""
        message: dict[str, Any] = {"role": "assistant", "content": wish.said[:LONGEST_SAID] or "(no text)"}
        native = [call for call in wish.calls if call.id]
        if native:
            message["tool_calls"] = [
                {
                    "id": call.id,
                    "type": "function",
                    "function": {"name": call.name, "arguments": json.dumps(call.arguments or {})},
                }
                for call in native
            ]
        self.messages.append(message)

    def _say(self, text: str) -> None:
        """Add to what the user says next; roles alternate."""
        if not text:
            return
        if self.messages[-1]["role"] == "user":
            self.messages[-1]["content"] += f"\n\n{text}"
        else:
            self.messages.append({"role": "user", "content": text})

    def _shorten(self) -> None:
        """Leave out the oldest answers of tools, and what was said long ago, until the messages keep the limit."""
        for message in self.messages[self._asked : -2]:
            if estimated_tokens(prompt_text(self.messages)) <= self.settings.tokens:
                return
            if len(message["content"]) > len(_DROPPED):
                message["content"] = _DROPPED

    def _count(self, usage: Mapping[str, Any]) -> None:
        for name, value in usage.items():
            if name in _SUMMED and isinstance(value, int | float):
                self._usage[name] = self._usage.get(name, 0) + value
            elif name == "model":
                self._usage[name] = value


def _refused(error: ChatError) -> bool:
    """True for an answer of the kind "this parameter I do not take", which for a first question means the tools."""
    return any(f"HTTP {status}" in str(error) for status in (400, 404, 405, 422, 501))


def _undiagnosed(parent: Evaluated) -> str:
    return f"No diagnosis was written. {verdict(parent.record)}"


def _note(diagnosis: str) -> str:
    one = paragraph(diagnosis)
    return one if len(one) <= LONGEST_NOTE else one[: LONGEST_NOTE - 3] + "..."
