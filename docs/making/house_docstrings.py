"""Docstrings as this project writes them, for Sphinx: `name : words` lines, underlined headings,
`code` in one backtick.

They are made for reading in the source, so stars, bars and underscores in laws mean themselves.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Any

_NAMES = r"`?\*{0,2}\w+`?(?:, `?\*{0,2}\w+`?)*"
#: A line that says what an argument or a field is; further lines of it are indented. The next may
#: begin in the same one.
_ITEM = re.compile(rf"({_NAMES}) : (.*)")
_NEXT = re.compile(rf"(?<=[.;)]) (?={_NAMES} : )")
_CODE = re.compile(r"``?([^`]+)``?")
_MARKUP = re.compile(r"([\\*_|`])")


def setup(app: Any) -> dict[str, bool]:
    """What Sphinx calls."""
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True}


def _process(app: Any, what: str, name: str, of: Any, options: Any, lines: list[str]) -> None:
    lines[:] = restructured(lines)


def restructured(lines: Sequence[str]) -> list[str]:
    """The lines of a docstring as reStructuredText."""
    return list(_restructured([line.rstrip() for line in lines]))


def _restructured(lines: Sequence[str]) -> Iterator[str]:
    quoted, number = False, 0
    while number < len(lines):
        line, after = lines[number], lines[number + 1] if number + 1 < len(lines) else ""
        number += 1
        if after and set(after) == {"-"}:
            yield from (f"**{line}**", "")
            number += 1
        elif _ITEM.match(line):
            yield ""
            while number <= len(lines) and _ITEM.match(line):
                words = [line]
                while number < len(lines) and lines[number].startswith(" "):
                    words.append(lines[number].strip())
                    number += 1
                yield from _items(" ".join(words))
                line = lines[number] if number < len(lines) else ""
                number += 1
            number -= 1
            yield ""
        elif line.startswith(" ") and not quoted:
            yield from ("::", "", line)
            quoted = True
        else:
            quoted = quoted and (not line or line.startswith(" "))
            yield line if quoted else escaped(line)


def _items(text: str) -> Iterator[str]:
    """What may be several of them on one line, `sweep : the data. seed : of the starts`, each as an
    item of a list.
    """
    for one in _NEXT.split(text):
        if found := _ITEM.match(one):
            names = ", ".join(f"``{name}``" for name in found[1].replace("`", "").split(", "))
            yield f"- {names}: {escaped(found[2])}"


def escaped(text: str) -> str:
    """Words with `code`, everything else meaning itself."""
    parts, end = [], 0
    for found in _CODE.finditer(text):
        parts += [_MARKUP.sub(r"\\\1", text[end : found.start()]), f"``{found[1]}``"]
        if text[found.end() : found.end() + 1].isalnum():
            parts.append("\\ ")
        end = found.end()
    return "".join([*parts, _MARKUP.sub(r"\\\1", text[end:])])
