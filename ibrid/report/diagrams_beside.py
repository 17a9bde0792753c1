"""Block diagrams beside each other where there is room, each as wide as its drawing, with one legend."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagram import FAMILIES, block_diagram_svg
from ibrid.report.markup import escape, paragraph, scroll
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program

WIDEST = "68rem"
#: A title, the diagram, and the names of blocks that get a frame.
Shown = tuple[str, Diagram, tuple[str, ...]]


class DrawnDiagrams(NamedTuple):
    """For the macro `diagrams`. `figures` : (title, SVG, its width in px or ""). `families` : (style, words)."""

    figures: list[tuple[str, Markup, str]]
    families: list[tuple[str, str]]


def drawn_diagrams(shown: Sequence[Shown], kinds: Sequence[ModuleKind]) -> DrawnDiagrams:
    """Some diagrams, drawn; a single one needs no title."""
    figures = []
    for title, diagram, framed in shown:
        svg = block_diagram_svg(diagram, kinds, framed)
        width = re.search(r"max-width:(\d+)px", svg)
        figures.append((title, svg, width[1] if width else ""))
    families = {kind.name: kind.family for kind in kinds}
    used = dict.fromkeys(families.get(block.kind, "unknown") for _, diagram, _ in shown for block in diagram.instances)
    return DrawnDiagrams(figures, [(name.replace(" ", "-"), FAMILIES.get(name, name)) for name in used])


def readable(text: str) -> Diagram | None:
    """The diagram of a program text; None where there is none."""
    try:
        return parse_program(text) if text else None
    except IbridError:
        return None


def diagrams_beside(shown: Sequence[Shown], kinds: Sequence[ModuleKind], note: str = "") -> str:
    """HTML of some diagrams; a single one needs no title. `note` : what their frames mean."""
    figures = "".join(_drawn(words, block_diagram_svg(diagram, kinds, marked)) for words, diagram, marked in shown)
    words = "Thick lines carry a dq pair, thin ones a scalar; circles add; dots are branches."
    legend = _families([diagram for _, diagram, _ in shown], kinds)
    words = f"{words} {note}".rstrip()
    return paragraph(words, "note") + legend + f'<div class="beside">{figures}</div>'


def _drawn(words: str, svg: str) -> str:
    """A figure as wide as its drawing, or narrower where there is no room."""
    width = re.search(r"max-width:(\d+)px", svg)
    room = f"min({width[1]}px,{WIDEST})" if width else "auto"
    style = f"flex:0 1 {room};max-width:{width[1] + 'px' if width else 'none'};flex-grow:1"
    title = f"<figcaption>{escape(words)}</figcaption>" if words else ""
    return f'<figure style="{style}">{title}{scroll(words or "Block diagram", svg)}</figure>'


def _families(diagrams: Sequence[Diagram], kinds: Sequence[ModuleKind]) -> str:
    families = {kind.name: kind.family for kind in kinds}
    used = dict.fromkeys(families.get(one.kind, "unknown") for diagram in diagrams for one in diagram.instances)
    words = "".join(
        f'<li><span class="swatch {escape(name.replace(" ", "-"))}"></span>{escape(FAMILIES.get(name, name))}</li>'
        for name in used
    )
    return f'<ul class="legend">{words}</ul>'
