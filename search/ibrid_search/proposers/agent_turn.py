"""One turn of an agent: answers and tools in exchange, until an edit is taken or the answers are
used up.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.report.facts.verdict import verdict
from ibrid.writing import PlainData
from ibrid_search.agents.tool import call_by_name, failed
from ibrid_search.agents.tools import Tools
from ibrid_search.blocks import blocks_alone, shown, strip_thinking
from ibrid_search.chat.chat import UNKNOWN, Answer, Chat, ChatError, estimated_tokens
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.chat.spending import Spender, added
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.agent_calls import Call, Wish, diagnosis_in, read_wish
from ibrid_search.proposers.agent_view import SUBMIT, AgentSettings, RunView, paragraph
from ibrid_search.proposers.local_model import LocalModel
from ibrid_search.step import Status

#: Characters of the reply that the store keeps, and of what submit_edit passes on.
LONGEST_REPLY, LONGEST_SUBMISSION = 400_000, 1_000_000

_ASK_EDIT = (
    "Your answer had neither a tool call nor whole SEARCH/REPLACE blocks. End the turn: call "
    "submit_edit, or write the "
    "blocks and a paragraph that begins with Diagnosis:"
)
_ASK_DIAGNOSIS = (
    "The edit is taken. Now write the diagnosis in one paragraph, without tools or code: what the "
    "record shows, which layer "
    "is missing or wrong, what the edit changes and what you expect of it."
)
_CUT = "Your answer was cut off at its limit; be shorter. "
_LAST = "One answer is left in this turn: end it with an edit and a diagnosis."


@dataclass(eq=False)
class Turn:
    """`question` : the messages it begins with. `native` : whether the server takes tools; False
    once it has refused.
    `spender` : whose turn it is, and who counts what it costs.
    """

    chat: Chat
    settings: AgentSettings
    spender: Spender
    context: Context
    view: RunView
    question: Sequence[Mapping[str, Any]]
    rng: np.random.Generator
    native: bool

    def __post_init__(self) -> None:
        self.tools = Tools(self.context.study, self.view).reading
        self.dialogue = Dialogue(self.question)
        self._edit = self._diagnosis = self._note = self._failure = ""
        self._calls = 0
        self._usage: PlainData = {}
        self._reply: list[str] = []

    def proposal(self) -> Proposal:
        """Ask until the turn has ended."""
        for left in reversed(range(self.settings.answers)):
            answer = self._answer()
            if answer is None or self._ended_by(read_wish(answer), answer.cut):
                break
            if left == 1:
                self.dialogue.say(_LAST)
        if self._edit and not self._diagnosis and not self._failure:
            self.dialogue.say(_ASK_DIAGNOSIS)
            answer = self._answer()
            self._diagnosis = "" if answer is None else diagnosis_in(read_wish(answer).said)
        return Proposal(
            edit=self._edit,
            note=shown(self._note or self._diagnosis),
            reply="\n\n".join(self._reply)[:LONGEST_REPLY],
            diagnosis=paragraph(self._diagnosis)
            or f"No diagnosis was written. {verdict(self.context.parent.record)}",
            usage={**self._usage, "answers": len(self._reply), "tool_calls": self._calls},
            failure="" if self._edit else self._failure,
        )

    def _answer(self) -> Answer | None:
        """The next answer; None when there is none, with the reason kept."""
        self.dialogue.shorten(self.settings.tokens)
        self._failure = self.spender.spending.over
        if self._failure:
            return None
        try:
            with self.spender.asking(self.chat.name):
                answer = self._complete(int(self.rng.integers(2**31)))
        except ChatError as error:
            self._count(error.usage)
            self._failure = str(error)
            return None
        thought = estimated_tokens(strip_thinking(answer.text)[0])
        self._count(
            {"model": self.chat.name, "questions": 1, "thinking_tokens": thought, **answer.usage}
        )
        calls = "".join(f"\n[called {one.name} {one.arguments}]" for one in answer.tool_calls)
        self._reply.append(answer.text + calls)
        return answer

    def _complete(self, seed: int) -> Answer:
        """An answer; a server that refuses tools at the first question is asked again without."""
        messages, chat = self.dialogue.messages, self.chat
        if isinstance(chat, ChatServer | LocalModel):
            spending = self.spender.spending
            chat = chat.bounded(spending.seconds_left, spending.questions_left, self.spender.sent)
        if self.native:
            try:
                return chat.complete(messages, tools=self._declared, rng_seed=seed)
            except ChatError as error:
                if self.dialogue.begun or error.status not in UNKNOWN:
                    raise
                self._count(error.usage)
                if over := self.spender.spending.over:
                    raise ChatError(over) from None
                self.native = False
        return chat.complete(messages, rng_seed=seed)

    @property
    def _declared(self) -> list[PlainData]:
        return [
            {
                "type": "function",
                "function": {
                    "name": one.name,
                    "description": one.description,
                    "parameters": one.schema,
                },
            }
            for one in (*self.tools, SUBMIT)
        ]

    def _ended_by(self, wish: Wish, cut: bool) -> bool:
        """Take up what an answer asks for; True when the turn is over."""
        self.dialogue.answered(wish)
        if wish.edit:
            wrong = self._taken(wish.edit, wish.diagnosis, wish.change)
            if wrong:
                self.dialogue.say(wrong)
            return not wrong
        if not wish.calls:
            self.dialogue.say((_CUT if cut else "") + _ASK_EDIT)
        ended = False
        for call in wish.calls:  # each is answered, also after the end: servers want it so
            answer = failed("the turn has ended") if ended else self._called(call)
            self.dialogue.tell(call, answer)
            ended = ended or "taken" in answer
        return ended

    def _called(self, call: Call) -> PlainData:
        """What a call is answered; {"taken": True} ends the turn."""
        if call.arguments is None:
            return failed(f"the arguments of {call.name} are no JSON object; write them again")
        if call.name == SUBMIT.name:
            given = SUBMIT.call(call.arguments, longest=LONGEST_SUBMISSION)
            wrong = str(given["error"]) if "error" in given else self._taken(**given)
            return failed(wrong) if wrong else {"taken": True}
        if self._calls >= self.settings.calls:
            return failed(
                f"the {self.settings.calls} calls of this turn are used up; end it with "
                f"{SUBMIT.name}"
            )
        self._calls += 1
        return call_by_name(self.tools, call.name, call.arguments, longest=self.settings.longest)

    def _taken(self, edit: str, diagnosis: str, change: str = "") -> str:
        """Keep an edit as the turn's; "" when it may be evaluated, else a sentence that says what
        to mend.
        """
        self._edit, self._diagnosis, self._note = blocks_alone(edit), diagnosis, change
        judged = verdict_of(Proposal(edit), self.context)
        if judged.status is Status.DUPLICATE:
            return (
                "The run has evaluated this structure already, so the edit tells nothing new. Try "
                "another."
            )
        if judged.status is not Status.PENDING:
            return (
                f"The edit cannot be evaluated ({judged.status}): {judged.reason[:2_000]} Mend it, "
                "or try another."
            )
        return ""

    def _count(self, usage: Mapping[str, Any]) -> None:
        self.spender.count(usage)
        self._usage = added(self._usage, usage)


#: Characters of an answer of the model that stay in the dialogue.
LONGEST_SAID = 8_000
_DROPPED = "(left out to stay within the token limit; call the tool again where it is needed)"


class Dialogue:
    """Messages in the words of the OpenAI interface; `question` are the first of them and stay."""

    def __init__(self, question: Sequence[Mapping[str, Any]]) -> None:
        self.messages: list[PlainData] = [dict(one) for one in question]
        self._asked = len(self.messages)

    @property
    def begun(self) -> bool:
        """True once the model has answered."""
        return len(self.messages) > self._asked

    def answered(self, wish: Wish) -> None:
        """Add what the model said; calls of the interface must be there for their answers to be
        understood.
        """
        message: PlainData = {
            "role": "assistant",
            "content": wish.said[:LONGEST_SAID] or "(no text)",
        }
        native = [call for call in wish.calls if call.id]
        if native:
            message["tool_calls"] = [_native(call) for call in native]
        self.messages.append(message)

    def tell(self, call: Call, answer: Mapping[str, Any]) -> None:
        """Add the answer of a tool, in the way in which it was called."""
        text = json.dumps(answer, ensure_ascii=False)
        if call.id:
            self.messages.append({"role": "tool", "tool_call_id": call.id, "content": text})
        else:
            self.say(f"Answer of {call.name[:60]}:\n```json\n{text}\n```")

    def say(self, text: str) -> None:
        """Add to what the user says next."""
        if self.messages[-1]["role"] == "user":
            self.messages[-1]["content"] += f"\n\n{text}"
        else:
            self.messages.append({"role": "user", "content": text})

    def shorten(self, limit_tokens: int) -> None:
        """Leave out what was said and answered longest ago in this turn until the limit is kept;
        the last two stay.
        """
        for message in self.messages[self._asked : -2]:
            if estimated_tokens(json.dumps(self.messages, ensure_ascii=False)) <= limit_tokens:
                return
            if len(message["content"]) > len(_DROPPED):
                message["content"] = _DROPPED
            for call in message.get("tool_calls", ()):
                call["function"]["arguments"] = "{}"


def _native(call: Call) -> PlainData:
    arguments = call.arguments if isinstance(call.arguments, Mapping) else {}
    return {
        "id": call.id,
        "type": "function",
        "function": {"name": call.name, "arguments": json.dumps(arguments)},
    }
