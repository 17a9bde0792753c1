"""Effects of the catalogue beyond the tables of `effects` and `hardware`: what the devices alone
have, written in no program.
"""

from dataclasses import replace
from functools import partial
from math import pi

from ibrid_bench.hidden.declaration import ABSENT, PRESENT, HiddenEffect, Strength, always

_HZ = 2 * pi
_DROOP = Strength((0.3, 0.6), (1.5, 3.0), (5.0, 8.0))
_LOOPS, _LCL, _PROMPT = {"p_loop": "power", "q_loop": "power"}, {"filter": "LCL"}, {"T_d": ABSENT}
_NO_GAINS = {"kP_p": None, "kI_p": None, "kP_q": None, "kI_q": None}
_OPEN = {"p_loop": "reference", "q_loop": "reference", **_NO_GAINS}
_PERIOD = Strength((3e-5, 6e-5), (1e-4, 2e-4), (3e-4, 4e-4))
_OTHER = partial(Strength, (1.2, 1.4), (2.0, 3.0), (4.0, 6.0))
_SAME = Strength((1.0, 1.0), (1.0, 1.0), (1.0, 1.0), times="kP_current")
_TRAP = {
    "L_t": Strength((0.0008, 0.001), (0.002, 0.003), (0.006, 0.008)),
    "R_t": always(0.002, 0.01),
    "C_t": always(0.02, 0.04),
}

#: Each as the catalogue calls it.
FURTHER: tuple[HiddenEffect, ...] = (
    HiddenEffect("voltage_droop", "plain", "add", {"k_droop_v": _DROOP}, base=_LOOPS),
    HiddenEffect(
        "voltage_droop",
        "filtered",
        "add",
        {"k_droop_v": _DROOP, "omega_c_droop_v": always(_HZ * 3, _HZ * 10)},
        base=_LOOPS,
    ),
    HiddenEffect(
        "reference_filter",
        "low_pass",
        "add",
        {
            "omega_c_reference": Strength(
                (_HZ * 150, _HZ * 300), (_HZ * 30, _HZ * 80), (_HZ * 8, _HZ * 15)
            )
        },
        base=_LOOPS,
    ),
    HiddenEffect(
        "reference_feedforward",
        "less",
        "add",
        {"k_reference": Strength((-0.05, -0.1), (-0.15, -0.3), (-0.35, -0.5))},
        base=_LOOPS,
    ),
    HiddenEffect(
        "negative_sequence_control",
        "shared",
        "add",
        {
            "kP_negative": _SAME,
            "kI_negative": replace(_SAME, times="kI_current"),
            "omega_c_negative": Strength(
                (_HZ * 150, _HZ * 300), (_HZ * 50, _HZ * 100), (_HZ * 20, _HZ * 40)
            ),
        },
    ),
    HiddenEffect(
        "negative_sequence_control",
        "own",
        "add",
        {
            "kP_negative": Strength((0.05, 0.1), (0.2, 0.4), (0.6, 1.0)),
            "kI_negative": Strength((1.0, 3.0), (5.0, 15.0), (20.0, 40.0)),
        },
    ),
    HiddenEffect(
        "command_filter",
        "low_pass",
        "add",
        {
            "omega_c_command": Strength(
                (_HZ * 4000, _HZ * 6000), (_HZ * 1500, _HZ * 2500), (_HZ * 700, _HZ * 1000)
            )
        },
        base=_PROMPT,
    ),
    HiddenEffect(
        "measurement_filter",
        "all",
        "add",
        {
            "omega_c_sensor": Strength(
                (_HZ * 5000, _HZ * 8000), (_HZ * 1500, _HZ * 2500), (_HZ * 500, _HZ * 900)
            )
        },
        base={"kP_pll": PRESENT},
    ),
    HiddenEffect(
        "voltage_sensor",
        "feedforward",
        "replace",
        {"sensed_voltage": "pcc"},
        base={**_LCL, "k_ff": PRESENT, "kP_pll": PRESENT},
    ),
    HiddenEffect("current_sensor", "loop", "replace", {"sensed_current": "i_g"}, base=_LCL),
    HiddenEffect("power_reference", "plain", "replace", _OPEN, base=_LOOPS),
    HiddenEffect(
        "power_reference",
        "filtered",
        "replace",
        {
            **_OPEN,
            "omega_c_magnitude": Strength(
                (_HZ * 100, _HZ * 200), (_HZ * 20, _HZ * 60), (_HZ * 5, _HZ * 10)
            ),
        },
        base=_LOOPS,
    ),
    HiddenEffect(
        "power_reference",
        "active",
        "replace",
        {
            "p_loop": "reference",
            "kP_p": None,
            "kI_p": None,
            "omega_c_magnitude": Strength(
                (_HZ * 100, _HZ * 200), (_HZ * 20, _HZ * 60), (_HZ * 5, _HZ * 10)
            ),
        },
        base=_LOOPS,
    ),
    HiddenEffect("zero_order_hold", "command", "add", {"T_hold": _PERIOD}, base=_PROMPT),
    HiddenEffect("measurement_delay", "current", "add", {"T_current": _PERIOD}, base=_PROMPT),
    HiddenEffect(
        "power_gains",
        "q",
        "replace",
        {"kP_q": _OTHER("kP_p"), "kI_q": _OTHER("kI_p")},
        base={**_LOOPS, **_PROMPT},
    ),
    HiddenEffect("trap_filter", "beside", "add", _TRAP, base=_LCL),
    HiddenEffect(
        "core_saturation",
        "converter",
        "add",
        {"I_core": Strength((3.0, 4.0), (1.7, 2.3), (1.0, 1.3))},
        base=_LCL,
    ),
)
