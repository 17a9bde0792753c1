"""The messages of a turn as they grow: roles alternate, every call has its answer, and the whole keeps a token limit."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from ibrid_search.proposers.agent_calls import Call, Wish
from ibrid_search.proposers.chat import estimated_tokens

#: Characters of an answer of the model that stay in the dialogue.
LONGEST_SAID = 8_000
_DROPPED = "(left out to stay within the token limit; call the tool again where it is needed)"


class Dialogue:
    """Messages in the words of the OpenAI interface; `question` are the first of them and stay."""

    def __init__(self, question: Sequence[Mapping[str, Any]]) -> None:
        self.messages: list[dict[str, Any]] = [dict(one) for one in question]
        self._asked = len(self.messages)

    @property
    def begun(self) -> bool:
        """True once the model has answered."""
        return len(self.messages) > self._asked

    def answered(self, wish: Wish) -> None:
        """Add what the model said; calls of the interface must be there for their answers to be understood."""
        message: dict[str, Any] = {"role": "assistant", "content": wish.said[:LONGEST_SAID] or "(no text)"}
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
        """Leave out what was said and answered longest ago in this turn until the limit is kept; the last two stay."""
        for message in self.messages[self._asked : -2]:
            if estimated_tokens(json.dumps(self.messages, ensure_ascii=False)) <= limit_tokens:
                return
            if len(message["content"]) > len(_DROPPED):
                message["content"] = _DROPPED
            for call in message.get("tool_calls", ()):
                call["function"]["arguments"] = "{}"


def _native(call: Call) -> dict[str, Any]:
    arguments = call.arguments if isinstance(call.arguments, Mapping) else {}
    return {"id": call.id, "type": "function", "function": {"name": call.name, "arguments": json.dumps(arguments)}}
