"""The block diagram as an inline SVG: signals flow from left to right; measurements return from the
plant.

Boxes are coloured by family; thick lines carry a dq pair, thin ones a scalar; circles add and
subtract; loops are framed.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

from markupsafe import Markup

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagrams.block_graph import Node, block_graph
from ibrid.report.block_diagrams.drawing import Layout, arrange
from ibrid.report.block_diagrams.layering import LINE, header_of, shorten
from ibrid.report.block_diagrams.loop_frames import loop_frames
from ibrid.report.block_diagrams.marks import AT_BOUND, MARKS, OPEN
from ibrid.report.block_diagrams.references import with_references
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.editing.loops import loops

#: Larger diagrams are not drawn: nobody could read them.
LARGEST = 60
#: Narrower drawings shrink on a telephone rather than scroll.
SMALL = 800


def block_diagram_svg(
    diagram: Diagram,
    vocabulary: Sequence[ModuleKind],
    framed: Collection[str] = (),
    values: Mapping[str, Sequence[str]] | None = None,
) -> Markup:
    """Inline SVG of a diagram, or a paragraph that says why there is none. framed : modules with a
    thick frame. values : lines for the boxes of modules (`values_of`).
    """
    if not diagram.instances:
        return Markup("<p>The program adds no modules, so there is nothing to draw.</p>")
    if len(diagram.instances) > LARGEST:
        return Markup(
            f"<p>The diagram has {len(diagram.instances)} modules; drawings are made of at most "
            f"{LARGEST}.</p>"
        )
    graph = with_references(block_graph(diagram, vocabulary, values, framed), vocabulary)
    drawing = arrange(graph)
    frames = [frame.svg for frame in loop_frames(drawing, loops(diagram, tuple(vocabulary)))]
    parts = [frame for frame, _ in frames]
    parts += [part for index in range(len(graph.nets)) for part in _net(drawing, index)]
    parts += [part for node in graph.nodes for part in _node(drawing, node, node.name in framed)]
    parts += [name for _, name in frames]
    label = (
        f"Block diagram of {len(diagram.instances)} modules; the connections are those of the "
        "program below."
    )
    return Markup(
        f'<svg class="diagram{" small" if drawing.width < SMALL else ""}" role="img" '
        f'aria-label="{escape(label)}" '
        f'viewBox="0 0 {drawing.width:.0f} {drawing.height:.0f}" '
        f'style="max-width:{drawing.width:.0f}px">'
        f"{''.join(parts)}</svg>"
    )


def _net(drawing: Layout, index: int) -> list[str]:
    net = drawing.placement.graph.nets[index]
    path = "".join(
        f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in drawing.pieces(index)
    )
    title = (
        f"{'.'.join(dict.fromkeys(net.source))} to "
        f"{', '.join('.'.join(dict.fromkeys(pin)) for pin in net.targets)}"
    )
    markup = [
        f'<g class="net{" vector" if net.vector else ""}"><title>{escape(title)}</title><path '
        f'd="{path}"/>'
    ]
    markup += [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{3.4 if net.vector else 2.8}"/>'
        for x, y in drawing.branches(index)
    ]
    for pin in net.targets:
        x, y = drawing.end(pin, "inputs")
        markup.append(f'<path class="tip" d="M{x:.1f} {y:.1f}l-8 -3.6v7.2z"/>')
    return [*markup, "</g>"]


def _node(drawing: Layout, node: Node, framed: bool) -> list[str]:
    left, top, width, height = drawing.boxes[node.name]
    middle = left + width / 2
    if node.shape == "sum":
        markup = [f'<circle cx="{middle:.1f}" cy="{top + height / 2:.1f}" r="{height / 2:.1f}"/>']
        for port in node.inputs:
            x, y = drawing.end((node.name, port), "inputs")
            sign = "\u2212" if port in node.minus else "+"
            markup.append(_text(x + 6, y + 4, sign, "sign"))
        return [f'<g class="node sum"><title>{escape(node.name)}</title>', *markup, "</g>"]
    box = f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}"'
    if node.shape == "reference":
        return [
            f'<g class="node reference">{box} rx="11"/>',
            _text(middle, top + 15.0, shorten(node.kind), "name"),
            "</g>",
        ]
    if node.shape == "terminal":
        return [
            f'<g class="node terminal">{box} rx="13"/>',
            _text(middle, top + 17.5, node.name, "name"),
            "</g>",
        ]
    family = node.family.replace(" ", "-") if node.family in FAMILIES else "unknown"
    style = f"node family-{family}{' framed' if framed else ''}"
    markup = [
        f'<g class="{style}"><title>{escape(f"{node.name}: {node.kind}")}</title>{box} rx="5"/>'
    ]
    markup.append(_text(middle, top + 17.5, shorten(node.name), "name"))
    markup.append(_text(middle, top + 32.5, shorten(node.kind), "kind"))
    markup += [
        _marked(_text(middle, top + 32.5 + LINE * number, shorten(line), "value"))
        for number, line in enumerate(node.values, start=1)
    ]
    if drawing.placement.shapes[node.name].labelled:
        markup.append(
            f'<path class="rule" d="M{left:.1f} {top + header_of(node) + 2:.1f}h{width:.1f}"/>'
        )
        for pin_side, x, anchor in (
            ("inputs", left + 6, "start"),
            ("outputs", left + width - 6, "end"),
        ):
            for port in getattr(node, pin_side):
                y = top + getattr(drawing.placement.shapes[node.name], pin_side)[port] + 4
                markup.append(_text(x, y, shorten(port), f"port {anchor}"))
    return [*markup, "</g>"]


#: Families with a colour of their own, and words for the legend.
FAMILIES = {
    "physical plant": "plant",
    "physical branch": "branch beside the plant",
    "dynamic control": "dynamic control",
    "synchronisation": "synchronisation",
    "operating point": "frames and operating point",
    "static": "static",
    "residual": "residual",
}


def _marked(text: str) -> str:
    """Marks behind values in the colour of what needs a look."""
    return re.sub(rf"[{OPEN}{AT_BOUND}]+(?=,|<)", r'<tspan class="mark">\g<0></tspan>', text)


def _text(x: float, y: float, words: str, style: str) -> str:
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>'


@dataclass(frozen=True)
class Shown:
    """A title, a diagram, the names of blocks that get a frame, and the lines in its boxes."""

    title: str
    diagram: Diagram
    framed: tuple[str, ...] = ()
    values: Mapping[str, Sequence[str]] = field(default_factory=dict)


class DrawnDiagrams(NamedTuple):
    """For the macro `diagrams`.

    `figures` : (title, SVG, its width in px or ""). `families` : (style, words). `marks` : (mark
    behind a value, words), of those that are there.
    """

    figures: list[tuple[str, Markup, str]]
    families: list[tuple[str, str]]
    marks: list[tuple[str, str]]


def drawn_diagrams(shown: Sequence[Shown], kinds: Sequence[ModuleKind]) -> DrawnDiagrams:
    """Some diagrams, drawn; a single one needs no title."""
    figures = []
    for one in shown:
        svg = block_diagram_svg(one.diagram, kinds, one.framed, one.values)
        width = re.search(r"max-width:(\d+)px", svg)
        figures.append((one.title, svg, width[1] if width else ""))
    families = {kind.name: kind.family for kind in kinds}
    used = dict.fromkeys(
        families.get(block.kind, "unknown") for one in shown for block in one.diagram.instances
    )
    texts = [line for one in shown for lines in one.values.values() for line in lines]
    return DrawnDiagrams(
        figures,
        [(name.replace(" ", "-"), FAMILIES.get(name, name)) for name in used],
        [(mark, words) for mark, words in MARKS.items() if any(mark in line for line in texts)],
    )


def readable(text: str) -> Diagram | None:
    """The diagram of a program text; None where there is none."""
    try:
        return parse_program(text) if text else None
    except IbridError:
        return None
