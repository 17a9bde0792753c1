"""The controller of a hidden device: synchronisation, outer loops for p and q, current loop with
its additions.
"""

from dataclasses import dataclass

import casadi as ca
from ibrid_bench.hidden.blocks import Symbols, band_pass, notch

from ibrid.plants.dynamics import J, States, low_pass


@dataclass(frozen=True)
class Measured:
    """What the controller sees, in its frame: e, i_ti, i_g (2,), v (2,) at the PCC; delta_omega,
    deviation of the frame's frequency, rad/s.
    """

    e: ca.SX
    v: ca.SX
    i_ti: ca.SX
    i_g: ca.SX
    delta_omega: ca.SX


class SecondOrder:
    """Two generalised integrators on the axes of the stationary frame, written in the controller's
    frame.

    y' = k w (u - y) - w z - omega J y, z' = w y - omega J z, omega the speed of the frame, w that
    to which they are tuned.
    """

    def __init__(self, states: States, name: str) -> None:
        self.states, self.y, self.z = states, states.add(f"{name}_y", 2), states.add(f"{name}_z", 2)

    @property
    def positive(self) -> ca.SX:
        """(2,) the positive sequence: half of y, and half of z a quarter of a turn ahead."""
        return (self.y + J(self.z)) / 2

    def hears(self, m: Symbols, k: ca.SX, u: ca.SX, delta_omega: ca.SX) -> None:
        """Set the rates, of a signal u (2,)."""
        omega = m.omega_0 + delta_omega
        w = omega if m.sogi_tuning == "pll" else m.omega_0
        self.states.moves(self.y, k * w * (u - self.y) - w * self.z - omega * J(self.y))
        self.states.moves(self.z, w * self.y - omega * J(self.z))


def phase_locked_loop(m: Symbols, states: States, e_q: ca.SX, delta: ca.SX) -> ca.SX:
    """delta_omega = (kP + kI/s) of the filtered e_q; also moves the angle delta."""
    filtered = low_pass(states, "pll_filter", m.omega_c_pll, e_q)
    filtered = notch(states, "pll_notch", m.omega_n_pll, m.Q_pll, filtered)
    integral = states.add("pll_integral")
    delta_omega = m.kP_pll * filtered + m.kI_pll * integral
    states.moves(integral, filtered)
    states.moves(delta, delta_omega)
    return delta_omega


def current_reference(m: Symbols, states: States, seen: Measured, u: ca.SX, r: ca.SX) -> ca.SX:
    """(2,) i_ref from the outer loops.

    r (2,) : set-points; of each loop its own, without a loop the current itself.
    """
    measured = {"p": ca.dot(seen.e, seen.i_g), "q": ca.dot(seen.e, J(seen.i_g))}
    power = {
        axis: low_pass(states, f"{axis}_filter", m.omega_c_power, value)
        for axis, value in measured.items()
        if getattr(m, f"{axis}_loop") == "power"
    }
    i_d, i_q = r[0], r[1]
    if m.p_loop == "power":
        i_d = _pi(states, "p_integral", m.kP_p, m.kI_p, r[0] - _droop(m, states, seen) - power["p"])
    elif m.p_loop == "dc_link":
        v_dc = states.add("v_dc")
        states.moves(v_dc, (r[0] - ca.dot(u, seen.i_ti)) / (m.C_dc * v_dc))
        i_d = _pi(states, "p_integral", m.kP_p, m.kI_p, v_dc - 1)
    if m.q_loop == "power":
        i_q = -_pi(
            states,
            "q_integral",
            m.kP_q,
            m.kI_q,
            r[1] - _voltage_droop(m, states, seen) - power["q"],
        )
    elif m.q_loop == "voltage":
        i_q = -_pi(states, "q_integral", m.kP_q, m.kI_q, r[1] - ca.norm_2(seen.e))
    if "reference" in (m.p_loop, m.q_loop):
        size = ca.norm_2(low_pass(states, "magnitude", m.omega_c_magnitude, seen.e))
        i_d, i_q = (
            r[0] / size if m.p_loop == "reference" else i_d,
            -r[1] / size if m.q_loop == "reference" else i_q,
        )
    i_ref = low_pass(states, "reference_filter", m.omega_c_reference, ca.vertcat(i_d, i_q))
    return i_ref - _virtual_drop(m, seen) if m.virtual_impedance == "current_reference" else i_ref


def voltage_command(
    m: Symbols, states: States, seen: Measured, i_ref: ca.SX, repeated: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """(2,) command before its delay, and (2,) what the comb gets to hear again; `repeated` is what
    it hears.
    """
    current = seen.i_g if m.sensed_current == "i_g" else seen.i_ti
    filtered = low_pass(states, "current_filter", m.omega_c_current, current)
    error = i_ref - filtered
    heard = error if m.comb_gain is None else error + m.comb_gain * repeated
    integral = states.add("current_integral", 2)
    shaped = _lead_lag(m, states, heard)
    states.moves(integral, shaped)
    command = m.kP_current * shaped + m.kI_current * integral
    if m.k_resonant is not None:
        command += m.k_resonant * band_pass(
            states, "resonant", m.omega_resonant, 2 * m.width_resonant, error
        )
    if m.kP_negative is not None:
        slow = low_pass(states, "negative_reference", m.omega_c_negative, i_ref)
        command += _negative_sequence(m, states, slow - current)
    forward = low_pass(
        states, "feedforward", m.omega_c_ff, seen.v if m.sensed_voltage == "pcc" else seen.e
    )
    if m.k_sogi is not None:
        band = SecondOrder(states, "sogi")
        band.hears(m, m.k_sogi, forward, seen.delta_omega)
        forward = band.y
    command += m.k_ff * notch(states, "feedforward_notch", m.omega_n_ff, m.Q_ff, forward)
    if m.decoupling != "none":
        speed = 1 + seen.delta_omega / m.omega_0 if m.decoupling == "pll" else 1.0
        command += speed * m.L_decoupling * J(filtered if m.current_filter == "both" else current)
    if m.k_damping is not None:
        i_C = seen.i_ti - seen.i_g
        slow = (
            0.0
            if m.omega_c_damping is None
            else low_pass(states, "damping", m.omega_c_damping, i_C)
        )
        command -= m.k_damping * (i_C - slow)
    if m.virtual_impedance == "command":
        command -= _virtual_drop(m, seen)
    if m.k_reference is not None:
        command += m.k_reference * i_ref
    return low_pass(states, "command_filter", m.omega_c_command, command), heard


def _pi(states: States, name: str, kP: ca.SX, kI: ca.SX, error: ca.SX) -> ca.SX:
    integral = states.add(name)
    states.moves(integral, error)
    return kP * error + kI * integral


def _negative_sequence(m: Symbols, states: States, error: ca.SX) -> ca.SX:
    """kP error + kI x, x' = error - 2 omega_0 J x: a PI controller in the frame that turns
    backwards.
    """
    integral = states.add("negative_integral", 2)
    states.moves(integral, error - 2 * m.omega_0 * J(integral))
    return m.kP_negative * error + m.kI_negative * integral


def _droop(m: Symbols, states: States, seen: Measured) -> ca.SX:
    if m.k_droop is None:
        return ca.SX(0)
    return m.k_droop / m.omega_0 * low_pass(states, "droop", m.omega_c_droop, seen.delta_omega)


def _voltage_droop(m: Symbols, states: States, seen: Measured) -> ca.SX:
    if m.k_droop_v is None:
        return ca.SX(0)
    return m.k_droop_v * low_pass(states, "droop_v", m.omega_c_droop_v, ca.norm_2(seen.e))


def _virtual_drop(m: Symbols, seen: Measured) -> ca.SX:
    if m.R_virtual is None:
        return ca.SX.zeros(2)
    return m.R_virtual * seen.i_g + m.X_virtual * J(seen.i_g)


def _lead_lag(m: Symbols, states: States, signal: ca.SX) -> ca.SX:
    if m.omega_zero is None:
        return signal
    ratio = m.omega_pole / m.omega_zero
    return ratio * signal + (1 - ratio) * low_pass(states, "lead_lag", m.omega_pole, signal)
