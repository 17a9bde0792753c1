"""Text of which parts are tables of their own, and text that names its columns above them: blocks
with their own line of names, and LabVIEW's measurement files.
"""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

#: How LabVIEW's files begin, and the end of their heads.
_LABVIEW = "LabVIEW Measurement"
#: Words of a name, and numbers.
_WORDS = re.compile(r"[^\W\d_]{2,}|[^\W\d_]\(")
_NUMBERS = re.compile(r"[-+]?\d*[.,]?\d+(?:[eE][-+]?\d+)?")
#: Most tables of a text.
_MOST = 200
#: How lines of numbers begin.
_NUMERIC = frozenset("0123456789+-.,") | {""}


def labview_named(lines: Sequence[str]) -> list[str]:
    """The lines of a file of LabVIEW, whose names of columns have their units, and whose X_Value is
    called what it is; other lines as they are.
    """
    if not lines or not lines[0].startswith(_LABVIEW):
        return [*lines]
    mark = "," if lines[0][len(_LABVIEW) :].startswith(",") else "\t"
    rows = [line.split(mark) for line in lines[:200]]
    place = next((k for k, row in enumerate(rows) if row[0].strip() == "X_Value"), None)
    if place is None:
        return [*lines]
    said = {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows[:place]}
    first = (said.get("X_Dimension") or ["X_Value"])[0] or "X_Value"
    units = said.get("Y_Unit_Label", [])
    names = [f"{first} [s]" if first == "Time" else first]
    for k, name in enumerate(rows[place][1:]):
        unit = units[k] if k < len(units) else ""
        names.append(f"{name.strip()} [{unit}]" if unit else name.strip())
    if names[-1] in ("Comment", ""):
        names.pop()
    width = len(names)
    head = [line for row, line in zip(rows, lines, strict=False) if len(row) != width]
    own = [
        line for line in head[: place + 1] if not line.startswith(("X_Value", "***", "Y_", "X_"))
    ]
    body = [mark.join(line.split(mark)[:width]) for line in lines[place + 1 :]]
    padding = [""] * (place - len(own))
    return [*padding, *own, mark.join(names), *body]


def blocks_of(lines: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Tables below the same line of names that stands several times: the number of the line before
    the first of each, and its lines behind those that all have in common; one for other text.

    What stands between two tables belongs to the second, and as many lines before the first to it.
    """
    named = Counter(
        line.strip()
        for line in lines
        if line.lstrip()[:1] not in _NUMERIC and len(_WORDS.findall(line)) > 2
    )
    repeated = [line for line, count in named.items() if 1 < count <= _MOST]
    heads = [k for k, line in enumerate(lines) if line.strip() in repeated] if repeated else []
    heads = [k for k in heads if _is_body(lines, k + 1)]
    if len(heads) < 2 or len({lines[k].strip() for k in heads}) > 1:
        return [(0, [*lines])]
    begins = [_begin(lines, k, heads[0]) for k in heads[1:]]
    before, first = heads[1] - begins[0], heads[0]
    begins = [max(0, first - before), *begins, len(lines)]
    shared = [*lines[: begins[0]]]
    return [
        (first - len(shared), [*shared, *lines[first:last]]) for first, last in pairwise(begins)
    ]


def _begin(lines: Sequence[str], head: int, first: int) -> int:
    """Where what belongs to a line of names begins: behind the numbers before it."""
    k = head
    while k > first + 1 and not _is_row(lines[k - 1]):
        k -= 1
    while not lines[k].strip():
        k += 1
    return k


def _is_body(lines: Sequence[str], k: int) -> bool:
    return any(_is_row(line) for line in lines[k : k + 2])


def _is_row(line: str) -> bool:
    return len(_NUMBERS.findall(line)) > 2 and not _WORDS.search(line)
