"""One request to a chat server, and its reply read as data; what goes wrong is one sentence, and
whether to ask again.
"""

import importlib
import json
import os
import re
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from ibrid.errors import IbridError
from ibrid_search.chat.chat import LONGEST_ANSWER, Answer, ChatError, ToolCall

#: In place of an address: the package litellm finds the server by the name of the model.
LITELLM = "litellm"
#: Bytes of a reply that are read at most, and of one that is an error, packed as it comes.
LARGEST_REPLY, LARGEST_ERROR = 8_000_000, 16_000
#: Seconds that a thread may take to say that its time is up.
GRACE = 0.5
#: HTTP status that may be another one the next time, besides all from 500 on.
_AGAIN = (408, 409, 425, 429)
_KEY, _PLACE = (
    "; check the key in the environment",
    "; check the model's name and the base URL, which usually ends in /v1",
)
#: Names of fields that hold a key; `key` itself also means other things.
_SECRET = re.compile(
    r"(^|_)(api_?key|authorization|(auth|access)_token|bearer|secret|password|signature)(_|$)"
)
#: What mends an HTTP status.
_REMEDIES = {401: _KEY, 403: _KEY, 404: _PLACE, 405: _PLACE}
#: Why a redirect ends a question.
_NOT_FOLLOWED = (
    ", where it is not followed, since the key and the data would go along; give that address, if "
    "you trust it"
)
#: What some servers want in place of a parameter that they refuse; others are left out.
_INSTEAD: Mapping[str, str] = {"max_tokens": "max_completion_tokens"}
#: What a request cannot do without, or does without only where somebody else decides so.
_FIXED = ("model", "messages", "tools", "tool_choice", "response_format", "grammar")
#: Parameters that the client knows by name; others go along in the body.
_NAMED = (
    *_FIXED[:-1],
    "max_tokens",
    "max_completion_tokens",
    "temperature",
    "seed",
    "reasoning_effort",
)


@dataclass(frozen=True)
class Refusal:
    """Why a request has no reply.

    `sentence` : goes on after the name of the model and its server. `again` : the next time may be
    better. `pause` : seconds that the server asks to wait. `unknown` : parameters that this server
    does not know, where that is the reason.
    `status` : of HTTP, 0 without one. `late` : the time was up.
    """

    sentence: str
    again: bool = False
    pause: float = 0.0
    unknown: tuple[str, ...] = ()
    status: int = 0
    late: bool = False


def adapted_body(body: Mapping[str, Any], unknown: Collection[str]) -> dict[str, Any]:
    """A request without what its server does not know, or with what it wants in place of that."""
    kept = {name: value for name, value in body.items() if name not in unknown}
    return kept | {
        _INSTEAD[name]: body[name] for name in _INSTEAD if name in body and name in unknown
    }


def post(url: str, key: str, body: Mapping[str, Any], timeout: float) -> bytes | Refusal:
    """Ask once, `timeout` seconds at most, whatever the server does: a thread waits for it, and is
    left behind where it must.

    Raises ChatError when the package openai is not installed.
    """
    require_openai()
    answers: SimpleQueue[bytes | Refusal | BaseException] = SimpleQueue()

    def ask() -> None:
        try:
            answers.put(_post(url, key, body, timeout))
        except BaseException as error:
            answers.put(error)

    Thread(target=ask, daemon=True).start()
    try:
        answer = answers.get(timeout=timeout + GRACE)
    except Empty:
        return Refusal(f"did not end its answer within {timeout:.3g} s", again=True, late=True)
    if isinstance(answer, BaseException):
        raise answer
    return answer


def _post(url: str, key: str, body: Mapping[str, Any], timeout: float) -> bytes | Refusal:
    """One attempt; what goes wrong is a refusal."""
    openai = require_openai()
    transport = _transport(openai)
    ask = _by_litellm if url == LITELLM else _streamed
    try:
        return ask(url, key, body, timeout)
    except (openai.APITimeoutError, transport.TimeoutException):
        return Refusal(f"did not answer within {timeout:.3g} s", again=True, late=True)
    except openai.APIStatusError as error:
        return _refused(error, body)
    except (openai.APIConnectionError, transport.HTTPError, transport.StreamError) as error:
        return Refusal(f"cannot be reached ({_cause(error)}); is the server running?", again=True)
    except (openai.OpenAIError, transport.InvalidURL) as error:
        return Refusal(f"cannot be asked ({_cause(error)})")


def _transport(openai: Any) -> Any:
    """The HTTP library that this openai builds on: httpx, later httpx2."""
    return importlib.import_module(
        openai.DefaultHttpxClient.__mro__[1].__module__.partition(".")[0]
    )


def _cut_errors(openai: Any, end: float) -> Callable[[Any], None]:
    """What ends the body of a reply that is an error early, of which the client would read all.

    end : time at most.
    """

    class Cut(_transport(openai).SyncByteStream):
        def __init__(self, whole: Any) -> None:
            self.whole = whole

        def __iter__(self) -> Iterator[bytes]:
            left = LARGEST_ERROR
            for piece in self.whole:
                yield piece[:left]
                left -= len(piece)
                if left <= 0 or time.monotonic() > end:
                    return

        def close(self) -> None:
            self.whole.close()

    def cut(response: Any) -> None:
        if response.status_code >= 300:
            response.stream = Cut(response.stream)

    return cut


def _streamed(url: str, key: str, body: Mapping[str, Any], timeout: float) -> bytes | Refusal:
    """The reply is read piece by piece, so that neither its size nor its slowness is up to the
    server.
    """
    openai = require_openai()
    end, pieces, size = time.monotonic() + timeout, [], 0
    hooks = {"response": [_cut_errors(openai, end)]}
    named = {name: value for name, value in body.items() if name in _NAMED}
    other = {name: value for name, value in body.items() if name not in _NAMED}
    with (
        openai.DefaultHttpxClient(
            follow_redirects=False, timeout=timeout, event_hooks=hooks
        ) as transport,
        openai.OpenAI(
            api_key=key, base_url=url, timeout=timeout, max_retries=0, http_client=transport
        ) as client,
        client.chat.completions.with_streaming_response.create(
            **named, extra_body=other
        ) as response,
    ):
        for piece in response.iter_bytes():
            pieces.append(piece)
            size += len(piece)
            if size > LARGEST_REPLY:
                return Refusal(f"sent more than {LARGEST_REPLY} bytes; ask for fewer tokens")
            if time.monotonic() > end:
                return Refusal(
                    f"did not end its answer within {timeout:.3g} s", again=True, late=True
                )
    return b"".join(pieces)


def _by_litellm(url: str, key: str, body: Mapping[str, Any], timeout: float) -> bytes:
    """The reply of any server that litellm knows, in the form of the OpenAI interface; its errors
    are those of openai.
    """
    os.environ.setdefault(
        "LITELLM_LOCAL_MODEL_COST_MAP", "True"
    )  # else importing it waits for the network
    try:
        litellm: Any = importlib.import_module("litellm")
    except ImportError:
        raise ChatError(
            "a model by litellm needs the package litellm; pip install 'ibrid[litellm]'"
        ) from None
    litellm.suppress_debug_info = True  # it prints an advertisement beside every error
    return litellm.completion(**body, timeout=timeout, num_retries=0).model_dump_json().encode()


def check_url(url: str) -> None:
    """Raise IbridError unless `url` is that of a server, without a name and password, which would
    be stored.
    """
    try:
        parts = urlsplit(url)
        fine = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        (parts.hostname or "").encode(
            "idna"
        )  # as the network asks for it: parts of at most 63 characters
    except ValueError:
        parts, fine = urlsplit(""), False
    names = [name for name, _ in parse_qsl(parts.query, keep_blank_values=True)]
    if parts.username or parts.password or any(name == "key" or is_secret(name) for name in names):
        raise IbridError(
            "a base URL must not hold a password or a key; put it into an environment variable"
        )
    if not fine or not url.isprintable() or " " in url or len(url) > 2_000:
        raise IbridError(
            f"a base URL looks like http://127.0.0.1:8000/v1, found {url!r:.80}; give that of a "
            "server"
        )


def is_secret(name: str) -> bool:
    """Whether a field of this name holds what must not be stored: a key, but no `max_tokens`."""
    return _SECRET.search(name.lower().replace("-", "_")) is not None


def names_within(value: Any) -> Iterator[str]:
    """The names in what JSON can carry, at any depth."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield str(name)
            yield from names_within(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from names_within(inner)


def require_openai() -> Any:
    """The package openai; ChatError when it is not installed."""
    try:
        return importlib.import_module("openai")
    except ImportError:
        raise ChatError(
            "a language model on a server needs the package openai; pip install 'ibrid[llm]'"
        ) from None


def _refused(error: Any, body: Mapping[str, Any]) -> Refusal:
    status, said = error.status_code, _said(error)
    free = (name for name in body if name not in _FIXED and name not in _INSTEAD.values())
    unknown = tuple(name for name in free if name in said) if status in (400, 422) else ()
    if 300 <= status < 400:
        return Refusal(f"sends on to {_elsewhere(error)}{_NOT_FOLLOWED}", status=status)
    sentence = f"answered HTTP {status}{f' ({said})' if said else ''}{_REMEDIES.get(status, '')}"
    return Refusal(
        sentence, status in _AGAIN or status >= 500, _retry_after(error), unknown, status
    )


def _elsewhere(error: Any) -> str:
    """The host that a redirect leads to, or its path on the same one."""
    place = error.response.headers.get("location", "")
    try:
        text = urlsplit(place).netloc.rpartition("@")[2] or place or "nowhere"
    except ValueError:  # no address at all
        text = place
    return "".join(one for one in text[:100] if one.isprintable())


def _said(error: Any) -> str:
    """What a server gives as the reason of an error; pages of HTML say nothing."""
    body = error.body
    if isinstance(body, Mapping):
        inner = body.get("error", body)
        body = inner.get("message", "") if isinstance(inner, Mapping) else inner
    text = body if isinstance(body, str) and "<html" not in body.lower() else ""
    return " ".join("".join(one if one.isprintable() else " " for one in text[:400]).split())[:200]


def _retry_after(error: Any) -> float:
    try:
        return max(0.0, float(error.response.headers.get("retry-after", 0.0)))
    except ValueError:  # a date, or nonsense
        return 0.0


def _cause(error: BaseException) -> str:
    """The innermost reason, cut; an error of openai alone says only 'Connection error.'"""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join((str(error) or type(error).__name__).split())[:200]


MOST_TOOL_CALLS = 32
LONGEST_ARGUMENTS = 100_000
MOST_TOKENS = 10**9


def read_reply(body: bytes, where: str) -> Answer:
    """Read a chat completion; its usage are the counts of the server, as far as they make sense.
    `where` : the model and its server, for messages.

    Raises ChatError when `body` is none.
    """
    try:
        return _read(json.loads(body), where)
    except (ValueError, RecursionError):
        raise ChatError(
            f"{where} sent {_looks_like(body)} in place of JSON; check the base URL, which usually "
            "ends in /v1"
        ) from None


def _read(data: Any, where: str) -> Answer:
    choices = data.get("choices") if isinstance(data, Mapping) else None
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, Mapping) else None
    if not isinstance(choice, Mapping) or not isinstance(message, Mapping):
        raise ChatError(
            f"{where} sent JSON that is no chat completion; check that it serves a chat model"
        )
    thinking = _text(message.get("reasoning_content") or message.get("reasoning"))
    text = _text(message.get("content"))
    whole = f"<think>{thinking}</think>{text}" if thinking else text
    cut = choice.get("finish_reason") == "length" or len(whole) > LONGEST_ANSWER
    return Answer(
        whole[:LONGEST_ANSWER],
        _tool_calls(message.get("tool_calls")),
        _tokens(data.get("usage")),
        cut,
    )


def _looks_like(body: bytes) -> str:
    start = body[:200].lstrip().lower()
    if not start:
        return "nothing"
    return "a web page" if start.startswith((b"<!doctype", b"<html")) else "something else"


def _text(content: Any) -> str:
    """Text of a message, which some servers give in parts; surrogates that no file could hold are
    replaced.
    """
    if isinstance(content, list):
        parts = (one.get("text") for one in content if isinstance(one, Mapping))
        content = "".join(one for one in parts if isinstance(one, str))
    return content.encode("utf-8", "replace").decode("utf-8") if isinstance(content, str) else ""


def _tool_calls(found: Any) -> tuple[ToolCall, ...]:
    calls = []
    for entry in found[:MOST_TOOL_CALLS] if isinstance(found, list) else ():
        function = entry.get("function") if isinstance(entry, Mapping) else None
        if not isinstance(function, Mapping) or not isinstance(function.get("name"), str):
            continue
        arguments = function.get("arguments")
        text = _text(arguments if isinstance(arguments, str) else json.dumps(arguments))
        calls.append(
            ToolCall(
                _text(function["name"])[:64], text[:LONGEST_ARGUMENTS], _text(entry.get("id"))[:100]
            )
        )
    return tuple(calls)


def _tokens(usage: Any) -> dict[str, int]:
    if not isinstance(usage, Mapping):
        return {}
    details = usage.get("completion_tokens_details")
    counts = {
        "prompt_tokens": usage.get("prompt_tokens"),
        "completion_tokens": usage.get("completion_tokens"),
        "thinking_tokens": details.get("reasoning_tokens")
        if isinstance(details, Mapping)
        else None,
    }
    return {
        name: value
        for name, value in counts.items()
        if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_TOKENS
    }
