"""Block diagrams beside each other where there is room, each as wide as its drawing, with one legend."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagram import FAMILIES, block_diagram_svg
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program

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
