"""Rules for connections: both ends exist, point the right way, carry the same kind of signal, and drive every input."""

from collections.abc import Mapping

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import usual_kind
from ibrid.signals import Signal
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Connection, Diagram, Instance
from ibrid.structure.violation import Findings, first_line, shown, some
from ibrid.structure.wiring import split_port

Kinds = Mapping[str, ModuleKind | None]


def check_connections(diagram: Diagram, kinds: Kinds, findings: Findings) -> None:
    """Report what is wrong with the connections of a diagram, and inputs that nothing drives."""
    made: dict[tuple[str, str], Connection] = {}
    driven = set()
    for connection in diagram.connections:
        pair = (connection.source, connection.target)
        driven.add(connection.target)
        if pair in made:
            message = (
                f"the connection {pair[0]} -> {pair[1]} is made twice{first_line(made[pair].line)}; "
                "remove one, or use a gain of 2"
            )
            findings.add(connection.line, "repeated_connection", message)
            continue
        made[pair] = connection
        _check_connection(connection, kinds, findings)
    _check_driven(diagram, kinds, driven, findings)


def _check_connection(connection: Connection, kinds: Kinds, findings: Findings) -> None:
    source = _signal(connection.source, "source", connection.line, kinds, findings)
    target = _signal(connection.target, "target", connection.line, kinds, findings)
    if source is None or target is None or source is target:
        return
    remedy = _fitting(connection, source, kinds)
    message = f"{connection.source} [{source}] cannot drive {connection.target} [{target}]; {remedy}"
    findings.add(connection.line, "signal_kind", message)


def _signal(port: str, end: str, line: int | None, kinds: Kinds, findings: Findings) -> Signal | None:
    """Signal kind of one end of a connection; None, and a finding, where that end is wrong."""
    if port in (TERMINAL_VOLTAGE, TERMINAL_CURRENT):
        if (port == TERMINAL_VOLTAGE) == (end == "source"):
            return Signal.DQ_VEC
        rule = (
            "comes from outside; it can only be a source"
            if end == "target"
            else "leaves the diagram; it can only be a target"
        )
        findings.add(line, "direction", f"{port} {rule}, so turn the connection round or name another port")
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
        wanted = f"{what} of {name} is {some(here)}" if here else f"{kind.name} has no {what.split()[1]}"
        findings.add(line, "direction", f"{port} is {opposite}, but the {end} of a connection is {what}; {wanted}")
    elif here:
        message = f"{name} ({kind.name}) has no {what.split()[1]} {shown(inner)}; {findings.near(inner, here)}"
        findings.add(line, "unknown_port", message)
    else:
        findings.add(line, "unknown_port", f"{name} ({kind.name}) has no {what.split()[1]}s; remove the connection")
    return None


def _ports_of(name: str, kinds: Kinds) -> str:
    kind = kinds[name]
    if kind is None:
        return "its kind is not known either"
    return f"inputs of {name} are {some(kind.inputs) or 'none'}, outputs {some(kind.outputs) or 'none'}"


def _fitting(connection: Connection, source: Signal, kinds: Kinds) -> str:
    """What would mend a connection of unequal signals: a port of that module that fits, else an adapter."""
    name, _ = split_port(connection.target)
    kind = kinds.get(name)
    fitting = [port for port, signal in kind.inputs.items() if signal is source] if kind else []
    if fitting:
        return f"inputs of {name} that accept a {source}: {', '.join(fitting)}"
    adapters = {
        Signal.SCALAR: f"pack two scalars with {usual_kind(Element.PACK).name}, or use the _dq form of the source",
        Signal.DQ_VEC: f"take one axis with {usual_kind(Element.SLICE_D).name} or {usual_kind(Element.SLICE_Q).name}",
        Signal.POWER_PAIR: "use a module with a power_pair input",
    }
    return f"no input of {name or connection.target} accepts a {source}: {adapters[source]}"


def _check_driven(diagram: Diagram, kinds: Kinds, driven: set[str], findings: Findings) -> None:
    done: set[str] = set()
    for instance in diagram.instances:
        kind = kinds[instance.name]
        if kind is None or instance.name in done:
            continue
        done.add(instance.name)
        for port, signal in kind.inputs.items():
            if f"{instance.name}.{port}" not in driven:
                remedy = _drivers(diagram, kinds, instance, signal)
                findings.add(
                    instance.line, "undriven_input", f"nothing drives {instance.name}.{port} [{signal}]; {remedy}"
                )


def _drivers(diagram: Diagram, kinds: Kinds, instance: Instance, signal: Signal) -> str:
    outer = [TERMINAL_VOLTAGE] if signal is Signal.DQ_VEC else []
    found = outer + [
        f"{name}.{port}"
        for name, kind in kinds.items()
        if kind is not None and name != instance.name
        for port, carried in kind.outputs.items()
        if carried is signal
    ]
    zero = f"; a {usual_kind(Element.ZERO).name} gives zero" if signal is Signal.SCALAR else ""
    if not found:
        return f"add a module with a {signal} output{zero}"
    return f"connect {'one of ' * (len(found) > 1)}{some(found)} to it{zero}"
