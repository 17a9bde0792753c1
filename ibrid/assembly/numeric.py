"""The python-control path: every module a StateSpace, joined by `control.interconnect` with named
states.

Modules that direct terms lead round to each other are closed among themselves first, because
`interconnect` passes signals on in sequence and not round a loop.
"""

from collections.abc import Mapping, Sequence

import control
import numpy as np

from ibrid.assembly.direct_loops import joined_by_direct_terms
from ibrid.assembly.interconnection import state_names
from ibrid.assembly.joined import Interconnected
from ibrid.assembly.modules_at import ModuleMatrices, require_finite
from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import Wiring, channels_of, owner_of, split_port

INPUTS, OUTPUTS = ("v_D", "v_Q"), ("i_D", "i_Q")
_AXES = ("d", "q")


def closed_loop(
    wiring: Wiring, matrices: Mapping[str, Matrices], name: str = "inverter"
) -> control.StateSpace:
    """Assemble dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ.

    Parameters
    ----------
    wiring : of a legal diagram. matrices : instance -> (A, B, C, D) in numbers.

    Returns
    -------
    System with inputs v_D, v_Q, outputs i_D, i_Q and states "instance.state" in the order of the
    modules.

    Raises
    ------
    DiagramError : a loop of direct terms makes I - D F singular; the message names the loop.
    OperatingPointError : the matrices are not finite, as where no real operating point exists.
    """
    require_finite(matrices)
    blocks = {outer: _terminal(outer) for outer in (TERMINAL_VOLTAGE, TERMINAL_CURRENT)}
    blocks |= {
        label: _block(label, kind, matrices[label])
        for label, kind in wiring.kinds.items()
        if kind.inputs
    }
    owner = {label: label for label in blocks}
    for number, members in enumerate(joined_by_direct_terms(wiring, matrices), start=1):
        whole = f"loop:{number}"
        blocks[whole] = _close(wiring, [blocks.pop(member) for member in members], members, whole)
        owner |= dict.fromkeys(members, whole)
    joined = control.interconnect(
        list(blocks.values()),
        connections=_connections(wiring, owner),
        inplist=[f"{TERMINAL_VOLTAGE}.in:{axis}" for axis in _AXES],
        inputs=list(INPUTS),
        outlist=[f"{TERMINAL_CURRENT}.{_name(TERMINAL_CURRENT, axis)}" for axis in (0, 1)],
        outputs=list(OUTPUTS),
        check_unused=False,
        warn_duplicate=False,
    )
    a, b, c, d = (
        np.asarray(part, dtype=float) for part in (joined.A, joined.B, joined.C, joined.D)
    )
    within = [state for block in blocks.values() for state in block.state_labels]
    states = [
        (label, one)
        for label, kind in wiring.kinds.items()
        for one in state_names(kind, len(matrices[label][0]))
    ]
    order = [within.index(f"{label}:{one}") for label, one in states]
    whole = np.block([[a[np.ix_(order, order)], b[order]], [c[:, order], d]])
    seen = Interconnected.of(whole, [f"{label}.{one}" for label, one in states])
    seen = matrices.seen(seen) if isinstance(matrices, ModuleMatrices) else seen
    a, b, c, d = seen.matrices()
    return control.StateSpace(
        a, b, c, d, inputs=list(INPUTS), outputs=list(OUTPUTS), states=list(seen.states), name=name
    )


def _connections(wiring: Wiring, owner: Mapping[str, str]) -> list[list[str]]:
    """[input, outputs that add up there], those within a closed loop left out."""
    connections = []
    for target, sources in wiring.sources.items():
        within = owner[owner_of(target)]
        for axis in range(wiring.width(target)):
            outer = [
                f"{owner[owner_of(source)]}.{_name(source, axis, wiring.width(source))}"
                for source in sources
                if owner.get(owner_of(source)) not in (None, within if ":" in within else None)
            ]
            if outer:
                name = (
                    f"in:{_AXES[axis]}"
                    if target == TERMINAL_CURRENT
                    else _name(target, axis, wiring.width(target))
                )
                connections.append([f"{within}.{name}", *outer])
    return connections


def _name(port: str, axis: int, width: int = 2) -> str:
    """Name of a channel; unique even after modules are merged, since it carries the module's name
    and colons.
    """
    whole = port.replace(".", ":")
    return whole if width == 1 else f"{whole}:{_AXES[axis]}"


def _names(label: str, ports: Mapping[str, Signal]) -> list[str]:
    return [
        _name(port, axis, ports[split_port(port)[1]].width)
        for port, axis in channels_of(label, ports)
    ]


def _terminal(port: str) -> control.StateSpace:
    """An outer port as a block that passes both axes through, so that it has a name inside."""
    return control.StateSpace(
        *(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), np.eye(2)),
        name=port,
        inputs=[f"in:{axis}" for axis in _AXES],
        outputs=[_name(port, axis) for axis in (0, 1)],
    )


def _block(label: str, kind: ModuleKind, matrices: Matrices) -> control.StateSpace:
    inputs, outputs = _names(label, kind.inputs), _names(label, kind.outputs)
    states = [f"{label}:{one}" for one in state_names(kind, len(matrices[0]))]
    shapes = (
        (len(states), len(states)),
        (len(states), len(inputs)),
        (len(outputs), len(states)),
        (len(outputs), -1),
    )
    parts = [
        np.array(rows, dtype=float).reshape(shape)
        for rows, shape in zip(matrices, shapes, strict=True)
    ]
    return control.StateSpace(
        *parts, name=label, inputs=inputs, outputs=outputs, states=states or None
    )


def _close(
    wiring: Wiring, systems: Sequence[control.StateSpace], members: Sequence[str], name: str
) -> control.StateSpace:
    """Connect the members of a loop to each other and keep all their inputs and outputs."""
    together = control.append(*systems)
    entering = [
        channel
        for member in members
        for channel in channels_of(member, wiring.kinds[member].inputs)
    ]
    leaving = [
        channel
        for member in members
        for channel in channels_of(member, wiring.kinds[member].outputs)
    ]
    gain = np.zeros((len(entering), len(leaving)))
    for row, (port, axis) in enumerate(entering):
        for source in wiring.sources[port]:
            if (source, axis) in leaving:
                gain[row, leaving.index((source, axis))] += 1.0
    a, b, c, d = (np.asarray(part) for part in (together.A, together.B, together.C, together.D))
    y = np.linalg.solve(
        np.eye(len(leaving)) - d @ gain, np.hstack([c, d])
    )  # y = C x + D (u + gain y)
    c, d = y[:, : len(a)], y[:, len(a) :]
    states = [label for system in systems for label in system.state_labels]
    return control.StateSpace(
        *(a + b @ gain @ c, b + b @ gain @ d, c, d),
        name=name,
        inputs=[label for system in systems for label in system.input_labels],
        outputs=[label for system in systems for label in system.output_labels],
        states=states or None,
    )
