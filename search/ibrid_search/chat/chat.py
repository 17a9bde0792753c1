"""A conversation with a language model, wherever it runs: what is asked, what comes back, and what
goes wrong.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Protocol, runtime_checkable

from ibrid.errors import IbridError
from ibrid.frozen import Frozen

#: One turn in the words of the OpenAI interface: {"role": "system" | "user" | "assistant" | "tool",
#: "content": text, ...}.
Message = Mapping[str, Any]

#: Letters of a word that a token stands for, where nobody has counted; digits and signs count one
#: each, as they do for tokenizers with a small vocabulary (SmolLM2).
LETTERS_PER_TOKEN = 5
_PIECES = re.compile(r"[^\W\d_]+|\S")
#: Characters of an answer that are kept.
LONGEST_ANSWER = 400_000
#: HTTP status of "this field I do not know".
UNKNOWN = (400, 404, 405, 415, 422, 501)


class ChatError(IbridError):
    """A model that gives no answer, in one sentence.

    `usage` : what was spent on it all the same. `status` : of HTTP, 0 where that is not the reason.
    """

    def __init__(
        self, sentence: str, usage: Mapping[str, Any] | None = None, status: int = 0
    ) -> None:
        super().__init__(sentence)
        self.usage, self.status = dict(usage or {}), status


@dataclass(frozen=True)
class ToolCall:
    """A tool that the model wants called.

    `arguments` : JSON text as the model wrote it, which may be wrong.
    """

    name: str
    arguments: str
    id: str = ""


@dataclass(frozen=True)
class Answer(Frozen):
    """What a model said.

    `text` : thinking, where the server gives it apart, stands in front between think tags. `cut` :
    the token or time limit ended it. `usage` : model, prompt_tokens, completion_tokens (thinking
    included), cost, seconds, retries.
    """

    text: str
    tool_calls: tuple[ToolCall, ...] = ()
    usage: Mapping[str, Any] = field(default_factory=dict)
    cut: bool = False


@runtime_checkable
class Chat(Protocol):
    """A model that answers. `name` : for messages and records."""

    @property
    def name(self) -> str: ...

    def complete(
        self,
        messages: Sequence[Message],
        *,
        tools: Sequence[Mapping[str, Any]] | None = None,
        rng_seed: int = 0,
    ) -> Answer:
        """The next turn of the assistant.

        `tools` : {"type": "function", "function": {"name", "description", "parameters"}}; a model
        that does not know how to call them answers with text. `rng_seed` : of the sampling, where
        the model has one.

        Raises ChatError for everything that a server or a model can do wrong.
        """
        ...


def estimated_tokens(text: str) -> int:
    """About the number of tokens of a text, rather too many; the same every time."""
    return sum(ceil(len(piece) / LETTERS_PER_TOKEN) for piece in _PIECES.findall(text))


def prompt_text(messages: Sequence[Message]) -> str:
    """All that is said in some messages, for counting and for models without a template."""
    return "\n\n".join(f"{one.get('role', 'user')}: {one.get('content') or ''}" for one in messages)
