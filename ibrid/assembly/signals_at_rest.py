"""The operating point in numbers: of every signal that follows from the plant, and of the
controller frame.

What follows, and what sets the frame, `known_at_rest` tells from the structure.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import casadi as ca

from ibrid.assembly.known_at_rest import Carried
from ibrid.assembly.numbers import is_zero, weighted_sum
from ibrid.assembly.operating_point import Pair
from ibrid.modules.kind import EQUILIBRIUM, Matrices, ModuleKind
from ibrid.modules.large_signal import Motion, asked, dot, length, square_root
from ibrid.modules.own_law import call_law
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, split_port

Frame = tuple[Any, Any]  # cosine and sine of delta_eq
Parameters = Mapping[str, Mapping[str, Any]]  # instance -> parameter -> float or symbol

#: Squared gain from a vector in the frame to the component that is driven to zero, below which it
#: decides nothing.
NOTHING = 1e-20
#: Cosine of the angle between e and the d axis that still counts as zero: then d, not -d, is
#: chosen.
PERPENDICULAR = 1e-9


def controller_frame(
    wiring: Wiring,
    flow: Carried,
    parameters: Parameters,
    in_grid: Mapping[str, Pair],
    omega_0: float,
    deviation: Any = 0.0,
) -> Frame:
    """(cos, sin) of delta_eq: the q component that the controller holds is where it holds it, e has
    a positive d component.

    It is held at zero but where the kind of that input says another value, as a PLL without
    integral action does beside its own frequency.

    Every signal is affine in (cos, sin), so its values in three frames give k0 + k1 cos + k2 sin =
    0; k0 is what comes from v_DQ without a rotation, less the value at which the component is held.
    Where nothing is held the capacitor voltage is on the d axis; without rotations the frame is
    that of the grid. Not numbers where the voltage is too small to be held there.

    flow : of the same wiring, whose `aligned` is that component. deviation : of the grid's
    frequency from the nominal one, rad/s.
    """
    if not flow.turned:
        return 1.0, 0.0
    target, e = flow.aligned, in_grid["e"]
    if target is None:
        return _unit(e)
    name, _ = split_port(target[0])
    held = wiring.kinds[name].arriving_at_rest(parameters[name], deviation)

    def driven_to_zero(frame: Frame) -> Any:
        value = (
            signals_at_rest(wiring, flow, parameters, in_grid, omega_0, frame, [target])[target]
            - held
        )
        on_u_r = (
            target[0] == f"{wiring.plant}.u_r"
        )  # its reference on d is what the known signals leave of it
        return to_frame(frame, in_grid["u_r"])[1] - value if on_u_r else value

    east, north, west = (
        driven_to_zero((1.0, 0.0)),
        driven_to_zero((0.0, 1.0)),
        driven_to_zero((-1.0, 0.0)),
    )
    k0, k1, k2 = (east + west) / 2, (east - west) / 2, north - (east + west) / 2
    decided = k1 * k1 + k2 * k2 > NOTHING
    z = _choose(decided, -k2, e[0]), _choose(decided, k1, e[1])
    square = dot(z, z)
    along = dot(z, e)
    side = _choose(along >= -PERPENDICULAR * square_root(square * dot(e, e)), 1.0, -1.0)
    if is_zero(k0):
        size = square_root(square) * side
        return z[0] / size, z[1] / size
    rest = _choose(decided, k0, 0.0)
    reach = square_root(square - rest * rest) * side
    return (z[0] * reach - rest * z[1]) / square, (z[1] * reach + rest * z[0]) / square


def _unit(z: Pair) -> Frame:
    size = length(z)
    return z[0] / size, z[1] / size


def _choose(condition: Any, yes: Any, no: Any) -> Any:
    """One of two values, by a truth value or a symbol."""
    return (
        ca.if_else(condition, yes, no)
        if isinstance(condition, ca.SX)
        else (yes if condition else no)
    )


def signals_at_rest(
    wiring: Wiring,
    flow: Carried,
    parameters: Parameters,
    in_grid: Mapping[str, Pair],
    omega_0: float,
    frame: Frame,
    wanted: Iterable[Channel],
) -> dict[Channel, Any]:
    """Operating point of the wanted channels, each in the frame that it has.

    Parameters
    ----------
    flow : of the same wiring. parameters : per unit. in_grid : the plant's ports in the grid frame,
    with `v_in` the
    terminal voltage. frame : of the controller, in which the plant's signals are. wanted : input or
    output channels that follow from the plant (`flow.known`).
    """
    wanted = tuple(wanted)
    upstream = _upstream(flow, wanted)
    at_rest = _given(wiring, in_grid, frame, upstream)
    if flow.command:
        at_rest |= {
            (f"{wiring.plant}.u_r", axis): value
            for axis, value in enumerate(to_frame(frame, in_grid["u_r"]))
        }
    direct: dict[str, Matrices] = {}
    for channel, inputs in flow.needs.items():
        if channel not in upstream:
            continue
        name, _ = split_port(channel[0])
        kind = wiring.kinds[name]
        row = channels_of(name, kind.outputs).index(channel)
        entering = {one: _arriving(flow, at_rest, one) for one in inputs}
        if kind.rests_by_law and kind.large_signal is not None:
            at_rest[channel] = _by_law(
                kind.large_signal.law, kind, name, parameters[name], omega_0, entering
            )[row]
            continue
        if not kind.static:
            gains: Mapping[Channel, Any] = dict.fromkeys(inputs, kind.dc_gain)
        else:
            if name not in direct:
                direct[name] = matrices_of(
                    kind, parameters[name], omega_0, frame, _at_ports(name, kind, entering)
                )
            gains = dict(zip(channels_of(name, kind.inputs), direct[name][3][row], strict=True))
        at_rest[channel] = weighted_sum((gains[one], value) for one, value in entering.items())
    return {channel: _arriving(flow, at_rest, channel) for channel in wanted}


def to_frame(frame: Frame, z: Pair) -> Pair:
    """R(delta_eq) z."""
    cosine, sine = frame
    return weighted_sum(((cosine, z[0]), (sine, z[1]))), weighted_sum(
        ((cosine, z[1]), (-sine, z[0]))
    )


def matrices_of(
    kind: ModuleKind,
    parameters: Mapping[str, Any],
    omega_0: float,
    frame: Frame,
    ports: Mapping[str, Pair],
) -> Matrices:
    """State-space matrices of a kind at given parameters and equilibrium."""
    own = {name: parameters[name] for name in kind.parameters}
    return kind.matrices(**own, **kind.context(omega_0, frame, ports))


def _upstream(flow: Carried, wanted: Iterable[Channel]) -> set[Channel]:
    """The output channels on which the wanted ones depend."""
    front = [source for channel in wanted for source in flow.entering.get(channel, (channel,))]
    upstream: set[Channel] = set()
    for channel in front:  # grows while it is walked
        if channel not in upstream:
            upstream.add(channel)
            front += [
                source for one in flow.needs.get(channel, ()) for source in flow.entering[one]
            ]
    return upstream


def _given(
    wiring: Wiring, in_grid: Mapping[str, Pair], frame: Frame, upstream: set[Channel]
) -> dict[Channel, Any]:
    """Where the operating point comes from: the terminal voltage and the plant's outputs."""
    given: dict[Channel, Any] = {(TERMINAL_VOLTAGE, axis): in_grid["v_in"][axis] for axis in (0, 1)}
    for port, signal in wiring.kinds[wiring.plant].outputs.items():
        name = f"{wiring.plant}.{port}"
        if (name, 0) in upstream or (name, 1) in upstream:
            z = to_frame(frame, in_grid["e" if port == "e_q" else port])
            given |= {(name, axis): z[axis + 2 - signal.width] for axis in range(signal.width)}
    return given


def _arriving(flow: Carried, found: Mapping[Channel, Any], channel: Channel) -> Any:
    return weighted_sum((1.0, found[source]) for source in flow.entering.get(channel, (channel,)))


def _at_ports(name: str, kind: ModuleKind, entering: Mapping[Channel, Any]) -> dict[str, Pair]:
    """The equilibria that a memoryless law asks for, all of inputs."""
    return {
        port: (entering[f"{name}.{port}", 0], entering.get((f"{name}.{port}", 1), 0.0))
        for port in kind.equilibrium_ports
        if port in kind.inputs
    }


def _by_law(
    law: Callable[..., Motion],
    kind: ModuleKind,
    name: str,
    parameters: Mapping[str, Any],
    omega_0: float,
    entering: Mapping[Channel, Any],
) -> Sequence[Any]:
    """All outputs of a memoryless kind whose law, not its linearisation, says where it rests."""
    ports = _at_ports(name, kind, entering)
    known = {
        **parameters,
        "omega_0": omega_0,
        **{f"{port}{EQUILIBRIUM}": pair for port, pair in ports.items()},
    }
    inputs = {
        port: ports[port] if signal.width == 2 else ports[port][0]
        for port, signal in kind.inputs.items()
    }
    return call_law(kind.name, law, (), **inputs, **asked(law, known))[1]
