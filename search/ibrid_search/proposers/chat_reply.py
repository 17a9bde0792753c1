"""The reply of a chat server, read as data: whatever is not as it should be becomes a sentence, or is left out."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ibrid_search.proposers.chat import LONGEST_ANSWER, ChatError, ToolCall

MOST_TOOL_CALLS = 32
LONGEST_ARGUMENTS = 100_000
MOST_TOKENS = 10**9


@dataclass(frozen=True)
class Reply:
    """`text`, `tool_calls`, `cut` : as in Answer. `tokens` : counts of the server, as far as they make sense."""

    text: str
    tool_calls: tuple[ToolCall, ...]
    cut: bool
    tokens: Mapping[str, int]


def read_reply(body: bytes, where: str) -> Reply:
    """Read a chat completion. `where` : the model and its server, for messages.

    Raises ChatError when `body` is none.
    """
    try:
        return _read(json.loads(body), where)
    except (ValueError, RecursionError):
        raise ChatError(
            f"{where} sent {_looks_like(body)} in place of JSON; check the base URL, which usually ends in /v1"
        ) from None


def _read(data: Any, where: str) -> Reply:
    choices = data.get("choices") if isinstance(data, Mapping) else None
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, Mapping) else None
    if not isinstance(choice, Mapping) or not isinstance(message, Mapping):
        raise ChatError(f"{where} sent JSON that is no chat completion; check that it serves a chat model")
    thinking = _text(message.get("reasoning_content") or message.get("reasoning"))
    text = _text(message.get("content"))
    whole = f"<think>{thinking}</think>{text}" if thinking else text
    cut = choice.get("finish_reason") == "length" or len(whole) > LONGEST_ANSWER
    return Reply(whole[:LONGEST_ANSWER], _tool_calls(message.get("tool_calls")), cut, _tokens(data.get("usage")))


def _looks_like(body: bytes) -> str:
    start = body[:200].lstrip().lower()
    if not start:
        return "nothing"
    return "a web page" if start.startswith((b"<!doctype", b"<html")) else "something else"


def _text(content: Any) -> str:
    """Text of a message, which some servers give in parts; surrogates that no file could hold are replaced."""
    if isinstance(content, list):
        parts = (one.get("text") for one in content if isinstance(one, Mapping))
        content = "".join(one for one in parts if isinstance(one, str))
    return content.encode("utf-8", "replace").decode("utf-8") if isinstance(content, str) else ""


def _tool_calls(found: Any) -> tuple[ToolCall, ...]:
    calls = []
    for one in found[:MOST_TOOL_CALLS] if isinstance(found, list) else ():
        function = one.get("function") if isinstance(one, Mapping) else None
        if not isinstance(function, Mapping) or not isinstance(function.get("name"), str):
            continue
        arguments = function.get("arguments")
        text = _text(arguments if isinstance(arguments, str) else json.dumps(arguments))
        calls.append(ToolCall(_text(function["name"])[:64], text[:LONGEST_ARGUMENTS], _text(one.get("id"))[:100]))
    return tuple(calls)


def _tokens(usage: Any) -> dict[str, int]:
    if not isinstance(usage, Mapping):
        return {}
    details = usage.get("completion_tokens_details")
    found = {
        "prompt_tokens": usage.get("prompt_tokens"),
        "completion_tokens": usage.get("completion_tokens"),
        "thinking_tokens": details.get("reasoning_tokens") if isinstance(details, Mapping) else None,
    }
    return {
        name: value
        for name, value in found.items()
        if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_TOKENS
    }
