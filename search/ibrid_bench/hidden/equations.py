"""A hidden device as nonlinear equations with its loops cut where a delay sits, and their exact
Jacobians.

x' = f(x, s, v, r), the signals that leave for the delays s_out = h(x, s, v, r), i_DQ = g(x, s, v).
The command is always cut, delayed or not, so that every structure has the same form; s = s_out
delayed closes it.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from ibrid_bench.hidden.blocks import Symbols
from ibrid_bench.hidden.controller import (
    Measured,
    SecondOrder,
    current_reference,
    phase_locked_loop,
    voltage_command,
)
from ibrid_bench.hidden.nonlinear import dead_zone, limited
from ibrid_bench.hidden.parameters import Device, Structure
from ibrid_bench.hidden.plant import arriving, beside_the_inverter, l_filter, lcl_filter

from ibrid.plants.dynamics import J, R, States, low_pass

_THRESHOLDS: Structure = (("deadband", True), ("limit", True))


@dataclass(frozen=True, eq=False)
class Equations:
    """Functions of (x, s, v, r, n): states (n,), delayed signals (m,), v_DQ (2,), set-points (2,),
    numbers of the device.

    states : names of x. cut : m, 2 for the command, 2 each for a comb and for a current that is
    measured late. numbers : names of n, omega_0 (rad/s) the last.
    at_rest : -> what is zero at rest beside the asked power, (n + m,), then p, q at the capacitor
    and at the PCC, (2,) each; and the Jacobians of the three by (x, s, r). linearised : -> the nine
    matrices of (x', s_out, i_DQ) by (x, s, v).
    moving : -> x', s_out and i_DQ themselves.
    """

    states: tuple[str, ...]
    cut: int
    numbers: tuple[str, ...]
    at_rest: ca.Function
    linearised: ca.Function
    moving: ca.Function


@cache
def equations(structure: Structure, *, nonlinear: bool = False) -> Equations:
    """The equations of all devices of one structure; built once.

    nonlinear : with a dead zone before the PLL and a limit of the current reference, whose numbers
    then follow in n.
    """
    m, numbers, symbols = _symbols((*structure, *_THRESHOLDS) if nonlinear else structure)
    states = States()
    repeats, late = m.comb_gain is not None, m.T_current is not None
    cut = 2 + 2 * repeats + 2 * late
    s, v_DQ, r = ca.SX.sym("s", cut), ca.SX.sym("v_DQ", 2), ca.SX.sym("r", 2)
    u = s[:2]

    locked = m.kP_pll is not None
    delta = states.add("delta") if locked else ca.SX(0)
    rotation = R(delta)
    v = rotation @ v_DQ
    plant = (lcl_filter if m.filter == "LCL" else l_filter)(m, states, v, arriving(m, u))
    e, i_ti, i_g = (
        low_pass(states, f"sensor_{name}", m.omega_c_sensor, getattr(plant, name))
        for name in ("e", "i_ti", "i_g")
    )
    sequence = None if m.k_dsogi is None else SecondOrder(states, "dsogi")
    locked_to = e if sequence is None else sequence.positive
    e_q = dead_zone(locked_to[1], m.deadband) if nonlinear else locked_to[1]
    delta_omega = phase_locked_loop(m, states, e_q, delta) if locked else ca.SX(0)
    plant.turn(m.omega_0 + delta_omega)
    if sequence is not None and m.k_dsogi is not None:
        sequence.hears(m, m.k_dsogi, e, delta_omega)
    seen = Measured(e, v, s[-2:] if late else i_ti, i_g, delta_omega)
    i_ref = current_reference(m, states, seen, u, r)
    if nonlinear:
        i_ref = limited(i_ref, m.limit)
    command, heard = voltage_command(m, states, seen, i_ref, s[2:4] if repeats else ca.SX(0, 1))
    i_own = rotation.T @ plant.i_g
    i_DQ = i_own - beside_the_inverter(m, states, v_DQ)

    s_out = ca.vertcat(command, *([heard] if repeats else []), *([i_ti] if late else []))
    rest = ca.vertcat(states.x_dot, s - s_out)
    at_capacitor = ca.vertcat(ca.dot(plant.e, plant.i_g), ca.dot(plant.e, J(plant.i_g)))
    at_pcc = ca.vertcat(ca.dot(v_DQ, i_own), ca.dot(v_DQ, J(i_own)))
    arguments = [states.x, s, v_DQ, r, symbols]
    unknown = ca.vertcat(states.x, s, r)
    resting = [rest, at_capacitor, at_pcc]
    outputs, inputs = (states.x_dot, s_out, i_DQ), (states.x, s, v_DQ)
    matrices = [ca.densify(ca.jacobian(output, one)) for output in outputs for one in inputs]
    return Equations(
        states=tuple(states.names),
        cut=cut,
        numbers=numbers,
        at_rest=ca.Function(
            "at_rest", arguments, resting + [ca.jacobian(one, unknown) for one in resting]
        ),
        linearised=ca.Function("linearised", arguments, matrices),
        moving=ca.Function("moving", arguments, list(outputs)),
    )


def values_of(device: Device, omega_0: float) -> np.ndarray:
    """The numbers of a device in the order of its equations."""
    return np.array([*device.numbers.values(), omega_0])


def _symbols(structure: Structure) -> tuple[Symbols, tuple[str, ...], ca.SX]:
    found = {name: ca.SX.sym(name) for name, value in structure if value is True}
    found["omega_0"] = ca.SX.sym("omega_0")
    switches = {
        name: value if isinstance(value, str) else None
        for name, value in structure
        if name not in found
    }
    return Symbols(**found, **switches), tuple(found), ca.vertcat(*found.values())
