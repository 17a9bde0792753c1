"""A diagram joined into one nonlinear model: the laws of its modules, substituted into each other where they can be."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import networkx as nx
import numpy as np

from ibrid.assembly.signals_at_rest import Channel, channels_of, sources_of
from ibrid.export.averaged import NonlinearModel
from ibrid.export.module_motion import by_port
from ibrid.export.rest import Rest
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.wiring import Wiring, split_port


def assembled(wiring: Wiring, at: Rest) -> NonlinearModel:
    """The model of a wired diagram at its operating point; outputs are substituted in the order of direct terms."""
    x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
    v, r = ca.SX.sym("v", 2), ca.SX.sym("r", len(at.references))
    reference = {channel: r[index] for index, channel in enumerate(at.references)}
    signal = {
        channel: ca.SX.sym(f"{channel[0]}:{channel[1]}")
        for module in at.modules
        for channel in channels_of(module.name, module.kind.outputs)
    }
    signal |= {(TERMINAL_VOLTAGE, axis): v[axis] for axis in (0, 1)}

    def arriving(channel: Channel) -> Any:
        terms = [signal[source] for source in sources_of(wiring, channel)]
        return sum(terms, reference.get(channel, ca.SX(0)))

    rates: list[Any] = []
    law: dict[Channel, Any] = {}
    for module in at.modules:
        inputs = by_port(module.kind, [arriving(one) for one in channels_of(module.name, module.kind.inputs)])
        states = x[module.name]
        rate, outputs = module.motion([states[k] for k in range(states.numel())], inputs)
        rates += rate
        law |= dict(zip(channels_of(module.name, module.kind.outputs), map(ca.SX, outputs), strict=True))
    loops = _solve(law, signal)
    symbols = [signal[channel] for channel in law]
    explicit = [law[channel] if channel not in loops else signal[channel] for channel in law]

    def resolved(expressions: Sequence[Any]) -> ca.SX:
        whole = ca.vertcat(*expressions) if expressions else ca.SX(0, 1)
        return ca.substitute(whole, ca.vertcat(*symbols), ca.vertcat(*explicit))

    z = ca.vertcat(*[signal[channel] for channel in loops]) if loops else ca.SX.sym("z", 0)
    arguments = [ca.vertcat(*x.values()), z, v, r]
    names = ["x", "z", "v", "r"]
    residual = [law[channel] - signal[channel] for channel in loops]
    current = [arriving((TERMINAL_CURRENT, axis)) for axis in (0, 1)]
    return NonlinearModel(
        states=tuple(f"{module.name}.{state}" for module in at.modules for state in module.states),
        algebraic=channel_names(loops, wiring),
        references=channel_names(list(at.references), wiring),
        f=ca.Function("f", arguments, [ca.densify(resolved(rates))], names, ["x_dot"]),
        g=ca.Function("g", arguments, [ca.densify(resolved(residual))], names, ["residual"]),
        h=ca.Function("h", arguments, [ca.densify(resolved(current))], names, ["i"]),
        x0=np.array([value for module in at.modules for value in at.states[module.name]]),
        z0=np.array([at.outputs[channel] for channel in loops]),
        v0=np.array([at.outputs[TERMINAL_VOLTAGE, axis] for axis in (0, 1)]),
        r0=np.array(list(at.references.values()), dtype=float),
    )


def channel_names(channels: Sequence[Channel], wiring: Wiring) -> tuple[str, ...]:
    """ "NAME.port" of each channel, with .d or .q where the port has two axes."""
    return tuple(f"{port}.{'dq'[axis]}" if _has_axes(wiring, port) else port for port, axis in channels)


def _has_axes(wiring: Wiring, port: str) -> bool:
    if port in (TERMINAL_VOLTAGE, TERMINAL_CURRENT):
        return True
    name, inner = split_port(port)
    kind = wiring.kinds[name]
    return {**kind.inputs, **kind.outputs}[inner].width == 2


def _solve(law: dict[Channel, Any], signal: Mapping[Channel, Any]) -> list[Channel]:
    """Replace in each law the signals that follow from others; returns the channels of loops, which stay unknown."""
    owner = {signal[channel].name(): channel for channel in law}
    graph = nx.DiGraph()
    graph.add_nodes_from(law)
    for channel, expression in law.items():
        graph.add_edges_from((owner[one.name()], channel) for one in ca.symvar(expression) if one.name() in owner)
    condensed = nx.condensation(graph)
    loops: list[Channel] = []
    for node in nx.topological_sort(condensed):
        members = [one for one in law if one in condensed.nodes[node]["members"]]
        if len(members) > 1 or graph.has_edge(members[0], members[0]):
            loops += members
        for channel in members:
            needed = [one for one in graph.predecessors(channel) if one not in loops]
            if needed:
                law[channel] = ca.substitute(
                    law[channel],
                    ca.vertcat(*[signal[one] for one in needed]),
                    ca.vertcat(*[law[one] for one in needed]),
                )
    return loops
