"""Rows of a workbook that a filter, or a hand, hides: calamine reads them like the others and does
not say so.
"""

import re

from ibrid.measurement.importing.binary.workbook_parts import (
    opened_workbook,
    said,
    sheet_places,
    tags,
    text_of,
)

_HIDDEN = re.compile(r"""\shidden\s*=\s*["'](?:1|true)["']""")


def hidden_rows(content: bytes) -> dict[str, list[str]]:
    """Name of a sheet -> numbers of its hidden rows, of an xlsx; nothing is said of other
    workbooks.

    References
    ----------
    ECMA-376, part 1, 18.3.1.73 (row).
    """
    with opened_workbook(content) as book:
        if book is None:
            return {}
        rows_by_sheet = {
            name: [
                said("r", row) for row in tags(text_of(book, place), "row") if _HIDDEN.search(row)
            ]
            for name, place in sheet_places(book).items()
        }
    return {name: rows for name, rows in rows_by_sheet.items() if rows}
