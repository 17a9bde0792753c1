"""The effects of the catalogue as they are hidden in devices: every id, at its usual places, in
three severities.

Per unit, s, rad/s. "add": the device has it and the model lacks it; "remove": the other way round;
"replace": one for another.
"""

from math import pi, radians

from ibrid_bench.hidden.declaration import ABSENT, PRESENT, HiddenEffect, Strength, always

_HZ = 2 * pi
_NO_PLL = {"kP_pll": None, "kI_pll": None, "omega_c_pll": None}
_NO_P, _NO_Q = (
    {"p_loop": "none", "kP_p": None, "kI_p": None},
    {"q_loop": "none", "kP_q": None, "kI_q": None},
)
_DELAY = Strength((2e-5, 4e-5), (8e-5, 1.5e-4), (2e-4, 3e-4))
_BELIEVED_DELAY = Strength((2e-5, 4e-5), (6e-5, 1e-4), (1.4e-4, 1.8e-4))
_PREFILTER = Strength((_HZ * 300, _HZ * 600), (_HZ * 80, _HZ * 150), (_HZ * 20, _HZ * 40))
_POWER_FILTER = Strength((_HZ * 100, _HZ * 200), (_HZ * 25, _HZ * 50), (_HZ * 6, _HZ * 12))
_CURRENT_FILTER = Strength(
    (_HZ * 3000, _HZ * 5000), (_HZ * 1000, _HZ * 2000), (_HZ * 400, _HZ * 700)
)
_FORWARD_FILTER = Strength((_HZ * 1500, _HZ * 3000), (_HZ * 300, _HZ * 700), (_HZ * 50, _HZ * 150))
_FORWARD = Strength((0.1, 0.2), (0.4, 0.7), (0.85, 0.98))
_DAMPING = Strength((0.03, 0.06), (0.1, 0.25), (0.4, 0.8))
_HIGH_PASS = always(_HZ * 100, _HZ * 300)
_COUPLING = Strength((0.2, 0.35), (0.5, 0.7), (1.0, 1.2), times="L_F")
_DROOP = Strength((2.0, 4.0), (8.0, 15.0), (25.0, 40.0))
_DROOP_FILTER = always(_HZ * 3, _HZ * 15)
_DROP = {
    "R_virtual": Strength((0.01, 0.02), (0.04, 0.08), (0.12, 0.25)),
    "X_virtual": Strength((0.01, 0.03), (0.06, 0.12), (0.2, 0.4)),
}
_SHUNT = {
    "R_shunt": always(0.02, 0.2),
    "C_shunt": Strength((0.004, 0.01), (0.02, 0.05), (0.1, 0.2)),
}
_SERIES_R = Strength((0.01, 0.03), (0.1, 0.2), (0.4, 0.8))
_BRANCH = {
    "R_branch": always(0.3, 1.0),
    "C_branch": Strength((0.1, 0.2), (0.4, 0.8), (1.0, 2.0), times="C_F"),
}
_PHASE_LOCK = {
    "kP_pll": Strength((15, 30), (50, 90), (120, 180)),
    "kI_pll": Strength((100, 300), (1000, 3000), (4000, 8000)),
}
_P_LOOP = {"kP_p": always(0.005, 0.03), "kI_p": Strength((3.0, 6.0), (12.0, 25.0), (40.0, 60.0))}
_Q_LOOP = {"kP_q": always(0.005, 0.03), "kI_q": Strength((3.0, 6.0), (12.0, 25.0), (40.0, 60.0))}
_VOLTAGE = {
    "q_loop": "voltage",
    "kP_q": always(0.05, 0.3),
    "kI_q": Strength((5, 10), (20, 50), (80, 150)),
}
_DC = {
    "p_loop": "dc_link",
    "C_dc": Strength((0.05, 0.08), (0.02, 0.04), (0.008, 0.015)),
    "kP_p": always(1.0, 3.0),
    "kI_p": always(20.0, 80.0),
}
_LCL = {
    "filter": "LCL",
    "C_F": Strength((0.01, 0.02), (0.04, 0.07), (0.1, 0.15)),
    "L_g": always(0.5, 1.0, times="L_F"),
    "R_g": always(0.5, 1.5, times="R_F"),
}
_LINE = {
    "L_series": Strength((0.2, 0.4), (1.2, 2.0), (2.5, 3.5), times="L_g"),
    "R_series": Strength((0.2, 0.4), (1.2, 2.0), (2.5, 3.5), times="R_g"),
}
_LINE_BEFORE_L = {
    "L_series": Strength((0.02, 0.04), (0.08, 0.15), (0.2, 0.3)),
    "R_series": Strength((0.002, 0.004), (0.008, 0.015), (0.02, 0.03)),
}
_ANGLE = Strength(
    (radians(0.5), radians(1)),
    (radians(2), radians(4)),
    (radians(6), radians(10)),
    either_sign=True,
)

_UNLOCKED = {
    "decoupling": "nominal",
    "omega_c_pll": None,
}  # without a PLL there is no other frequency than omega_0
_LOCKED = {"kP_pll": PRESENT}
_WITH_P, _WITH_Q = {"p_loop": "power"}, {"q_loop": "power"}
_P_ALONE, _Q_ALONE = {**_WITH_P, "omega_c_power": ABSENT}, {**_WITH_Q, "omega_c_power": ABSENT}
_WITHOUT_POWER_FILTER = {"omega_c_power": ABSENT}
_WITH_LCL = {"filter": "LCL"}
_FORWARDED = {"k_ff": PRESENT}

FRAME_MISALIGNMENT = HiddenEffect(
    "frame_misalignment",
    "angle",
    "add",
    measurement={"frame_angle": _ANGLE},
    verdicts=("data-convention",),
)

#: Every id of the table of effects.
HIDDEN: tuple[HiddenEffect, ...] = (
    HiddenEffect("control_delay", "command", "add", {"T_d": _DELAY}, base={"T_d": ABSENT}),
    HiddenEffect(
        "control_delay", "command", "remove", {}, {"T_d": _BELIEVED_DELAY}, base={"T_d": ABSENT}
    ),
    HiddenEffect("pll_missing", "pll", "add", _PHASE_LOCK, _NO_PLL, _UNLOCKED, base=_LOCKED),
    HiddenEffect("pll_missing", "pll", "remove", _NO_PLL, _PHASE_LOCK, _UNLOCKED, base=_LOCKED),
    HiddenEffect("power_loop_missing", "p", "add", _P_LOOP, _NO_P, base=_P_ALONE),
    HiddenEffect("power_loop_missing", "p", "remove", _NO_P, _P_LOOP, base=_P_ALONE),
    HiddenEffect("reactive_loop_missing", "q", "add", _Q_LOOP, _NO_Q, base=_Q_ALONE),
    HiddenEffect("reactive_loop_missing", "q", "remove", _NO_Q, _Q_LOOP, base=_Q_ALONE),
    HiddenEffect(
        "pll_prefilter",
        "low_pass",
        "add",
        {"omega_c_pll": _PREFILTER},
        {"omega_c_pll": None},
        base=_LOCKED,
    ),
    HiddenEffect(
        "pll_prefilter",
        "notch",
        "add",
        {"omega_n_pll": always(_HZ * 90, _HZ * 130), "Q_pll": Strength((5, 8), (1.5, 3), (0.6, 1))},
        base=_LOCKED,
    ),
    HiddenEffect(
        "pll_prefilter",
        "low_pass",
        "remove",
        {"omega_c_pll": None},
        {"omega_c_pll": _PREFILTER},
        base=_LOCKED,
    ),
    HiddenEffect(
        "power_filter",
        "p_and_q",
        "add",
        {"omega_c_power": _POWER_FILTER},
        base=_WITHOUT_POWER_FILTER,
    ),
    HiddenEffect(
        "power_filter",
        "p_and_q",
        "remove",
        {},
        {"omega_c_power": _POWER_FILTER},
        base=_WITHOUT_POWER_FILTER,
    ),
    HiddenEffect("current_filter", "both", "add", {"omega_c_current": _CURRENT_FILTER}),
    HiddenEffect(
        "current_filter",
        "loop",
        "add",
        {"omega_c_current": _CURRENT_FILTER, "current_filter": "loop"},
    ),
    HiddenEffect("current_filter", "both", "remove", {}, {"omega_c_current": _CURRENT_FILTER}),
    HiddenEffect("voltage_feedforward", "fitted", "add", {"k_ff": _FORWARD}, {"k_ff": 0.0}),
    HiddenEffect("voltage_feedforward", "unit", "add", {"k_ff": 1.0}, {"k_ff": 0.0}),
    HiddenEffect("voltage_feedforward", "fitted", "remove", {"k_ff": 0.0}, {"k_ff": _FORWARD}),
    HiddenEffect("voltage_feedforward", "unit", "remove", {"k_ff": 0.0}, {"k_ff": 1.0}),
    HiddenEffect(
        "voltage_feedforward_filter",
        "low_pass",
        "add",
        {"omega_c_ff": _FORWARD_FILTER},
        base=_FORWARDED,
    ),
    HiddenEffect(
        "voltage_feedforward_filter",
        "low_pass",
        "remove",
        {},
        {"omega_c_ff": _FORWARD_FILTER},
        base=_FORWARDED,
    ),
    HiddenEffect(
        "decoupling",
        "nominal",
        "add",
        {"decoupling": "nominal", "L_decoupling": _COUPLING},
        {"decoupling": "none"},
    ),
    HiddenEffect(
        "decoupling",
        "pll",
        "add",
        {"decoupling": "pll", "L_decoupling": _COUPLING},
        {"decoupling": "none"},
        base=_LOCKED,
    ),
    HiddenEffect(
        "decoupling",
        "nominal",
        "remove",
        {"decoupling": "none"},
        {"decoupling": "nominal", "L_decoupling": _COUPLING},
    ),
    HiddenEffect(
        "decoupling",
        "pll",
        "replace",
        {"decoupling": "pll"},
        {"decoupling": "nominal"},
        _PHASE_LOCK,
        base=_LOCKED,
    ),
    HiddenEffect(
        "decoupling",
        "nominal",
        "replace",
        {"decoupling": "nominal"},
        {"decoupling": "pll"},
        _PHASE_LOCK,
        base=_LOCKED,
    ),
    HiddenEffect("active_damping", "plain", "add", {"k_damping": _DAMPING}, base=_WITH_LCL),
    HiddenEffect(
        "active_damping",
        "high_pass",
        "add",
        {"k_damping": _DAMPING, "omega_c_damping": _HIGH_PASS},
        base=_WITH_LCL,
    ),
    HiddenEffect("active_damping", "plain", "remove", {}, {"k_damping": _DAMPING}, base=_WITH_LCL),
    HiddenEffect("ac_voltage_loop", "q_loop", "replace", _VOLTAGE, base={**_WITH_Q, **_WITH_LCL}),
    HiddenEffect("ac_voltage_loop", "fixed", "add", _VOLTAGE, _NO_Q, base={**_WITH_Q, **_WITH_LCL}),
    HiddenEffect("dc_link", "p_loop", "replace", _DC, base=_WITH_P),
    HiddenEffect("dc_link", "fixed", "add", _DC, _NO_P, base=_WITH_P),
    HiddenEffect(
        "frequency_droop",
        "filtered",
        "add",
        {"k_droop": _DROOP, "omega_c_droop": _DROOP_FILTER},
        base={**_LOCKED, **_WITH_P},
    ),
    HiddenEffect(
        "frequency_droop", "plain", "add", {"k_droop": _DROOP}, base={**_LOCKED, **_WITH_P}
    ),
    HiddenEffect(
        "frequency_droop",
        "filtered",
        "remove",
        {},
        {"k_droop": _DROOP, "omega_c_droop": _DROOP_FILTER},
        base={**_LOCKED, **_WITH_P},
    ),
    HiddenEffect("virtual_impedance", "command", "add", _DROP),
    HiddenEffect(
        "virtual_impedance",
        "current_reference",
        "add",
        {**_DROP, "virtual_impedance": "current_reference"},
    ),
    HiddenEffect("virtual_impedance", "command", "remove", {}, _DROP),
    HiddenEffect(
        "series_impedance",
        "lcl",
        "add",
        _LINE,
        base=_WITH_LCL,
        verdicts=("parameters-only", "no-gap"),
    ),
    HiddenEffect("series_impedance", "l_filter", "add", _LINE_BEFORE_L, base={"filter": "L"}),
    HiddenEffect("shunt_capacitance", "pcc", "add", _SHUNT),
    HiddenEffect("shunt_capacitance", "pcc", "remove", {}, _SHUNT),
    HiddenEffect("capacitor_damping", "series", "add", {"R_C": _SERIES_R}, base=_WITH_LCL),
    HiddenEffect("capacitor_damping", "branch", "add", _BRANCH, base=_WITH_LCL),
    HiddenEffect("capacitor_damping", "series", "remove", {}, {"R_C": _SERIES_R}, base=_WITH_LCL),
    HiddenEffect("filter_capacitor", "lcl", "replace", _LCL, base={"filter": "L"}),
    FRAME_MISALIGNMENT,
)
