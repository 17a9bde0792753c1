"""A diagram with its modules numbered by its structure alone, and which of its parameters share a
value.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.compiling.canonical import canonical_order
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram, Instance
from ibrid.structure.reading.wiring import split_port, wire

#: A port: number of the module and the port's name; OUTER and v_DQ or i_DQ at the terminals.
Port = tuple[int, str]
#: A free number of a module: its number and the parameter's name.
Slot = tuple[int, str]
OUTER = -1
OUT: Port = (OUTER, TERMINAL_CURRENT)
IN: Port = (OUTER, TERMINAL_VOLTAGE)


@dataclass(frozen=True, eq=False)
class Numbered:
    """A legal diagram whose modules have numbers: i_DQ first, then what drives it, and what drives
    that.

    `names` : of the modules in their order. `kinds` : of the same. `sources` : input port -> what
    adds up there, in order.
    `owner` : free parameter -> the first parameter that has the same value by name, itself when it
    is alone.
    """

    diagram: Diagram
    names: tuple[str, ...]
    kinds: tuple[ModuleKind, ...]
    sources: Mapping[Port, tuple[Port, ...]]
    owner: Mapping[Slot, Slot]

    @cached_property
    def instances(self) -> tuple[Instance, ...]:
        """The modules in their order."""
        by_name = {one.name: one for one in self.diagram.instances}
        return tuple(by_name[name] for name in self.names)

    @cached_property
    def place(self) -> dict[str, int]:
        """Name -> number."""
        return {name: number for number, name in enumerate(self.names)}


def numbered(diagram: Diagram, vocabulary: Vocabulary, *, equilibrium: str = "exact") -> Numbered:
    """Number the modules of a legal diagram; the same for diagrams that differ in names and order
    of lines alone.

    Breadth first from i_DQ against the wires; among the sources of one input by kind, then by
    canonical order. Modules without a way to i_DQ come last.
    """
    wiring = wire(diagram, vocabulary)
    rank = {
        name: index
        for index, name in enumerate(canonical_order(diagram, vocabulary, equilibrium=equilibrium))
    }

    def weight(source: str) -> tuple[str, int, str]:
        name, port = split_port(source)
        return (wiring.kinds[name].name, rank[name], port) if name else ("", -1, port)

    inputs = {
        name: [f"{name}.{port}" for port in kind.inputs] for name, kind in wiring.kinds.items()
    }
    order: dict[str, None] = {}
    waiting = [TERMINAL_CURRENT]
    for target in waiting:
        for source in sorted(wiring.sources[target], key=weight):
            name = split_port(source)[0]
            if name and name not in order:
                order[name] = None
                waiting += inputs[name]
    order |= dict.fromkeys(
        sorted((name for name in wiring.kinds if name not in order), key=rank.__getitem__)
    )
    place = {name: number for number, name in enumerate(order)}

    def port(end: str) -> Port:
        name, inner = split_port(end)
        return (place[name] if name else OUTER), inner

    names = tuple(order)
    sources = {
        port(target): tuple(sorted(map(port, found))) for target, found in wiring.sources.items()
    }
    return Numbered(
        diagram,
        names,
        tuple(wiring.kinds[name] for name in names),
        sources,
        _owners(diagram, wiring.kinds, names),
    )


def _owners(
    diagram: Diagram, kinds: Mapping[str, ModuleKind], names: tuple[str, ...]
) -> dict[Slot, Slot]:
    bindings = {one.name: one.bindings for one in diagram.instances}
    first: dict[str, Slot] = {}
    owner: dict[Slot, Slot] = {}
    for number, name in enumerate(names):
        for parameter in kinds[name].parameters:
            bound = bindings[name].get(parameter, f"{name}.{parameter}")
            shared = bound if isinstance(bound, str) else f"{name}.{parameter}"
            if isinstance(bound, float):
                continue
            owner[number, parameter] = first.setdefault(shared, (number, parameter))
    return owner
