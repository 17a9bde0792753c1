"""What a model wants done, read from its answer: tool calls of the interface, calls written as
JSON, or an edit in text.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from ibrid_search.blocks import has_blocks, shown, strip_thinking
from ibrid_search.chat.chat import Answer
from ibrid_search.proposers.agent_view import paragraph

#: Calls that are read from one answer, and characters of text that are searched for them.
MOST_CALLS, LONGEST_TEXT = 16, 100_000
#: How calls are set apart in text: a code fence, or the tags that several model families were
#: trained on.
_BETWEEN = (("```", "```"), ("<tool_call>", "</tool_call>"))
_DIAGNOSIS, _CHANGE = "diagnosis:", "change:"


@dataclass(frozen=True)
class Call:
    """`arguments` : what the model gave, None when it was no JSON. `id` : of the interface, "" for
    a call in text.
    """

    name: str
    arguments: Any
    id: str = ""


@dataclass(frozen=True)
class Wish:
    """`said` : the answer without thinking.

    `calls` : in order. `edit` : SEARCH/REPLACE blocks in the text, or "". `diagnosis`, `change` :
    the paragraph beside them and the line that says what changes, or "".
    """

    said: str
    calls: tuple[Call, ...] = ()
    edit: str = ""
    diagnosis: str = ""
    change: str = ""


def read_wish(answer: Answer) -> Wish:
    """What an answer asks for; text that asks for nothing has neither calls nor an edit."""
    said = strip_thinking(answer.text)[1].strip()
    native = tuple(
        Call(
            one.name,
            _json(one.arguments) if one.arguments.strip() else {},
            one.id or f"call_{number}",
        )
        for number, one in enumerate(answer.tool_calls[:MOST_CALLS])
    )
    if native:
        return Wish(said, native)
    if has_blocks(said):
        return Wish(said, edit=said, diagnosis=diagnosis_in(said), change=_change_in(said))
    return Wish(said, tuple(islice(_calls_in(said[:LONGEST_TEXT]), MOST_CALLS)))


def diagnosis_in(text: str) -> str:
    """The paragraph that begins with "Diagnosis:", else the longest one outside the blocks and code
    fences.
    """
    lines = [line for line in _prose(text).split("\n") if _after(_CHANGE, line) is None]
    paragraphs = [one for one in map(paragraph, "\n".join(lines).split("\n\n")) if one]
    for one in paragraphs:
        if (found := _after(_DIAGNOSIS, one)) is not None:
            return found
    return max(paragraphs, key=len, default="")


def _change_in(text: str) -> str:
    found = (_after(_CHANGE, line) for line in _prose(text).split("\n"))
    return next((one for one in found if one), "")


def _after(word: str, text: str) -> str | None:
    """What follows a word at the beginning of a text, marks of emphasis aside; None when the word
    is not there.
    """
    start = text[:40].lstrip(" *_#`-").lower()
    if not start.startswith(word):
        return None
    return text[text.lower().index(word) + len(word) :].strip(" *_#`")


def _prose(text: str) -> str:
    """The text without SEARCH/REPLACE blocks and fenced code."""
    kept, inside, fenced = [], False, False
    for line in text[:LONGEST_TEXT].splitlines():
        mark = line.strip()
        if mark.startswith("<<<<<"):
            inside = True
        elif mark.startswith(">>>>>"):
            inside = False
        elif mark.startswith("```"):
            fenced = not fenced
        elif not inside and not fenced:
            kept.append(line)
    return "\n".join(kept)


def _calls_in(text: str) -> Iterator[Call]:
    """Calls written as {"tool": NAME, "arguments": {...}}, alone, fenced or between tags."""
    for piece in (text, *_pieces(text)):
        found = _json(piece.removeprefix("json").strip())
        ones: Sequence[Any] = found if isinstance(found, list) else (found,)
        calls = [call for one in ones[:MOST_CALLS] if (call := _call(one)) is not None]
        if calls:
            yield from calls
            if piece is text:
                return


def _pieces(text: str) -> Iterator[str]:
    for opening, closing in _BETWEEN:
        rest = text
        for _ in range(MOST_CALLS):
            piece, closed, rest = rest.partition(opening)[2].partition(closing)
            if not closed:
                break
            yield piece


def _call(value: Any) -> Call | None:
    if not isinstance(value, Mapping):
        return None
    name = value.get("tool", value.get("name"))
    if name is None and "edit" in value:
        return Call("submit_edit", value)
    arguments = value.get("arguments", value.get("parameters", {}))
    return Call(shown(name)[:60], arguments) if isinstance(name, str) else None


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None
