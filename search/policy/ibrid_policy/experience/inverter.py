"""A plausible inverter to learn from: choices, parameters at which it is stable, and the sweep that
would be measured.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from ibrid.assembly.symbolic import symbolic_matrices, symbolic_model
from ibrid.errors import DiagramError
from ibrid.fit.kernel import admittance
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.reference import P1_Q03
from ibrid.plants.sweeping import frequency_grid
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid_policy.experience.choices import PARTS, Choices, consistent
from ibrid_policy.experience.drawn_diagram import drawn_diagram

_HZ = 2 * pi
#: How often an inverter has a part, and which variants more often than others.
HABITS: Mapping[str, tuple[float, Mapping[str, float]]] = {
    "filter": (0.8, {"LCL": 6, "LCL_R": 1, "LCL_RC": 0.5, "LLFilter": 0.5}),
    "frame": (
        0.95,
        {"pll": 6, "droop": 1, "filtered droop": 2, "machine": 1, "hybrid": 0.7, "oscillator": 0.7},
    ),
    "pll filter": (0.45, {"low-pass": 3, "notch": 1}),
    "current": (0.92, {"converter": 5, "grid": 1.5, "proportional": 0.7}),
    "current filter": (0.2, {}),
    "voltage": (0.15, {}),
    "p": (0.85, {"power": 5, "dc link": 1}),
    "q": (0.85, {"power": 5, "magnitude": 1.5, "droop": 0.5, "filtered droop": 0.5}),
    "power filter": (0.35, {}),
    "same gains": (0.6, {}),
    "same corners": (0.7, {}),
    "feedforward": (0.65, {"unit": 3, "scaled": 1, "filtered": 1.5}),
    "decoupling": (0.7, {"nominal": 1, "measured": 1.2}),
    "voltage decoupling": (0.6, {}),
    "damping": (0.2, {"capacitor current": 2, "fast voltage": 1}),
    "virtual impedance": (0.12, {}),
    "frequency droop": (0.1, {}),
    "delay": (0.3, {}),
    "shunt": (0.08, {}),
}
#: What a grid-forming inverter usually has in place of power loops.
_FORMING = {"droop", "filtered droop", "machine", "oscillator"}
# log-uniform, per unit, s, rad/s; a negative gain is drawn by its size
_RANGES: Mapping[str, tuple[float, float]] = {
    "plant.L_F": (0.04, 0.3),
    "plant.R_F": (0.002, 0.02),
    "plant.C_F": (0.02, 0.15),
    "plant.L_g": (0.04, 0.3),
    "plant.R_g": (0.002, 0.03),
    "plant.R_C": (0.02, 0.5),
    "plant.R_d": (0.3, 1.0),
    "plant.C_d": (0.03, 0.15),
    "pll.kP_pll": (10.0, 200.0),
    "pll.kI_pll": (50.0, 8000.0),
    "pll.kP": (5.0, 100.0),
    "pll.kI": (50.0, 4000.0),
    "pll_filter.omega_c": (_HZ * 50, _HZ * 1000),
    "pll_filter.omega_n": (_HZ * 80, _HZ * 150),
    "pll_filter.Q": (0.6, 5.0),
    "p_loop.kP": (0.003, 0.1),
    "p_loop.kI": (3.0, 60.0),
    "q_loop.kP": (0.003, 0.1),
    "q_loop.kI": (3.0, 60.0),
    "dc_link.C_dc": (0.01, 0.06),
    "dc_loop.kP": (0.8, 4.0),
    "dc_loop.kI": (10.0, 100.0),
    "ac_loop.kP": (0.03, 0.4),
    "ac_loop.kI": (5.0, 150.0),
    "p_filter.omega_c": (_HZ * 5, _HZ * 150),
    "q_filter.omega_c": (_HZ * 5, _HZ * 150),
    "current.kP": (0.15, 1.2),
    "current.kI": (4.0, 60.0),
    "current.k": (0.2, 1.5),
    "current_filter.omega_c": (_HZ * 500, _HZ * 5000),
    "voltage.kP": (0.1, 1.5),
    "voltage.kI": (5.0, 300.0),
    "droop_corner.omega_c": (_HZ * 1, _HZ * 30),
    "inertia.omega_c": (0.5, 30.0),
    "feedforward.k": (0.3, 0.95),
    "feedforward.omega_c": (_HZ * 50, _HZ * 2000),
    "damping_filter.omega_c": (_HZ * 10, _HZ * 300),
    "virtual_resistance.k": (0.01, 0.2),
    "frequency_filter.omega_c": (_HZ * 3, _HZ * 20),
    "delay.T_d": (5e-5, 3e-4),
    "shunt.R": (0.02, 0.2),
    "shunt.C": (0.01, 0.1),
    "gain.k": (0.1, 1.0),
    "oscillator.eta": (0.3, 10.0),
    "oscillator.kappa": (0.6, 1.57),
    "oscillator.alpha": (5.0, 60.0),
}
_NEGATIVE: Mapping[str, tuple[float, float]] = {
    "p_droop.k": (1.5, 20.0),
    "p_gain.k": (1.0, 15.0),
    "q_droop.k": (0.02, 0.3),
    "damping.k": (0.03, 0.6),
    "frequency_droop.k": (0.01, 0.1),
}
#: Tries before a structure is given up, and how far left of the axis its poles lie (rad/s).
_TRIES, _MARGIN = 250, 1.0


@dataclass(frozen=True, eq=False)
class Inverter:
    """`choices` : what it is made of. `values` : of its exact diagram in the extended vocabulary.
    `sweep` : measured.
    """

    choices: Choices
    diagram: Diagram
    values: Mapping[str, float]
    sweep: Sweep


def drawn_choices(rng: np.random.Generator) -> dict[str, str]:
    """What an inverter may be made of, by habit; grid-forming ones have droops rather than power
    loops.
    """
    chosen: dict[str, str] = {}
    for part, variants in PARTS.items():
        often, weights = HABITS[part]
        if rng.random() < often:
            weight = np.array([weights.get(one, 1.0) for one in variants], dtype=float)
            chosen[part] = str(rng.choice(variants, p=weight / weight.sum()))
    if chosen.get("frame") in _FORMING:
        chosen.pop("p", None)
        chosen["q"] = str(rng.choice(["droop", "filtered droop"]))
        if rng.random() < 0.6:
            chosen |= {"filter": "LCL", "current": "converter", "voltage": "PI"}
        if rng.random() < 0.3:
            chosen["virtual impedance"] = "reactance"
    elif chosen.get("q", "").endswith("droop"):
        chosen["q"] = "power"
    if rng.random() < 0.5:  # most devices are plainer than what the habits add up to
        for part in (
            "voltage",
            "virtual impedance",
            "frequency droop",
            "shunt",
            "damping",
            "current filter",
        ):
            if chosen.get("frame") not in _FORMING:
                chosen.pop(part, None)
    return consistent(chosen)


def draw_inverter(rng: np.random.Generator, choices: Choices) -> Inverter | None:
    """An inverter of these choices with random parameters, stable at its operating points; None
    when none was found.
    """
    diagram = drawn_diagram(choices, VOCABULARY)
    wiring = wire(diagram, VOCABULARY)
    f0_hz = float(rng.choice([50.0, 60.0]))
    node = "capacitor" if choices.get("filter", "").startswith("LCL") else "pcc"
    physics = {"equilibrium": "exact", "power_node": node, "omega_0": 2 * pi * f0_hz}
    points = _operating_points(rng)
    names = parameter_table(wiring, "exact").names
    in_seconds = [f"{name}.L" for name in wiring.having(Element.COUPLING)]
    try:
        matrices = symbolic_matrices(
            wiring, dict.fromkeys(wiring.having(Element.DELAY), 3), **physics
        )
    except DiagramError:
        return None
    for _ in range(_TRIES):
        values = _drawn_values(rng, names)
        # at the nominal frequency it counts in seconds, at the measured one in per unit
        values |= {name: values[name] / (2 * pi * f0_hz) for name in in_seconds}
        theta = np.array([values[name] for name in names])
        if all(_stable(matrices, theta, op) for op in points):
            break
    else:
        return None
    model = symbolic_model(wiring, **physics)
    frequency = frequency_grid(
        "5:5000:16" if rng.random() < 0.8 else f"5:5000:{int(rng.integers(20, 41))}"
    )
    found = [
        PointSweep(op, frequency, admittance(model, theta, op.pqv, 2 * pi * frequency))
        for op in points
    ]
    sweep = Sweep(tuple(found), f0_hz=f0_hz, power_node=node, source="drawn inverter")
    if rng.random() < 0.25:
        level = float(rng.choice([40.0, 50.0, 60.0]))
        sweep = add_noise(sweep, level, rng=rng, record_sigma=bool(rng.random() < 0.5))
    return Inverter(dict(choices), diagram, values, sweep)


def _operating_points(rng: np.random.Generator) -> tuple[OperatingPoint, ...]:
    if rng.random() < 0.6:
        return P1_Q03
    number = int(rng.choice([1, 2, 2, 3]))
    drawn = [
        (round(float(rng.uniform(0.5, 1.0)), 2), round(float(rng.uniform(-0.4, 0.4)), 2))
        for _ in range(number)
    ]
    return tuple(OperatingPoint(f"p={p:g},q={q:g}", p, q) for p, q in dict.fromkeys(drawn))


def _drawn_values(rng: np.random.Generator, names: tuple[str, ...]) -> dict[str, float]:
    values: dict[str, float] = {}
    for name in names:
        if name in _NEGATIVE:
            values[name] = -_log_uniform(rng, *_NEGATIVE[name])
        elif name in _RANGES:
            values[name] = _log_uniform(rng, *_RANGES[name])
    inductance, share = values["plant.L_F"], _log_uniform(rng, 0.6, 1.1)
    for name in names:
        if name == "decoupling.L":
            values[name] = inductance * share
        elif name == "e_decoupling.L":
            values[name] = values["plant.C_F"]
        elif name == "virtual_reactance.L":
            values[name] = _log_uniform(rng, 0.02, 0.3)
        elif name == "pll_damping.k":
            values[name] = _log_uniform(rng, 0.3, 0.98)
    return values


def _stable(matrices, theta: np.ndarray, op: OperatingPoint) -> bool:
    a = np.asarray(matrices(theta, [op.p, op.q, op.v])[0].full())
    return bool(np.isfinite(a).all() and (np.linalg.eigvals(a).real < -_MARGIN).all())


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())
