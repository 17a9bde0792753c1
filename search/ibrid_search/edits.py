"""SEARCH/REPLACE edits of program text: applying one, making one, and what went wrong when one does
not apply.

Blocks apply in order, each to what the one before left, all or none. Nothing here runs or
interprets the text.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from difflib import SequenceMatcher

from ibrid_search.blocks import (
    EditBlock,
    EditError,
    read_blocks,
    shown,
    split_lines,
    strip_thinking,
    write_block,
)
from ibrid_search.step import Status

__all__ = ["EditError", "apply_edit", "edit_between", "strip_thinking"]

#: Characters of a line, and lines of a program, that are compared to find the most similar one.
LONGEST_ALIKE, MOST_ALIKE = 200, 1500
_STATEMENT = re.compile(r"\w{1,64}\.(?:add|connect)\(")


def apply_edit(edit: str, program: str) -> str:
    """The program after all blocks of `edit`; line ends become line feeds, and the last line has
    one.

    A SEARCH text matches whole lines. When no place has exactly these lines, spacing, quote marks,
    uniform indentation and blank lines at the ends of the block are overlooked, then comments too;
    the replacement takes over the indentation of what it replaces. An empty SEARCH appends at the
    end. Code fences and text around the blocks do not count, and a marker has 5 to 9 characters.

    Raises
    ------
    EditError : NO_EDIT without a whole block, NO_MATCH naming the nearest line, AMBIGUOUS naming
    the lines.
    """
    lines = split_lines(program)
    for block in read_blocks(edit):
        lines = _apply(block, lines)
    return "\n".join(lines) + "\n"


def edit_between(before: str, after: str) -> str:
    """Blocks that turn program text `before` into `after`: the changed lines and what tells their
    place; "" when equal.

    `apply_edit(edit_between(a, b), a) == b` for programs whose lines end in a line feed.
    Raises EditError, NO_EDIT, for a changed line that reads as a marker of a block.
    """
    old, new = split_lines(before), split_lines(after)
    return "\n".join(
        write_block(*_surrounded([*new[:j1], *old[i1:]], j1, i2 - i1, new[j1:j2]))
        for i1, i2, j1, j2 in _changes(old, new)
    )


def _apply(block: EditBlock, lines: list[str]) -> list[str]:
    search = _without_blank_ends(block.search)
    if not search:
        last = next((line for line in reversed(lines) if line.strip()), "")
        return lines + _indented(_without_blank_ends(block.replace), last)
    exact = _places(block.search, lines, str.rstrip)
    if exact:
        begin, end = _only(exact, block)
        replace = block.replace
        if _indent(lines[begin]) and _at_margin(replace):
            replace = _indented(replace, lines[begin])
        return [*lines[:begin], *replace, *lines[end:]]
    for normal in (_spacing_aside, _comments_aside):
        found = _places(search, lines, normal)
        if found:
            begin, end = _only(found, block)
            return [
                *lines[:begin],
                *_indented(_without_blank_ends(block.replace), lines[begin]),
                *lines[end:],
            ]
    raise EditError(Status.NO_MATCH, _no_match(block, search, lines))


def _spacing_aside(line: str) -> str | None:
    return "".join(line.split()).replace("'", '"')


def _comments_aside(line: str) -> str | None:
    """None for a line that holds no statement, so that it is passed over."""
    return "".join(line.partition("#")[0].split()).replace("'", '"') or None


def _places(
    search: Sequence[str], lines: Sequence[str], normal: Callable[[str], str | None]
) -> list[tuple[int, int]]:
    """Half-open ranges of lines that read as `search`, the first few; linear in the length of
    both.
    """
    wanted = [one for one in map(normal, search) if one is not None]
    present = [(number, one) for number, one in enumerate(map(normal, lines)) if one is not None]
    if not any(wanted):
        return []
    text, pattern = (
        "\n" + "\n".join(some) + "\n" for some in ([one for _, one in present], wanted)
    )
    ranges, position, line = [], -1, 0
    while len(ranges) < 6 and (following := text.find(pattern, position + 1)) >= 0:
        line += text.count("\n", max(position, 0), following)
        position = following
        ranges.append((present[line][0], present[line + len(wanted) - 1][0] + 1))
    return ranges


def _only(places: list[tuple[int, int]], block: EditBlock) -> tuple[int, int]:
    if len(places) > 1:
        where = ", ".join(str(begin + 1) for begin, _ in places[:5]) + (
            " and more" if len(places) > 5 else ""
        )
        raise EditError(
            Status.AMBIGUOUS,
            f"block {block.number}: its SEARCH text must be in the program once, but it is there "
            f"at lines {where}; "
            "add the line before or after it to SEARCH and REPLACE",
        )
    return places[0]


def _no_match(block: EditBlock, search: Sequence[str], lines: Sequence[str]) -> str:
    """Which line of the block is not there, and which line of the program comes nearest."""
    present = {_comments_aside(line) for line in lines} | {_spacing_aside(line) for line in lines}
    missing = [
        line for line in search if not {_comments_aside(line), _spacing_aside(line)} & present
    ]
    if not missing:
        return (
            f"block {block.number}: every line of its SEARCH text is in the program, but not one "
            "after another in this "
            f"order (line {_nearest(search[0], lines) + 1} of the program has the first); write a "
            "block for each place"
        )
    at = _nearest(missing[0], lines)
    near = (
        f"line {at + 1} of the program, `{shown(lines[at])}`, is the nearest"
        if lines
        else "the program is empty"
    )
    return (
        f"block {block.number}: `{shown(missing[0])}` is not in the program; {near}; "
        "copy the lines of SEARCH from the program"
    )


def _nearest(line: str, lines: Sequence[str]) -> int:
    """Index of the line most like `line`; looks at bounded lengths and numbers."""
    matcher = SequenceMatcher(None, "", line.strip()[:LONGEST_ALIKE], autojunk=False)
    best, at = -1.0, 0
    for number, one in enumerate(lines[:MOST_ALIKE]):
        matcher.set_seq1(one.strip()[:LONGEST_ALIKE])
        if (
            matcher.real_quick_ratio() > best
            and matcher.quick_ratio() > best
            and (ratio := matcher.ratio()) > best
        ):
            best, at = ratio, number
    return at


def _without_blank_ends(lines: Sequence[str]) -> list[str]:
    written = [number for number, line in enumerate(lines) if line.strip()]
    return list(lines[written[0] : written[-1] + 1]) if written else []


def _indent(line: str) -> str:
    return line[: len(line) - len(line.lstrip())]


def _statements(lines: Sequence[str]) -> list[str]:
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _at_margin(lines: Sequence[str]) -> bool:
    """True for statements of a body that have lost their indentation: in a legal program none
    begins at the margin.
    """
    statements = _statements(lines)
    return bool(statements) and all(_STATEMENT.match(line) for line in statements)


def _indented(lines: Sequence[str], like: str) -> list[str]:
    """The lines shifted together so that the outermost statement stands where `like` does."""
    base = min((len(_indent(line)) for line in _statements(lines)), default=0)
    return [
        _indent(like) + line[min(base, len(_indent(line))) :] if line.strip() else ""
        for line in lines
    ]


def _changes(old: Sequence[str], new: Sequence[str]) -> Iterator[tuple[int, int, int, int]]:
    """Ranges i1:i2 of `old` that become j1:j2 of `new`, from the top."""
    head = 0
    while head < min(len(old), len(new)) and old[head] == new[head]:
        head += 1
    tail = 0
    while tail < min(len(old), len(new)) - head and old[-1 - tail] == new[-1 - tail]:
        tail += 1
    middle = SequenceMatcher(
        None, old[head : len(old) - tail], new[head : len(new) - tail], autojunk=False
    )
    for word, i1, i2, j1, j2 in middle.get_opcodes():
        if word != "equal":
            yield i1 + head, i2 + head, j1 + head, j2 + head


def _surrounded(
    lines: Sequence[str], begin: int, number: int, replace: Sequence[str]
) -> tuple[Sequence[str], list[str]]:
    """SEARCH and REPLACE for `number` lines from `begin`, with neighbours until the place is the
    only one.
    """
    low, high = begin, begin + number
    while low > 0 or high < len(lines):
        search = lines[low:high]
        if any(line.strip() for line in search) and len(_places(search, lines, str.rstrip)) == 1:
            break
        if low > 0 and (begin - low <= high - begin - number or high == len(lines)):
            low -= 1
        else:
            high += 1
    return lines[low:high], [*lines[low:begin], *replace, *lines[begin + number : high]]
