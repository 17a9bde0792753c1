"""Text of which parts are tables of their own, and text that names its columns above them: blocks
with their own line of names, and LabVIEW's measurement files.
"""

import re
from collections import Counter
from itertools import pairwise, zip_longest

#: Words of a name.
_WORDS = re.compile(r"[^\W\d_]{2,}|[^\W\d_]\(")
#: How lines of numbers begin.
_NUMERIC = frozenset("0123456789+-.,")


def labview_named(lines: list[str]) -> list[str]:
    """The lines of a file of LabVIEW, whose names of columns have their units, and whose X_Value is
    called what it is; other lines as they are.
    """
    place = next((k for k, one in enumerate(lines[:200]) if one.startswith("X_Value\t")), 0)
    if not lines[0].startswith("LabVIEW Measurement") or not place:
        return lines
    above = lines[:place]
    said = dict(line.split("\t", 1) for line in above if "\t" in line)
    names = lines[place].removesuffix("\tComment").split("\t")
    names[0] = said.get("X_Dimension", "").partition("\t")[0] or names[0]
    units = zip_longest(names, ["", *said.get("Y_Unit_Label", "").split("\t")])
    named = [f"{one} [{unit}]" if unit else one for one, unit in units]
    return [*(f"# {line}" for line in above), "\t".join(named), *lines[place + 1 :]]


def blocks_of(lines: list[str]) -> list[tuple[int, list[str]]]:
    """Tables below one line of names that stands several times: how many lines stand before each,
    and its lines behind those that all have in common; one table for other text.

    What stands between two tables belongs to the second, and as many lines before the first to it.
    """
    begin = [line.lstrip()[:1] for line in lines]
    named = Counter(
        line
        for line in lines
        if line.lstrip()[:1] not in _NUMERIC and len(_WORDS.findall(line)) > 2
    )
    heads = [k for k, line in enumerate(lines) if named[line] > 1]
    heads = [k for k in heads if _NUMERIC & {*begin[k + 1 : k + 3]}]
    if len(heads) < 2 or len({lines[k] for k in heads}) > 1:
        return [(0, lines)]
    begins = []
    for k in heads[1:]:
        while begin[k - 1] not in _NUMERIC:
            k -= 1
        begins.append(k)
    own = sum(map(bool, begin[begins[0] : heads[1]]))
    begins = [max(0, heads[0] - own), *begins, len(lines)]
    shared = lines[: begins[0]]
    return [(k - len(shared), shared + lines[k:end]) for k, end in pairwise(begins)]
