"""The devices and candidate structures that the benchmark runs over: random stable inverters, right
and wrong diagrams.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.plants.random_plants import Population, random_stable
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import sweep
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

FREQUENCY = np.geomspace(5.0, 5000.0, 16)


@dataclass(frozen=True)
class Device:
    """A hidden inverter, its true diagram and its clean sweep at p = 1, q = +-0.3."""

    plant: ReferenceInverter
    diagram: Diagram
    sweep: Sweep

    def noisy(self, decibel: float, seed: int) -> Sweep:
        """The sweep with noise at that signal-to-noise ratio."""
        return add_noise(self.sweep, decibel, rng=np.random.default_rng(seed))


def devices(number: int, population: Population, *, seed: int = 7) -> list[Device]:
    """Random stable devices; half of the textbook ones have a filter before the PLL."""
    rng = np.random.default_rng(seed)
    found = []
    for index in range(number):
        plant = random_stable(rng, population=population, pll_filter=index % 2 == 1)
        found.append(Device(plant, parse_program(plant.program), sweep(plant, None, FREQUENCY)))
    return found


def without(diagram: Diagram, *names: str, wires: tuple[tuple[str, str], ...] = ()) -> Diagram:
    """The diagram less some modules with their connections, and less some wires."""
    smaller = Diagram(diagram.name)
    smaller.extend(
        [one for one in diagram.instances if one.name not in names],
        [
            one
            for one in diagram.connections
            if not {one.source.split(".")[0], one.target.split(".")[0]} & set(names)
            and (one.source, one.target) not in wires
        ],
    )
    return smaller


def wrong_candidates() -> dict[str, Diagram]:
    """Structures that lack something the devices have, and one with the wrong filter."""
    right = textbook("gfl_exact")
    no_pll = without(right, "pll", "park_v", "park_i", "decoupling")
    no_pll.add("ConstZero", "no_frequency")
    for source, target in (
        ("no_frequency.out", "plant.delta_omega"),
        ("v_DQ", "plant.v_in"),
        ("plant.i_g", "i_DQ"),
    ):
        no_pll.connect(source, target)
    return {
        "no PLL": no_pll,
        "no outer loops": without(right, "power", "minus_p", "p_loop", "q_loop", "i_ref"),
        "no feedforward": without(right, wires=(("plant.e", "plant.u_r"),)),
        "L filter for LCL": textbook("gfl_l_filter"),
    }


def of_order(order: int) -> Diagram:
    """A diagram of 6, 13, 20 or 30 states: the bare filter, the 13-state inverter, and that with
    chains of filters.
    """
    if order == 6:
        bare = Diagram("bare")
        for kind, name in (("LCL", "plant"), ("ConstZero", "zero"), ("Gain_dq", "gain")):
            bare.add(kind, name)
        for source, target in (
            ("v_DQ", "plant.v_in"),
            ("plant.e", "gain.in_"),
            ("gain.out", "plant.u_r"),
            ("zero.out", "plant.delta_omega"),
            ("plant.i_g", "i_DQ"),
        ):
            bare.connect(source, target)
        return bare
    whole = textbook("gfl_pll_filter_exact")
    chain = {13: (), 20: range(3), 30: range(8)}[order]
    if not chain:
        return whole
    larger = without(whole, wires=(("plant.e", "plant.u_r"), ("pll_filter.out", "pll.e_q")))
    previous = "plant.e"
    for index in chain:
        larger.add("LPF1_dq", f"filter_{index}")
        larger.connect(previous, f"filter_{index}.in_")
        previous = f"filter_{index}.out"
    larger.connect(previous, "plant.u_r")
    larger.add("LPF1", "second_pll_filter")
    larger.connect("pll_filter.out", "second_pll_filter.in_")
    larger.connect("second_pll_filter.out", "pll.e_q")
    return larger
