"""Rows of a workbook that a filter, or a hand, hides: calamine reads them like the others and does
not say so.
"""

import io
import re
from html import unescape
from zipfile import ZipFile, is_zipfile

_BOOK, _RELATIONS = "xl/workbook.xml", "xl/_rels/workbook.xml.rels"
_HIDDEN = re.compile(r"""\shidden\s*=\s*["'](?:1|true)["']""")


def hidden_rows(content: bytes) -> dict[str, list[str]]:
    """Name of a sheet -> numbers of its hidden rows, of an xlsx; nothing is said of other
    workbooks.

    References
    ----------
    ECMA-376, part 1, 18.3.1.73 (row) and 18.2.19 (sheet).
    """
    if not is_zipfile(io.BytesIO(content)):
        return {}
    with ZipFile(io.BytesIO(content)) as book:
        if not {_BOOK, _RELATIONS} <= {*book.namelist()}:
            return {}
        places = {
            _said("Id", one): _said("Target", one)
            for one in _tags(book, _RELATIONS, "Relationship")
        }
        rows_by_sheet = {}
        for sheet in _tags(book, _BOOK, "sheet"):
            target = places.get(_said("r:id", sheet), "")
            path = target.lstrip("/") if target.startswith("/") else f"xl/{target}"
            if path in book.namelist():
                rows = [_said("r", row) for row in _tags(book, path, "row") if _HIDDEN.search(row)]
                rows_by_sheet[_said("name", sheet)] = rows
    return {name: rows for name, rows in rows_by_sheet.items() if rows}


def _tags(book: ZipFile, path: str, name: str) -> list[str]:
    return re.findall(
        rf"<(?:\w+:)?{name}\s[^<>]*>", book.read(path).decode("utf-8", errors="replace")
    )


def _said(key: str, tag: str) -> str:
    """The value of an attribute, "" where the tag has none."""
    value = re.search(rf"""\s{key}\s*=\s*(?:"([^"]*)"|'([^']*)')""", tag)
    return unescape(value[1] or value[2] or "") if value else ""
