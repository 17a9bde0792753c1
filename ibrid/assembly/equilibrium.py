"""The operating point at every port that needs one, and the angle of the controller frame.

`exact`: computed from p, q, v and the plant, carried through sums, static modules and the DC gain
of filters and delays. `paper`: (E0d, 0), (I0d, 0) and delta_eq, three free numbers at every
operating point.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ibrid.assembly.known_at_rest import carried
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.signals_at_rest import (
    Frame,
    Pair,
    Parameters,
    controller_frame,
    signals_at_rest,
    to_frame,
)
from ibrid.assembly.terminals import Point
from ibrid.errors import DiagramError
from ibrid.modules.behaviour import Element
from ibrid.structure.reading.wiring import PLANT, Wiring, channels_of


def equilibria(
    wiring: Wiring,
    parameters: Parameters,
    point: Point,
    power_node: str,
    omega_0: float,
    deviation: Any = 0.0,
) -> tuple[Frame, dict[str, dict[str, Pair]]]:
    """Controller frame and equilibrium at the ports of every module, `exact` mode.

    Parameters
    ----------
    wiring : of a legal diagram. parameters : instance -> parameter -> value, per unit.
    point : (p, q, v) per unit. power_node : "capacitor" or "pcc". omega_0 : rad/s. deviation : of
    the grid's frequency from the nominal one, rad/s, which turns the frame of a PLL without
    integral action.

    Returns
    -------
    (cos, sin) of delta_eq, and instance -> port -> (d, q) for the ports that the kind's law asks
    for; a scalar is (value, 0). Not numbers where no real operating point exists.

    Raises
    ------
    DiagramError : a module needs the operating point of a signal that does not follow from the
    plant.
    """
    if len(wiring.devices) > 1:
        raise DiagramError(
            "the diagram has two devices, each with its own frame; this asks for one, leave one out"
        )
    plant = wiring.plant
    in_grid = plant_equilibrium(wiring.kinds[plant], parameters[plant], *point, power_node)
    flow = carried(wiring)
    frame = controller_frame(wiring, flow, parameters, in_grid, omega_0, deviation)
    # instance, port, its channels, wherever a law asks for an operating point, the plant's apart
    wanted = [
        (name, port, channels_of(name, {port: {**kind.inputs, **kind.outputs}[port]}))
        for name, kind in wiring.kinds.items()
        if kind.family != PLANT
        for port in kind.equilibrium_ports
    ]
    for name, port, channels in wanted:
        if not flow.known.issuperset(channels):
            raise DiagramError(
                f"{name} ({wiring.kinds[name].name}) needs the operating point at {name}.{port}, "
                "which does not follow "
                "from the plant; wire that port to a plant signal, a sum of them, or such a signal "
                "behind filters and gains"
            )
    channels = {channel for _, _, some in wanted for channel in some}
    signals = signals_at_rest(wiring, flow, parameters, in_grid, omega_0, frame, channels)
    ports: dict[str, dict[str, Pair]] = {name: {} for name in wiring.kinds}
    ports[plant] = {
        port: to_frame(frame, in_grid[port]) for port in wiring.kinds[plant].equilibrium_ports
    }
    for name, port, some in wanted:
        ports[name][port] = (signals[some[0]], signals[some[1]] if len(some) == 2 else 0.0)
    return frame, ports


def device_equilibria(
    devices: Sequence[Wiring],
    parameters: Parameters,
    point: Point,
    power_node: str,
    omega_0: float,
) -> dict[str, tuple[Frame, dict[str, Pair]]]:
    """Instance -> (frame, port -> (d, q)), each device at its own operating point.

    Of two devices behind one PCC, p and q are sums over both, shared as their `Share` says, each
    measured at that node of its device; v is common. Raises DiagramError as `equilibria` does.
    """
    by_instance = {}
    for device, own in device_points(devices, parameters, point):
        frame, ports = equilibria(device, parameters, own, power_node, omega_0)
        by_instance |= {name: (frame, ports[name]) for name in device.kinds}
    return by_instance


def device_points(
    devices: Sequence[Wiring], parameters: Parameters, point: Point
) -> list[tuple[Wiring, Point]]:
    """The devices of a diagram, each with its own (p, q, v): what its `Share` says of p and q, or
    what is left.
    """
    p, q, v = point
    left = [p, q]
    points: dict[str, Point] = {}
    for device in devices:
        for name in device.having(Element.SHARE):
            own = parameters[name]["share_p"] * p, parameters[name]["share_q"] * q
            points[device.plant] = (*own, v)
            left = [left[0] - own[0], left[1] - own[1]]
    return [(device, points.get(device.plant, (*left, v))) for device in devices]


def paper_equilibria(
    wiring: Wiring, parameters: Parameters
) -> dict[str, tuple[Frame, dict[str, Pair]]]:
    """The same per module under `equilibrium="paper"`: instance -> (frame, port -> (d, q))."""
    by_instance = {}
    for name, kind in wiring.kinds.items():
        own = parameters[name]
        frame = (
            (ca.cos(own["delta_eq"]), ca.sin(own["delta_eq"])) if kind.uses_frame else (1.0, 0.0)
        )
        ports = {
            port: (1.0 if word == "V0" else own[word], 0.0)
            for port, word in kind.equilibrium.items()
        }
        by_instance[name] = (frame, ports)
    return by_instance
