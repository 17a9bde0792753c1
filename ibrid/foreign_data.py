"""JSON and TOML that others wrote: read, or refused by a ValueError whatever is wrong.

Both know whole numbers of any length, which no float holds and Python does not print: those are
infinite here, as an exponent of 999 is, so that a reader who asks for a finite number has asked for
everything.
"""

import json
import re
import tomllib
from collections import Counter
from math import inf
from pathlib import Path
from typing import Any

#: Digits of a whole number from which on it is a float: all shorter ones can be one.
DIGITS = 300
#: A name of more parts than that, of which the reader of Python takes a space that grows with their
#: square.
_DEEP = re.compile(r"(?:\.[ \t]*[\w\"'-]+[ \t]*){40}(?=[.=\]])")
#: Bytes of a file at most.
LARGEST = 200_000_000


def text_in(path: Path) -> str:
    """The text of a file.

    Raises OSError, and ValueError for a device, a pipe, a file that is too large or no UTF-8.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ValueError("it is a device or a pipe")
    if path.exists() and path.stat().st_size > LARGEST:
        raise ValueError(f"it has more than {LARGEST // 10**6} MB")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ValueError("it is no text in UTF-8") from None


def json_in(text: str | bytes) -> Any:
    """What a text of JSON holds.

    Raises ValueError, also where an object has a name twice, of which Python keeps the last.
    """
    try:
        return json.loads(text, parse_int=_whole, object_pairs_hook=_named_once)
    except RecursionError:
        raise ValueError("its nesting is too deep") from None
    except UnicodeDecodeError:
        raise ValueError("it is no text in UTF-8") from None


def toml_in(text: str) -> dict[str, Any]:
    """What a text of TOML holds. Raises ValueError."""
    if _DEEP.search(text):
        raise ValueError("a name of more than forty parts")
    try:
        return _with_floats(tomllib.loads(text))
    except RecursionError:
        raise ValueError("its nesting is too deep") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # of Python's integers, whose sentence is for programmers
        raise ValueError("a whole number of thousands of digits") from None


def _named_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these names and values."""
    content = dict(pairs)
    if len(content) < len(pairs):
        name = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"the name {name[:40]!r} stands twice in one object, keep one of them")
    return content


def _whole(text: str) -> int | float:
    return int(text) if len(text) <= DIGITS else float(text)


def _with_floats(content: Any) -> Any:
    """The same with whole numbers that are too long for a float as infinite ones."""
    if isinstance(content, dict):
        return {key: _with_floats(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_with_floats(value) for value in content]
    if isinstance(content, int) and abs(content) >= 10**DIGITS:
        return inf if content > 0 else -inf
    return content
