"""What a drawing of a diagram shows: boxes for modules, circles for sums, pills for the terminals,
and the nets that join them. A net is one source and all that it drives, so that it can be drawn as
one branching line.

A diagram that the grammar refuses can be drawn too: unknown kinds become boxes with the ports that
are used.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram
from ibrid.structure.network.outside import PORT
from ibrid.structure.reading.wiring import PLANT, split_port

TERMINALS = (TERMINAL_VOLTAGE, TERMINAL_CURRENT)
#: Names of sums begin like this, which no module name can.
SUM = "sum at "
Pin = tuple[str, str]


@dataclass(frozen=True)
class Node:
    """One shape. `shape` : "module", "sum", "terminal" or "reference", of which `kind` is the name.

    `kind`, `family` : words, "" where they do not apply. `minus` : inputs of a sum that are
    subtracted. `values` : lines in the box of a module.
    """

    name: str
    shape: str
    kind: str = ""
    family: str = ""
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    minus: tuple[str, ...] = ()
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Net:
    """`source` drives every one of `targets`, all (node, port).

    `vector` : True for two-channel signals.
    """

    source: Pin
    targets: tuple[Pin, ...]
    vector: bool = True


@dataclass(frozen=True)
class BlockGraph:
    """Shapes in the order of the program, and nets in the order of their first connection."""

    nodes: tuple[Node, ...]
    nets: tuple[Net, ...]

    def node(self, name: str) -> Node:
        """The shape of that name."""
        return next(one for one in self.nodes if one.name == name)


def block_graph(
    diagram: Diagram,
    vocabulary: Sequence[ModuleKind],
    values: Mapping[str, Sequence[str]] | None = None,
    kept: Collection[str] = (),
) -> BlockGraph:
    """Shapes and nets of a diagram, legal or not; an input with several sources gets a sum in
    front.

    A module that only changes a sign is drawn as the minus at a sum, unless it is one of `kept`.
    values : lines for the boxes of modules.
    """
    kinds = {kind.name: kind for kind in vocabulary}
    wires = _wires(diagram)
    sources: dict[str, list[str]] = {}
    for source, target in wires:
        sources.setdefault(target, []).append(source)
    modules = _modules(diagram, wires)
    port = modules.pop(PORT, "")
    negated = _signs(modules, kinds, wires, kept)
    nodes = [
        replace(
            _module(name, kind, kinds.get(kind), wires), values=tuple((values or {}).get(name, ()))
        )
        for name, kind in modules.items()
        if name not in negated
    ]
    nodes += [Node(PORT, "module", port, PLANT, ("v", "i_in"), ("v_in", "i"))] if port else []
    driven: dict[str, list[Pin]] = {}
    for target, given in sources.items():
        pin = _pin(target)
        if pin[0] in negated:
            continue
        if len(given) == 1 and _pin(given[0])[0] not in negated:
            driven.setdefault(given[0], []).append(pin)
            continue
        name = f"{SUM}{target}"
        ports = tuple(str(index) for index in range(len(given)))
        minus = tuple(
            port for source, port in zip(given, ports, strict=True) if _pin(source)[0] in negated
        )
        nodes.append(Node(name, "sum", inputs=ports, outputs=("out",), minus=minus))
        driven[f"{name}.out"] = [pin]
        for source, port in zip(given, ports, strict=True):
            driven.setdefault(negated.get(_pin(source)[0], source), []).append((name, port))
    used = {end for wire in wires for end in wire}
    if TERMINAL_VOLTAGE in used:
        nodes.append(Node(TERMINAL_VOLTAGE, "terminal", outputs=(TERMINAL_VOLTAGE,)))
    if TERMINAL_CURRENT in used:
        nodes.append(Node(TERMINAL_CURRENT, "terminal", inputs=(TERMINAL_CURRENT,)))
    signals = {
        f"{instance.name}.{port}": signal
        for instance in diagram.instances
        if instance.kind in kinds
        for port, signal in {**kinds[instance.kind].inputs, **kinds[instance.kind].outputs}.items()
    }
    nets = tuple(
        Net(_pin(source), tuple(pins), _vector(source, signals)) for source, pins in driven.items()
    )
    return BlockGraph(tuple(nodes), nets)


def _signs(
    modules: Mapping[str, str],
    kinds: Mapping[str, ModuleKind],
    wires: Sequence[tuple[str, str]],
    kept: Collection[str],
) -> dict[str, str]:
    """Module -> what it negates, for those that are drawn as a minus: one source, and no other sign
    before or behind.
    """
    signs = [
        name
        for name, kind in modules.items()
        if kind in kinds and kinds[kind].element is Element.SIGN
    ]
    negated: dict[str, str] = {}
    for name in signs:
        given = [source for source, target in wires if _pin(target)[0] == name]
        taken = [target for source, target in wires if _pin(source)[0] == name]
        around = [_pin(end)[0] for end in (*given, *taken)]
        if (
            name not in kept
            and len(given) == 1
            and taken
            and not any(one in signs for one in around)
        ):
            negated[name] = given[0]
    return negated


def _wires(diagram: Diagram) -> list[tuple[str, str]]:
    """Connections that can be drawn: none into the voltage, out of the current, or twice the
    same.
    """
    pairs = [(one.source, one.target) for one in diagram.connections]
    drawn = [
        pair
        for pair in dict.fromkeys(pairs)
        if pair[0] != TERMINAL_CURRENT and pair[1] != TERMINAL_VOLTAGE
    ]
    if not diagram.outside.elements:
        return drawn
    inner = {TERMINAL_VOLTAGE: f"{PORT}.v_in", TERMINAL_CURRENT: f"{PORT}.i_in"}
    behind = [(inner.get(source, source), inner.get(target, target)) for source, target in drawn]
    return [(TERMINAL_VOLTAGE, f"{PORT}.v"), *behind, (f"{PORT}.i", TERMINAL_CURRENT)]


def _modules(diagram: Diagram, wires: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Instance -> kind, first of a name; instances that only connections mention have the kind
    "?".
    """
    kinds: dict[str, str] = {}
    for instance in diagram.instances:
        kinds.setdefault(instance.name, instance.kind)
    for wire in wires:
        for end in wire:
            name = _pin(end)[0]
            if name not in TERMINALS:
                kinds.setdefault(name, "?")
    if diagram.outside.elements:
        kinds[PORT] = ", ".join(element.kind for element in diagram.outside.elements)
    return kinds


def _module(
    name: str, kind: str, known: ModuleKind | None, wires: Sequence[tuple[str, str]]
) -> Node:
    taken = dict.fromkeys(_pin(target)[1] for _, target in wires if _pin(target)[0] == name)
    given = dict.fromkeys(_pin(source)[1] for source, _ in wires if _pin(source)[0] == name)
    if known is None:
        return Node(name, "module", kind, "unknown", tuple(taken), tuple(given))
    inputs = tuple(dict.fromkeys([*known.inputs, *taken]))
    outputs = tuple(port for port in dict.fromkeys([*known.outputs, *given]) if port in given)
    return Node(name, "module", kind, known.family, inputs, outputs)


def _pin(end: str) -> Pin:
    if end in TERMINALS:
        return end, end
    name, port = split_port(end)
    return (name, port) if name else (port, "")


def _vector(source: str, signals: Mapping[str, Signal]) -> bool:
    """Two channels, as the terminals have; a sum carries what its target takes."""
    port = source.removeprefix(SUM).removesuffix(".out") if source.startswith(SUM) else source
    return signals.get(port, Signal.DQ_VEC).width > 1
