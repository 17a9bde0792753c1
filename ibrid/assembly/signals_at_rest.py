"""The operating point of every signal that follows from the plant, channel by channel.

It is carried from the terminal voltage and the plant's outputs through sums, memoryless modules and the DC gain of
filters and delays; what drives the plant's command has the plant's u_r. Which channels follow is a question of structure
alone, so that it never depends on values.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ibrid.assembly.numbers import weighted_sum
from ibrid.modules.declaration import trial_arguments
from ibrid.modules.kind import EQUILIBRIUM, Matrices, ModuleKind
from ibrid.modules.large_signal import Motion, asked
from ibrid.modules.own_law import call_law
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.steady_state import carries, command_of, entering, in_order, steady_inputs
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port

Channel = tuple[str, int]  # "NAME.port" or "v_DQ", and the axis
Pair = tuple[Any, Any]
Frame = tuple[Any, Any]  # cosine and sine of delta_eq
Parameters = Mapping[str, Mapping[str, Any]]  # instance -> parameter -> float or symbol


@dataclass(frozen=True)
class Carried:
    """Output channels that follow from the plant, each after those it needs.

    `needs` : channel -> the input channels of its module that set it. `known` : these and those of the plant.
    `reached` : the known ones that carry more than a ConstZero. `command` : the outputs that drive the plant's command;
    wherever all of them add up they have its u_r, which constants beside them make.
    """

    needs: Mapping[Channel, tuple[Channel, ...]]
    known: frozenset[Channel]
    reached: frozenset[Channel]
    command: frozenset[str]

    def follows(self, wiring: Wiring, channel: Channel) -> bool:
        """True when the operating point of a channel is known."""
        return self.known.issuperset(_entering(wiring, channel, self.command))


@lru_cache(64)
def carried(wiring: Wiring) -> Carried:
    """Which channels follow from the plant, and in which order."""
    known = {(TERMINAL_VOLTAGE, 0), (TERMINAL_VOLTAGE, 1)}
    for name, kind in wiring.kinds.items():
        if kind.family == PLANT:
            known.update(channels_of(name, kind.outputs))
    needs = {
        channel: inputs
        for name, kind in wiring.kinds.items()
        if carries(kind)
        for channel, inputs in _dependence(name, kind).items()
    }
    known.update((f"{wiring.plant}.u_r", axis) for axis in (0, 1))
    reached, command = set(known), command_of(wiring)
    sources = {
        channel: {source for one in inputs for source in _entering(wiring, one, command)}
        for channel, inputs in needs.items()
        if channel not in known
    }
    order = in_order(sources, known, lambda channel: (channel,))
    for channel in order:
        if not reached.isdisjoint(sources[channel]):
            reached.add(channel)
    follows = {channel: needs[channel] for channel in order}
    return Carried(follows, frozenset(known.union(order)), frozenset(reached), command)


def _dependence(name: str, kind: ModuleKind) -> dict[Channel, tuple[Channel, ...]]:
    """Output channel -> the input channels that set it at rest."""
    inputs, outputs = channels_of(name, kind.inputs), channels_of(name, kind.outputs)
    if not kind.static:  # one input and a DC gain that acts on each axis
        return {(port, axis): (inputs[axis],) for port, axis in outputs}
    steady = [f"{name}.{port}" for port in steady_inputs(kind)]
    point = [f"{name}.{port}" for port in kind.equilibrium_ports]
    d = kind.matrices(**trial_arguments(kind))[3]
    return {
        output: tuple(
            one for one, gain in zip(inputs, row, strict=True) if one[0] in steady and (gain != 0 or one[0] in point)
        )
        for output, row in zip(outputs, d, strict=True)
    }


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
    flow : of the same wiring. parameters : per unit. in_grid : the plant's ports in the grid frame, with `v_in` the
    terminal voltage. frame : of the controller, in which the plant's signals are. wanted : input or output channels that
    follow from the plant (`flow.follows`).
    """
    wanted = tuple(wanted)
    upstream = _upstream(wiring, flow, wanted)
    at_rest = _given(wiring, in_grid, frame, upstream)
    if flow.command:
        at_rest |= {(f"{wiring.plant}.u_r", axis): value for axis, value in enumerate(to_frame(frame, in_grid["u_r"]))}
    direct: dict[str, Matrices] = {}
    for channel, inputs in flow.needs.items():
        if channel not in upstream:
            continue
        name, _ = split_port(channel[0])
        kind = wiring.kinds[name]
        row = channels_of(name, kind.outputs).index(channel)
        entering = {one: _arriving(wiring, flow, at_rest, one) for one in inputs}
        if kind.rests_by_law and kind.large_signal is not None:
            at_rest[channel] = _by_law(kind.large_signal.law, kind, name, parameters[name], omega_0, entering)[row]
            continue
        if not kind.static:
            gains: Mapping[Channel, Any] = dict.fromkeys(inputs, kind.dc_gain)
        else:
            if name not in direct:
                direct[name] = matrices_of(kind, parameters[name], omega_0, frame, _at_ports(name, kind, entering))
            gains = dict(zip(channels_of(name, kind.inputs), direct[name][3][row], strict=True))
        at_rest[channel] = weighted_sum((gains[one], value) for one, value in entering.items())
    return {channel: _arriving(wiring, flow, at_rest, channel) for channel in wanted}


def channels_of(name: str, ports: Mapping[str, Signal]) -> list[Channel]:
    """The channels of a module's ports, in order."""
    return [(f"{name}.{port}", axis) for port, signal in ports.items() for axis in range(signal.width)]


def sources_of(wiring: Wiring, channel: Channel) -> list[Channel]:
    """The output channels that add up in an input channel; an output channel itself."""
    return [(source, channel[1]) for source in wiring.sources.get(channel[0], (channel[0],))]


def _entering(wiring: Wiring, channel: Channel, command: frozenset[str]) -> list[Channel]:
    """As `sources_of`, with the plant's u_r in place of all that drive it; command : of `Carried`."""
    port, axis = channel
    return [(one, axis) for one in entering(wiring, port, command)] if port in wiring.sources else [channel]


def to_frame(frame: Frame, z: Pair) -> Pair:
    """R(delta_eq) z."""
    cosine, sine = frame
    return weighted_sum(((cosine, z[0]), (sine, z[1]))), weighted_sum(((cosine, z[1]), (-sine, z[0])))


def matrices_of(
    kind: ModuleKind, parameters: Mapping[str, Any], omega_0: float, frame: Frame, ports: Mapping[str, Pair]
) -> Matrices:
    """State-space matrices of a kind at given parameters and equilibrium."""
    own = {name: parameters[name] for name in kind.parameters}
    return kind.matrices(**own, **kind.context(omega_0, frame, ports))


def _upstream(wiring: Wiring, flow: Carried, wanted: Iterable[Channel]) -> set[Channel]:
    """The output channels on which the wanted ones depend."""
    front = [source for channel in wanted for source in _entering(wiring, channel, flow.command)]
    upstream: set[Channel] = set()
    for channel in front:  # grows while it is walked
        if channel not in upstream:
            upstream.add(channel)
            front += [source for one in flow.needs.get(channel, ()) for source in _entering(wiring, one, flow.command)]
    return upstream


def _given(wiring: Wiring, in_grid: Mapping[str, Pair], frame: Frame, upstream: set[Channel]) -> dict[Channel, Any]:
    """Where the operating point comes from: the terminal voltage and the plant's outputs."""
    given: dict[Channel, Any] = {(TERMINAL_VOLTAGE, axis): in_grid["v_in"][axis] for axis in (0, 1)}
    for port, signal in wiring.kinds[wiring.plant].outputs.items():
        name = f"{wiring.plant}.{port}"
        if (name, 0) in upstream or (name, 1) in upstream:
            z = to_frame(frame, in_grid["e" if port == "e_q" else port])
            given |= {(name, axis): z[axis + 2 - signal.width] for axis in range(signal.width)}
    return given


def _arriving(wiring: Wiring, flow: Carried, found: Mapping[Channel, Any], channel: Channel) -> Any:
    return weighted_sum((1.0, found[source]) for source in _entering(wiring, channel, flow.command))


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
    known = {**parameters, "omega_0": omega_0, **{f"{port}{EQUILIBRIUM}": pair for port, pair in ports.items()}}
    inputs = {port: ports[port] if signal.width == 2 else ports[port][0] for port, signal in kind.inputs.items()}
    return call_law(kind.name, law, (), **inputs, **asked(law, known))[1]
