"""Which signals follow from the plant, channel by channel: a question of structure alone, which
never depends on values.

The operating point is carried from the terminal voltage and the plant's outputs through sums,
memoryless modules and the DC gain of filters and delays; what drives the plant's command has the
plant's u_r.

The controller frame lies at the angle at which a q component is where the controller holds it: at
the input of the PLL (or of whatever integrates into the angle); without one, on the q axis of the
voltage loop; without that, of the converter voltage less what is known in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.declaration import trial_arguments
from ibrid.modules.kind import ModuleKind
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.steady_state import (
    carries,
    command_of,
    entering,
    in_order,
    steady_inputs,
)
from ibrid.structure.reading.wiring import (
    PLANT,
    Channel,
    Wiring,
    channels_of,
    sources_of,
    split_port,
)


@dataclass(frozen=True)
class Carried:
    """Output channels that follow from the plant, each after those it needs, and the input channels
    that they reach.

    `needs` : output channel -> the input channels of its module that set it. `entering` : input
    channel -> what adds up there.
    `known` : channels whose operating point follows from the plant. `turned` : whether the
    controller has a frame of its own.
    `aligned` : the input channel whose value at rest sets that frame, mostly zero there; None where
    that cannot be decided.
    `command` : the outputs that drive the plant's command; wherever all of them add up they have
    its u_r, which constants beside them make.
    """

    needs: Mapping[Channel, tuple[Channel, ...]]
    entering: Mapping[Channel, tuple[Channel, ...]]
    known: frozenset[Channel]
    turned: bool
    aligned: Channel | None
    command: frozenset[str]


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
    command = command_of(wiring)
    arriving = {
        (port, axis): tuple((source, axis) for source in sources)
        for port, sources in entering(wiring, command).items()
        for axis in (0, 1)
    }
    sources = {
        channel: {source for one in inputs for source in arriving[one]}
        for channel, inputs in needs.items()
        if channel not in known
    }
    order = in_order(sources, known, lambda channel: (channel,))
    reached = set(known)  # the known ones that carry more than a ConstZero
    for channel in order:
        if not reached.isdisjoint(sources[channel]):
            reached.add(channel)
    known.update(order)
    at_inputs = {channel for channel, sources in arriving.items() if known.issuperset(sources)}
    follows = frozenset(at_inputs.union(channel for channel in known if channel not in arriving))
    return Carried(
        needs={channel: needs[channel] for channel in order},
        entering=arriving,
        known=follows,
        turned=any(kind.element in ROTATIONS for kind in wiring.kinds.values()),
        aligned=_aligned_channel(wiring, follows, frozenset(reached)),
        command=command,
    )


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
            one
            for one, gain in zip(inputs, row, strict=True)
            if one[0] in steady and (gain != 0 or one[0] in point)
        )
        for output, row in zip(outputs, d, strict=True)
    }


def _aligned_channel(
    wiring: Wiring, known: frozenset[Channel], reached: frozenset[Channel]
) -> Channel | None:
    """The input channel whose value at rest sets the controller frame.

    reached : what carries more than a ConstZero.
    """
    loops = _angle_loops(wiring)
    locked = [name for name in loops if wiring.kinds[name].element is Element.PLL]
    if locked:
        channel = (f"{locked[0]}.e_q", 0)
        return channel if channel in known else None
    for name in loops:
        (port,) = wiring.kinds[name].inputs
        channel = (f"{name}.{port}", 0)
        if channel in known and not reached.isdisjoint(sources_of(wiring, channel)):
            return channel
    if not loops:
        return None
    for name, kind in wiring.kinds.items():
        if _integrates(kind, 2):
            (port,) = kind.inputs
            channel = (f"{name}.{port}", 1)
            if channel in known and _sees_voltage(wiring, channel[0]):
                return channel
    channel = (f"{wiring.plant}.u_r", 1)
    return channel if channel in known else None


def _angle_loops(wiring: Wiring) -> list[str]:
    """Modules that integrate one scalar into the angle of the frame, the nearest to the rotations
    first.
    """
    front = [
        f"{name}.delta"
        for name in (*wiring.having(Element.ROTATION_IN), *wiring.having(Element.ROTATION_OUT))
    ]
    integrators: list[str] = []
    seen: set[str] = set()
    for port in front:  # breadth first; grows while it is walked
        for source in wiring.sources[port]:
            name, _ = split_port(source)
            if source == TERMINAL_VOLTAGE or name in seen:
                continue
            seen.add(name)
            kind = wiring.kinds[name]
            if kind.family == PLANT or kind.bilinear:
                continue
            if _integrates(kind, 1):
                integrators.append(name)
            front += [f"{name}.{one}" for one in kind.inputs]
    return integrators


def _integrates(kind: ModuleKind, width: int) -> bool:
    """True for a controller with one input of that width whose value at rest its integrator makes
    zero.
    """
    return kind.integrates and [signal.width for signal in kind.inputs.values()] == [width]


def _sees_voltage(wiring: Wiring, port: str) -> bool:
    """True when the capacitor or the terminal voltage comes to a port without an integrator in
    between.
    """
    front, seen = [port], set[str]()
    for one in front:  # grows while it is walked
        for source in wiring.sources[one]:
            name, output = split_port(source)
            if source in seen:
                continue
            seen.add(source)
            if source == TERMINAL_VOLTAGE:
                return True
            kind = wiring.kinds[name]
            if kind.family == PLANT:
                if output in ("e", "e_q"):
                    return True
            elif not kind.bilinear and (kind.static or kind.dc_gain is not None):
                front += [f"{name}.{entering}" for entering in kind.inputs]
    return False
