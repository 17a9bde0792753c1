"""A diagram being edited: modules and wires added, bypassed and removed, then tidied into a whole
again.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

import networkx as nx

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary, usual_kind
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import (
    TERMINAL_CURRENT,
    TERMINAL_VOLTAGE,
    Binding,
    Connection,
    Diagram,
    Instance,
)
from ibrid.structure.reading.wiring import owner_of, split_port


class Draft:
    """A working copy of a diagram.

    Ports are "NAME.port" or an outer port; nothing is checked until it is parsed again.
    """

    def __init__(self, diagram: Diagram, kinds: Vocabulary) -> None:
        self.name, self.outside = diagram.name, diagram.outside
        self.vocabulary = {kind.name: kind for kind in kinds}
        self.instances: dict[str, Instance] = {one.name: one for one in diagram.instances}
        self.wires: list[tuple[str, str]] = [
            (one.source, one.target) for one in diagram.connections
        ]

    def diagram(self) -> Diagram:
        """The diagram as it stands."""
        done = Diagram(self.name)
        done.outside = self.outside
        done.extend(
            self.instances.values(), [Connection(source, target) for source, target in self.wires]
        )
        return done

    # --- looking
    # ------------------------------------------------------------------------------------------

    def kind(self, name: str) -> ModuleKind:
        """Declaration of a module's kind."""
        return self.vocabulary[self.instances[name].kind]

    def named(self, *kinds: str) -> list[str]:
        """Modules of some kinds, in order."""
        return [name for name, one in self.instances.items() if one.kind in kinds]

    def having(self, *elements: Element, signal: Signal | None = None) -> list[str]:
        """Modules that are one of these elements, in order; of one signal if it is given."""
        kinds = ((name, self.kind(name)) for name in self.instances)
        return [
            name
            for name, kind in kinds
            if kind.element in elements and signal in (None, kind.signal)
        ]

    def usual(self, element: Element, signal: Signal | None = None) -> str:
        """Name of the kind that a new block of this element gets in this vocabulary."""
        return usual_kind(element, signal, tuple(self.vocabulary.values())).name

    def sources(self, target: str) -> list[str]:
        """What drives an input."""
        return [source for source, to in self.wires if to == target]

    def targets(self, source: str) -> list[str]:
        """What an output drives."""
        return [to for start, to in self.wires if start == source]

    def signal(self, port: str) -> Signal:
        """What a port carries."""
        name, inner = split_port(port)
        if not name:
            return Signal.DQ_VEC
        kind = self.kind(name)
        return kind.outputs[inner] if inner in kind.outputs else kind.inputs[inner]

    def outputs(self, signal: Signal) -> list[str]:
        """All sources of a signal, the terminal voltage included."""
        found = [TERMINAL_VOLTAGE] if signal is Signal.DQ_VEC else []
        return found + [
            f"{name}.{port}"
            for name in self.instances
            for port, carried in self.kind(name).outputs.items()
            if carried is signal
        ]

    def upstream(self, port: str, *, without: str | None = None) -> set[str]:
        """Modules from which an input or output can be reached, its own module left out for an
        input.

        without : a module through which no path counts.
        """
        graph = self._graph()
        if without is not None:
            graph.remove_edges_from(list(graph.out_edges(without)))
        name, inner = split_port(port)
        if name and inner in self.kind(name).outputs:
            return (nx.ancestors(graph, name) | {name}) & set(self.instances)
        starts = {split_port(one)[0] for one in self.sources(port)} - {""}
        return starts.union(*(nx.ancestors(graph, one) for one in starts)) & set(self.instances)

    def _graph(self) -> nx.DiGraph:
        graph = nx.DiGraph()
        graph.add_nodes_from(self.instances)
        graph.add_edges_from((owner_of(source), owner_of(target)) for source, target in self.wires)
        return graph

    # --- changing
    # ------------------------------------------------------------------------------------------

    def add(self, kind: str, stem: str, **bindings: Binding) -> str:
        """Add a module, named after `stem`; returns its name."""
        name, number = stem, 2
        while name in self.instances:
            name, number = f"{stem}_{number}", number + 1
        self.instances[name] = Instance(kind, name, bindings)
        return name

    def connect(self, source: str, *targets: str) -> None:
        """Add a wire to each target, once."""
        for target in targets:
            if (source, target) not in self.wires:
                self.wires.append((source, target))

    def disconnect(self, source: str, target: str) -> None:
        """Remove a wire."""
        self.wires = [wire for wire in self.wires if wire != (source, target)]

    def rewire(self, old: str, new: str, *targets: str) -> None:
        """Let inputs that take one source take another."""
        for target in targets:
            self.disconnect(old, target)
            self.connect(new, target)

    def drive(self, target: str, *sources: str) -> None:
        """Let these sources and no others drive an input."""
        for old in self.sources(target):
            self.disconnect(old, target)
        self.gather(target, *sources)

    def gather(self, target: str, *sources: str) -> None:
        """Let these sources drive an input too."""
        for source in sources:
            self.connect(source, target)

    def chain(self, *ports: str) -> None:
        """connect(ports[0], ports[1]), connect(ports[2], ports[3]) and so on."""
        for index in range(0, len(ports), 2):
            self.connect(ports[index], ports[index + 1])

    def negated(self, source: str) -> str:
        """The port that carries minus a source: an existing sign of it, or a new one."""
        signal = self.signal(source)
        for target in self.targets(source):
            name = split_port(target)[0]
            if name and self.kind(name).element is Element.SIGN and len(self.sources(target)) == 1:
                return f"{name}.out"
        name = self.add(
            self.usual(Element.SIGN, signal), "minus_" + re.sub(r"\W", "_", split_port(source)[1])
        )
        self.connect(source, f"{name}.in_")
        return f"{name}.out"

    def insert(
        self, source: str, targets: Iterable[str], kind: str, stem: str, **bindings: Any
    ) -> str:
        """Put a block of one input and one output between a source and some of its targets; returns
        its name.
        """
        name = self.add(kind, stem, **bindings)
        self.rewire(source, f"{name}.out", *targets)
        self.connect(source, f"{name}.in_")
        return name

    def insert_before(self, target: str, kind: str, stem: str, **bindings: Any) -> str:
        """Put a block between an input and the sum of all that drives it, but for what is lost in
        the converter; its name.
        """
        name = self.add(kind, stem, **bindings)
        losses = [f"{loss}.out" for loss in self.having(Element.CONVERTER_LOSS)]
        for source in (one for one in self.sources(target) if one not in losses):
            self.disconnect(source, target)
            self.connect(source, f"{name}.in_")
        self.connect(f"{name}.out", target)
        return name

    def replace(self, name: str, kind: str, stem: str, **bindings: Any) -> str:
        """Put another kind in a module's place; ports of the same name keep their wires, others
        lose them.
        """
        new, ports = self.vocabulary[kind], self.kind(name)
        kept = {
            port
            for port, signal in {**new.inputs, **new.outputs}.items()
            if {**ports.inputs, **ports.outputs}.get(port) is signal
        }
        fresh = self.add(kind, stem, **bindings)

        def moved(port: str) -> str | None:
            owner, inner = split_port(port)
            return port if owner != name else f"{fresh}.{inner}" if inner in kept else None

        wires = [(moved(source), moved(target)) for source, target in self.wires]
        self.wires = [
            (source, target)
            for source, target in wires
            if source is not None and target is not None
        ]
        order = {
            fresh if key == name else key: value
            for key, value in self.instances.items()
            if key != fresh
        }
        order[fresh] = self.instances[fresh]
        self.instances = order
        alike = {
            key
            for key, box in ports.parameters.items()
            if getattr(new.parameters.get(key), "unit", None) == box.unit
        }
        self._hand_on(name, {f"{name}.{key}": f"{fresh}.{key}" for key in alike})
        return fresh

    def redraw(self, name: str, kind: str, **bindings: Binding) -> None:
        """Let a block be of another kind with the same ports; it keeps its name, its wires and
        bindings of parameters that both kinds have.
        """
        one, new = self.instances[name], self.vocabulary[kind]
        kept = {key: value for key, value in one.bindings.items() if key in new.parameters}
        self.instances[name] = Instance(kind, name, {**kept, **bindings})

    def rename(self, old: str, new: str) -> None:
        """Give a module another name, which must be free, in its wires and in what it shares."""
        one = self.instances[old]
        self.instances = {
            new if name == old else name: Instance(one.kind, new, one.bindings)
            if name == old
            else each
            for name, each in self.instances.items()
        }

        def port(end: str) -> str:
            owner, inner = split_port(end)
            return f"{new}.{inner}" if owner == old else end

        self.wires = [(port(source), port(target)) for source, target in self.wires]
        self._hand_on(old, {f"{old}.{key}": f"{new}.{key}" for key in self.kind(new).parameters})

    def bypass(self, *names: str) -> None:
        """Take blocks of one input and one output away, one after the other, and join what each
        stood between; a wire around it goes too.
        """
        for name in names:
            before = [source for source in self.sources(f"{name}.in_") if source != f"{name}.out"]
            after = [target for target in self.targets(f"{name}.out") if target != f"{name}.in_"]
            self.remove(name)
            for source in before:
                self.connect(source, *after)

    def remove(self, *names: str) -> None:
        """Take modules and their wires away, one after the other."""
        for name in names:
            del self.instances[name]
            self.wires = [
                wire
                for wire in self.wires
                if name not in (split_port(wire[0])[0], split_port(wire[1])[0])
            ]
            self._hand_on(name, {})

    def bind(self, name: str, **bindings: Binding) -> None:
        """Add or replace bindings of a module."""
        one = self.instances[name]
        self.instances[name] = Instance(one.kind, name, {**one.bindings, **bindings})

    def unbind(self, name: str, *parameters: str) -> None:
        """Let parameters of a module be free and its own."""
        instance = self.instances[name]
        self.instances[name] = Instance(
            instance.kind,
            name,
            {key: value for key, value in instance.bindings.items() if key not in parameters},
        )

    def _hand_on(self, name: str, heirs: Mapping[str, str]) -> None:
        """Parameters shared under the name of a module that is gone: the heir lends its own, else
        the first of the others.

        So those that shared go on sharing, and a module that gets the name later has nothing to do
        with it.
        """
        uses: dict[str, list[tuple[str, str]]] = {}
        for other, one in self.instances.items():
            for key, value in one.bindings.items():
                if isinstance(value, str) and value.split(".")[0] == name:
                    uses.setdefault(value, []).append((other, key))
        for shared, users in uses.items():
            lent = heirs.get(shared)
            if lent is None:
                (first, own), *users = users
                self.unbind(first, own)
                lent = f"{first}.{own}"
            for other, key in users:
                self.bind(other, **{key: lent})

    def tidy(self) -> None:
        """Make the draft whole: nothing undriven, nothing without a way to the terminal current.

        An input that nothing drives takes its module away, but for an axis of a pack and the
        plant's frequency, which get zero. Zero where something else drives too is taken away.
        """
        while self._repair() or self._prune():
            pass

    def _repair(self) -> bool:
        for name in list(self.instances):
            kind = self.kind(name)
            bare = [port for port in kind.inputs if not self.sources(f"{name}.{port}")]
            if not bare:
                continue
            plant, pack = (
                "delta_omega" in kind.inputs and "u_r" in kind.inputs,
                kind.element is Element.PACK,
            )
            if plant and bare == ["delta_omega"]:
                self.connect(
                    f"{self.add(self.usual(Element.ZERO), 'no_frequency')}.out",
                    f"{name}.delta_omega",
                )
            elif (
                pack
                and len(bare) == 1
                and not self._constant(f"{name}.{(kind.inputs.keys() - set(bare)).pop()}")
            ):
                self.connect(
                    f"{self.add(self.usual(Element.ZERO), 'zero')}.out", f"{name}.{bare[0]}"
                )
            elif plant:
                continue  # nothing to be done here: the grammar will refuse it
            else:
                self.remove(name)
            return True
        return False

    def _constant(self, target: str) -> bool:
        return all(
            self.kind(split_port(one)[0]).element is Element.ZERO for one in self.sources(target)
        )

    def _prune(self) -> bool:
        useful = (
            nx.ancestors(self._graph(), TERMINAL_CURRENT)
            if TERMINAL_CURRENT in self._graph()
            else set()
        )
        idle = [name for name in self.instances if name not in useful]
        for name in self.having(Element.ZERO):
            for target in self.targets(f"{name}.out"):
                if len(self.sources(target)) > 1:
                    self.disconnect(f"{name}.out", target)
                    return True
        self.remove(*idle)
        return bool(idle)
