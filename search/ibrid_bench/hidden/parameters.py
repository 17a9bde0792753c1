"""Everything that a hidden device may contain: parameters, and switches that are parameters left
out.
"""

from dataclasses import dataclass, fields
from math import isfinite
from typing import Literal

from ibrid.errors import IbridError

FilterKind = Literal["LCL", "L"]
ActiveLoop = Literal["power", "dc_link", "reference", "none"]
ReactiveLoop = Literal["power", "voltage", "reference", "none"]
Decoupling = Literal["pll", "nominal", "none"]
FilteredCurrent = Literal["both", "loop"]
SogiTuning = Literal["pll", "nominal"]
SensedVoltage = Literal["e", "pcc"]
SensedCurrent = Literal["i_ti", "i_g"]
VirtualImpedance = Literal["command", "current_reference"]
Structure = tuple[tuple[str, str | bool], ...]

_MAY_BE_NEGATIVE = {
    "k_ff",
    "k_damping",
    "k_reference",
    "delay_angle",
    "comb_gain",
    "R_virtual",
    "X_virtual",
}
_MAY_BE_ZERO = _MAY_BE_NEGATIVE | {
    *("R_F", "L_g", "R_g", "R_C", "L_series", "R_series", "load_R", "T_d", "k_droop", "k_resonant"),
    *("kP_pll", "kP_p", "kP_q", "kP_current"),
}
_TOGETHER = (
    ("R_branch", "C_branch"),
    ("R_shunt", "C_shunt"),
    ("load_R", "load_L", "load_C"),
    ("kP_pll", "kI_pll"),
    ("omega_n_pll", "Q_pll"),
    ("kP_p", "kI_p"),
    ("kP_q", "kI_q"),
    ("omega_n_ff", "Q_ff"),
    ("R_virtual", "X_virtual"),
    ("k_resonant", "omega_resonant", "width_resonant"),
    ("kP_negative", "kI_negative"),
    ("omega_zero", "omega_pole"),
    ("comb_gain", "comb_delay"),
    ("D_dead_time", "a_dead_time"),
    ("L_t", "R_t", "C_t"),
)


@dataclass(frozen=True, kw_only=True)
class Device:
    """A grid-following inverter with every effect that may be hidden in it; per unit, s, rad/s.
    None: not there.

    Filter. filter : "LCL", or "L" where the controller measures the current and the voltage of its
    terminals.
    L_F, R_F, C_F, L_g, R_g : as in the LCL. R_C : in series with C_F. R_branch, C_branch : in
    series, beside C_F.
    I_core : current at which L_F is 1/sqrt(2) of itself. L_t, R_t, C_t : a trap in series, beside
    C_F.
    L_series, R_series : between the inverter's terminals and the PCC; behind an L filter the
    voltage is measured before.
    R_shunt, C_shunt : in series from the PCC to neutral. load_R, load_L, load_C : the same, a
    series resonant load.

    Synchronisation. kP_pll, kI_pll : None: the controller works in the frame of the PCC voltage.
    omega_c_pll : low-pass,
    omega_n_pll, Q_pll : notch on e_q.

    Outer loops. p_loop : "power", "dc_link" (kP_p, kI_p act on v_dc - 1; C_dc in s), "reference"
    (p* / |e|, e filtered with omega_c_magnitude where given) or "none", a fixed reference. q_loop :
    "power", "voltage" (on |e|), "reference" or "none".
    omega_c_power : low-pass on p and q. k_droop, omega_c_droop : p* -= k_droop delta_omega /
    omega_0, with a low-pass or without; k_droop_v, omega_c_droop_v : q* -= k_droop_v |e|.
    omega_c_reference : low-pass on the current reference.

    Current loop. kP_current, kI_current : 1 and 1/s. omega_c_current : low-pass on the measured
    current, for loop and decoupling or the loop alone (current_filter). k_ff, omega_c_ff,
    omega_n_ff, Q_ff : gain, low-pass, notch of the
    voltage feedforward. decoupling : L_decoupling J i, "pll" times omega / omega_0. k_damping : u_r
    -= k (i_ti - i_g), less its low-pass at omega_c_damping where given. R_virtual, X_virtual :
    times i_g, subtracted from the voltage command or the current reference (virtual_impedance).
    k_reference : u_r += k i_ref. omega_c_command : low-pass on the
    whole command. sensed_voltage : that of the feedforward; sensed_current : that of the loop and
    the decoupling.
    omega_c_sensor : low-pass on every voltage and current that the controller sees. T_d : delay of
    the whole command, s,
    T_current : of the inverter's current as the controller sees it. T_hold : for how long the
    command holds a value, s.

    Hardware. D_dead_time, a_dead_time : the converter's voltage loses D i_ti/sqrt(|i_ti|^2 + a^2).
    delay_angle : rad by which
    the command arrives turned. k_sogi : the feedforward passes a SOGI of this gain, k_dsogi : the
    PLL sees the positive sequence of a DSOGI; both in the stationary frame, tuned to the PLL's
    frequency or the nominal one (sogi_tuning).

    k_resonant, omega_resonant, width_resonant : 2 k w s / (s^2 + 2 w s + omega^2) on the error of
    the current loop, at a multiple of f0 control of the negative sequence (2) or of harmonics (6).
    kP_negative, kI_negative : a PI controller in the frame that turns backwards, on the reference,
    behind a low-pass at omega_c_negative where given, less the measured current.

    In no catalogue. omega_zero, omega_pole : (1 + s/omega_zero) / (1 + s/omega_pole) on it.
    comb_gain, comb_delay : 1 / (1 - g e^-sT) on it.

    Raises IbridError for a number out of range and for parameters that only make sense together.
    """

    filter: FilterKind = "LCL"
    L_F: float
    R_F: float
    C_F: float | None = None
    L_g: float = 0.0
    R_g: float = 0.0
    R_C: float = 0.0
    R_branch: float | None = None
    C_branch: float | None = None
    L_series: float = 0.0
    R_series: float = 0.0
    I_core: float | None = None
    L_t: float | None = None
    R_t: float | None = None
    C_t: float | None = None
    R_shunt: float | None = None
    C_shunt: float | None = None
    load_R: float | None = None
    load_L: float | None = None
    load_C: float | None = None

    kP_pll: float | None = None
    kI_pll: float | None = None
    omega_c_pll: float | None = None
    omega_n_pll: float | None = None
    Q_pll: float | None = None

    p_loop: ActiveLoop = "power"
    q_loop: ReactiveLoop = "power"
    kP_p: float | None = None
    kI_p: float | None = None
    kP_q: float | None = None
    kI_q: float | None = None
    C_dc: float | None = None
    omega_c_power: float | None = None
    k_droop: float | None = None
    omega_c_droop: float | None = None
    k_droop_v: float | None = None
    omega_c_droop_v: float | None = None
    omega_c_magnitude: float | None = None
    omega_c_reference: float | None = None

    kP_current: float
    kI_current: float
    omega_c_current: float | None = None
    current_filter: FilteredCurrent = "both"
    k_ff: float = 0.0
    omega_c_ff: float | None = None
    omega_n_ff: float | None = None
    Q_ff: float | None = None
    decoupling: Decoupling = "none"
    L_decoupling: float | None = None
    k_damping: float | None = None
    omega_c_damping: float | None = None
    R_virtual: float | None = None
    X_virtual: float | None = None
    virtual_impedance: VirtualImpedance = "command"
    k_reference: float | None = None
    omega_c_command: float | None = None
    omega_c_sensor: float | None = None
    sensed_voltage: SensedVoltage = "e"
    sensed_current: SensedCurrent = "i_ti"
    T_d: float = 0.0
    T_current: float | None = None
    T_hold: float | None = None

    k_resonant: float | None = None
    omega_resonant: float | None = None
    width_resonant: float | None = None
    kP_negative: float | None = None
    kI_negative: float | None = None
    omega_c_negative: float | None = None
    omega_zero: float | None = None
    omega_pole: float | None = None
    comb_gain: float | None = None
    comb_delay: float | None = None

    D_dead_time: float | None = None
    a_dead_time: float | None = None
    delay_angle: float | None = None
    k_sogi: float | None = None
    k_dsogi: float | None = None
    sogi_tuning: SogiTuning = "pll"

    def __post_init__(self) -> None:
        for name, value in self.numbers.items():
            if not isfinite(value) or (value < 0 and name not in _MAY_BE_NEGATIVE):
                raise IbridError(
                    f"{name} of a hidden device must be zero or positive; found {value:g}."
                )
            if value == 0 and name not in _MAY_BE_ZERO:
                raise IbridError(
                    f"{name} of a hidden device must not be zero; leave it out where it is not "
                    "there."
                )
        for names in (*_TOGETHER, *self._needed()):
            given = [getattr(self, name) is not None for name in names]
            if any(given) != all(given):
                raise IbridError(
                    f"a hidden device must have all of {', '.join(names)} or none; found {given}."
                )
        if self.filter == "LCL" and not self.L_g + self.L_series:
            raise IbridError("L_g of a hidden device with an LCL filter must be positive; found 0.")

    def _needed(self) -> list[tuple[str, ...]]:
        """Names that must all be given: a parameter that is always given, with those that a switch
        asks for.
        """
        needed = [("L_F", "C_F")] if self.filter == "LCL" else []
        needed += [("L_F", "kI_p")] if self.p_loop in ("power", "dc_link") else []
        needed += [("L_F", "kI_q")] if self.q_loop in ("power", "voltage") else []
        needed += [("L_F", "C_dc")] if self.p_loop == "dc_link" else []
        needed += [("L_F", "L_decoupling")] if self.decoupling != "none" else []
        needed += (
            [("L_F", "kI_pll")] if self.decoupling == "pll" or self.k_droop is not None else []
        )
        return needed

    @property
    def numbers(self) -> dict[str, float]:
        """Name -> value of the parameters that are there."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: float(value) for name, value in found.items() if not isinstance(value, str | None)
        }

    @property
    def structure(self) -> Structure:
        """What sets the form of the equations: the switches, and which parameters are there."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return tuple(
            (name, value if isinstance(value, str) else value is not None)
            for name, value in found.items()
        )
