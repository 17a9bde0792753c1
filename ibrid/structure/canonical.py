"""The hash of a structure: equal for diagrams that differ in names and order of lines alone, and for no others."""

import hashlib
from collections.abc import Sequence

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, choose_vocabulary
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram, Instance
from ibrid.structure.labelling import CanonicalForm, canonical_form
from ibrid.structure.parameters import ParameterTable, kind_parameters, parameter_table
from ibrid.structure.wiring import Wiring, split_port, wire


def structure_hash(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> str:
    """Hash of kinds, connections, sharing of parameters, fixed values and boxes of a legal diagram; 32 hex digits.

    Names of modules and of parameters, the order of the lines and the name of the function do not enter.
    Raises DiagramError for a kind or port that does not exist.
    """
    text = canonical_form(*_graph(diagram, vocabulary, equilibrium)).text
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def canonical_order(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> tuple[str, ...]:
    """Names of the modules in an order that depends on the structure alone; diagrams of one hash correspond in it."""
    form: CanonicalForm = canonical_form(*_graph(diagram, vocabulary, equilibrium))
    names = [instance.name for instance in diagram.instances]
    return tuple(names[vertex - 2] for vertex in form.order if 2 <= vertex < len(names) + 2)


def canonical_wiring(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> Wiring:
    """The wiring in an order that depends on the structure alone, so that renaming or reordering changes no number."""
    wiring = wire(diagram, choose_vocabulary(vocabulary))
    order = canonical_order(diagram, vocabulary, equilibrium=equilibrium)
    rank = {name: index for index, name in enumerate(order)}
    instances = tuple(sorted(wiring.instances, key=lambda one: rank[one.name]))

    def place(port: str) -> tuple[int, str]:
        name, inner = split_port(port)
        return rank.get(name, -1), inner

    return Wiring(
        instances,
        {one.name: wiring.kinds[one.name] for one in instances},
        {target: tuple(sorted(wiring.sources[target], key=place)) for target in sorted(wiring.sources, key=place)},
        wiring.outside,
    )


def _graph(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind], equilibrium: str
) -> tuple[list[str], list[tuple[int, int, str]]]:
    """Vertices: the outer ports, the modules, the shared parameters; edges: connections and uses of a parameter."""
    wiring = wire(diagram, choose_vocabulary(vocabulary))
    table = parameter_table(wiring, equilibrium)
    labels = [f"outer {TERMINAL_VOLTAGE}", f"outer {TERMINAL_CURRENT}"]
    place = {TERMINAL_VOLTAGE: 0, TERMINAL_CURRENT: 1}
    for instance in wiring.instances:
        place[instance.name] = len(labels)
        labels.append(_label(instance, wiring, table, equilibrium))
    edges = [_edge(source, target, place) for target, sources in wiring.sources.items() for source in sources]
    for parameter in table.free:
        if len(parameter.members) > 1:
            edges += [(len(labels), place[name], f"parameter {own}") for name, own in parameter.members]
            labels.append("parameter")
    return labels, edges


def _label(instance: Instance, wiring: Wiring, table: ParameterTable, equilibrium: str) -> str:
    words = [instance.kind]
    for parameter, box in kind_parameters(wiring.kinds[instance.name], equilibrium).items():
        bound = table.of(instance.name, parameter)
        narrower = instance.bindings.get(parameter)
        if isinstance(bound, float):
            words.append(f"{parameter}={bound + 0.0!r}")  # -0.0 is 0.0
        elif isinstance(narrower, tuple) and narrower != (box.low, box.high):
            words.append(f"{parameter} in {narrower!r}")
    return "module " + " ".join(words)


def _edge(source: str, target: str, place: dict[str, int]) -> tuple[int, int, str]:
    (start, output), (end, entry) = split_port(source), split_port(target)
    return place[start or output], place[end or entry], f"{output} to {entry}"
