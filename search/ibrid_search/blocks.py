"""The text of an edit: SEARCH/REPLACE blocks, read from an answer and written.

    <<<<<<< SEARCH
        g.connect("plant.i_g", "i_DQ")
    =======
        g.connect("plant.e", "gain.in_")
        g.connect("plant.i_g", "i_DQ")
    >>>>>>> REPLACE

Lines are scanned one by one, so that no answer takes long to refuse.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ibrid.errors import IbridError
from ibrid_search.step import Status

LONGEST_EDIT = 100_000  # characters
MOST_BLOCKS = 100

_OPEN = re.compile(r"<{5,9} ?SEARCH", re.IGNORECASE)
_MIDDLE = re.compile(r"={5,9}")
_CLOSE = re.compile(r">{5,9}(?: ?REPLACE)?", re.IGNORECASE)
_MARKERS = {"<<<<<": _OPEN, "=====": _MIDDLE, ">>>>>": _CLOSE}
_FENCE = "```"
_LONGEST_MARKER = 24

_THINK, _THOUGHT = ("<think>", "<thinking>"), ("</think>", "</thinking>")


class EditError(IbridError):
    """An edit that does not apply.

    `status` : NO_EDIT, NO_MATCH or AMBIGUOUS. `reason` : one sentence for the proposer.
    """

    def __init__(self, status: Status, reason: str) -> None:
        super().__init__(status, reason)
        self.status, self.reason = status, reason

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True)
class EditBlock:
    """Lines to find and lines to put there; `number` counts from 1."""

    number: int
    search: tuple[str, ...]
    replace: tuple[str, ...]


def read_blocks(edit: str) -> list[EditBlock]:
    """The blocks of an answer in their order; text around them and code fences do not count.

    A marker has 5 to 9 characters and may be indented. Raises EditError, NO_EDIT, unless there is a
    block and each is whole.
    """
    if len(edit) > LONGEST_EDIT:
        raise EditError(
            Status.NO_EDIT,
            f"an edit has at most {LONGEST_EDIT} characters, found {len(edit)}; write only the "
            "lines that change",
        )
    blocks: list[EditBlock] = []
    parts: list[list[str]] = []  # of the open block: SEARCH, then REPLACE
    begun = 0
    for number, line in enumerate(split_lines(edit), 1):
        marker = _marker(line)
        if marker is _OPEN and not parts:
            parts, begun = [[]], number
        elif marker is _MIDDLE and len(parts) == 1:
            parts.append([])
        elif marker is _CLOSE and len(parts) == 2:
            blocks.append(EditBlock(len(blocks) + 1, tuple(parts[0]), tuple(parts[1])))
            parts = []
        elif marker is not None and parts:
            raise EditError(
                Status.NO_EDIT, _unfinished(begun, len(parts), f"line {number} is `{shown(line)}`")
            )
        elif parts and not line.lstrip().startswith(_FENCE):
            parts[-1].append(line)
    if parts:
        raise EditError(Status.NO_EDIT, _unfinished(begun, len(parts), "the answer ends there"))
    if not 1 <= len(blocks) <= MOST_BLOCKS:
        raise EditError(
            Status.NO_EDIT,
            f"an answer has 1 to {MOST_BLOCKS} SEARCH/REPLACE blocks, found "
            f"{len(blocks) or 'none'}; "
            "write a line <<<<<<< SEARCH, the lines to replace, =======, the new lines and >>>>>>> "
            "REPLACE",
        )
    return blocks


def has_blocks(text: str) -> bool:
    """Whether a text holds whole blocks."""
    try:
        return bool(read_blocks(text))
    except EditError:
        return False


def blocks_alone(text: str) -> str:
    """The blocks without the words around them; the whole text where they cannot be read."""
    try:
        return "\n".join(write_block(one.search, one.replace) for one in read_blocks(text))
    except EditError:
        return text


def write_block(search: Sequence[str], replace: Sequence[str]) -> str:
    """The text of a block; EditError, NO_EDIT, for a line that would read as one of its markers."""
    for line in (*search, *replace):
        if _marker(line) is not None or line.lstrip().startswith(_FENCE):
            raise EditError(
                Status.NO_EDIT,
                f"the line `{shown(line)}` of a program reads as a marker of an edit; take it out "
                "of it",
            )
    return "\n".join(["<<<<<<< SEARCH", *search, "=======", *replace, ">>>>>>> REPLACE"]) + "\n"


def strip_thinking(answer: str) -> tuple[str, str]:
    """What a reasoning model wrote before its answer, and the answer.

    Thinking ends at the last closing think tag, also where the template has swallowed the opening
    one; after an opening tag that nothing closes, all is thinking.
    """
    end = max(answer.rfind(tag) + len(tag) if tag in answer else 0 for tag in _THOUGHT)
    if any(answer.find(tag, end) >= 0 for tag in _THINK):
        return answer, ""
    return answer[:end], answer[end:]


def split_lines(text: str) -> list[str]:
    """Lines without their ends, whatever system wrote them."""
    text = text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n")
    return text.split("\n") if text else []


def shown(line: str) -> str:
    """A line within a sentence: printable, without backticks, cut where it is long."""
    text = "".join(one if one.isprintable() and one != "`" else " " for one in line.strip()[:100])
    return text + ("..." if len(line.strip()) > 100 else "")


def _marker(line: str) -> re.Pattern[str] | None:
    stripped = line.strip()
    pattern = _MARKERS.get(stripped[:5]) if len(stripped) <= _LONGEST_MARKER else None
    return pattern if pattern is not None and pattern.fullmatch(stripped) else None


def _unfinished(begun: int, parts: int, instead: str) -> str:
    wanted = "=======" if parts == 1 else ">>>>>>> REPLACE"
    return (
        f"the block that begins in line {begun} of the answer needs a line {wanted} next, but "
        f"{instead}; finish it"
    )
