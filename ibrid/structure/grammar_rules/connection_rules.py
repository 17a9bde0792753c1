"""Rules of the grammar for modules one by one and for their connections."""

import math
from collections.abc import Mapping, Sequence

from ibrid.errors import some
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY, usual_kind
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import (
    TERMINAL_CURRENT,
    TERMINAL_VOLTAGE,
    Binding,
    Connection,
    Instance,
)
from ibrid.structure.grammar_rules.violation import Violations, first_line, shown
from ibrid.structure.reading.parameters import kind_parameters, number_or_name
from ibrid.structure.reading.wiring import PLANT, split_port

Kinds = Mapping[str, ModuleKind | None]


def check_connections(
    instances: Sequence[Instance],
    connections: Sequence[Connection],
    kinds: Kinds,
    findings: Violations,
) -> None:
    """Report what is wrong with the connections of a diagram, and inputs that nothing drives."""
    made: dict[tuple[str, str], Connection] = {}
    driven = set()
    for connection in connections:
        pair = (connection.source, connection.target)
        driven.add(connection.target)
        if pair in made:
            message = (
                f"the connection {pair[0]} -> {pair[1]} is made "
                f"twice{first_line(made[pair].line)}; "
                "remove one, or use a gain of 2"
            )
            findings.add(connection.line, "repeated_connection", message)
            continue
        made[pair] = connection
        _check_connection(connection, kinds, findings)
    _check_driven(instances, kinds, driven, findings)


def _check_connection(connection: Connection, kinds: Kinds, findings: Violations) -> None:
    source = _signal(connection.source, "source", connection.line, kinds, findings)
    target = _signal(connection.target, "target", connection.line, kinds, findings)
    if source is None or target is None or source is target:
        return
    remedy = _fitting(connection, source, kinds)
    message = (
        f"{connection.source} [{source}] cannot drive {connection.target} [{target}]; {remedy}"
    )
    findings.add(connection.line, "signal_kind", message)


def _signal(
    port: str, end: str, line: int | None, kinds: Kinds, findings: Violations
) -> Signal | None:
    """Signal kind of one end of a connection; None, and a finding, where that end is wrong."""
    if port in (TERMINAL_VOLTAGE, TERMINAL_CURRENT):
        if (port == TERMINAL_VOLTAGE) == (end == "source"):
            return Signal.DQ_VEC
        rule = (
            "comes from outside; it can only be a source"
            if end == "target"
            else "leaves the diagram; it can only be a target"
        )
        findings.add(
            line, "direction", f"{port} {rule}, so turn the connection round or name another port"
        )
        return None
    name, inner = split_port(port)
    if not name:
        if inner in kinds:
            remedy = f"write {inner}.port; {_ports_of(inner, kinds)}"
        else:
            remedy = f"write NAME.port, {TERMINAL_VOLTAGE} or {TERMINAL_CURRENT}"
        findings.add(line, "unknown_port", f"{shown(port)} is no port; {remedy}")
        return None
    if name not in kinds:
        remedy = findings.near(name, kinds) if kinds else "add one"
        findings.add(line, "unknown_module", f"{port}: no module is called {shown(name)}; {remedy}")
        return None
    kind = kinds[name]
    if kind is None:
        return None
    here, other = (kind.outputs, kind.inputs) if end == "source" else (kind.inputs, kind.outputs)
    if inner in here:
        return here[inner]
    what, opposite = ("an output", "an input") if end == "source" else ("an input", "an output")
    if inner in other:
        wanted = (
            f"{what} of {name} is {some(here)}" if here else f"{kind.name} has no {what.split()[1]}"
        )
        findings.add(
            line,
            "direction",
            f"{port} is {opposite}, but the {end} of a connection is {what}; {wanted}",
        )
    elif here:
        message = (
            f"{name} ({kind.name}) has no {what.split()[1]} {shown(inner)}; "
            f"{findings.near(inner, here)}"
        )
        findings.add(line, "unknown_port", message)
    else:
        findings.add(
            line,
            "unknown_port",
            f"{name} ({kind.name}) has no {what.split()[1]}s; remove the connection",
        )
    return None


def _ports_of(name: str, kinds: Kinds) -> str:
    kind = kinds[name]
    if kind is None:
        return "its kind is not known either"
    return (
        f"inputs of {name} are {some(kind.inputs) or 'none'}, outputs "
        f"{some(kind.outputs) or 'none'}"
    )


def _fitting(connection: Connection, source: Signal, kinds: Kinds) -> str:
    """What would mend a connection of unequal signals: a port of that module that fits, else an
    adapter.
    """
    name, _ = split_port(connection.target)
    kind = kinds.get(name)
    fitting = [port for port, signal in kind.inputs.items() if signal is source] if kind else []
    if fitting:
        return f"inputs of {name} that accept a {source}: {', '.join(fitting)}"
    adapters = {
        Signal.SCALAR: f"pack two scalars with {usual_kind(Element.PACK).name}, or use the _dq "
        "form of the source",
        Signal.DQ_VEC: f"take one axis with {usual_kind(Element.SLICE_D).name} or "
        f"{usual_kind(Element.SLICE_Q).name}",
        Signal.POWER_PAIR: "use a module with a power_pair input",
    }
    return f"no input of {name or connection.target} accepts a {source}: {adapters[source]}"


def _check_driven(
    instances: Sequence[Instance], kinds: Kinds, driven: set[str], findings: Violations
) -> None:
    done: set[str] = set()
    for instance in instances:
        kind = kinds[instance.name]
        if kind is None or instance.name in done:
            continue
        done.add(instance.name)
        for port, signal in kind.inputs.items():
            if f"{instance.name}.{port}" not in driven:
                remedy = _drivers(kinds, instance, signal)
                findings.add(
                    instance.line,
                    "undriven_input",
                    f"nothing drives {instance.name}.{port} [{signal}]; {remedy}",
                )


def _drivers(kinds: Kinds, instance: Instance, signal: Signal) -> str:
    outer = [TERMINAL_VOLTAGE] if signal is Signal.DQ_VEC else []
    drivers = outer + [
        f"{name}.{port}"
        for name, kind in kinds.items()
        if kind is not None and name != instance.name
        for port, carried in kind.outputs.items()
        if carried is signal
    ]
    zero = f"; a {usual_kind(Element.ZERO).name} gives zero" if signal is Signal.SCALAR else ""
    if not drivers:
        return f"add a module with a {signal} output{zero}"
    return f"connect {'one of ' * (len(drivers) > 1)}{some(drivers)} to it{zero}"


def check_modules(
    instances: Sequence[Instance],
    vocabulary: Sequence[ModuleKind],
    equilibrium: str,
    findings: Violations,
) -> dict[str, ModuleKind | None]:
    """Report what is wrong with modules and bindings; instance name -> kind, None where the kind is
    unknown.
    """
    known = {kind.name: kind for kind in vocabulary}
    kinds: dict[str, ModuleKind | None] = {}
    first: dict[str, Instance] = {}
    for instance in instances:
        kind = known.get(instance.kind)
        if kind is None:
            findings.add(instance.line, "unknown_kind", _unknown_kind(instance, known, findings))
        else:
            _check_bindings(instance, kind, equilibrium, findings)
        if instance.name in first:
            where = first_line(first[instance.name].line)
            message = (
                f"the name {instance.name} is used twice{where}; give this {instance.kind[:64]} a "
                "name of its own"
            )
            findings.add(instance.line, "duplicate_name", message)
        else:
            first[instance.name] = instance
            kinds[instance.name] = kind
    _check_shared(instances, kinds, equilibrium, findings)
    return kinds


def _unknown_kind(instance: Instance, known: dict[str, ModuleKind], findings: Violations) -> str:
    extended = {kind.name for kind in VOCABULARY if kind.extended}
    if instance.kind in extended:
        return (
            f"{instance.kind} (module {instance.name}) is an extended kind that this vocabulary "
            "leaves out; "
            "use the extended vocabulary or a kind of the paper"
        )
    hint = f"one of your own comes with --kinds FILE.py; {findings.near(instance.kind, known)}"
    return f"the vocabulary has no kind {shown(instance.kind)} (module {instance.name}); {hint}"


def _check_bindings(
    instance: Instance, kind: ModuleKind, equilibrium: str, findings: Violations
) -> None:
    boxes = kind_parameters(kind, equilibrium)
    where = f"{instance.name} ({kind.name})"
    for name, value in instance.bindings.items():
        if name in boxes:
            if fault := _binding_fault(
                f"{instance.name}.{name}", value, boxes[name], kind.family == PLANT
            ):
                findings.add(instance.line, "box", fault)
        elif name not in kind.paper_parameters:  # those are accepted and ignored under "exact"
            if not boxes:
                remedy = "this kind has no parameters, so remove the binding"
            else:
                remedy = findings.near(name, boxes)
            findings.add(
                instance.line, "binding", f"{where} has no parameter {shown(name)}; {remedy}"
            )


def _binding_fault(where: str, value: Binding, box: Range, plant: bool) -> str | None:
    limits = f"[{box.low:g}, {box.high:g}] {box.unit}"
    if isinstance(value, tuple):
        low, high = value
        if box.low <= low < high <= box.high:
            return None
        return f"the box ({low:g}, {high:g}) of {where} must lie within {limits}; narrow it"
    if isinstance(value, str):
        return None
    if not math.isfinite(value):
        return f"{where} is fixed to {value}; write a finite number"
    if plant and not box.low <= value <= box.high:
        return (
            f"{where} is fixed to {value:g}, but a plant parameter lies within {limits}; move it "
            "there or let it free"
        )
    if box.divides and value <= 0:
        return (
            f"{where} is fixed to {value:g}, but its law needs a number above zero; it usually "
            f"lies within {limits}"
        )
    return None


def _check_shared(
    instances: Sequence[Instance],
    kinds: dict[str, ModuleKind | None],
    equilibrium: str,
    findings: Violations,
) -> None:
    members: dict[str, list[tuple[Instance, str, float, float]]] = {}
    for instance in instances:
        kind = kinds.get(instance.name)
        if kind is None:
            continue
        for parameter, box in kind_parameters(kind, equilibrium).items():
            value = instance.bindings.get(parameter)
            low, high = value if isinstance(value, tuple) else box.unbound
            if isinstance(name := number_or_name(instance, parameter), str):
                members.setdefault(name, []).append((instance, parameter, low, high))
    for name, sharing in members.items():
        low = max(sharing, key=lambda member: member[2])
        high = min(sharing, key=lambda member: member[3])
        if len(sharing) > 1 and not low[2] < high[3]:
            where = some(
                f"{one[0].name}.{one[1]} ({one[2]:g} to {one[3]:g})" for one in (low, high)
            )
            line = max((one[0].line for one in sharing if one[0].line is not None), default=None)
            message = (
                f"{where} share the name {name}, but their boxes do not overlap; give them names "
                "of their own"
            )
            findings.add(line, "shared_box", message)
