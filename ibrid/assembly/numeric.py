"""The python-control path: every module a StateSpace, joined by `control.interconnect` with named states.

Modules that direct terms lead round to each other are closed among themselves first, by `StateSpace.feedback`, because
`interconnect` passes signals on in sequence.
"""

from collections.abc import Mapping, Sequence

import control
import numpy as np

from ibrid.assembly.direct_loops import joined_by_direct_terms
from ibrid.assembly.interconnection import state_names
from ibrid.assembly.signals_at_rest import Channel, channels_of
from ibrid.errors import OperatingPointError
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
    OperatingPointError : the matrices are not finite, as where no real operating point exists.
    """
    _require_finite(matrices)
    blocks = {label: _block(label, kind, matrices[label]) for label, kind in wiring.kinds.items() if kind.inputs}
    owner = {label: label for label in blocks}
    for number, members in enumerate(joined_by_direct_terms(wiring, matrices), start=1):
        whole = f"loop:{number}"
        blocks[whole] = _close(wiring, [blocks.pop(member) for member in members], members, whole)
        owner |= dict.fromkeys(members, whole)
    entering, leaving = _entering(wiring, owner), _leaving(wiring, owner)
    placeholder = [f"{owner[wiring.plant]}.{_signal(wiring, (f'{wiring.plant}.{port}', 0))}" for port in ("u_r", "i_g")]
    joined = control.interconnect(
        list(blocks.values()),
        connections=_connections(wiring, owner),
        inplist=entering or [[placeholder[0]]] * 2,  # python-control wants something to drive and to read
        inputs=list(INPUTS),
        outlist=leaving or [[placeholder[1]]] * 2,
        outputs=list(OUTPUTS),
        check_unused=False,
        warn_duplicate=False,
    )
    a, b, c, d = (np.asarray(part, dtype=float) for part in (joined.A, joined.B, joined.C, joined.D))
    direct = sum(source == TERMINAL_VOLTAGE for source in wiring.sources[TERMINAL_CURRENT])
    b, c, d = b * bool(entering), c * bool(leaving), d * bool(entering and leaving) + direct * np.eye(2)
    within = [state for block in blocks.values() for state in block.state_labels]
    states = [(label, one) for label, kind in wiring.kinds.items() for one in _states(kind, matrices[label])]
    order = [within.index(f"{label}:{one}") for label, one in states]
    return control.StateSpace(
        a[np.ix_(order, order)],
        b[order],
        c[:, order],
        d,
        inputs=list(INPUTS),
        outputs=list(OUTPUTS),
        states=[f"{label}.{one}" for label, one in states],
        name=name,
    )


def _require_finite(matrices: Mapping[str, Matrices]) -> None:
    wrong = [
        label
        for label, parts in matrices.items()
        if not all(np.isfinite(np.array(rows, dtype=float)).all() for rows in parts)
    ]
    if wrong:
        raise OperatingPointError(
            f"the matrices of {', '.join(wrong)} must be finite; with these values there is no real operating point, "
            "ask for less power, a higher voltage or a smaller impedance to the grid"
        )


def _connections(wiring: Wiring, owner: Mapping[str, str]) -> list[list[str]]:
    """[input, outputs that add up there], those within a closed loop left out."""
    found = []
    for target, sources in wiring.sources.items():
        label, port = split_port(target)
        if label not in owner:
            continue
        for axis in range(wiring.kinds[label].inputs[port].width):
            outer = [
                f"{owner[one]}.{_signal(wiring, (source, axis))}"
                for source in sources
                if (one := split_port(source)[0]) in owner
                and not (owner[label] != label and owner[one] == owner[label])
            ]
            if outer:
                found.append([f"{owner[label]}.{_signal(wiring, (target, axis))}", *outer])
    return found


def _entering(wiring: Wiring, owner: Mapping[str, str], axis: int) -> list[str]:
    """The inputs that the terminal voltage drives."""
    return [
        f"{owner[split_port(target)[0]]}.{_signal(wiring, (target, axis))}"
        for target, sources in wiring.sources.items()
        if target != TERMINAL_CURRENT
        for source in sources
        if source == TERMINAL_VOLTAGE
    ]


def _leaving(wiring: Wiring, owner: Mapping[str, str], axis: int) -> list[str]:
    """The outputs that add up in the terminal current."""
    return [
        f"{owner[split_port(source)[0]]}.{_signal(wiring, (source, axis))}"
        for source in wiring.sources[TERMINAL_CURRENT]
        if split_port(source)[0] in owner
    ]


def _states(kind: ModuleKind, matrices: Matrices) -> list[str]:
    return state_names(kind, len(matrices[0]))


def _signal(wiring: Wiring, channel: Channel) -> str:
    """Name of a channel; unique even after modules are merged, since it carries the module's name and a colon."""
    label, port = split_port(channel[0])
    kind = wiring.kinds[label]
    return _name(label, port, {**kind.inputs, **kind.outputs}[port], channel[1])


def _name(label: str, port: str, signal: Signal, axis: int) -> str:
    return f"{label}:{port}" if signal.width == 1 else f"{label}:{port}:{_AXES[axis]}"


def _names(label: str, ports: Mapping[str, Signal]) -> list[str]:
    return [_name(label, port, signal, axis) for port, signal in ports.items() for axis in range(signal.width)]


def _block(label: str, kind: ModuleKind, matrices: Matrices) -> control.StateSpace:
    inputs, outputs = _names(label, kind.inputs), _names(label, kind.outputs)
    states = [f"{label}:{one}" for one in _states(kind, matrices)]
    shapes = (len(states), len(states)), (len(states), len(inputs)), (len(outputs), len(states)), (len(outputs), -1)
    parts = [np.array(rows, dtype=float).reshape(shape) for rows, shape in zip(matrices, shapes, strict=True)]
    return control.StateSpace(*parts, name=label, inputs=inputs, outputs=outputs, states=states or None)


def _close(
    wiring: Wiring, systems: Sequence[control.StateSpace], members: Sequence[str], name: str
) -> control.StateSpace:
    """Connect the members of a loop to each other and keep all their inputs and outputs."""
    together = control.append(*systems)
    entering = [channel for member in members for channel in channels_of(member, wiring.kinds[member].inputs)]
    leaving = [channel for member in members for channel in channels_of(member, wiring.kinds[member].outputs)]
    gain = np.zeros((len(entering), len(leaving)))
    for row, (port, axis) in enumerate(entering):
        for source in wiring.sources[port]:
            if (source, axis) in leaving:
                gain[row, leaving.index((source, axis))] += 1.0
    empty = np.zeros((0, 0))
    back = control.StateSpace(empty, np.zeros((0, len(leaving))), np.zeros((len(entering), 0)), gain)
    closed = together.feedback(back, sign=1)
    states = [label for system in systems for label in system.state_labels]
    return control.StateSpace(
        *(closed.A, closed.B, closed.C, closed.D),
        name=name,
        inputs=[_signal(wiring, channel) for channel in entering],
        outputs=[_signal(wiring, channel) for channel in leaving],
        states=states or None,
    )
