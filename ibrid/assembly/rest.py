"""Where every signal of a diagram rests in absolute quantities, and the constants that keep it
there.

References (p* = 1) are constants that a linear model has lost. An input of a module must rest where
its law wants it: the operating point where the law names one, zero in front of an integrator. What
the sources there do not add up to is its reference. Signals behind integrators count from their
value at rest, so that references hold whatever the gains are.

A rest at another frequency than the nominal one is one in the frame that turns with it: there
reactances and susceptances are larger by the ratio of the frequencies, and a frequency that
multiplies in a law, as of the plant, is off by their difference.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import casadi as ca
import numpy as np

from ibrid.assembly.equilibrium import device_points, equilibria
from ibrid.assembly.module_motion import Module, by_port, module_at
from ibrid.assembly.numbers import is_zero
from ibrid.assembly.operating_point import Pair, Parameters, add, plant_equilibrium
from ibrid.assembly.signals_at_rest import Frame, matrices_of, to_frame
from ibrid.assembly.terminals import Inner, Point, behind_terminals
from ibrid.errors import IbridError
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import EQUILIBRIUM, ModuleKind
from ibrid.modules.large_signal import asked, require_large_signal
from ibrid.modules.own_law import call_law
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.network.outside import LABEL, PORT
from ibrid.structure.reading.parameters import ParameterTable, parameters_at
from ibrid.structure.reading.wiring import PLANT, Channel, Wiring, channels_of, sources_of

#: A reference below this, per unit or rad, is the rounding of a sum that is zero.
ROUNDING = 1e-12
NO_REST = "the model has no real operating point here; ask for less power"
#: Input that takes the deviation of the frequency from the nominal one, rad/s.
DEVIATION = "delta_omega"


@dataclass(frozen=True)
class Rest:
    """The operating point of a whole diagram, absolute, per unit and rad; numbers, or symbols where
    it was asked for in symbols.

    `states` : instance -> values. `outputs` : channel -> value, the terminal voltage among them.
    `references` : input channel -> constant that adds to its sources. `inner` : the device's own
    point behind its port, whose numbers at the nominal frequency are `port`, element -> name ->
    value. `deviation` : of the frequency from the nominal one, rad/s.
    """

    modules: tuple[Module, ...]
    states: Mapping[str, tuple[Any, ...]]
    outputs: Mapping[Channel, Any]
    references: Mapping[Channel, Any]
    inner: Inner | None = None
    port: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    deviation: Any = 0.0


def rest(
    wiring: Wiring,
    table: ParameterTable,
    values: Mapping[str, Any],
    point: Point,
    *,
    power_node: str,
    omega_0: float,
    pade_orders: Mapping[str, int],
    deviation: Any = 0.0,
) -> Rest:
    """The operating point (p, q, v) of a wired diagram at parameter values; of two devices behind
    one PCC p and q are of both.

    values, point, deviation : numbers or symbols; of symbols nothing is asked, so that where there
    is no rest it is not a number.
    deviation : of the frequency at rest from the nominal one, rad/s; the signals are those of the
    frame that turns with it.

    Raises ModuleError for a kind without a large-signal law, DiagramError where the operating point
    of a module does not follow from the plant, IbridError where there is none.
    """
    for kind in wiring.kinds.values():
        require_large_signal(kind)
    numbers = parameters_at(wiring, table, values)
    there = _turning(wiring, numbers, 1 + deviation / omega_0)
    settled = []
    inner = behind_terminals(wiring.outside, wiring.plant, there, point, power_node)
    for device, own in device_points(wiring.devices, there, inner.point):
        frame, ports = equilibria(device, there, own, inner.power_node, omega_0, deviation)
        modules = tuple(
            module_at(
                name,
                kind,
                numbers[name],
                omega_0,
                ports[name],
                pade_orders[name] if kind.delay else None,
            )
            for name, kind in device.kinds.items()
        )
        plant = plant_equilibrium(
            device.kinds[device.plant], there[device.plant], *own, inner.power_node
        )
        settled.append(_Settled(device, frame, ports, plant, own[2], deviation).settle(modules))
    port = {name: own for name, own in numbers.items() if name.startswith(f"{PORT}.")}
    return replace(_together(wiring, settled), inner=inner, port=port, deviation=deviation)


def _turning(
    wiring: Wiring, numbers: Mapping[str, Mapping[str, Any]], ratio: Any
) -> Mapping[str, Mapping[str, Any]]:
    """The numbers with reactances and susceptances at a frequency so many times the nominal one."""
    if is_zero(ratio - 1.0):
        return numbers
    grows = {name for name, kind in wiring.kinds.items() if _multiplied(kind)}
    return {
        name: {key: value * ratio if key[0] in "LC" else value for key, value in own.items()}
        if name in grows or name.startswith(f"{PORT}.")
        else own
        for name, own in numbers.items()
    }


def _multiplied(kind: ModuleKind) -> bool:
    """Whether the frequency multiplies in the law: a plant, or a decoupling without states."""
    return DEVIATION in kind.inputs and (kind.family == PLANT or not kind.states)


def _together(wiring: Wiring, parts: Sequence[Rest]) -> Rest:
    """Devices that meet at the terminals alone, their modules in the order of the diagram."""
    module = {one.name: one for part in parts for one in part.modules}
    return Rest(
        tuple(module[name] for name in wiring.kinds),
        {name: part.states[name] for part in parts for name in part.states},
        {channel: part.outputs[channel] for part in parts for channel in part.outputs},
        {channel: part.references[channel] for part in parts for channel in part.references},
    )


class _Settled:
    """Fills the values at rest: what the laws want first, then what follows from it, then loops of
    linear modules.
    """

    def __init__(
        self,
        wiring: Wiring,
        frame: Frame,
        ports: Mapping[str, Mapping[str, Pair]],
        plant: Mapping[str, Pair],
        v: Any,
        deviation: Any,
    ) -> None:
        self.wiring, self.frame, self.ports, self.plant, self.deviation = (
            wiring,
            frame,
            ports,
            plant,
            deviation,
        )
        self.states: dict[str, tuple[Any, ...]] = {}
        self.inputs: dict[Channel, Any] = {}
        self.outputs: dict[Channel, Any] = {(TERMINAL_VOLTAGE, 0): v, (TERMINAL_VOLTAGE, 1): 0.0}

    def settle(self, modules: tuple[Module, ...]) -> Rest:
        waiting = []
        for module in modules:
            if module.kind.large_signal is not None:
                self._place(module, self._at_operating_point(module))
            elif module.kind.integrates:
                self._place(module, [0.0] * len(channels_of(module.name, module.kind.inputs)))
            else:
                waiting.append(module)
        while waiting:
            ready = [one for one in waiting if self._arriving(one) is not None]
            for module in (
                ready or waiting
            ):  # the rest is a loop of filters and gains: counted from its value at rest
                arriving = self._arriving(module)
                zero = [0.0] * len(channels_of(module.name, module.kind.inputs))
                self._place(module, zero if arriving is None else arriving)
            waiting = [one for one in waiting if one.name not in self.states]
        if not all(
            isinstance(one, ca.SX) or isfinite(one)
            for one in (*self.inputs.values(), *self.outputs.values())
        ):
            raise IbridError(NO_REST)
        missing = {
            channel: wanted
            - sum(self.outputs[source] for source in sources_of(self.wiring, channel))
            for channel, wanted in self.inputs.items()
        }
        references = {channel: value for channel, value in missing.items() if _counts(value)}
        return Rest(modules, self.states, self.outputs, references)

    def _place(self, module: Module, inputs: list[Any]) -> None:
        """Give a module its inputs; its states and outputs follow."""
        name, kind = module.name, module.kind
        self.inputs |= dict(zip(channels_of(name, kind.inputs), inputs, strict=True))
        x = self._states_at_rest(module, inputs)
        _, outputs = module.motion(x, by_port(kind, inputs))
        self.states[name] = x
        self.outputs |= dict(
            zip(channels_of(name, kind.outputs), map(_plain, outputs), strict=True)
        )

    def _states_at_rest(self, module: Module, inputs: list[Any]) -> tuple[Any, ...]:
        kind = module.kind
        if kind.large_signal is not None:
            if kind.large_signal.at_rest is None:
                return ()
            known = {
                **module.arguments,
                **{f"{port}{EQUILIBRIUM}": z for port, z in self.ports[module.name].items()},
            }
            law = kind.large_signal.at_rest
            return tuple(_plain(one) for one in call_law(kind.name, law, **asked(law, known)))
        if not module.states or all(is_zero(one) for one in inputs):
            return (0.0,) * len(module.states)
        a, b = (ca.vertcat(*(ca.horzcat(*row) for row in part)) for part in module.matrices_at_rest)
        return tuple(ca.solve(a, -b @ ca.vertcat(*inputs)).elements())

    def _at_operating_point(self, module: Module) -> list[Any]:
        """Inputs of a module whose law depends on them: from the plant, else zero; the angle is
        that of the frame.
        """
        inputs: list[Any] = []
        for port, signal in module.kind.inputs.items():
            if module.kind.large_signal is not None and port == module.kind.large_signal.angle:
                inputs.append(ca.atan2(self.frame[1], self.frame[0]))
            elif module.kind.family == PLANT and port in self.plant:
                inputs += [_plain(one) for one in to_frame(self.frame, self.plant[port])]
            elif port == DEVIATION and _multiplied(module.kind):
                inputs.append(self.deviation)
            else:
                inputs += [
                    _plain(one)
                    for one in self.ports[module.name].get(port, (0.0, 0.0))[: signal.width]
                ]
        return inputs

    def _arriving(self, module: Module) -> list[Any] | None:
        """What the sources of its inputs add up to; None where some are not known yet."""
        sums = []
        for channel in channels_of(module.name, module.kind.inputs):
            sources = sources_of(self.wiring, channel)
            if not all(source in self.outputs for source in sources):
                return None
            sums.append(sum(self.outputs[source] for source in sources))
        return sums


def _plain(value: Any) -> Any:
    return value if isinstance(value, ca.SX) else float(value)


def _counts(value: Any) -> bool:
    """False for a sum that is zero but for rounding."""
    return not is_zero(value) if isinstance(value, ca.SX) else abs(value) > ROUNDING


def terminal_point(
    wiring: Wiring, parameters: Parameters, point: Point, power_node: str, omega_0: float
) -> tuple[Pair, Pair]:
    """v0 and i0, (D, Q) per unit, current out of the inverter, V0 on the D axis.

    The current is that of the plant in closed form (`plant_equilibrium`), of each device where
    there are two, less what shunts at the PCC take; with a port that of its chain. parameters :
    instance -> parameter -> value. point : (p, q, v).

    Raises DiagramError for a plant whose operating point is not known in closed form.
    """
    inner = behind_terminals(wiring.outside, wiring.plant, parameters, point, power_node)
    v = (point[2] / parameters.get(LABEL, {}).get("voltage_scale", 1.0), 0.0)
    if inner.current is not None:
        return v, inner.current
    current = (0.0, 0.0)
    for device, own in device_points(wiring.devices, parameters, inner.point):
        plant = plant_equilibrium(
            device.kinds[device.plant], parameters[device.plant], *own, inner.power_node
        )
        current = add(current, plant["i_g"])
    for name in wiring.having(Element.SHUNT):
        a, b, c, d = map(
            np.array, matrices_of(wiring.kinds[name], parameters[name], omega_0, (1.0, 0.0), {})
        )
        own = (d - c @ np.linalg.solve(a, b)) @ v
        current = add(current, (float(own[0]), float(own[1])))
    return v, (float(current[0]), float(current[1]))
