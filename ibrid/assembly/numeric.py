"""The python-control path: every module a StateSpace, joined by `control.interconnect` with named states.

Modules in a loop of direct terms are closed among themselves first, by `StateSpace.feedback`, because `interconnect`
passes signals on in sequence.
"""

from collections.abc import Mapping, Sequence

import control
import networkx as nx
import numpy as np

from ibrid.assembly.interconnection import state_names
from ibrid.errors import DiagramError
from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.signals import Signal
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.wiring import Wiring, split_port

INPUTS, OUTPUTS = ("v_D", "v_Q"), ("i_D", "i_Q")
_AXES = ("d", "q")


def closed_loop(wiring: Wiring, matrices: Mapping[str, Matrices], name: str = "inverter") -> control.StateSpace:
    """Assemble dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ.

    Parameters
    ----------
    wiring : of a legal diagram. matrices : instance -> (A, B, C, D) in numbers.

    Returns
    -------
    System with inputs v_D, v_Q, outputs i_D, i_Q and states "instance.state" in the order of the modules.

    Raises
    ------
    DiagramError : a loop of direct terms makes I - D F singular; the message names the loop.
    """
    blocks = {label: _block(label, kind, matrices[label]) for label, kind in wiring.kinds.items() if kind.inputs}
    owner = {label: label for label in blocks}
    for number, members in enumerate(_direct_loops(wiring, matrices), start=1):
        loop = _close(wiring, [blocks.pop(member) for member in members], members, f"direct_loop_{number}")
        blocks[str(loop.name)] = loop
        owner |= dict.fromkeys(members, str(loop.name))
    inside = {label for label, whole in owner.items() if whole != label}
    connections = []
    for target, sources in wiring.sources.items():
        label, port = split_port(target)
        if label not in owner:
            continue
        for axis in range(wiring.kinds[label].inputs[port].width):
            signal = _signal(target, axis, wiring)
            outer = [
                f"{owner[split_port(source)[0]]}.{_signal(source, axis, wiring)}"
                for source in sources
                if split_port(source)[0] in owner
                and not (label in inside and owner[split_port(source)[0]] == owner[label])
            ]
            if outer:
                connections.append([f"{owner[label]}.{signal}", *outer])
    entering = [
        [
            f"{owner[split_port(target)[0]]}.{_signal(target, axis, wiring)}"
            for target, sources in wiring.sources.items()
            if target != TERMINAL_CURRENT
            for source in sources
            if source == TERMINAL_VOLTAGE
        ]
        for axis in (0, 1)
    ]
    direct = sum(source == TERMINAL_VOLTAGE for source in wiring.sources[TERMINAL_CURRENT])
    leaving = [
        [
            f"{owner[split_port(source)[0]]}.{_signal(source, axis, wiring)}"
            for source in wiring.sources[TERMINAL_CURRENT]
            if split_port(source)[0] in owner
        ]
        for axis in (0, 1)
    ]
    joined = control.interconnect(
        list(blocks.values()),
        connections=connections,
        inplist=entering,
        inputs=list(INPUTS),
        outlist=leaving,
        outputs=list(OUTPUTS),
        check_unused=False,
        warn_duplicate=False,
    )
    order = _state_order(wiring, matrices, blocks)
    a, b, c, d = (np.asarray(part, dtype=float) for part in (joined.A, joined.B, joined.C, joined.D))
    names = [f"{label}.{state}" for label, kind in wiring.kinds.items() for state in _states(kind, matrices[label])]
    return control.ss(
        a[np.ix_(order, order)], b[order], c[:, order], d + direct * np.eye(2),
        inputs=list(INPUTS), outputs=list(OUTPUTS), states=names, name=name,
    )  # fmt: skip


def _states(kind: ModuleKind, matrices: Matrices) -> list[str]:
    return state_names(kind, len(matrices[0]))


def _channels(ports: Mapping[str, Signal]) -> list[str]:
    return [
        port if signal.width == 1 else f"{port}__{axis}"
        for port, signal in ports.items()
        for axis in _AXES[: signal.width]
    ]


def _signal(port: str, axis: int, wiring: Wiring) -> str:
    """Name of a channel; unique even after modules are merged, since it carries the module's name."""
    label, inner = split_port(port)
    kind = wiring.kinds[label]
    width = {**kind.inputs, **kind.outputs}[inner].width
    return f"{label}__{inner}" if width == 1 else f"{label}__{inner}__{_AXES[axis]}"


def _block(label: str, kind: ModuleKind, matrices: Matrices) -> control.StateSpace:
    inputs, outputs = _channels(kind.inputs), _channels(kind.outputs)
    n = len(matrices[0])
    a, b, c, d = (np.array(rows, dtype=float) for rows in matrices)
    return control.ss(
        a.reshape(n, n), b.reshape(n, len(inputs)), c.reshape(len(outputs), n), d.reshape(len(outputs), len(inputs)),
        name=label,
        inputs=[f"{label}__{one}" for one in inputs],
        outputs=[f"{label}__{one}" for one in outputs],
        states=[f"{label}__{one}" for one in _states(kind, matrices)] if n else None,
    )  # fmt: skip


def _direct_loops(wiring: Wiring, matrices: Mapping[str, Matrices]) -> list[list[str]]:
    """Groups of modules that lie on a loop of direct terms, channel by channel."""
    graph = nx.DiGraph()
    for label, kind in wiring.kinds.items():
        d = matrices[label][3]
        inputs, outputs = _ports(label, kind.inputs), _ports(label, kind.outputs)
        graph.add_edges_from(
            (entering, leaving)
            for row, leaving in zip(d, outputs, strict=True)
            for gain, entering in zip(row, inputs, strict=True)
            if gain != 0
        )
        for port, axis in inputs:
            graph.add_edges_from(((source, axis), (port, axis)) for source in wiring.sources[port])
    merged = nx.Graph()
    for component in nx.strongly_connected_components(graph):
        if len(component) > 1:
            labels = list(dict.fromkeys(split_port(port)[0] for port, _ in component))
            merged.add_nodes_from(labels)
            nx.add_path(merged, labels)
    order = list(wiring.kinds)
    return [sorted(group, key=order.index) for group in nx.connected_components(merged)]


def _ports(label: str, ports: Mapping[str, Signal]) -> list[tuple[str, int]]:
    return [(f"{label}.{port}", axis) for port, signal in ports.items() for axis in range(signal.width)]


def _close(
    wiring: Wiring, systems: Sequence[control.StateSpace], members: Sequence[str], name: str
) -> control.StateSpace:
    """Connect the members of a loop to each other and keep all their inputs and outputs."""
    together = control.append(*systems)
    inputs = [label for system in systems for label in system.input_labels]
    outputs = [label for system in systems for label in system.output_labels]
    gain = np.zeros((len(inputs), len(outputs)))
    for member in members:
        for port, signal in wiring.kinds[member].inputs.items():
            for axis in range(signal.width):
                for source in wiring.sources[f"{member}.{port}"]:
                    if split_port(source)[0] in members:
                        row = inputs.index(_signal(f"{member}.{port}", axis, wiring))
                        gain[row, outputs.index(_signal(source, axis, wiring))] += 1.0
    through = np.eye(len(outputs)) - np.asarray(together.D) @ gain
    if np.linalg.cond(through) > 1e12:
        raise DiagramError(
            f"the loop of direct terms through {' -> '.join(members)} is singular (its gain is 1); "
            "put a filter or a delay in it"
        )
    closed = together.feedback(control.ss([], [], [], gain), sign=1)
    states = [label for system in systems for label in system.state_labels]
    return control.ss(
        closed.A, closed.B, closed.C, closed.D, name=name, inputs=inputs, outputs=outputs, states=states or None
    )


def _state_order(
    wiring: Wiring, matrices: Mapping[str, Matrices], blocks: Mapping[str, control.StateSpace]
) -> list[int]:
    joined = [label for block in blocks.values() for label in block.state_labels]
    wanted = [f"{label}__{one}" for label, kind in wiring.kinds.items() for one in _states(kind, matrices[label])]
    return [joined.index(label) for label in wanted]
