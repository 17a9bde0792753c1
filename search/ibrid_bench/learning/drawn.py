"""Inverters drawn from the families that the policy never saw: as many as seeds are asked for,
another one for each.

A family stands in the comparison as an inverter does, and its k-th seed is both that of the search
and the number of the inverter, so intervals speak of other inverters of these families. They are
drawn as those that the policy learns from are.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from ibrid_bench.search.hidden import Hidden, hidden_inverter
from ibrid_policy.experience.examples import held_out_family
from ibrid_policy.experience.inverter import draw_inverter, drawn_choices

from ibrid.plants.reference import P1_Q03
from ibrid.structure.diagrams.program import program_text

#: By their names in the comparison, as `held_out_family` calls them.
FAMILIES: Mapping[str, str] = MappingProxyType(
    {
        "drawn_dc_link": "dc link with voltage control",
        "drawn_oscillator": "oscillator",
        "drawn_hybrid": "hybrid",
    }
)
SEED = 20261122


def drawn_inverter(name: str, number: int) -> Hidden:
    """Inverter `number` of a family of `FAMILIES`, stable at p = 1, q = +-0.3, where it is swept as
    the others are.
    """
    rng = np.random.default_rng([SEED, list(FAMILIES).index(name), number])
    while True:
        choices = drawn_choices(rng)
        if held_out_family(choices) != FAMILIES[name]:
            continue
        found = draw_inverter(rng, choices)
        if found is None or {point.op for point in found.sweep.points} != set(P1_Q03):
            continue
        sweep, program = found.sweep, program_text(found.diagram)
        return hidden_inverter(
            name,
            f"drawn inverter {number}",
            program,
            found.values,
            f0_hz=sweep.f0_hz,
            power_node=sweep.power_node,
        )
