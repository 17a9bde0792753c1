"""The XML files in an xlsx workbook, and their tags."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import unescape
from io import BytesIO
from zipfile import ZipFile, is_zipfile

_BOOK, _RELATIONS = "xl/workbook.xml", "xl/_rels/workbook.xml.rels"


@contextmanager
def opened_workbook(content: bytes) -> Iterator[ZipFile | None]:
    """An xlsx as the archive that it is; None for other workbooks."""
    if not is_zipfile(BytesIO(content)):
        yield None
        return
    with ZipFile(BytesIO(content)) as book:
        yield book if {_BOOK, _RELATIONS} <= {*book.namelist()} else None


def sheet_places(book: ZipFile) -> dict[str, str]:
    """Name of a sheet -> its file in the workbook.

    References
    ----------
    ECMA-376, part 1, 18.2.19 (sheet).
    """
    targets = {
        said("Id", tag): said("Target", tag)
        for tag in tags(text_of(book, _RELATIONS), "Relationship")
    }
    places = {}
    for sheet in tags(text_of(book, _BOOK), "sheet"):
        target = targets.get(said("r:id", sheet), "")
        place = target.lstrip("/") if target.startswith("/") else f"xl/{target}"
        if place in book.namelist():
            places[said("name", sheet)] = place
    return places


def text_of(book: ZipFile, place: str) -> str:
    return book.read(place).decode("utf-8", errors="replace")


def tags(text: str, names: str) -> list[str]:
    """The tags with attributes of a name, or of one of several such as `row|c`, in their order."""
    return re.findall(rf"<(?:\w+:)?(?:{names})\s[^<>]*>", text)


def said(key: str, tag: str) -> str:
    """The value of an attribute, "" where the tag has none."""
    value = re.search(rf"""\s{key}\s*=\s*(?:"([^"]*)"|'([^']*)')""", tag)
    return unescape(value[1] or value[2] or "") if value else ""
