"""What a device is before something is hidden in it: the structures of the textbook programs, with
random parameters.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from ibrid_bench.hidden.parameters import Device

_L_FILTER = {"filter": "L", "C_F": None, "L_g": 0.0, "R_g": 0.0}
_PREFILTER = (2 * pi * 200, 2 * pi * 1000)
_POWER_FILTER = (2 * pi * 20, 2 * pi * 100)
_DELAY = (8e-5, 1.6e-4)

#: Name of a textbook program -> what sets it apart from "gfl"; a pair is drawn between its ends.
BASES: Mapping[str, Mapping[str, Any]] = {
    "gfl": {},
    "gfl_exact": {"decoupling": "pll"},
    "gfl_pll_filter": {"omega_c_pll": _PREFILTER},
    "gfl_pll_filter_exact": {"decoupling": "pll", "omega_c_pll": _PREFILTER},
    "gfl_power_filter": {"decoupling": "pll", "omega_c_power": _POWER_FILTER},
    "gfl_delay": {"decoupling": "pll", "T_d": _DELAY},
    "gfl_l_filter": {"decoupling": "pll", **_L_FILTER},
    "gfl_l_filter_delay": {"decoupling": "pll", "T_d": _DELAY, "k_ff": 0.0, **_L_FILTER},
}

# per unit, rad/s, 1/s
_RANGES = {
    "L_F": (0.06, 0.2),
    "R_F": (0.002, 0.02),
    "C_F": (0.02, 0.1),
    "L_g": (0.05, 0.25),
    "R_g": (0.005, 0.03),
    "kP_pll": (30.0, 150.0),
    "kI_pll": (300.0, 6000.0),
    "kP_p": (0.005, 0.05),
    "kI_p": (6.0, 40.0),
    "kP_current": (0.2, 0.8),
    "kI_current": (5.0, 50.0),
}


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Between two positive values, every decade alike."""
    return float(low * (high / low) ** rng.random())


def draw_base(name: str, rng: np.random.Generator) -> Device:
    """A device of that structure, stable or not: one pair of gains for p and q unless the program
    has two.
    """
    drawn: dict[str, Any] = {key: log_uniform(rng, *ends) for key, ends in _RANGES.items()}
    own = name != "gfl_l_filter_delay"
    device = Device(
        **drawn,
        kP_q=drawn["kP_p"] * (1.0 if own else log_uniform(rng, 0.5, 2.0)),
        kI_q=drawn["kI_p"] * (1.0 if own else log_uniform(rng, 0.5, 2.0)),
        k_ff=1.0,
        decoupling="nominal",
        L_decoupling=drawn["L_F"],
    )
    changes = {
        key: log_uniform(rng, *one) if isinstance(one, tuple) else one
        for key, one in BASES[name].items()
    }
    return replace(device, **changes)
