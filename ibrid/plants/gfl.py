"""The grid-following inverter of the paper, section II, as a nonlinear state-space model in CasADi.

Equations (2) to (7): LCL or L filter in the frame of the PLL, PLL, power control, current control. Nothing here is
linearised and nothing is shared with the block diagrams, so a sweep of this model is an independent truth for them.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from math import isfinite, pi
from typing import Literal

import casadi as ca

from ibrid.errors import IbridError

FilterKind = Literal["LCL", "L"]
Decoupling = Literal["pll", "nominal", "none"]


@dataclass(frozen=True, kw_only=True)
class GFLParameters:
    """Parameters and options of the grid-following inverter; per unit on its own base unless a unit is given.

    L_F, R_F : inverter-side inductance and resistance. With filter "L" they are the whole filter.
    C_F : filter capacitance (susceptance at nominal frequency); 0 with filter "L".
    L_g, R_g : grid-side inductance and resistance, between capacitor and PCC; 0 with filter "L".
    kP_pll, kI_pll : PLL gains, rad/s and rad/s^2 per unit of voltage.
    kP_power, kI_power : gains of both power controllers, 1 and 1/s (equation 5).
    kP_current, kI_current : gains of the current controller, 1 and 1/s; kI_current = omega_0 k_I,i, because
        equation (6a) integrates omega_0 times the error.
    omega_c_pll : cutoff of a first-order low-pass between e_q and the PLL, rad/s; None: no filter.
    omega_c_power : cutoff of a first-order low-pass on the measured p and q, rad/s; None: no filter.
    feedforward : gain of the capacitor voltage in the voltage command (1 in equation 6b).
    decoupling : "pll": (omega/omega_0) L J i_ti with the PLL frequency, equation (6b); "nominal": L J i_ti; "none".
    L_decoupling : inductance that the decoupling assumes; None: L_F.
    filter : "LCL", or "L" where the controller measures the PCC voltage and the filter current.

    Raises IbridError when a value is not finite, a storage element or integral gain is not positive, or a resistance,
    proportional gain or cutoff is negative.
    """

    L_F: float
    R_F: float
    C_F: float = 0.0
    L_g: float = 0.0
    R_g: float = 0.0
    kP_pll: float
    kI_pll: float
    kP_power: float
    kI_power: float
    kP_current: float
    kI_current: float
    omega_c_pll: float | None = None
    omega_c_power: float | None = None
    feedforward: float = 1.0
    decoupling: Decoupling = "pll"
    L_decoupling: float | None = None
    filter: FilterKind = "LCL"

    def __post_init__(self) -> None:
        positive = {"L_F", "kI_pll", "kI_power", "kI_current", "omega_c_pll", "omega_c_power"}
        positive |= {"C_F", "L_g"} if self.filter == "LCL" else set()
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, str):
                continue
            if not isfinite(value) or value < 0 or (field.name in positive and value == 0):
                least = "positive" if field.name in positive else "zero or positive"
                raise IbridError(f"{field.name} of a grid-following inverter must be {least}; found {value:g}.")

    @property
    def assumed_inductance(self) -> float:
        """Inductance in the decoupling term, per unit; 0 without decoupling."""
        if self.decoupling == "none":
            return 0.0
        return self.L_F if self.L_decoupling is None else self.L_decoupling


@dataclass(frozen=True)
class Dynamics:
    """x' = f(x, v_DQ, r), i_DQ = g(x, v_DQ) as CasADi functions.

    states : names, one per entry of x, in the naming of the block diagrams where such a state exists.
    f : (x, v_DQ (2,), r (2,) = [p*, q*]) -> x', per second.
    g : (x, v_DQ) -> i_DQ (2,), out of the inverter.
    """

    states: tuple[str, ...]
    f: ca.Function
    g: ca.Function

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, v_DQ, r) -> A, B (for v_DQ), C, D."""
        x = ca.SX.sym("x", len(self.states))
        v_DQ, r = ca.SX.sym("v_DQ", 2), ca.SX.sym("r", 2)
        x_dot, i_DQ = self.f(x, v_DQ, r), self.g(x, v_DQ)
        matrices = [ca.jacobian(x_dot, x), ca.jacobian(x_dot, v_DQ), ca.jacobian(i_DQ, x), ca.jacobian(i_DQ, v_DQ)]
        return ca.Function("linearised", [x, v_DQ, r], [ca.densify(m) for m in matrices])


def _J(z: ca.SX) -> ca.SX:
    return ca.vertcat(-z[1], z[0])


def _R(delta: ca.SX) -> ca.SX:
    c, s = ca.cos(delta), ca.sin(delta)
    return ca.vertcat(ca.horzcat(c, s), ca.horzcat(-s, c))


def gfl_dynamics(parameters: GFLParameters, omega_0: float) -> Dynamics:
    """The nonlinear model; omega_0 in rad/s. Source: paper, equations (2) to (7)."""
    m, lcl = parameters, parameters.filter == "LCL"
    states: list[str] = []
    parts: list[ca.SX] = []

    def state(*names: str) -> ca.SX:
        states.extend(names)
        parts.append(ca.SX.sym(names[0], len(names)))
        return parts[-1]

    v_DQ, r = ca.SX.sym("v_DQ", 2), ca.SX.sym("r", 2)
    i_ti = state("plant.i_ti_d", "plant.i_ti_q") if lcl else None
    e_c = state("plant.e_d", "plant.e_q") if lcl else None
    i_g = state("plant.i_g_d", "plant.i_g_q")
    e_q_filtered = state("pll_filter.e_q") if m.omega_c_pll is not None else None
    phi_pll, delta = state("pll.integral"), state("pll.angle")
    pq_filtered = state("power_filter.p", "power_filter.q") if m.omega_c_power is not None else None
    phi_p, phi_q = state("power_p.integral"), state("power_q.integral")
    gamma = state("current.integral_d", "current.integral_q")

    v = _R(delta) @ v_DQ
    e = v if e_c is None else e_c
    i = i_g if i_ti is None else i_ti

    # synchronisation, equation (3)
    e_q_pll = e[1] if e_q_filtered is None else e_q_filtered
    omega = omega_0 + m.kP_pll * e_q_pll + m.kI_pll * phi_pll

    # outer power control, equations (4) and (5)
    power = ca.vertcat(ca.dot(e, i_g), ca.dot(e, _J(i_g)))
    error = r - (power if pq_filtered is None else pq_filtered)
    i_r = ca.vertcat(
        m.kP_power * error[0] + m.kI_power * phi_p,
        -m.kP_power * error[1] - m.kI_power * phi_q,
    )

    # inner current control, equation (6)
    speed = omega / omega_0 if m.decoupling == "pll" else 1.0
    u_r = (
        m.kP_current * (i_r - i)
        + m.kI_current / omega_0 * gamma
        + m.feedforward * e
        + speed * m.assumed_inductance * _J(i)
    )

    # filter in the frame of the PLL, equation (2)
    rates: list[ca.SX] = []
    current_rate = omega_0 / m.L_F * (u_r - e - m.R_F * i) - omega * _J(i)
    if e_c is not None:
        rates += [
            current_rate,
            omega_0 / m.C_F * (i - i_g) - omega * _J(e_c),
            omega_0 / m.L_g * (e_c - v - m.R_g * i_g) - omega * _J(i_g),
        ]
    else:
        rates += [current_rate]
    if e_q_filtered is not None and m.omega_c_pll is not None:
        rates += [m.omega_c_pll * (e[1] - e_q_filtered)]
    rates += [e_q_pll, omega - omega_0]
    if pq_filtered is not None and m.omega_c_power is not None:
        rates += [m.omega_c_power * (power - pq_filtered)]
    rates += [error[0], error[1], omega_0 * (i_r - i)]

    x = ca.vertcat(*parts)
    return Dynamics(
        states=tuple(states),
        f=ca.Function("f", [x, v_DQ, r], [ca.vertcat(*rates)], ["x", "v_DQ", "r"], ["x_dot"]),
        g=ca.Function("g", [x, v_DQ], [_R(delta).T @ i_g], ["x", "v_DQ"], ["i_DQ"]),
    )


def hertz(frequency: float) -> float:
    """rad/s of a frequency in Hz."""
    return 2 * pi * frequency
