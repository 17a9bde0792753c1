"""A block diagram on axes of matplotlib, with the layout that pages draw."""

from collections.abc import Sequence
from typing import Any

from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagrams.block_graph import Node, block_graph
from ibrid.report.block_diagrams.drawing import Layout, arrange
from ibrid.report.block_diagrams.layering import header_of, shorten
from ibrid.report.block_diagrams.references import with_references
from ibrid.structure.diagrams.diagram import Diagram

#: Family -> fill of its boxes, the light colours of pages.
FILLS = {
    "physical plant": "#fbe3cf",
    "physical branch": "#f6eebb",
    "dynamic control": "#dbe8f8",
    "synchronisation": "#eadcf5",
    "operating point": "#d9efe4",
    "static": "#eceff2",
    "residual": "#f8dada",
}
#: Of kinds that the vocabulary does not have.
_UNKNOWN = "#fff3c4"
#: Points of a letter for each unit of the drawing, of which letters of 12 are names.
_NAME, _KIND, _PORT = 12.0, 10.5, 9.5
_LINE, _FILL = "#16202c", "#ffffff"


def arranged(diagram: Diagram, vocabulary: Sequence[ModuleKind]) -> Layout:
    """The layout of a diagram with its references."""
    return arrange(with_references(block_graph(diagram, vocabulary), vocabulary))


def draw_diagram(axes: Any, drawing: Layout, points_per_unit: float) -> None:
    """Boxes, sums and wires, thick ones for a dq pair.

    points_per_unit : size on the figure of a unit of the drawing, in points, by which letters are
    scaled.
    """
    for index, net in enumerate(drawing.placement.graph.nets):
        width = (2.2 if net.vector else 1.1) * points_per_unit
        for begin, end in drawing.pieces(index):
            axes.plot([begin[0], end[0]], [begin[1], end[1]], color=_LINE, lw=width, zorder=1)
        for branch in drawing.branches(index):
            axes.add_patch(Circle(branch, 3.2, color=_LINE, zorder=2))
        for pin in net.targets:
            x, y = drawing.end(pin, "inputs")
            tip = [(x, y), (x - 8, y - 3.6), (x - 8, y + 3.6)]
            axes.add_patch(Polygon(tip, color=_LINE, zorder=2))
    for node in drawing.placement.graph.nodes:
        _draw_node(axes, drawing, node, points_per_unit)
    axes.set(xlim=(0, drawing.width), ylim=(drawing.height, 0), aspect="equal")
    axes.set_axis_off()


def _draw_node(axes: Any, drawing: Layout, node: Node, scale: float) -> None:
    left, top, width, height = drawing.boxes[node.name]
    middle = left + width / 2

    def write(x: float, y: float, words: str, size: float, **style: Any) -> None:
        style = {"ha": "center", "va": "center", "parse_math": False, "zorder": 4} | style
        axes.text(x, y, words, fontsize=size * scale, color=_LINE, **style)

    if node.shape == "sum":
        circle = Circle((middle, top + height / 2), height / 2, fc=_FILL, ec=_LINE, zorder=3)
        axes.add_patch(circle)
        for port in node.inputs:
            x, y = drawing.end((node.name, port), "inputs")
            write(x + 6, y, "\N{MINUS SIGN}" if port in node.minus else "+", _NAME)
        return
    fill = FILLS.get(node.family, _UNKNOWN) if node.shape == "module" else _FILL
    rounding = 5 if node.shape == "module" else height / 2 - 0.1
    style = f"round,pad=0,rounding_size={rounding}"
    axes.add_patch(
        FancyBboxPatch(
            (left, top), width, height, boxstyle=style, fc=fill, ec=_LINE, lw=scale, zorder=3
        )
    )
    if node.shape != "module":
        words = shorten(node.kind) if node.shape == "reference" else node.name
        write(middle, top + height / 2, words, _NAME)
        return
    write(middle, top + 13.5, shorten(node.name), _NAME, weight="bold")
    write(middle, top + 28.5, shorten(node.kind), _KIND)
    shape = drawing.placement.shapes[node.name]
    if shape.labelled:
        rule = top + header_of(node) + 2
        axes.plot([left, left + width], [rule, rule], color=_LINE, lw=0.6 * scale, zorder=4)
        for port in node.inputs:
            write(left + 6, top + shape.inputs[port], shorten(port), _PORT, ha="left")
        for port in node.outputs:
            write(left + width - 6, top + shape.outputs[port], shorten(port), _PORT, ha="right")
