"""How the sweeps that ship with ibrid are made: `python data/make_data.py` writes them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.plants.gfl import GFLParameters
from ibrid.plants.published import BEYOND, PAPER_LIKE, PUBLISHED
from ibrid.plants.random_plants import random_stable
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import frequency_grid, sweep

GRID = "5:5000:16"
RANDOM_DRAWS = 10
SEED = 20


@dataclass(frozen=True, eq=False)
class Benchmark:
    """A shipped sweep: its name (file name without .csv), the inverter and the header of its
    file.
    """

    name: str
    plant: ReferenceInverter

    def sweep(self) -> Sweep:
        """The data, made anew by linearisation."""
        return sweep(self.plant, None, frequency_grid(GRID))

    @property
    def header(self) -> tuple[str, ...]:
        """How it was made and what is inside."""
        values = ", ".join(
            f"{name} = {value!r}" for name, value in self.plant.diagram_values.items()
        )
        return (
            f"made by: python data/make_data.py; {self.plant.summary}",
            f"inverter: {self.plant.source}",
            f"method: exact linearisation of the nonlinear model{self._equations}, frequencies "
            f"{GRID} Hz, clean; current out, q axis leads d, per unit",
            f"true parameters: {values}",
        )

    @property
    def _equations(self) -> str:
        m = self.plant.parameters
        of_the_paper = isinstance(m, GFLParameters) and (m.p_loop, m.q_loop) == ("power", "power")
        return " (paper, equations 2 to 7)" if of_the_paper else ""


def recipes() -> Iterator[Benchmark]:
    """Every shipped benchmark of our own, in a fixed order."""
    yield Benchmark("paper_like", PAPER_LIKE)
    for plant in PUBLISHED:
        yield Benchmark(f"published_{plant.name}", plant)
    for plant in BEYOND:
        yield Benchmark(plant.name, plant)
    for index in range(RANDOM_DRAWS):
        yield Benchmark(f"random_{index:02d}", _random_draw(index))


def _random_draw(index: int) -> ReferenceInverter:
    """The first half from the textbook ranges, the second from the wide ones; every other one with
    a PLL filter.
    """
    return random_stable(
        np.random.default_rng([SEED, index]),
        population="textbook" if index < RANDOM_DRAWS // 2 else "wide",
        pll_filter=index % 2 == 0,
        name=f"random_{index:02d}",
    )
