"""What is legal but probably a mistake: half a frame, unit slips, modules that do nothing."""

from collections.abc import Sequence

import networkx as nx

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.kind import PAPER_RANGES, ModuleKind
from ibrid.modules.vocabulary import usual_kind
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Instance
from ibrid.structure.grammar_rules.violation import Violations
from ibrid.structure.reading.parameters import kind_parameters, number_or_name
from ibrid.structure.reading.wiring import Wiring, owner_of

#: A coupling of more seconds than this is more than 7 per unit at 60 Hz, so it was meant per unit.
LARGEST_COUPLING = 0.02


def check_habits(
    wiring: Wiring, vocabulary: Sequence[ModuleKind], equilibrium: str, findings: Violations
) -> None:
    """Report the doubtful parts of a legal diagram that is wired."""
    _rotations(wiring, vocabulary, findings)
    _idle(wiring, vocabulary, findings)
    for instance in wiring.instances:
        _coupling_unit(instance, wiring, vocabulary, findings)
        if equilibrium == "exact":
            _ignored(instance, findings)
    _shared_units(wiring, vocabulary, equilibrium, findings)
    _shared_with_fixed(wiring, findings)


def _rotations(wiring: Wiring, vocabulary: Sequence[ModuleKind], findings: Violations) -> None:
    for present, absent in (ROTATIONS, ROTATIONS[::-1]):
        names = wiring.having(present)
        if names and not wiring.having(absent):
            opposite = usual_kind(absent, kinds=vocabulary).name
            message = (
                f"{names[0]} ({wiring.kinds[names[0]].name}) turns into the controller frame or "
                f"back, but no {opposite} "
                f"does the opposite; add a {opposite} or remove {names[0]}"
            )
            findings.add(_line(wiring, names[0]), "one_rotation", message)


def _idle(wiring: Wiring, vocabulary: Sequence[ModuleKind], findings: Violations) -> None:
    graph = nx.DiGraph()
    graph.add_nodes_from([*wiring.kinds, TERMINAL_VOLTAGE, TERMINAL_CURRENT])
    for target, sources in wiring.sources.items():
        graph.add_edges_from((owner_of(source), owner_of(target)) for source in sources)
    useful = nx.ancestors(graph, TERMINAL_CURRENT)
    for name, kind in wiring.kinds.items():
        if name not in useful:
            message = (
                f"{name} ({kind.name}) has no path to {TERMINAL_CURRENT} and changes nothing; "
                "connect it or remove it"
            )
            findings.add(_line(wiring, name), "idle_module", message)
    if TERMINAL_VOLTAGE not in useful:
        message = (
            f"{TERMINAL_VOLTAGE} has no path to {TERMINAL_CURRENT}, so the admittance is zero; "
            f"connect it to {wiring.plant}.v_in, through a "
            f"{usual_kind(Element.ROTATION_IN, kinds=vocabulary).name} if the "
            "controller has a frame of its own"
        )
        findings.add(None, "voltage_unused", message)


def _coupling_unit(
    instance: Instance, wiring: Wiring, vocabulary: Sequence[ModuleKind], findings: Violations
) -> None:
    if wiring.kinds[instance.name].element is not Element.COUPLING:
        return
    for name, value in instance.bindings.items():
        if not isinstance(value, float) or abs(value) <= LARGEST_COUPLING:
            continue
        message = (
            f"{instance.name} ({instance.kind}) has {name} = {value:g} s, {377 * abs(value):.3g} "
            "per unit at 60 Hz; "
            f"its {name} is in seconds, the per-unit value divided by omega_0 (377 rad/s at 60 "
            "Hz), unlike that of "
            f"{_per_unit(vocabulary)}"
        )
        findings.add(instance.line, "coupling_unit", message)


def _ignored(instance: Instance, findings: Violations) -> None:
    for name in instance.bindings:
        if name in PAPER_RANGES:
            message = (
                f'{instance.name}.{name} is bound, but under equilibrium="exact" it is computed, '
                "not fitted; "
                "remove the binding"
            )
            findings.add(instance.line, "ignored_binding", message)


def _per_unit(vocabulary: Sequence[ModuleKind]) -> str:
    """The coupling whose inductance is per unit."""
    return usual_kind(Element.COUPLING_AT_FREQUENCY, kinds=vocabulary).name


def _shared_units(
    wiring: Wiring, vocabulary: Sequence[ModuleKind], equilibrium: str, findings: Violations
) -> None:
    """A name shared by numbers of different units, such as the L [s] of a coupling and the plant's
    L_F [pu].
    """
    groups: dict[str, list[tuple[Instance, str, str]]] = {}
    for instance in wiring.instances:
        for parameter, box in kind_parameters(wiring.kinds[instance.name], equilibrium).items():
            if isinstance(name := number_or_name(instance, parameter), str):
                groups.setdefault(name, []).append((instance, parameter, box.unit))
    for name, members in groups.items():
        owner = next((one for one in members if f"{one[0].name}.{one[1]}" == name), members[0])
        for member in members:
            if member[2] != owner[2]:
                coupling = any(
                    wiring.kinds[one[0].name].element is Element.COUPLING for one in (member, owner)
                )
                _report_units(
                    name, member, owner, _per_unit(vocabulary) if coupling else "", findings
                )


def _report_units(
    name: str,
    member: tuple[Instance, str, str],
    owner: tuple[Instance, str, str],
    per_unit: str,
    findings: Violations,
) -> None:
    """per_unit : the kind to take where one of the two is a coupling in seconds, else empty."""
    (instance, parameter, unit), (other, of_other, expected) = member, owner
    message = (
        f"{instance.name}.{parameter} [{unit}] shares the name {name} with {other.name}.{of_other} "
        f"[{expected}]"
    )
    if per_unit and {unit, expected} == {"s", "pu"}:
        message += (
            f", which is off by omega_0 (377 at 60 Hz); use {per_unit}, whose L is per unit, or "
            "give L a name of its own"
        )
        findings.add(instance.line, "coupling_unit", message)
    else:
        message += ", a number of another unit; give one of them a name of its own"
        findings.add(instance.line, "shared_unit", message)


def _shared_with_fixed(wiring: Wiring, findings: Violations) -> None:
    elsewhere = {
        f"{instance.name}.{parameter}": value
        for instance in wiring.instances
        for parameter, value in instance.bindings.items()
        if isinstance(value, float | str) and value != f"{instance.name}.{parameter}"
    }
    for instance in wiring.instances:
        for parameter, name in instance.bindings.items():
            own = f"{instance.name}.{parameter}"
            if isinstance(name, str) and name != own and name in elsewhere:
                value = elsewhere[name]
                message = (
                    f"{own} is bound to {name}, but {name} itself is "
                    f"{f'fixed to {value:g}' if isinstance(value, float) else f'bound to {value}'}, "
                    f"so the two differ; bind {own} to "
                    f"{value if isinstance(value, str) else f'{value:g}'} as well"
                )
                findings.add(instance.line, "shared_with_fixed", message)


def _line(wiring: Wiring, name: str) -> int | None:
    return next(instance.line for instance in wiring.instances if instance.name == name)
