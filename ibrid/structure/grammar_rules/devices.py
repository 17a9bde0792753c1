"""Two devices behind one PCC: parts of a diagram that meet at its outer ports alone, each with a plant of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import networkx as nx

from ibrid.modules.kind import ModuleKind
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram, Instance
from ibrid.structure.grammar_rules.violation import Violations
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port


@lru_cache(64)
def devices(wiring: Wiring) -> tuple[Wiring, ...]:
    """The parts of a legal diagram with a plant each, in the order of the plants; the whole wiring where there is one plant.

    What is connected to no plant, such as a shunt at the PCC, belongs to the first part.
    """
    plants = [name for name, kind in wiring.kinds.items() if kind.family == PLANT]
    if len(plants) < 2:
        return (wiring,)
    edges = [(source, target) for target, sources in wiring.sources.items() for source in sources]
    part = _parts(wiring.kinds, edges)
    first = part[plants[0]]
    owner = {name: part[name] if part[name] in {part[plant] for plant in plants} else first for name in wiring.kinds}
    return tuple(_part_of(wiring, {name for name in wiring.kinds if owner[name] == part[plant]}) for plant in plants)


def _part_of(wiring: Wiring, names: set[str]) -> Wiring:
    def inside(port: str) -> bool:
        return port in (TERMINAL_VOLTAGE, TERMINAL_CURRENT) or split_port(port)[0] in names

    return replace(
        wiring,
        instances=tuple(one for one in wiring.instances if one.name in names),
        kinds={name: kind for name, kind in wiring.kinds.items() if name in names},
        sources={
            target: tuple(source for source in sources if inside(source))
            for target, sources in wiring.sources.items()
            if inside(target)
        },
    )


def check_plants(
    diagram: Diagram, kinds: Mapping[str, ModuleKind | None], vocabulary: Sequence[ModuleKind], findings: Violations
) -> None:
    """Report a diagram without a plant, with plants that are not devices of their own, and shares that do not add up."""
    plants = [one for one in diagram.instances if (kind := kinds[one.name]) is not None and kind.family == PLANT]
    shares = [one for one in diagram.instances if (kind := kinds[one.name]) is not None and kind.shares]
    available = " or ".join(kind.name for kind in vocabulary if kind.family == PLANT)
    if not plants and all(kinds.values()):
        findings.add(None, "no_plant", f"the diagram has no plant; add one {available}")
    part = _parts(kinds, [(one.source, one.target) for one in diagram.connections])
    dividing = " or ".join(kind.name for kind in vocabulary if kind.shares)
    for index, extra in enumerate(plants[1:], start=1):
        beside = next((one for one in plants[:index] if part[one.name] == part[extra.name]), None)
        if beside is not None or not dividing:
            other = (beside or plants[0]).name
            apart = f", or let two devices meet at {TERMINAL_VOLTAGE} and {TERMINAL_CURRENT} alone" if dividing else ""
            message = (
                f"{extra.name} ({extra.kind}) is a second plant beside {other}; keep exactly one {available}{apart}"
            )
            findings.add(extra.line, "several_plants", message)
            return
    if plants:
        _check_shares(plants, shares, dividing, part, findings)
        _check_shares_in_place(diagram, shares, findings)


def _check_shares(
    plants: Sequence[Instance], shares: Sequence[Instance], dividing: str, part: Mapping[str, int], findings: Violations
) -> None:
    if len(plants) == 1 and shares:
        message = (
            f"{shares[0].name} ({shares[0].kind}) divides power between devices, but there is one plant; remove it"
        )
        findings.add(shares[0].line, "share", message)
        return
    holding = {part[one.name] for one in shares}
    without = [one for one in plants if part[one.name] not in holding]
    if len(plants) > 1 and (len(without) != 1 or len(shares) != len(plants) - 1):
        message = (
            f"{plants[-1].name} ({plants[-1].kind}) is a second plant beside {plants[0].name}; keep exactly one, or let "
            f"{TERMINAL_VOLTAGE} enter each device but one, which delivers the rest, through a {dividing}: found {len(shares)}"
        )
        findings.add(plants[-1].line, "several_plants", message)


def _check_shares_in_place(diagram: Diagram, shares: Sequence[Instance], findings: Violations) -> None:
    for share in shares:
        entering = [each.source for each in diagram.connections if each.target == f"{share.name}.v_DQ"]
        if entering and entering != [TERMINAL_VOLTAGE]:
            message = f"{share.name} ({share.kind}) takes the terminal voltage and nothing else; connect {TERMINAL_VOLTAGE} to it"
            findings.add(share.line, "share", message)


def _parts(names: Mapping[str, object], edges: Sequence[tuple[str, str]]) -> dict[str, int]:
    """Number of the part that each module is in; connections to outer ports join nothing."""
    graph = nx.Graph()
    graph.add_nodes_from(names)
    ends = ((split_port(source)[0], split_port(target)[0]) for source, target in edges)
    graph.add_edges_from((one, other) for one, other in ends if one in names and other in names)
    return {name: number for number, part in enumerate(nx.connected_components(graph)) for name in part}
