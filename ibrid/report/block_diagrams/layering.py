"""Where the shapes of a drawing go: columns from left to right along the signal flow, heights
within a column.

The plant closes every loop, so the way back from it to the controller counts as feedback; the rest
is layered as far to the right as its consumers allow. Heights follow the neighbours (least squares
with separation), then straighten lines.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np

from ibrid.report.block_diagrams.block_graph import BlockGraph, Net, Node, Pin
from ibrid.structure.reading.wiring import PLANT

#: Of pins of a block, or of the tops of blocks, by name.
Heights = Mapping[str, float]
#: Lengths in drawing units, of which a line of text takes about 12.
PORT_PITCH, HEADER, LINE, GAP = 16.0, 36.0, 13.0, 26.0
BOLD, PLAIN, SMALL = 7.3, 6.3, 5.7  # widths of a character
LONGEST = 22


@dataclass(frozen=True)
class NodeShape:
    """Size of a node and the height of each pin below its top."""

    width: float
    height: float
    inputs: Heights
    outputs: Heights
    labelled: bool = False


#: Of the blocks, by name.
Shapes = Mapping[str, NodeShape]


@dataclass(frozen=True)
class Placement:
    """Column and top (drawing units, downwards) of every node, with its shape."""

    graph: BlockGraph
    shapes: Shapes
    column: Mapping[str, int]
    top: Heights

    @property
    def columns(self) -> int:
        """Number of columns."""
        return max(self.column.values()) + 1

    def height_of(self, pin: Pin, side: str) -> float:
        """Height of a pin; `side` is "inputs" or "outputs"."""
        return self.top[pin[0]] + getattr(self.shapes[pin[0]], side)[pin[1]]


def shorten(text: str) -> str:
    """A name short enough for a box."""
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def shape(node: Node) -> NodeShape:
    """Size and pins; pins carry labels where a side has several."""
    if node.shape == "sum":
        spacing = 13.0
        radius = max(13.0, spacing * len(node.inputs) / 2 + 3)
        inputs = {
            port: radius + (i - (len(node.inputs) - 1) / 2) * spacing
            for i, port in enumerate(node.inputs)
        }
        return NodeShape(2 * radius, 2 * radius, inputs, {"out": radius})
    if node.shape == "reference":
        width = max(PLAIN * len(shorten(node.kind)) + 18, 44.0)
        return NodeShape(width, 22.0, {}, dict.fromkeys(node.outputs, 11.0))
    if node.shape == "terminal":
        return NodeShape(
            54.0, 26.0, dict.fromkeys(node.inputs, 13.0), dict.fromkeys(node.outputs, 13.0)
        )
    labelled = len(node.inputs) > 1 or len(node.outputs) > 1
    lines = [PLAIN * len(shorten(line)) for line in (node.kind, *node.values)]
    width = max(BOLD * len(shorten(node.name)), *lines, 40.0) + 16
    header = header_of(node)
    if not labelled:
        height = header + 6.0
        return NodeShape(
            width,
            height,
            dict.fromkeys(node.inputs, height / 2),
            dict.fromkeys(node.outputs, height / 2),
        )
    rows = max(len(node.inputs), len(node.outputs))
    ports = sum(
        SMALL * max((len(shorten(port)) for port in side), default=0)
        for side in (node.inputs, node.outputs)
    )
    height = header + rows * PORT_PITCH + 4
    inputs, outputs = _down(node.inputs, header), _down(node.outputs, header)
    return NodeShape(max(width, ports + 30), height, inputs, outputs, labelled=True)


def header_of(node: Node) -> float:
    """Height of name, kind and values."""
    return HEADER + LINE * len(node.values)


def _down(ports: Sequence[str], header: float) -> dict[str, float]:
    return {port: header + (index + 0.5) * PORT_PITCH for index, port in enumerate(ports)}


def place(graph: BlockGraph, seed: int = 0) -> Placement:
    """Columns and heights of all nodes; `seed` shuffles the order from which the search for few
    crossings begins.
    """
    shapes = {node.name: shape(node) for node in graph.nodes}
    flow = _forward_flow(graph)
    forward = [
        (source, target)
        for source, target in _pairs(graph.nets)
        if flow.has_edge(source[0], target[0])
    ]
    layers = list(
        nx.topological_generations(flow.reverse())
    )  # as far to the right as the consumers of a node allow
    column = {name: index for index, layer in enumerate(reversed(layers)) for name in layer}
    order = [node.name for node in graph.nodes]
    if seed:
        np.random.default_rng(seed).shuffle(order)
    return Placement(graph, shapes, column, _heights(order, shapes, column, forward))


def _pairs(nets: Sequence[Net]) -> list[tuple[Pin, Pin]]:
    return [(net.source, target) for net in nets for target in net.targets]


def _forward_flow(graph: BlockGraph) -> nx.DiGraph:
    """The nodes and their edges without those that close loops, the plant's first."""
    flow = nx.DiGraph()
    flow.add_nodes_from(node.name for node in graph.nodes)
    flow.add_edges_from((source[0], target[0]) for source, target in _pairs(graph.nets))
    for plant in (node.name for node in graph.nodes if node.family == PLANT):
        upstream = nx.ancestors(flow, plant) | {plant}
        flow.remove_edges_from(
            [(plant, name) for name in list(flow.successors(plant)) if name in upstream]
        )
    while not nx.is_directed_acyclic_graph(flow):
        flow.remove_edge(*nx.find_cycle(flow)[-1][:2])
    return flow


def _heights(
    order: Sequence[str],
    shapes: Shapes,
    column: Mapping[str, int],
    forward: Sequence[tuple[Pin, Pin]],
) -> dict[str, float]:
    layers = [
        [name for name in order if column[name] == index]
        for index in range(max(column.values()) + 1)
    ]
    top = {name: 100.0 * rank for layer in layers for rank, name in enumerate(layer)}
    wishes = _Wishes(shapes, forward)
    for sweep in range(12):
        for layer in layers if sweep % 2 else layers[::-1]:
            wanted = {name: wishes.mean(name, top, both=sweep > 3) for name in layer}
            layer.sort(key=lambda name: wanted[name] + shapes[name].height / 2)
            _separate(layer, wanted, shapes, top)
    for layer in layers[::-1]:
        for direction in (-1, 1):
            _straighten(layer, direction, wishes, shapes, top)
    lowest = min(top.values())
    return {
        name: float(round(value - lowest)) for name, value in top.items()
    }  # whole units: no invisible steps


class _Wishes:
    """Tops at which a node's lines would be straight."""

    def __init__(self, shapes: Shapes, forward: Sequence[tuple[Pin, Pin]]) -> None:
        self.after: dict[str, list[tuple[str, float]]] = {name: [] for name in shapes}
        self.before: dict[str, list[tuple[str, float]]] = {name: [] for name in shapes}
        for source, target in forward:
            offset = shapes[target[0]].inputs[target[1]] - shapes[source[0]].outputs[source[1]]
            self.after[source[0]].append((target[0], offset))
            self.before[target[0]].append((source[0], -offset))

    def mean(self, name: str, top: Heights, both: bool) -> float:
        """Mean over the neighbours; with `both`, on both sides."""
        near = self.after[name] + (self.before[name] if both or not self.after[name] else [])
        return sum(top[other] + offset for other, offset in near) / len(near) if near else top[name]

    def first(self, name: str, top: Heights) -> float:
        """For the first neighbour downstream."""
        return next((top[other] + offset for other, offset in self.after[name]), top[name])


def _separate(
    layer: Sequence[str],
    wanted: Heights,
    shapes: Shapes,
    top: dict[str, float],
) -> None:
    """Least-squares heights in the given order, at least GAP apart (pool adjacent violators)."""
    floor, blocks = 0.0, []
    shifts = {}
    for name in layer:
        shifts[name] = floor
        blocks.append(([name], wanted[name] - floor))
        floor += shapes[name].height + GAP
        while len(blocks) > 1 and blocks[-2][1] > blocks[-1][1]:
            names, value = blocks.pop()
            others, other = blocks.pop()
            count = len(names) + len(others)
            blocks.append((others + names, (value * len(names) + other * len(others)) / count))
    for names, value in blocks:
        top.update({name: value + shifts[name] for name in names})


def _straighten(
    layer: Sequence[str],
    direction: int,
    wishes: _Wishes,
    shapes: Shapes,
    top: dict[str, float],
) -> None:
    """Move each node, as far as its neighbours in the column allow, to where its first line
    downstream is straight.
    """
    for index, name in list(enumerate(layer))[::direction]:
        above, below = -np.inf, np.inf
        if index:
            above = top[layer[index - 1]] + shapes[layer[index - 1]].height + GAP
        if index + 1 < len(layer):
            below = top[layer[index + 1]] - GAP - shapes[name].height
        top[name] = max(above, min(wishes.first(name, top), below))
