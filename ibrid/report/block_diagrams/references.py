"""References that a linear model has lost, drawn where a controller compares them with what it
measures.

A constant adds nothing to small signals, so that a program does not have it; in a drawing a
regulator without one seems to have nothing to follow. A reference stands at the input of an outer
regulator, and of a gain that takes power or the size of a voltage (a droop), where nothing else
that arrives is the answer of another regulator.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagrams.block_graph import SUM, BlockGraph, Net, Node, Pin

#: Names of references begin like this, which no module name can; the input follows.
REFERENCE = "reference at "
#: The input of a sum, or of a block, at which a reference arrives.
PORT = "reference"
_MEASURING = (Element.POWER, Element.FILTER, Element.DC_LINK)
_REGULATORS = (Element.PI, Element.INTEGRATOR)
#: Blocks that pass on what they get, in another form.
_PASSING = (
    Element.LOW_PASS,
    Element.HOLD,
    Element.NOTCH,
    Element.PADE,
    Element.DELAY,
    Element.BAND_PASS,
    Element.POSITIVE_SEQUENCE,
    Element.SLICE_D,
    Element.SLICE_Q,
    Element.ROTATION_IN,
)
#: What a signal may be the size of.
_SIZES = (Element.POWER, Element.MAGNITUDE)
#: What a controller holds at zero: the voltage across the axis of a PLL.
_AT_ZERO = ("e_q",)


def with_references(graph: BlockGraph, vocabulary: Sequence[ModuleKind]) -> BlockGraph:
    """The graph with a node, shape "reference", for each reference; a junction is put in front of
    an input that has none.
    """
    kinds = {kind.name: kind for kind in vocabulary}
    paths = _Paths(graph, kinds)
    for node in graph.nodes:
        kind = kinds.get(node.kind)
        if kind is None:
            continue
        if kind.element is Element.REFERENCE:
            graph = _joined(graph, (node.name, PORT), "p_ref, q_ref")
        elif len(node.inputs) == 1 and (name := paths.reference_of(node, kind)):
            graph = _compared(graph, (node.name, node.inputs[0]), name, _is_vector(kind))
    return graph


class _Paths:
    """Where the signals of a graph come from."""

    def __init__(self, graph: BlockGraph, kinds: Mapping[str, ModuleKind]) -> None:
        self._nodes = {node.name: node for node in graph.nodes}
        self._sources = {pin: net.source for net in graph.nets for pin in net.targets}
        self._kinds = kinds

    def reference_of(self, node: Node, kind: ModuleKind) -> str:
        """What a block follows, "" where it has no reference of its own."""
        arriving = self._arriving((node.name, node.inputs[0]))
        measured = [name for pin in arriving if (name := self._measured(pin))]
        if not measured or measured[0] in _AT_ZERO:
            return ""
        if kind.element in _REGULATORS:
            others = [pin for pin in arriving if not self._measured(pin)]
            return "" if any(map(self._regulated, others)) else f"{measured[0]}_ref"
        droop = kind.element is Element.GAIN and len(arriving) == len(measured) == 1
        size = droop and self._is_size(arriving[0])
        return f"{measured[0]}_ref" if size else ""

    def _arriving(self, pin: Pin) -> list[Pin]:
        """The sources of an input, those of a sum in front of it."""
        source = self._sources.get(pin)
        if source is None:
            return []
        node = self._nodes[source[0]]
        if node.shape != "sum":
            return [source]
        inputs = ((node.name, port) for port in node.inputs)
        return [self._sources[one] for one in inputs if one in self._sources]

    def _back(
        self, pin: Pin, passing: Sequence[Element] = (*_PASSING, Element.MAGNITUDE)
    ) -> tuple[Element | None, Pin]:
        """The block behind filters and the like that a signal comes from, None for no block."""
        seen: set[str] = set()
        while (kind := self._kinds.get(self._nodes[pin[0]].kind)) is not None:
            before = self._sources.get((pin[0], self._nodes[pin[0]].inputs[0]))
            if kind.element not in passing or before is None or pin[0] in seen:
                return kind.element, pin
            seen.add(pin[0])
            pin = before
        return None, pin

    def _measured(self, pin: Pin) -> str:
        """The quantity that a signal measures, "" for another one."""
        element, (_, port) = self._back(pin)
        if element not in _MEASURING:
            return ""
        return {"e": "v", "i_g": "i", "i_ti": "i"}.get(port, port)

    def _regulated(self, pin: Pin) -> bool:
        """Whether a signal is the answer of another controller, so that it is the reference."""
        element, (name, _) = self._back(pin)
        if element is not Element.GAIN:
            return True
        return not self._arriving((name, self._nodes[name].inputs[0]))

    def _is_size(self, pin: Pin) -> bool:
        """Whether a signal is a power or the size of a voltage, also behind filters."""
        return self._back(pin, _PASSING)[0] in _SIZES


def _is_vector(kind: ModuleKind) -> bool:
    return next(iter(kind.inputs.values())).width > 1


def _joined(graph: BlockGraph, pin: Pin, words: str) -> BlockGraph:
    """With a reference at an input of its own."""
    name = f"{REFERENCE}{pin[0]}"
    nodes = [
        replace(node, inputs=(*node.inputs, pin[1])) if node.name == pin[0] else node
        for node in graph.nodes
    ]
    reference = Node(name, "reference", kind=words, outputs=("out",))
    return BlockGraph((*nodes, reference), (*graph.nets, Net((name, "out"), (pin,), True)))


def _compared(graph: BlockGraph, pin: Pin, words: str, vector: bool) -> BlockGraph:
    """With a reference at the sum in front of an input, of the opposite sign of what is there."""
    name, junction = f"{REFERENCE}{'.'.join(pin)}", f"{SUM}{'.'.join(pin)}"
    reference = Node(name, "reference", kind=words, outputs=("out",))
    nodes, nets = list(graph.nodes), list(graph.nets)
    if any(node.name == junction for node in nodes):
        place = next(k for k, node in enumerate(nodes) if node.name == junction)
        there = nodes[place]
        minus = there.minus if there.minus else (PORT,)
        nodes[place] = replace(there, inputs=(PORT, *there.inputs), minus=minus)
    else:
        place = next(k for k, net in enumerate(nets) if pin in net.targets)
        targets = tuple((junction, "0") if one == pin else one for one in nets[place].targets)
        nets[place] = replace(nets[place], targets=targets)
        nodes.append(Node(junction, "sum", inputs=(PORT, "0"), outputs=("out",), minus=(PORT,)))
        nets.append(Net((junction, "out"), (pin,), vector))
    nets.append(Net((name, "out"), ((junction, PORT),), vector))
    return BlockGraph((*nodes, reference), tuple(nets))
