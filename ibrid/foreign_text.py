"""Text that others wrote, where it leaves the program: a terminal, a page or a spreadsheet shows it
and does not obey it.

Names, comments and cells of files may hold escape sequences of terminals, characters that reverse
the direction of writing, and formulas. Whatever is printed or written passes here on its way out,
so that no reader of files has to remember it.
"""

import csv
import io
import os
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from typing import Any, ParamSpec
from unicodedata import category

P = ParamSpec("P")

#: Unicode categories of characters that act and are not seen: controls, formats (also of
#: direction), halves of surrogate pairs, separators of lines and paragraphs.
ACTING = ("Cc", "Cf", "Cs", "Zl", "Zp")
#: Characters of a word in a sentence.
LONGEST_WORD = 300
_PERHAPS = re.compile(r"[^\n\t -~]")
_SURROGATE = re.compile("[\ud800-\udfff]")
#: How a byte of a file name that is no text is written.
_BYTE = re.compile(r"\\x([89a-f][0-9a-f])")
#: What begins a formula in a spreadsheet; a sign before a number does not.
_FORMULA = re.compile(r"\s*[=+\-@＝＋－＠]")
#: Where one begins behind what parts cells in other countries; what stands there unless it is
#: marked, and the mark.
_AT_FORMULA = r"(?= *(?:[=@＝＠]|[+\-＋－][^\d.]))"
_WITHIN, _MARKED = (re.compile(rf"(?<=[;\t]){mark}{_AT_FORMULA}") for mark in ("", "'"))


def show_controls(text: str) -> str:
    """The text with characters that act written as escapes such as \\x1b; line breaks and tabs
    stay.
    """
    return (
        text
        if text.isascii() and text.isprintable()
        else _PERHAPS.sub(lambda found: _shown(found[0]), text)
    )


def controls_shown(function: Callable[P, str]) -> Callable[P, str]:
    """Let a function whose text others print answer with `show_controls` of it."""

    @wraps(function)
    def shown(*args: P.args, **keywords: P.kwargs) -> str:
        return show_controls(function(*args, **keywords))

    return shown


def show_surrogates(text: str) -> str:
    """The text with halves of surrogate pairs written as escapes, so that it can be encoded."""
    return _SURROGATE.sub(lambda found: _shown(found[0]), text)


def place_shown(text: str) -> str:
    """The name of a file from a text in which bytes that are no text were written as escapes, if
    there is one; else the text.
    """
    if not os.path.isfile(text) and _BYTE.search(text):
        named = _BYTE.sub(lambda found: chr(0xDC00 + int(found[1], 16)), text)
        if os.path.isfile(named):
            return named
    return text


def show_controls_within(content: Any, shown: Callable[[str], str] = show_controls) -> Any:
    """Plain data with every text in it, names too, changed so."""
    if isinstance(content, str):
        return shown(content)
    if isinstance(content, Mapping):
        return {
            show_controls_within(key, shown): show_controls_within(value, shown)
            for key, value in content.items()
        }
    if isinstance(content, list | tuple):
        return [show_controls_within(value, shown) for value in content]
    return content


def cut(text: str, longest: int) -> str:
    """The beginning of a text that is longer, with how long it is."""
    return text if len(text) <= longest else f"{text[: longest // 2]}... ({len(text)} characters)"


def cut_words(text: str) -> str:
    """The text with words of foreign lengths cut."""
    return re.sub(rf"\S{{{LONGEST_WORD + 1},}}", lambda found: cut(found[0], LONGEST_WORD), text)


def csv_text(rows: Iterable[Iterable[object]], notes: Iterable[str] = ()) -> str:
    """Rows as CSV below comment lines; no cell begins a formula, a number stays one.

    notes : lines with their "#". A cell that begins like a formula, or would where semicolons or
    tabs part cells, has a ' before it, as spreadsheets mark text.
    """
    table = io.StringIO()
    table.writelines(f"{_without_formulas(note)}\n" for note in notes)
    csv.writer(table, lineterminator="\n").writerows(
        [_cell(value) for value in row] for row in rows
    )
    return table.getvalue()


def cell_meant(text: str) -> str:
    """A cell without the mark that `csv_text` puts before what begins like a formula."""
    plain = _MARKED.sub("", text)
    return next(
        (
            one
            for one in (plain.removeprefix("'"), plain)
            if _MARKED.sub("", str(_cell(one))) == plain
        ),
        text,
    )


def _cell(value: object) -> object:
    if not isinstance(value, str):
        return value
    text = _WITHIN.sub("'", value)
    return f"'{text}" if _FORMULA.match(value) and not _is_number(value) else text


def _without_formulas(note: str) -> str:
    """A comment whose commas, semicolons and tabs, which begin cells in a spreadsheet, have a '
    where a formula would follow.
    """
    return re.sub(r"([,;\t])(?=[=@＝＠]|[+\-＋－][^\d.])", r"\1 '", note)


def _is_number(text: str) -> bool:
    try:
        complex(text)
    except ValueError:
        return False
    return True


@cache
def _shown(character: str) -> str:
    if "\udc80" <= character <= "\udcff":  # a byte of a file name that is no text
        return f"\\x{ord(character) - 0xDC00:02x}"
    return (
        character.encode("unicode_escape").decode() if category(character) in ACTING else character
    )
