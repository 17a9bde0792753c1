"""Grid-forming inverters as nonlinear state-space models in CasADi: droop, virtual synchronous
machine, virtual oscillator.

All have an LCL filter and the same cascade of voltage and current control; they differ in what
makes frequency and amplitude. Nothing here is linearised and nothing is shared with the block
diagrams.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, sin
from types import MappingProxyType
from typing import ClassVar

import casadi as ca

from ibrid.plants.dynamics import Dynamics, J, R, States, low_pass, pi_control
from ibrid.plants.output_filter import (
    LCLParameters,
    OutputFilter,
    closed,
    output_filter,
    require_range,
)


@dataclass(frozen=True, kw_only=True)
class GFMParameters(LCLParameters):
    """Filter and cascade of every grid-forming inverter here; per unit on its own base unless a
    unit is given.

    L_F, R_F, C_F, L_g, R_g : LCL filter, p and q measured at its capacitor.
    kP_voltage, kI_voltage : voltage control, 1 and 1/s; i_ref = (kP + kI/s)(e_ref - e) +
    (omega/omega_0) C_F J e.
    kP_current, kI_current : current control, 1 and 1/s; u_r = (kP + kI/s)(i_ref - i_ti) +
    (omega/omega_0) L_F J i_ti.
    X_virtual : e_ref = [E, 0] - (omega/omega_0) X_virtual J i_g.
    k_damping, omega_damping : u_r -= k (e - e behind a low-pass of that corner, rad/s).

    Raises IbridError when a value is not finite or negative, or one that must not be zero is.
    """

    may_be_zero: ClassVar[frozenset[str]] = frozenset(
        {"R_F", "R_g", "kP_voltage", "kP_current", "X_virtual"}
    )

    kP_voltage: float
    kI_voltage: float
    kP_current: float
    kI_current: float
    X_virtual: float = 0.0
    k_damping: float
    omega_damping: float

    def __post_init__(self) -> None:
        require_range(self, self.may_be_zero, "grid-forming")


@dataclass(frozen=True, kw_only=True)
class DroopParameters(GFMParameters):
    """Droops on filtered p and q: omega = omega_0 + m_p (p* - p_f), E = V* + m_q (q* - q_f).

    m_p : rad/s per unit of power. m_q : per unit. omega_p, omega_q : corners of the low-passes of p
    and q, rad/s.
    """

    m_p: float
    omega_p: float
    m_q: float
    omega_q: float


@dataclass(frozen=True, kw_only=True)
class VSMParameters(GFMParameters):
    """Virtual synchronous machine: T_a d/dt domega/omega_0 = p* - p - k_d (omega -
    omega_pll)/omega_0 - k_w domega/omega_0.

    T_a : acceleration time, s. k_d : damping by the frequency that a PLL measures on e, per unit.
    k_w : governor, per unit.
    kP_pll, kI_pll : of that PLL, rad/s and rad/s^2 per unit of voltage. m_q, omega_q : E = V* + m_q
    (q* - q_f).
    """

    may_be_zero: ClassVar[frozenset[str]] = GFMParameters.may_be_zero | {"k_d", "kP_pll"}

    T_a: float
    k_d: float
    k_w: float
    kP_pll: float
    kI_pll: float
    m_q: float
    omega_q: float


@dataclass(frozen=True, kw_only=True)
class OscillatorParameters(GFMParameters):
    """Dispatchable virtual oscillator, amplitude E and frequency omega, with p and q of the
    capacitor:

    omega = omega_0 + eta/E^2 (sin(kappa) (p* - p) - cos(kappa) (q* - q)),
    E' = eta/E (cos(kappa) (p* - p) + sin(kappa) (q* - q)) + alpha (V*^2 - E^2) E.

    eta : rad/s per unit. kappa : rad. alpha : 1/s. The set-points are those at rest: p* = p, q* =
    q, V* = |e|.
    """

    may_be_zero: ClassVar[frozenset[str]] = GFMParameters.may_be_zero | {"kappa"}

    eta: float
    kappa: float
    alpha: float


@dataclass(frozen=True)
class _Synchronisation:
    """Frequency of the frame, rad/s, amplitude E, set-points r, and what these obey beside the
    power asked for.
    """

    omega: ca.SX
    amplitude: ca.SX
    r: ca.SX
    further: Callable[[ca.SX], list[ca.SX]] = lambda pq: []


def gfm_dynamics(parameters: GFMParameters, omega_0: float) -> Dynamics:
    """The nonlinear model; omega_0 in rad/s, set-points [p*, V* + m_q q*], of the oscillator [p*,
    q*, V*^2].

    Source: S. D'Arco, J. A. Suul and O. B. Fosso, EPSR 122 (2015), for the cascade; the classes for
    what drives it.
    """
    m, states = parameters, States()
    v_DQ = ca.SX.sym("v_DQ", 2)
    delta = states.add("angle.integral")
    plant = output_filter(m, states, R(delta) @ v_DQ, omega_0)
    made = _SYNCHRONISATIONS[type(m)](m, states, plant, omega_0)
    states.moves(delta, made.omega - omega_0)
    plant.drive(_command(m, states, plant, made, omega_0), made.omega)
    return closed(states, plant, delta, v_DQ, made.r, made.further)


def _droop(
    m: DroopParameters, states: States, plant: OutputFilter, omega_0: float
) -> _Synchronisation:
    r = ca.SX.sym("r", 2)
    p = low_pass(states, "p_filter.filtered", m.omega_p, plant.power[0])
    q = low_pass(states, "q_filter.filtered", m.omega_q, plant.power[1])
    return _Synchronisation(omega_0 + m.m_p * (r[0] - p), r[1] - m.m_q * q, r)


def _machine(
    m: VSMParameters, states: States, plant: OutputFilter, omega_0: float
) -> _Synchronisation:
    r = ca.SX.sym("r", 2)
    deviation = states.add("inertia.filtered")
    # the PLL's angle counts from the controller's frame
    locked = states.add("pll.angle")
    by_pll = pi_control(states, "pll.integral", m.kP_pll, m.kI_pll, (R(locked) @ plant.e)[1])
    states.moves(locked, by_pll - deviation)
    surplus = omega_0 * (r[0] - plant.power[0]) - m.k_d * (deviation - by_pll) - m.k_w * deviation
    states.moves(deviation, surplus / m.T_a)
    q = low_pass(states, "q_filter.filtered", m.omega_q, plant.power[1])
    return _Synchronisation(omega_0 + deviation, r[1] - m.m_q * q, r)


def _oscillator(
    m: OscillatorParameters, states: States, plant: OutputFilter, omega_0: float
) -> _Synchronisation:
    r, E = ca.SX.sym("r", 3), states.add("oscillator.E")
    c, s = cos(m.kappa), sin(m.kappa)
    surplus = r[:2] - plant.power
    omega = omega_0 + m.eta / E**2 * (s * surplus[0] - c * surplus[1])
    states.moves(E, m.eta / E * (c * surplus[0] + s * surplus[1]) + m.alpha * (r[2] - E**2) * E)
    # at rest the frequency leaves one combination of p* - p and q* - q open: the other one
    return _Synchronisation(omega, E, r, lambda pq: [c * (r[0] - pq[0]) + s * (r[1] - pq[1])])


_SYNCHRONISATIONS: Mapping[type, Callable[..., _Synchronisation]] = MappingProxyType(
    {DroopParameters: _droop, VSMParameters: _machine, OscillatorParameters: _oscillator}
)


def _command(
    m: GFMParameters, states: States, plant: OutputFilter, made: _Synchronisation, omega_0: float
) -> ca.SX:
    """(2,) u_r from voltage control with a virtual reactance, current control, and damping by the
    fast part of e.
    """
    speed = made.omega / omega_0
    e_ref = ca.vertcat(made.amplitude, 0) - speed * m.X_virtual * J(plant.i_g)
    by_voltage = pi_control(states, "voltage.integral", m.kP_voltage, m.kI_voltage, e_ref - plant.e)
    i_ref = by_voltage + speed * m.C_F * J(plant.e)
    by_current = pi_control(
        states, "current.integral", m.kP_current, m.kI_current, i_ref - plant.i_ti
    )
    slow = low_pass(states, "damping_filter.filtered", m.omega_damping, plant.e)
    return by_current + speed * m.L_F * J(plant.i_ti) - m.k_damping * (plant.e - slow)
