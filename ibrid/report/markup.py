"""The frame of all pages and small pieces of HTML. Every text that comes from a user passes through `escape` here."""

from collections.abc import Iterable, Sequence
from html import escape

from ibrid.report.numbers import error, number
from ibrid.report.style import heat, style_sheet
from ibrid.report.zoom import content_policy, script

#: (id, heading, body) of a part of a page.
Section = tuple[str, str, str]
#: Sections that print on a page of their own, sideways.
WIDE = {"diagram": ' class="wide"'}
#: What stands below every page.
CONVENTIONS = "Written by ibrid. Per unit on the inverter's base; current out of the inverter; q axis leads."


def page(title: str, header: str, sections: Iterable[Section], words: str = "") -> str:
    """A whole document; each section gets an entry in the navigation; `words` follow the conventions in the footer."""
    sections = list(sections)
    links = "".join(f'<li><a href="#{name}">{escape(heading)}</a></li>' for name, heading, _ in sections)
    bodies = "".join(
        f'<section id="{name}" aria-labelledby="{name}-heading"{WIDE.get(name, "")}>'
        f'<h2 id="{name}-heading">{escape(heading)}</h2>{body}</section>\n'
        for name, heading, body in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{content_policy()}">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>{escape(title)} · ibrid</title><style>{style_sheet()}</style></head>\n<body>"
        '<a class="skip" href="#main">Skip to the content</a>\n'
        f'<header>{header}</header>\n<nav aria-label="Sections"><ul>{links}</ul></nav>\n'
        f'<main id="main" tabindex="-1">{bodies}</main>\n<footer>{escape(f"{CONVENTIONS} {words}".strip())}</footer>\n'
        f"<script>{script()}</script></body></html>\n"
    )


def page_header(above: str, title: str, verdict: str, facts: Iterable[tuple[str, str]]) -> str:
    """What a page begins with: what it is about, its title, the answer in a sentence, and facts as (name, HTML)."""
    shown = "".join(f"<div><dt>{escape(name)}</dt><dd>{value}</dd></div>" for name, value in facts)
    return (
        f'<p class="eyebrow">{escape(above)}</p><h1>{escape(title)}</h1>'
        f'<p class="verdict">{escape(verdict)}</p><dl class="facts">{shown}</dl>'
    )


def judged(fine: bool, words: str) -> str:
    """A word in the colour of what is good or bad."""
    return f'<span class="{"good" if fine else "bad"}">{escape(words)}</span>'


def stable_or_not(stable: bool) -> str:
    """Whether something is stable, as a fact."""
    return judged(stable, "stable" if stable else "UNSTABLE")


def cell(text: str, *, numeric: bool = False, wraps: bool = False) -> str:
    """A table cell of plain text, on one line unless it `wraps`."""
    return f"<td{' class=text' if wraps else _attributes(numeric)}>{escape(text)}</td>"


def value_cell(value: float | None, digits: int = 4) -> str:
    """A number, with all its digits for whoever reads the page by machine."""
    return f"<td{_attributes(True)}>{data(value, number(value, digits))}</td>"


def error_cell(value: float | None) -> str:
    """A relative error, shaded."""
    return f"<td{_attributes(True, heat(value))}>{data(value, error(value))}</td>"


def data(value: float | None, text: str) -> str:
    """A shown number that carries its exact value."""
    return escape(text) if value is None else f'<data value="{float(value)!r}">{escape(text)}</data>'


def head(cells: Sequence[str], numeric: Sequence[int] = ()) -> str:
    """The head of a table; `numeric` columns are set flush right."""
    shown = "".join(
        f'<th scope="col"{_attributes(index in numeric)}>{escape(text)}</th>' if text else "<td></td>"
        for index, text in enumerate(cells)
    )
    return f"<thead><tr>{shown}</tr></thead>"


def row(name: str, cells: Iterable[str]) -> str:
    """A table row with its heading."""
    return f'<tr><th scope="row">{escape(name)}</th>{"".join(cells)}</tr>'


def table(label: str, caption: str, inner: str) -> str:
    """A table that scrolls sideways on a narrow screen, also by keyboard."""
    return paragraph(caption, "note caption") + scroll(label, f'<table aria-label="{escape(label)}">{inner}</table>')


def scroll(label: str, inner: str) -> str:
    """Something wide that scrolls, with a name for screen readers."""
    return f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(label)}">{inner}</div>'


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return "<ul>" + "".join(f"<li>{escape(one)}</li>" for one in sentences) + "</ul>"


def numbered(sentences: Iterable[str]) -> str:
    """Sentences in their order."""
    return "<ol>" + "".join(f"<li>{escape(one)}</li>" for one in sentences) + "</ol>"


def folded(title: str, inner: str) -> str:
    """What a reader may unfold; paper shows it unfolded."""
    return f"<details><summary>{escape(title)}</summary>{inner}</details>"


def program(text: str) -> str:
    """A program, or any text that is read line by line."""
    return scroll("Program text", f"<pre><code>{escape(text)}</code></pre>")


def difference_html(lines: Iterable[str]) -> str:
    """Lines of a unified difference, "" where there are none."""
    styles = {"+": "added", "-": "removed"}
    shown = "\n".join(
        f'<span class="{styles[line[0]]}">{escape(line)}</span>' if line[:1] in styles else escape(line)
        for line in lines
    )
    return scroll("Program difference", f"<pre><code>{shown}</code></pre>") if shown else ""


def paragraph(text: str, style: str = "") -> str:
    """A paragraph of plain text."""
    return f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>"


def _attributes(numeric: bool, style: str = "") -> str:
    return (' class="n"' if numeric else "") + (f' style="{style}"' if style else "")
