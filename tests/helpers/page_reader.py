"""Reads a page as a browser would: tags, words, and elements that close in order; what every page
must keep to.
"""

import re
from html.parser import HTMLParser

from ibrid.report.look.figure import content_policy, script

#: Bytes that a page may have.
LIMIT = 5_000_000


class Reader(HTMLParser):
    """Collects tags and words, and checks that elements close in order."""

    VOID = ("meta", "link", "br", "img", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert [tag] == self.open[-1:], f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data):
        if self.open[-1:] == ["script"]:
            self.scripts.append(data)
        elif self.open[-1:] != ["style"]:
            self.words.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def self_contained(text: str) -> Reader:
    """Read a page that is well-formed, loads nothing, and can run nothing but the script of the
    zoom.
    """
    assert len(text.encode()) < LIMIT
    reader = Reader(text)
    assert not reader.open
    assert reader.all("script") == [{}]
    assert "".join(reader.scripts) == script()
    policies = [
        one["content"]
        for one in reader.all("meta")
        if one.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policies == [content_policy()]
    assert not re.search(r"@import|url\((?!#)|https?://", text)
    for _, attributes in reader.tags:
        assert not any(name.startswith("on") for name in attributes)
        for name in ("src", "href", "xlink:href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:"))
    names = [attributes["id"] for _, attributes in reader.tags if "id" in attributes]
    assert len(names) == len(set(names))
    wanted = {
        a[key][1:]
        for _, a in reader.tags
        for key in ("href", "xlink:href")
        if (a.get(key) or "")[:1] == "#"
    }
    assert wanted | set(re.findall(r"url\(#([^)]+)\)", text)) <= set(names)
    return reader
