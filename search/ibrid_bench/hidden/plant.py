"""The power circuit of a hidden device: LCL or L filter in the controller's frame, and what stands
beside it at the PCC.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
from ibrid_bench.hidden.blocks import Symbols

from ibrid.plants.dynamics import J, States


@dataclass(frozen=True)
class OutputFilter:
    """Signals of the filter in the controller's frame, (2,) each.

    e : the measured voltage. i_ti, i_g : currents of the converter and into the grid.
    turn : sets the rates of the states, once the angular frequency of the frame (rad/s) is known.
    """

    e: ca.SX
    i_ti: ca.SX
    i_g: ca.SX
    turn: Callable[[ca.SX], None]


def lcl_filter(m: Symbols, states: States, v: ca.SX, u: ca.SX) -> OutputFilter:
    """L_F, R_F from converter to capacitor node; C_F with R_C, and a further R-C branch or trap, at
    it; L_g, R_g to the PCC.
    """
    i_ti, v_C, i_g = psi, *_ = (
        states.add("i_ti", 2),
        states.add("v_C", 2),
        states.add("i_g", 2),
    )  # psi : flux over L_F
    if m.I_core is not None:
        i_ti = psi / ca.sqrt(1 - ca.dot(psi, psi) / m.I_core**2)
    L_g, R_g = m.L_g + m.L_series, m.R_g + m.R_series
    R_branch, v_branch = m.R_branch, None
    if R_branch is None:
        i_branch, e = ca.SX.zeros(2), v_C + m.R_C * (i_ti - i_g)
    else:
        v_branch = states.add("v_branch", 2)
        # e = v_C + R_C (i_ti - i_g - (e - v_branch) / R_branch), solved for e
        e = (v_C + m.R_C * (i_ti - i_g + v_branch / R_branch)) / (1 + m.R_C / R_branch)
        i_branch = (e - v_branch) / R_branch
    if m.L_t is not None:
        i_trap, v_trap = states.add("i_trap", 2), states.add("v_trap", 2)
        i_branch += i_trap

    def turn(omega: ca.SX) -> None:
        states.moves(
            psi, m.omega_0 / m.L_F * (u - lost(m, i_ti) - e - m.R_F * i_ti) - omega * J(psi)
        )
        states.moves(v_C, m.omega_0 / m.C_F * (i_ti - i_g - i_branch) - omega * J(v_C))
        states.moves(i_g, m.omega_0 / L_g * (e - v - R_g * i_g) - omega * J(i_g))
        if v_branch is not None:
            states.moves(v_branch, m.omega_0 / m.C_branch * i_branch - omega * J(v_branch))
        if m.L_t is not None:
            states.moves(
                i_trap, m.omega_0 / m.L_t * (e - v_trap - m.R_t * i_trap) - omega * J(i_trap)
            )
            states.moves(v_trap, m.omega_0 / m.C_t * i_trap - omega * J(v_trap))

    return OutputFilter(e, i_ti, i_g, turn)


def l_filter(m: Symbols, states: States, v: ca.SX, u: ca.SX) -> OutputFilter:
    """L_F, R_F from converter to the terminals where e is measured; the series impedance from there
    to the PCC.
    """
    i = states.add("i_g", 2)
    L, R = m.L_F + m.L_series, m.R_F + m.R_series
    drive = u - lost(m, i) - v - R * i  # (L / omega_0) di/dt + L (omega / omega_0) J i
    e = v + m.R_series * i + m.L_series / L * drive

    def turn(omega: ca.SX) -> None:
        states.moves(i, m.omega_0 / L * drive - omega * J(i))

    return OutputFilter(e, i, i, turn)


def arriving(m: Symbols, u: ca.SX) -> ca.SX:
    """(2,) the command as it arrives at the converter: turned by what the controller leaves of the
    delay's angle.
    """
    return u if m.delay_angle is None else ca.cos(m.delay_angle) * u + ca.sin(m.delay_angle) * J(u)


def lost(m: Symbols, i: ca.SX) -> ca.SX:
    """(2,) voltage that dead time takes against a current."""
    if m.D_dead_time is None:
        return ca.SX.zeros(2)
    return m.D_dead_time * i / ca.sqrt(ca.dot(i, i) + m.a_dead_time**2)


def beside_the_inverter(m: Symbols, states: States, v_DQ: ca.SX) -> ca.SX:
    """(2,) current in the grid frame that branches from the PCC to neutral draw: a series R-C and a
    series R-L-C.
    """
    i_DQ = ca.SX.zeros(2)
    if m.R_shunt is not None:
        v_shunt = states.add("v_shunt", 2)
        i_shunt = (v_DQ - v_shunt) / m.R_shunt
        states.moves(v_shunt, m.omega_0 / m.C_shunt * i_shunt - m.omega_0 * J(v_shunt))
        i_DQ += i_shunt
    if m.load_L is not None:
        i_load, v_load = states.add("i_load", 2), states.add("v_load", 2)
        states.moves(
            i_load,
            m.omega_0 / m.load_L * (v_DQ - v_load - m.load_R * i_load) - m.omega_0 * J(i_load),
        )
        states.moves(v_load, m.omega_0 / m.load_C * i_load - m.omega_0 * J(v_load))
        i_DQ += i_load
    return i_DQ
