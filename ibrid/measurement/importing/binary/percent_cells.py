"""Cells of a workbook that are shown in percent: 0.8 there is shown as 80 %, and calamine reads
0.8.
"""

import re

import numpy as np

from ibrid.measurement.importing.binary.workbook_parts import (
    opened_workbook,
    said,
    sheet_places,
    tags,
    text_of,
)

_STYLES = "xl/styles.xml"
#: Formats without a code in the file: 0% and 0.00%.
_BUILT_IN = {"9", "10"}
#: What a format code shows as it stands, in which a percent sign scales nothing.
_LITERAL = re.compile(r'"[^"]*"|[\\_*].')
_CELL = re.compile(r"([A-Z]+)(\d+)")


def percent_cells(content: bytes) -> dict[str, np.ndarray]:
    """Name of a sheet -> (n, 2) row, from 1 on, and column, from 0 on, of the numbers that an xlsx
    shows in percent; nothing is said of other workbooks.

    References
    ----------
    ECMA-376, part 1, 18.8.30 (numFmt), 18.8.10 (cellXfs) and 18.3.1.4 (c).
    """
    with opened_workbook(content) as book:
        if book is None or _STYLES not in book.namelist():
            return {}
        styles = _percent_styles(text_of(book, _STYLES))
        if not styles:
            return {}
        cells = {
            name: _cells_in(text_of(book, place), styles)
            for name, place in sheet_places(book).items()
        }
    return {name: places for name, places in cells.items() if len(places)}


def _percent_styles(text: str) -> set[str]:
    """The numbers of the styles of cells whose numbers are shown in percent."""
    codes = {said("numFmtId", tag): said("formatCode", tag) for tag in tags(text, "numFmt")}
    percent = {key for key, code in codes.items() if "%" in _LITERAL.sub("", code)}
    percent |= _BUILT_IN - codes.keys()
    formats = re.search(r"<(?:\w+:)?cellXfs\b.*?</(?:\w+:)?cellXfs>", text, re.DOTALL)
    styles = tags(formats[0], "xf") if formats else []
    return {str(k) for k, style in enumerate(styles) if said("numFmtId", style) in percent}


def _cells_in(text: str, styles: set[str]) -> np.ndarray:
    """(n, 2) row and column of the cells of numbers in some styles; a cell without a place stands
    behind the one before.
    """
    places: list[tuple[int, int]] = []
    row, column = 0, -1
    for tag in tags(text, "row|c"):
        place = _CELL.fullmatch(said("r", tag))
        if place is not None:
            row, column = int(place[2]), _number_of(place[1])
        elif re.match(r"<(?:\w+:)?row\b", tag):
            row, column = int(said("r", tag) or row + 1), -1
            continue
        else:
            column += 1
        if said("s", tag) in styles and said("t", tag) in ("", "n"):
            places.append((row, column))
    return np.array(places, dtype=int).reshape(-1, 2)


def _number_of(letters: str) -> int:
    """The number of a column, from 0 on: A, .., Z, AA, .."""
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1
