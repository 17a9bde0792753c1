"""Voltage and current at the PCC at rest: what a network tool needs to place a linear model in a load flow."""

import numpy as np

from ibrid.assembly.equilibrium import device_points
from ibrid.assembly.operating_point import Pair, Parameters, add, plant_equilibrium
from ibrid.assembly.signals_at_rest import matrices_of
from ibrid.assembly.terminals import Point, behind_terminals
from ibrid.modules.behaviour import Element
from ibrid.structure.outside import LABEL
from ibrid.structure.wiring import Wiring


def terminal_point(
    wiring: Wiring, parameters: Parameters, point: Point, power_node: str, omega_0: float
) -> tuple[Pair, Pair]:
    """v0 and i0, (D, Q) per unit, current out of the inverter, V0 on the D axis.

    The current is that of the plant in closed form (`plant_equilibrium`), of each device where there are two, less what shunts
    at the PCC take; with a port that of its chain. parameters : instance -> parameter -> value. point : (p, q, v).

    Raises DiagramError for a plant whose operating point is not known in closed form.
    """
    inner = behind_terminals(wiring, parameters, point, power_node)
    v = (point[2] / parameters.get(LABEL, {}).get("voltage_scale", 1.0), 0.0)
    if inner.current is not None:
        return v, inner.current
    current = (0.0, 0.0)
    for device, own in device_points(wiring, parameters, inner.point):
        plant = plant_equilibrium(device.kinds[device.plant], parameters[device.plant], *own, inner.power_node)
        current = add(current, plant["i_g"])
    for name in wiring.having(Element.SHUNT):
        a, b, c, d = map(np.array, matrices_of(wiring.kinds[name], parameters[name], omega_0, (1.0, 0.0), {}))
        own = (d - c @ np.linalg.solve(a, b)) @ v
        current = add(current, (float(own[0]), float(own[1])))
    return v, (float(current[0]), float(current[1]))
