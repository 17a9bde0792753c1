"""What a device is told: by how much the constants of a diagram move when its set point of p or q
does.

Law: a constant at an input makes up at rest for what arrives there, so that it holds minus the
gain, at rest, from the measured power to that input, times the power. Told another power, it holds
minus that gain times that power; everything else stays. Nothing passes an integrator at rest, nor
an input with a constant of its own, behind which all is as it was. A filter of the power alone
measures it; one behind a gain or a sum, such as the inertia of a virtual machine, is part of the
law, and the set point is compared in front of it. A reference of current that is computed from a
power moves with it, by one over the voltage at rest.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from ibrid.assembly.module_motion import Module
from ibrid.assembly.numbers import is_zero
from ibrid.modules.behaviour import Element
from ibrid.modules.large_signal import reciprocal, square_root
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, sources_of

#: What a device may be told, in the order of the gains.
SET_POINTS = ("p_ref", "q_ref")
Gains = tuple[Any, Any]
_NONE: Gains = (0.0, 0.0)


def set_point_gains(
    wiring: Wiring,
    modules: Sequence[Module],
    references: Collection[Channel],
    arguments: Mapping[str, Mapping[str, Any]],
) -> dict[Channel, Gains]:
    """Input channel -> by how much its constant moves for each per unit of p_ref and of q_ref, of
    those that do.

    references : input channels that have a constant. arguments : instance -> numbers or symbols of
    its law.
    """
    owner = {
        channel: (module, row)
        for module in modules
        for row, channel in enumerate(channels_of(module.name, module.kind.outputs))
    }
    known: dict[Channel, Gains] = {}
    compared: set[Channel] = {*references}

    def measures(channel: Channel) -> bool:
        """Whether an output is the power, or that behind filters of it alone."""
        if channel not in owner:
            return False
        module = owner[channel][0]
        if module.kind.element is Element.POWER:
            return True
        sources = sources_of(wiring, _first_input(module, channel[1]))
        return not module.kind.static and len(sources) == 1 and measures(sources[0])

    def of_output(channel: Channel) -> Gains:
        if channel not in owner:
            return _NONE
        module, row = owner[channel]
        if module.kind.element is Element.POWER:
            return (1.0, 0.0) if channel[0].endswith(".p") else (0.0, 1.0)
        if channel in known:
            return known[channel]
        known[channel] = _NONE  # of a loop of direct terms nothing is said
        if not module.kind.static and module.kind.dc_gain and not measures(channel):
            compared.add(_first_input(module, channel[1]))
            return _NONE
        inputs = channels_of(module.name, module.kind.inputs)
        gains = _row_at_rest(module, row, arguments[module.name])
        terms = [
            (gain, of_input(one))
            for gain, one in zip(gains, inputs, strict=True)
            if one not in compared
        ]
        known[channel] = (
            sum(gain * p for gain, (p, _) in terms),
            sum(gain * q for gain, (_, q) in terms),
        )
        return known[channel]

    def of_input(channel: Channel) -> Gains:
        arriving = [of_output(source) for source in sources_of(wiring, channel)]
        return sum(p for p, _ in arriving), sum(q for _, q in arriving)

    for channel in references:
        of_input(channel)  # finds where else it is compared
    known.clear()
    moved = {channel: of_input(channel) for channel in sorted(compared)}
    gains: dict[Channel, Gains] = {
        channel: (-p, -q) for channel, (p, q) in moved.items() if not (is_zero(p) and is_zero(q))
    }
    for channel, (p, q) in _gains_of_references(wiring, modules, arguments):
        before = gains.get(channel, _NONE)
        gains[channel] = (before[0] + p, before[1] + q)
    return gains


def _gains_of_references(
    wiring: Wiring, modules: Sequence[Module], arguments: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[Channel, Gains]]:
    """Input channels that take a reference from power, with 1/|v| of p_ref on d, -1/|v| of q_ref on
    q.
    """
    given: dict[Channel, Gains] = {}
    for module in modules:
        if module.kind.element is Element.REFERENCE:
            v_d, v_q = arguments[module.name]["v_eq"]
            size = reciprocal(square_root(v_d * v_d + v_q * v_q))
            d, q = channels_of(module.name, module.kind.outputs)
            given |= {d: (size, 0.0), q: (0.0, -size)}
    for module in modules if given else ():
        for channel in channels_of(module.name, module.kind.inputs):
            for source in sources_of(wiring, channel):
                if source in given:
                    yield channel, given[source]


def _row_at_rest(module: Module, row: int, arguments: Mapping[str, Any]) -> list[Any]:
    """Gains at rest from each input channel to an output channel; zero of laws that are not linear,
    and of integrators.
    """
    kind, inputs = module.kind, channels_of(module.name, module.kind.inputs)
    if kind.large_signal is not None:
        return [0.0] * len(inputs)
    if kind.static:
        return [*kind.matrices(**arguments)[3][row]]
    first = _first_input(module, channels_of(module.name, kind.outputs)[row][1])
    return [(kind.dc_gain or 0.0) if one == first else 0.0 for one in inputs]


def _first_input(module: Module, axis: int) -> Channel:
    return f"{module.name}.{next(iter(module.kind.inputs), '')}", axis
