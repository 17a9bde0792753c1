"""The grid-following inverter of the paper, section II, as a nonlinear state-space model in CasADi.

Equations (2) to (7): LCL or L filter in the frame of the PLL, PLL, power control, current control;
in place of the power loops also control of a DC link and of the magnitude of the voltage. Nothing
here is linearised and nothing is shared with the block diagrams, so a sweep of this model is an
independent truth for them.
"""

from dataclasses import dataclass
from math import pi
from typing import Literal

import casadi as ca

from ibrid.border import methods_take_kinds
from ibrid.errors import IbridError
from ibrid.plants.dynamics import Dynamics, J, R, States, low_pass, pi_control
from ibrid.plants.output_filter import (
    FilterKind,
    OutputFilter,
    closed,
    output_filter,
    require_range,
)

Decoupling = Literal["pll", "nominal", "none"]
ActiveLoop = Literal["power", "dc_link"]
ReactiveLoop = Literal["power", "voltage"]


@methods_take_kinds
@dataclass(frozen=True, kw_only=True)
class GFLParameters:
    """Parameters and options of the grid-following inverter; per unit on its own base unless a unit
    is given.

    L_F, R_F : inverter-side inductance and resistance. With filter "L" they are the whole filter.
    C_F : filter capacitance (susceptance at nominal frequency); 0 with filter "L".
    L_g, R_g : grid-side inductance and resistance, between capacitor and PCC; 0 with filter "L".
    kP_pll, kI_pll : PLL gains, rad/s and rad/s^2 per unit of voltage.
    kP_power, kI_power : gains of both power controllers, 1 and 1/s (equation 5).
    kP_current, kI_current : gains of the current controller, 1 and 1/s; kI_current = omega_0 k_I,i,
    because
        equation (6a) integrates omega_0 times the error.
    omega_c_pll : cutoff of a first-order low-pass between e_q and the PLL, rad/s; None: no filter.
    omega_c_power : cutoff of a first-order low-pass on the measured p and q, rad/s; None: no
    filter.
    feedforward : gain of the capacitor voltage in the voltage command (1 in equation 6b).
    decoupling : "pll": (omega/omega_0) L J i_ti with the PLL frequency, equation (6b); "nominal": L
    J i_ti; "none".
    L_decoupling : inductance that the decoupling assumes; None: L_F.
    k_damping : u_r -= k (i_ti - i_g), active damping by the current of the capacitor.
    filter : "LCL", or "L" where the controller measures the PCC voltage and the filter current.
    p_loop : "power", or "dc_link": the d current controls the voltage of a DC link that a constant
    power source feeds.
    q_loop : "power", or "voltage": the q current controls the magnitude of e.
    C_dc : DC capacitance, s, twice its energy over the rating. kP_dc, kI_dc : gains on v_dc - 1, 1
    and 1/s.
    kP_ac, kI_ac : gains on |e| - V*, 1 and 1/s. None without the loop that has them.

    Raises IbridError when a value is not finite, a storage element or integral gain is not
    positive, a resistance, proportional gain or cutoff is negative, or a loop lacks its gains.
    """

    L_F: float
    R_F: float
    C_F: float = 0.0
    L_g: float = 0.0
    R_g: float = 0.0
    kP_pll: float
    kI_pll: float
    kP_power: float | None = None
    kI_power: float | None = None
    kP_current: float
    kI_current: float
    omega_c_pll: float | None = None
    omega_c_power: float | None = None
    feedforward: float = 1.0
    decoupling: Decoupling = "pll"
    L_decoupling: float | None = None
    k_damping: float = 0.0
    filter: FilterKind = "LCL"
    p_loop: ActiveLoop = "power"
    q_loop: ReactiveLoop = "power"
    C_dc: float | None = None
    kP_dc: float | None = None
    kI_dc: float | None = None
    kP_ac: float | None = None
    kI_ac: float | None = None

    def __post_init__(self) -> None:
        may_be_zero = {"R_F", "R_g", "kP_pll", "kP_power", "kP_current", "kP_dc", "kP_ac"}
        may_be_zero |= {"feedforward", "L_decoupling", "k_damping"} | (
            {"C_F", "L_g"} if self.filter == "L" else set()
        )
        require_range(self, may_be_zero, "grid-following")
        if lacking := [name for name in self._gains if getattr(self, name) is None]:
            raise IbridError(
                f"a grid-following inverter with these loops needs {', '.join(lacking)}; found "
                "none."
            )

    @property
    def _gains(self) -> set[str]:
        """Names of the parameters of its outer loops."""
        power = {"kP_power", "kI_power"} if "power" in (self.p_loop, self.q_loop) else set()
        dc_link = {"C_dc", "kP_dc", "kI_dc"} if self.p_loop == "dc_link" else set()
        return power | dc_link | ({"kP_ac", "kI_ac"} if self.q_loop == "voltage" else set())

    @property
    def assumed_inductance(self) -> float:
        """Inductance in the decoupling term, per unit; 0 without decoupling."""
        if self.decoupling == "none":
            return 0.0
        return self.L_F if self.L_decoupling is None else self.L_decoupling


def gfl_dynamics(parameters: GFLParameters, omega_0: float) -> Dynamics:
    """The nonlinear model; omega_0 in rad/s, set-points [p* or P_in, q* or V*].

    Source: paper, equations (2) to (7).
    """
    m, states = parameters, States()
    v_DQ, r = ca.SX.sym("v_DQ", 2), ca.SX.sym("r", 2)
    delta = states.add("pll.angle")
    plant = output_filter(m, states, R(delta) @ v_DQ, omega_0)

    # synchronisation, equation (3)
    e_q = low_pass(states, "pll_filter.e_q", m.omega_c_pll, plant.e[1])
    phi_pll = states.add("pll.integral")
    omega = omega_0 + m.kP_pll * e_q + m.kI_pll * phi_pll
    states.moves(phi_pll, e_q)
    states.moves(delta, omega - omega_0)

    # outer control, equations (4) and (5), and inner current control, equation (6)
    i_r, v_dc = _current_reference(m, states, plant, r)
    gamma = states.add("current.integral", 2)
    speed = omega / omega_0 if m.decoupling == "pll" else 1.0
    u_r = (
        m.kP_current * (i_r - plant.i_ti)
        + m.kI_current / omega_0 * gamma
        + m.feedforward * plant.e
        + speed * m.assumed_inductance * J(plant.i_ti)
        - m.k_damping * (plant.i_ti - plant.i_g)
    )
    states.moves(gamma, omega_0 * (i_r - plant.i_ti))
    if v_dc is not None:
        states.moves(v_dc, (r[0] - ca.dot(u_r, plant.i_ti)) / (_given(m.C_dc) * v_dc))
    plant.drive(u_r, omega)

    return closed(states, plant, delta, v_DQ, r)


def _current_reference(
    m: GFLParameters, states: States, plant: OutputFilter, r: ca.SX
) -> tuple[ca.SX, ca.SX | None]:
    """(2,) reference of the current from the outer loops, and the voltage of the DC link where
    there is one.
    """
    v_dc = None
    if m.p_loop == "power":
        error = r[0] - low_pass(states, "power_filter.p", m.omega_c_power, plant.power[0])
        i_d = pi_control(states, "power_p.integral", _given(m.kP_power), _given(m.kI_power), error)
    else:
        v_dc = states.add("dc_link.v_dc")
        i_d = pi_control(states, "dc_loop.integral", _given(m.kP_dc), _given(m.kI_dc), v_dc - 1)
    if m.q_loop == "power":
        error = r[1] - low_pass(states, "power_filter.q", m.omega_c_power, plant.power[1])
        i_q = -pi_control(states, "power_q.integral", _given(m.kP_power), _given(m.kI_power), error)
    else:
        i_q = -pi_control(
            states, "ac_loop.integral", _given(m.kP_ac), _given(m.kI_ac), r[1] - ca.norm_2(plant.e)
        )
    return ca.vertcat(i_d, i_q), v_dc


def _given(value: float | None) -> float:
    """A parameter of an outer loop that is there, as GFLParameters has checked."""
    return float("nan") if value is None else value


def hertz(frequency: float) -> float:
    """rad/s of a frequency in Hz."""
    return 2 * pi * frequency
