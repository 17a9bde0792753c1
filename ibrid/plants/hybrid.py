"""A hybrid of grid-following and grid-forming synchronisation as a nonlinear state-space model in
CasADi.

Its frequency is a weighted sum of what a PLL and what a power droop would make of it; the rest is
grid-following.
"""

from dataclasses import dataclass

import casadi as ca

from ibrid.errors import IbridError
from ibrid.plants.dynamics import Dynamics, J, R, States, low_pass, pi_control
from ibrid.plants.output_filter import LCLParameters, closed, output_filter, require_range


@dataclass(frozen=True, kw_only=True)
class HybridParameters(LCLParameters):
    """omega - omega_0 = weight (kP_pll + kI_pll/s) e_q + (1 - weight) m_p (p* - p_f); per unit
    unless a unit is given.

    L_F, R_F, C_F, L_g, R_g : LCL filter, p and q measured at its capacitor.
    weight : of the PLL, between 0 and 1, both excluded. kP_pll, kI_pll : rad/s and rad/s^2 per unit
    of voltage.
    m_p : droop, rad/s per unit of power. omega_c_power : corner of the low-passes on p and q,
    rad/s.
    kP_power, kI_power : i_ref_d = (kP + kI/s)(p* - p_f), i_ref_q = -(kP + kI/s)(q* - q_f); 1 and
    1/s.
    kP_current, kI_current : u_r = (kP + kI/s)(i_ref - i_ti) + (omega/omega_0) L_F J i_ti; 1 and
    1/s.

    Raises IbridError when a value is not finite or out of range.
    """

    weight: float
    kP_pll: float
    kI_pll: float
    m_p: float
    omega_c_power: float
    kP_power: float
    kI_power: float
    kP_current: float
    kI_current: float

    def __post_init__(self) -> None:
        require_range(self, (), "hybrid")
        if self.weight >= 1:
            raise IbridError(
                "weight of a hybrid inverter must lie below 1, which is a PLL alone; found "
                f"{self.weight:g}."
            )


def hybrid_dynamics(parameters: HybridParameters, omega_0: float) -> Dynamics:
    """The nonlinear model; omega_0 in rad/s, set-points [p*, q*]."""
    m, states = parameters, States()
    v_DQ, r = ca.SX.sym("v_DQ", 2), ca.SX.sym("r", 2)
    delta = states.add("angle.integral")
    plant = output_filter(m, states, R(delta) @ v_DQ, omega_0)
    p = low_pass(states, "p_filter.filtered", m.omega_c_power, plant.power[0])
    q = low_pass(states, "q_filter.filtered", m.omega_c_power, plant.power[1])
    error = r - ca.vertcat(p, q)

    by_pll = pi_control(states, "pll.integral", m.kP_pll, m.kI_pll, plant.e[1])
    deviation = m.weight * by_pll + (1 - m.weight) * m.m_p * error[0]
    states.moves(delta, deviation)

    i_ref = ca.vertcat(1, -1) * pi_control(states, "power.integral", m.kP_power, m.kI_power, error)
    by_current = pi_control(
        states, "current.integral", m.kP_current, m.kI_current, i_ref - plant.i_ti
    )
    u_r = by_current + (1 + deviation / omega_0) * m.L_F * J(plant.i_ti)
    plant.drive(u_r, omega_0 + deviation)
    return closed(states, plant, delta, v_DQ, r)
