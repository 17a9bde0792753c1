"""Simulated hardware: what built devices have and textbook ones lack, alone and in pairs, measured
with noise.

A case is one of `draw_case` with another pool; its program, nominal values and held-out sweep are
made the same way.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import pi, sqrt

import numpy as np
from ibrid_bench.hidden.case import F0_HZ, Case, as_program, measured
from ibrid_bench.hidden.declaration import PRESENT, HiddenEffect, Severity, Strength, always
from ibrid_bench.hidden.hiding import choose, hide
from ibrid_bench.hidden.nominal import nominal_values
from ibrid_bench.hidden.points import HELD_OUT, operating_points
from ibrid_bench.hidden.program import block_diagram

from ibrid.measurement.sweeps.noise import add_noise
from ibrid.plants.sweeping import frequency_grid

_DEAD = {
    "D_dead_time": Strength((0.004, 0.008), (0.015, 0.03), (0.04, 0.06)),
    "a_dead_time": always(0.05, 0.2),
}
_SOGI = Strength((2.0, 3.0), (1.2, 1.6), (0.5, 0.9))
_FORWARDED, _LOCKED = {"k_ff": PRESENT}, {"kP_pll": PRESENT}
_ANGLE = Strength((0.02, 0.04), (0.06, 0.12), (0.2, 0.3), either_sign=True)
_RESONANT = {
    "k_resonant": Strength((0.1, 0.2), (0.4, 0.8), (1.5, 3.0)),
    "width_resonant": always(2 * pi * 10, 2 * pi * 30),
}
_PORT = {"R_shunt": always(0.02, 0.2), "C_shunt": Strength((0.004, 0.01), (0.02, 0.05), (0.1, 0.2))}

#: Each as the catalogue calls it, but for the scale of p and q, which lies in the labels.
HARDWARE: tuple[HiddenEffect, ...] = (
    HiddenEffect("dead_time", "converter", "add", _DEAD),
    HiddenEffect(
        "feedforward_band_pass", "sogi", "add", {"k_sogi": _SOGI}, base={**_FORWARDED, **_LOCKED}
    ),
    HiddenEffect(
        "feedforward_band_pass",
        "sogi_fixed",
        "add",
        {"k_sogi": _SOGI, "sogi_tuning": "nominal"},
        base={**_FORWARDED, **_LOCKED},
    ),
    HiddenEffect("pll_sequence_filter", "dsogi", "add", {"k_dsogi": _SOGI}, base=_LOCKED),
    HiddenEffect(
        "pll_sequence_filter",
        "dsogi_fixed",
        "add",
        {"k_dsogi": _SOGI, "sogi_tuning": "nominal"},
        base=_LOCKED,
    ),
    HiddenEffect(
        "resonant_control",
        "negative_sequence",
        "add",
        {**_RESONANT, "omega_resonant": 4 * pi * F0_HZ},
    ),
    HiddenEffect(
        "resonant_control", "harmonics", "add", {**_RESONANT, "omega_resonant": 12 * pi * F0_HZ}
    ),
    HiddenEffect("delay_angle", "command", "add", {"delay_angle": _ANGLE}),
    HiddenEffect("shunt_capacitance", "pcc", "add", _PORT),
    HiddenEffect(
        "power_scale",
        "peak_for_rms",
        "add",
        measurement={"power_factor": sqrt(2)},
        verdicts=("data-convention",),
    ),
)


def draw_hardware(
    seed: int,
    effects: Sequence[str],
    *,
    noise_db: float = 50.0,
    severity: Severity = "clear",
    frequencies: int = 30,
    points: int = 4,
    pool: Sequence[HiddenEffect] = HARDWARE,
) -> Case:
    """A case that hides one effect of a pool or two; the same arguments give the same case.

    Four operating points by default, since dead time shows in how the response depends on the
    current.
    """
    rng = np.random.default_rng([seed, 17])
    ops = operating_points(points, rng)
    chosen = choose(pool, effects, len(effects), rng)
    hiding = hide(chosen, severity, (*ops, HELD_OUT), 2 * pi * F0_HZ, rng)
    diagram = block_diagram(hiding.model, 2 * pi * F0_HZ)
    values, far_off = nominal_values(diagram.values, rng, error=0.15, gross=False)
    frequency = frequency_grid(f"5:5000:{frequencies}")
    sweep = add_noise(
        measured(hiding, ops, frequency),
        noise_db,
        rng=np.random.default_rng([seed, 18]),
        record_sigma=True,
    )
    right = replace(hiding, measurement=replace(hiding.measurement, power_factor=1.0))
    verdicts = min(
        (effect.verdicts for effect, _ in hiding.effects),
        key=lambda one: one[0] != "data-convention",
    )
    truth = {
        "schema": "ibrid.hidden/1",
        "kind": "hardware",
        "seed": seed,
        "severity": severity,
        "effects": [
            {
                "id": effect.id,
                "change": effect.change,
                "variant": effect.variant,
                "parameters": parameters,
            }
            for effect, parameters in hiding.effects
        ],
        "verdicts": list(verdicts),
        "noise_db": noise_db,
        "sigma": "known",
        "base": hiding.base,
        "values": dict(diagram.values),
        "far_off": far_off,
        "device": as_program(hiding.device),
    }
    held_out = measured(right, (HELD_OUT,), frequency)
    return Case(sweep, diagram.text, values, held_out, truth, hiding.device, hiding.model)
