"""The source behind the grid that keeps the operating point at the PCC: v_Th = v - Z i."""

import numpy as np

from ibrid.analysis.grid import J, SeriesRL
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.terminals import behind_terminals
from ibrid.evaluation.record import Record
from ibrid.modules.branch import BRANCH
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table, parameters_at
from ibrid.structure.wiring import split_port, wire


def terminal_current(record: Record, op: str) -> np.ndarray | None:
    """(2,) [i_D, i_Q] that leaves the PCC at an operating point of the record, shunt branches included; per unit.

    None for a plant whose equilibrium is not known in closed form.
    """
    settings, values = record.settings, record.parameters[op]
    wiring = wire(record.diagram, record.vocabulary)
    plant, point = wiring.kinds[wiring.plant], settings["operating_points"][op]
    if plant.branches is None:
        return None
    at = (float(point["p"]), float(point["q"]), float(point["v"]))
    table = parameter_table(wiring, settings["equilibrium"])
    every = parameters_at(wiring, table, values)
    inner = behind_terminals(wiring, every, at, settings["power_node"])
    if inner.current is not None:
        return np.array(inner.current, dtype=float)
    numbers = every[wiring.plant]
    current = np.array(plant_equilibrium(plant, numbers, *inner.point, inner.power_node)["i_g"], dtype=float)
    shunts = [
        split_port(source)[0]
        for source in wiring.sources[TERMINAL_CURRENT]
        if source != TERMINAL_VOLTAGE and wiring.kinds[split_port(source)[0]].family == BRANCH
    ]
    if shunts:
        physics = {key: settings[key] for key in ("equilibrium", "power_node")}
        omega_0 = 2 * np.pi * float(settings["f0_hz"])
        matrices = module_matrices(wiring, table, values, at, omega_0=omega_0, pade_orders={}, **physics)
        for name in shunts:  # linear and in the grid frame: its DC gain acts on the voltage itself
            a, b, c, d = (np.array(part, dtype=float) for part in matrices[name])
            current = current + (d - c @ np.linalg.solve(a, b)) @ [at[2], 0.0]
    return current if np.isfinite(current).all() else None


def thevenin_voltage(v: float, current: np.ndarray, grid: SeriesRL) -> float:
    """|v_Th|, per unit, of v_Th = [v, 0] - (r + x J) i."""
    return float(np.linalg.norm(np.array([v, 0.0]) - (grid.r * np.eye(2) + grid.x * J) @ current))
