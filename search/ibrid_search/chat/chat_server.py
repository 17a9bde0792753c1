"""Any server that speaks the OpenAI chat interface, asked with the official client; everything it
sends is distrusted.
"""

import json
import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any

from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.streams import complain
from ibrid_search.blocks import strip_thinking
from ibrid_search.chat.answer_forms import FORMS, TOOL, fields_of, form_of, refused
from ibrid_search.chat.chat import (
    UNKNOWN,
    Answer,
    ChatError,
    Message,
    ToolCall,
    estimated_tokens,
    prompt_text,
)
from ibrid_search.chat.chat_request import (
    LITELLM,
    Refusal,
    adapted_body,
    check_url,
    is_secret,
    names_within,
    post,
    read_reply,
)

OPENAI = "https://api.openai.com/v1"
#: Where the base URL comes from when none is given, in this order.
URL_FROM = ("OPENAI_BASE_URL", "OPENAI_API_BASE")
#: Seconds between two attempts at most, also when the server asks for more.
LONGEST_PAUSE = 60.0
#: Seconds between two attempts from which on they are said.
SAID_FROM = 5.0
#: Seconds of an attempt at least, and changes of a request that a server does not understand.
SHORTEST, MOST_ADAPTED = 0.05, 6
#: Attempts after one that took all of its time.
LATE = 1


class FormRefused(ChatError):
    """The server does not take this form; the next question is asked in another."""


@dataclass(frozen=True)
class ChatServer(Frozen):
    """One model of a server.

    `base_url` : usually ends in /v1; None: OPENAI_BASE_URL or OPENAI_API_BASE, else OpenAI's own;
    `LITELLM` for whatever the package litellm knows, with its own environment variables for keys.
    `key_from` : name of the environment variable with the key; the key is read when a question is
    asked, sent to that server and kept nowhere. A server without keys (Ollama, vLLM, `transformers
    serve`) needs none. `timeout` : seconds for one answer. `retries` : after HTTP 429 or 5xx, a
    broken connection or a time-out, with pauses of `pause`, twice that, and so on (s).
    `within` : seconds for a question, and `requests`, at most, all attempts together; `sent` : told
    before each attempt how many the question took so far, it included. `max_tokens`, `temperature`
    : of an answer. `effort` : how much a reasoning model thinks, in the words of its server.
    `extra` : further fields of the request.
    `form` : of `FORMS`, or "auto": how the server is held to a schema, the first way it takes.
    `price` : per million tokens in and out, in whatever currency.

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
    within: float = inf
    requests: float = inf
    sent: Callable[[int], None] | None = field(default=None, compare=False, repr=False)
    effort: str | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    form: str = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.model or len(self.model) > 200 or not self.model.isprintable():
            raise IbridError(
                f"a model has a name of printable characters, found {self.model!r:.60}; name one"
            )
        if not self.key_from or not self.key_from.isidentifier():
            raise IbridError(
                "key_from is the name of an environment variable, never the key; name one"
            )
        if self.base_url not in (None, LITELLM):
            check_url(self.base_url)
        if len(self.price) != 2:
            raise IbridError(
                f"the price of {self.model} is that of a million tokens in and out; give two "
                "numbers"
            )
        numbers = (self.timeout, self.pause, self.temperature, *self.price, self.retries)
        if (
            not all(isfinite(one) and one >= 0 for one in numbers)
            or self.timeout == 0
            or self.max_tokens < 1
        ):
            raise IbridError(
                f"timeout and max_tokens of {self.model} must be positive, retries, pause, "
                "temperature and prices not "
                "negative; leave them out for the defaults"
            )
        if self.form not in ("auto", *FORMS):
            raise IbridError(
                f"an answer has the form auto, {', '.join(FORMS)}, found {self.form!r:.40}; choose "
                "one"
            )
        if wrong := sorted({"messages", "model", "stream"}.intersection(self.extra)):
            raise IbridError(f"the field {wrong[0]} of a request is not free; leave it out")
        for name, value in self.extra.items():
            if not _is_json(value):
                raise IbridError(
                    f"the field {name!r:.60} of a request must be what JSON can carry; give finite "
                    "numbers and text"
                )
            if any(map(is_secret, (name, *names_within(value)))):
                raise IbridError(
                    f"the field {name!r:.60} of a request would be stored with the run, and a key "
                    "must not be; put it into an environment variable"
                )

    @property
    def name(self) -> str:
        """The model's name."""
        return self.model

    @property
    def url(self) -> str:
        """Base URL that is asked; IbridError when the environment holds none."""
        if self.base_url == LITELLM:
            return LITELLM
        address = self.base_url or next(
            (value for name in URL_FROM if (value := os.environ.get(name))), OPENAI
        )
        check_url(address)
        return address

    def bounded(
        self, seconds: float, questions: float = inf, sent: Callable[[int], None] | None = None
    ) -> "ChatServer":
        """The same with less time for a question, and less often asked again, where that is less;
        `sent` is told of attempts.
        """
        return replace(
            self,
            within=min(self.within, seconds),
            requests=min(self.requests, questions),
            sent=sent,
        )

    @property
    def asked_form(self) -> str:
        """How the next answer is held to a schema."""
        return form_of(self.form, self.url, self.model)

    def complete(
        self,
        messages: Sequence[Message],
        *,
        tools: Sequence[Mapping[str, Any]] | None = None,
        rng_seed: int = 0,
    ) -> Answer:
        """The next turn; see `ibrid_search.proposers.chat.Chat`.

        The seed is a wish: few servers repeat an answer exactly.
        """
        return self._answer(
            messages, {"tools": [dict(one) for one in tools]} if tools else {}, rng_seed
        )

    def fill(
        self, messages: Sequence[Message], schema: Mapping[str, Any], form: str, rng_seed: int = 0
    ) -> Answer:
        """The next turn, held to a JSON schema in a form; its text is the JSON where the server
        holds to it.

        Raises FormRefused for a form that the server does not take, which is remembered; ChatError
        for everything else.
        """
        another = self.form == "auto" and form != FORMS[-1]
        try:
            answer = self._answer(messages, fields_of(form, schema), rng_seed)
        except ChatError as error:
            if error.status not in UNKNOWN or not another:
                raise
            refused(self.url, self.model).add(form)
            raise FormRefused(str(error), error.usage) from None
        said = next((one.arguments for one in answer.tool_calls if one.name == TOOL), answer.text)
        if another and not answer.cut and not strip_thinking(said)[1].strip().startswith("{"):
            refused(self.url, self.model).add(form)  # taken without a word, and not kept to
        return replace(answer, text=said, tool_calls=())

    def _answer(
        self, messages: Sequence[Message], more: Mapping[str, Any], rng_seed: int
    ) -> Answer:
        started = time.monotonic()
        body: dict[str, Any] = {
            "model": self.model,
            "messages": [dict(one) for one in messages],
            "max_tokens": self.max_tokens,
            "temperature": self.temperature,
            "seed": rng_seed,
            **({"reasoning_effort": self.effort} if self.effort else {}),
            **more,
            **self.extra,
        }
        key, retries = "", 0
        try:
            key = self.key()
            where = f"the model {self.model} at {self.url}"
            reply, retries = self._ask(key, body)
            if isinstance(reply, Refusal):
                times = f", {retries + 1} times" if retries else ""
                raise ChatError(f"{where} {reply.sentence}{times}", status=reply.status)
            completion = read_reply(reply, where)
        except IbridError as error:
            seconds = time.monotonic() - started
            spent = {
                "model": self.model,
                "questions": 1 + retries,
                "seconds": seconds,
                "retries": retries,
            }
            raise ChatError(
                without_key(key, str(error)), spent, getattr(error, "status", 0)
            ) from None
        calls = tuple(_without_key(key, one) for one in completion.tool_calls)
        spoken = completion.text + "".join(one.arguments for one in calls)
        usage = {
            "model": self.model,
            "questions": 1 + retries,
            "prompt_tokens": estimated_tokens(prompt_text(messages)),
            "completion_tokens": estimated_tokens(spoken),
            **completion.usage,
            "seconds": time.monotonic() - started,
            "retries": retries,
        }
        price_in, price_out = self.price
        usage["cost"] = (
            usage["prompt_tokens"] * price_in + usage["completion_tokens"] * price_out
        ) / 1e6
        return Answer(without_key(key, completion.text), calls, usage, completion.cut)

    def _ask(self, key: str, body: Mapping[str, Any]) -> tuple[bytes | Refusal, int]:
        """The reply or the last refusal, and how often it was asked again, within the bounds of all
        attempts together.
        """
        retries = adapted = 0
        end, known = time.monotonic() + self.within, refused(self.url, self.model)
        while True:
            left = end - time.monotonic()
            if self.sent is not None:
                self.sent(retries + adapted + 1)
            reply = post(
                self.url, key, adapted_body(body, known), min(self.timeout, max(left, SHORTEST))
            )
            if isinstance(reply, bytes):
                return reply, retries + adapted
            spent = retries + adapted + 1 >= self.requests
            if reply.unknown and adapted < MOST_ADAPTED and not spent:
                known.update(reply.unknown)
                adapted += 1
                continue
            pause = min(LONGEST_PAUSE, max(self.pause * 2**retries, reply.pause))
            most = min(self.retries, LATE) if reply.late else self.retries
            if not reply.again or spent or retries >= most or pause >= end - time.monotonic():
                return reply, retries + adapted
            if pause >= SAID_FROM:
                complain(without_key(key, self._waiting(reply, pause)))
            time.sleep(pause)
            retries += 1

    def _waiting(self, refusal: Refusal, pause: float) -> str:
        """Why nothing happens for a while."""
        return (
            f"the model {self.model} at {self.url} {refusal.sentence}; asking again in "
            f"{pause:.0f} s"
        )

    def key(self) -> str:
        """What the environment holds now, "none" where it holds nothing; IbridError when that is no
        key or one is needed.
        """
        key = os.environ.get(self.key_from, "").strip()
        if not (key.isascii() and key.isprintable()):
            raise IbridError(
                f"the key in {self.key_from} holds characters that no key has; set it again"
            )
        if not key and self.url.startswith(OPENAI):
            raise IbridError(
                f"the model {self.model} at {OPENAI} needs a key in {self.key_from}; set it, or "
                f"set {URL_FROM[0]} to the "
                "address of a server of your own"
            )
        return key or "none"


def _is_json(value: object) -> bool:
    """Whether a request can carry it."""
    try:
        json.dumps(value, allow_nan=False, ensure_ascii=False, default=dict).encode()
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def _without_key(key: str, call: ToolCall) -> ToolCall:
    name, arguments, id_ = (without_key(key, text) for text in (call.name, call.arguments, call.id))
    return ToolCall(name, arguments, id_)


def without_key(key: str, text: str) -> str:
    """The text without the key, should a server repeat it, plainly or with the escapes of JSON."""
    if len(key) < 8:
        return text
    plain_or_escaped = (f"(?:\\\\?{re.escape(one)}|\\\\u00(?i:{ord(one):02x}))" for one in key)
    return re.sub("".join(plain_or_escaped), "(key)", text)
