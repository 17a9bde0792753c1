"""Any server that speaks the OpenAI chat interface, asked with the official client; everything it sends is distrusted."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from ibrid.errors import IbridError
from ibrid_search.proposers.chat import Answer, ChatError, Message, estimated_tokens, prompt_text
from ibrid_search.proposers.chat_request import Refusal, check_url, post, read_reply

OPENAI = "https://api.openai.com/v1"
#: Where the base URL comes from when none is given, in this order.
URL_FROM = ("OPENAI_BASE_URL", "OPENAI_API_BASE")
#: Seconds between two attempts at most, also when the server asks for more.
LONGEST_PAUSE = 60.0


@dataclass(frozen=True)
class ChatServer:
    """One model of a server.

    `base_url` : usually ends in /v1; None: OPENAI_BASE_URL or OPENAI_API_BASE, else OpenAI's own. `key_from` : name of the
    environment variable with the key; the key is read when a question is asked, sent to that server and kept nowhere.
    A server without keys (Ollama, vLLM, `transformers serve`) needs none. `timeout` : seconds for one answer. `retries` :
    after HTTP 429 or 5xx, a broken connection or a time-out, with pauses of `pause`, twice that, and so on (s).
    `max_tokens`, `temperature` : of an answer. `price` : per million tokens in and out, in whatever currency.

    Raises IbridError for settings that have no meaning.
    """

    model: str
    base_url: str | None = None
    key_from: str = "OPENAI_API_KEY"
    timeout: float = 600.0
    retries: int = 4
    pause: float = 1.0
    max_tokens: int = 16_384
    temperature: float = 1.0
    price: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.model or len(self.model) > 200 or not self.model.isprintable():
            raise IbridError(f"a model has a name of printable characters, found {self.model!r:.60}; name one")
        if not self.key_from or not self.key_from.isidentifier():
            raise IbridError("key_from is the name of an environment variable, never the key; name one")
        if self.base_url is not None:
            check_url(self.base_url)
        numbers = (self.timeout, self.pause, self.temperature, *self.price, self.retries)
        if not all(isfinite(one) and one >= 0 for one in numbers) or self.timeout == 0 or self.max_tokens < 1:
            raise IbridError(
                f"timeout and max_tokens of {self.model} must be positive, retries, pause, temperature and prices not "
                "negative; leave them out for the defaults"
            )

    @property
    def name(self) -> str:
        """The model's name."""
        return self.model

    @property
    def url(self) -> str:
        """Base URL that is asked; IbridError when the environment holds none."""
        found = self.base_url or next((value for name in URL_FROM if (value := os.environ.get(name))), OPENAI)
        check_url(found)
        return found

    def complete(
        self, messages: Sequence[Message], *, tools: Sequence[Mapping[str, Any]] | None = None, rng_seed: int = 0
    ) -> Answer:
        """The next turn; see `ibrid_search.proposers.chat.Chat`. The seed is a wish: few servers repeat an answer exactly."""
        started = time.monotonic()
        body: dict[str, Any] = {
            "model": self.model,
            "messages": [dict(one) for one in messages],
            "max_tokens": self.max_tokens,
            "temperature": self.temperature,
            "seed": rng_seed,
            **({"tools": [dict(one) for one in tools]} if tools else {}),
        }
        key, retries = "", 0
        try:
            key = self.key()
            where = f"the model {self.model} at {self.url}"
            reply, retries = self._ask(key, body)
            if isinstance(reply, Refusal):
                times = f", {retries + 1} times" if retries else ""
                raise ChatError(f"{where} {reply.sentence}{times}")
            found = read_reply(reply, where)
        except IbridError as error:
            spent = {"model": self.model, "seconds": time.monotonic() - started, "retries": retries}
            raise ChatError(without_key(key, str(error)), spent) from None
        calls = tuple(replace(one, arguments=without_key(key, one.arguments)) for one in found.tool_calls)
        spoken = found.text + "".join(one.arguments for one in calls)
        usage = {
            "model": self.model,
            "prompt_tokens": estimated_tokens(prompt_text(messages)),
            "completion_tokens": estimated_tokens(spoken),
            **found.tokens,
            "seconds": time.monotonic() - started,
            "retries": retries,
        }
        usage["cost"] = self._cost(usage)
        return Answer(without_key(key, found.text), calls, usage, found.cut)

    def _ask(self, key: str, body: Mapping[str, Any]) -> tuple[bytes | Refusal, int]:
        """The reply or the last refusal, and how often it was asked again."""
        retries = adapted = 0
        while True:
            reply = post(self.url, key, body, self.timeout)
            if isinstance(reply, bytes):
                return reply, retries
            if reply.body is not None and adapted < 3:
                body, adapted = reply.body, adapted + 1
                continue
            if not reply.again or retries >= self.retries:
                return reply, retries
            time.sleep(min(LONGEST_PAUSE, max(self.pause * 2**retries, reply.pause)))
            retries += 1

    def key(self) -> str:
        """What the environment holds now, "none" where it holds nothing; IbridError when that is no key or one is needed."""
        key = os.environ.get(self.key_from, "").strip()
        if not (key.isascii() and key.isprintable()):
            raise IbridError(f"the key in {self.key_from} holds characters that no key has; set it again")
        if not key and self.url.startswith(OPENAI):
            raise IbridError(
                f"the model {self.model} at {OPENAI} needs a key in {self.key_from}; set it, or set {URL_FROM[0]} to the "
                "address of a server of your own"
            )
        return key or "none"

    def _cost(self, usage: Mapping[str, Any]) -> float:
        return (usage["prompt_tokens"] * self.price[0] + usage["completion_tokens"] * self.price[1]) / 1e6


def without_key(key: str, text: str) -> str:
    """The text without the key, should a server repeat it."""
    return text.replace(key, "(key)") if len(key) >= 8 else text
