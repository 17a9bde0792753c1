"""The page about the reference inverters that ship: what each is, and where its values come
from.
"""

import numpy as np
from ibrid_bench.markdown import markdown_table
from ibrid_bench.recipes import Benchmark, recipes

from ibrid.plants.published import PLANTS
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import state_space

HEADER = ("sweep", "plant", "what", "states", "slowest pole, rad/s")
_TOP = """# Reference inverters

Made by `python docs/making/write_pages.py`; a test compares the two.

Each is a nonlinear averaged model with known parameters, its equilibrium, a block diagram with true
values, and a sweep in `data/`. Sweeps by linearisation and by injection into the simulation agree
to 1e-3; the diagram with true values reproduces the linearisation to 1e-8 at every operating point;
tests check both. `ibrid sweep PLANT` measures one again; where sweep and diagram have the same
name, `ibrid evaluate NAME NAME` fits the diagram and `ibrid gap NAME NAME` compares the two.

How well each is fitted, identified and repaired: [Results by inverter](inverters_results.md).

The slowest pole is that at the two operating points of the sweep, connected to a stiff grid.

"""
_SOURCES = """
## Sources

"Published" means published values in the equations given; parts of the source beyond them are omitted, and listed.

"""


def inverters_page() -> str:
    """Markdown: a table with a row for each shipped sweep, then the source of each inverter's
    values.
    """
    shipped = list(recipes())
    table = markdown_table(HEADER, [_row(one) for one in shipped])
    drawn = [one for one in shipped if one.name.startswith("random_")]
    sources = "".join(
        f"- `{one.name}`: {one.plant.source}\n" for one in shipped if one not in drawn
    )
    some = {one.plant.source for one in drawn}
    return f"{_TOP}{table}{_SOURCES}{sources}" + "".join(
        f"- `random_..`: {source}\n" for source in sorted(some)
    )


def _row(benchmark: Benchmark) -> tuple[str, ...]:
    plant = benchmark.plant
    name = f"`{plant.name}`" if plant.name in PLANTS else ""
    return (
        f"`{benchmark.name}`",
        name,
        plant.summary,
        str(len(plant.dynamics.states)),
        f"{_slowest(plant):.2g}",
    )


def _slowest(plant: ReferenceInverter) -> float:
    return max(float(np.real(state_space(plant, op).poles).max()) for op in plant.operating_points)
