"""A diagram read against a vocabulary: which kind each module is, and what drives each input."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import networkx as nx

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError
from ibrid.frozen import Frozen
from ibrid.modules.behaviour import PLANT, Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import find_kind
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram, Instance
from ibrid.structure.network.outside import NOTHING, Outside

__all__ = [
    "PLANT",
    "Channel",
    "Wiring",
    "channels_of",
    "connected_parts",
    "owner_of",
    "sources_of",
    "split_port",
    "wire",
]

#: "NAME.port" or "v_DQ", and the axis.
Channel = tuple[str, int]


@dataclass(frozen=True, eq=False)
class Wiring(Frozen):
    """Modules with their kinds, and the sources of every input.

    `instances` : as added. `kinds` : instance name -> kind.
    `sources` : "NAME.port" of an input, or the outer port `i_DQ`, -> the outputs (or `v_DQ`) that
    add up there.
    `outside` : what lies between the terminals and the measurement.
    """

    instances: tuple[Instance, ...]
    kinds: Mapping[str, ModuleKind]
    sources: Mapping[str, tuple[str, ...]]
    outside: Outside = NOTHING

    @cached_property
    def plant(self) -> str:
        """Name of the plant; of two devices behind one PCC that of the first."""
        plants = [name for name, kind in self.kinds.items() if kind.family == PLANT]
        if not plants:
            raise DiagramError(
                "the diagram has no plant; add an output filter, which ibrid modules lists"
            )
        return plants[0]

    @cached_property
    def devices(self) -> tuple["Wiring", ...]:
        """The parts of a legal diagram with a plant each, in the order of the plants; the whole
        where there is one plant.

        What is connected to no plant, such as a shunt at the PCC, belongs to the first part.
        """
        plants = [name for name, kind in self.kinds.items() if kind.family == PLANT]
        if len(plants) < 2:
            return (self,)
        edges = [(source, target) for target, sources in self.sources.items() for source in sources]
        part = connected_parts(self.kinds, edges)
        with_plant = {part[plant] for plant in plants}
        owner = {
            name: part[name] if part[name] in with_plant else part[plants[0]] for name in self.kinds
        }
        return tuple(
            self._only({name for name in self.kinds if owner[name] == part[plant]})
            for plant in plants
        )

    def _only(self, names: set[str]) -> "Wiring":
        """The part that consists of these modules and the outer ports."""
        inside = (*names, TERMINAL_VOLTAGE, TERMINAL_CURRENT)
        sources = {
            target: tuple(source for source in sources if owner_of(source) in inside)
            for target, sources in self.sources.items()
            if owner_of(target) in inside
        }
        return replace(
            self,
            instances=tuple(one for one in self.instances if one.name in names),
            kinds={name: kind for name, kind in self.kinds.items() if name in names},
            sources=sources,
        )

    def having(self, *elements: Element, signal: Signal | None = None) -> tuple[str, ...]:
        """Names of the instances that are one of these elements; of one signal if it is given."""
        kinds = self.kinds.items()
        return tuple(
            name
            for name, kind in kinds
            if kind.element in elements and signal in (None, kind.signal)
        )

    def makers(self, port: str, element: Element) -> list[str]:
        """Instances that drive an input and are this element."""
        names = [split_port(source)[0] for source in self.sources.get(port, ())]
        return [name for name in names if name and self.kinds[name].element is element]

    def width(self, port: str) -> int:
        """Number of axes of a port; the outer ones have two."""
        name, inner = split_port(port)
        return {**self.kinds[name].inputs, **self.kinds[name].outputs}[inner].width if name else 2


@takes_kinds
def wire(diagram: Diagram, vocabulary: Sequence[ModuleKind]) -> Wiring:
    """Resolve a diagram that `violations` has found legal; DiagramError at the first unknown kind
    or port.
    """
    kinds = {instance.name: find_kind(instance.kind, vocabulary) for instance in diagram.instances}
    sources: dict[str, tuple[str, ...]] = {TERMINAL_CURRENT: ()}
    outputs = {TERMINAL_VOLTAGE}
    for name, kind in kinds.items():
        sources.update((f"{name}.{port}", ()) for port in kind.inputs)
        outputs.update(f"{name}.{port}" for port in kind.outputs)
    for connection in diagram.connections:
        if connection.target not in sources:
            raise DiagramError(
                f"{connection.target} is no input of this diagram; run ibrid check on the program"
            )
        if connection.source not in outputs:
            raise DiagramError(
                f"{connection.source} is no output of this diagram; run ibrid check on the program"
            )
        sources[connection.target] += (connection.source,)
    return Wiring(diagram.instances, kinds, sources, diagram.outside)


def connected_parts(
    names: Mapping[str, object], edges: Sequence[tuple[str, str]]
) -> dict[str, int]:
    """Number of the part that each module is in; connections to outer ports join nothing."""
    graph = nx.Graph()
    graph.add_nodes_from(names)
    ends = ((split_port(source)[0], split_port(target)[0]) for source, target in edges)
    graph.add_edges_from((one, other) for one, other in ends if one in names and other in names)
    return {
        name: number for number, part in enumerate(nx.connected_components(graph)) for name in part
    }


def channels_of(name: str, ports: Mapping[str, Signal]) -> list[Channel]:
    """The channels of a module's ports, in order."""
    return [
        (f"{name}.{port}", axis) for port, signal in ports.items() for axis in range(signal.width)
    ]


def sources_of(wiring: Wiring, channel: Channel) -> list[Channel]:
    """The output channels that add up in an input channel; an output channel itself."""
    return [(source, channel[1]) for source in wiring.sources.get(channel[0], (channel[0],))]


def split_port(port: str) -> tuple[str, str]:
    """("NAME", "port") of a port; ("", port) of an outer port."""
    name, _, inner = port.rpartition(".")
    return name, inner


def owner_of(port: str) -> str:
    """The module of a port; an outer port is a module of its own."""
    return split_port(port)[0] or port
