"""The data that all methods of the table get: an inverter, its noise, and the operating point that
none of them sees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from ibrid_bench.search.hidden import FREQUENCY, HALF_LOAD, Hidden
from ibrid_bench.search.inverters import inverter, plant_of
from ibrid_bench.search.trials import Trial, rules_trial

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import sweep
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

#: The benchmark, a published set behind an L filter, a random draw; each with a filter before the
#: PLL.
INVERTERS = ("paper_like", "published_kuleuven_600mva", "random_00")
NOISE_DB = (None, 40.0)
#: A grid of operating points around the held-out one, for black boxes that must interpolate.
GRID = tuple(
    OperatingPoint(f"p={p:g},q={q:g}", p, q) for p in (0.4, 0.7, 1.0) for q in (-0.3, 0.0, 0.3)
)
#: Module that the wrong textbook diagram lacks.
LEFT_OUT = "pll_filter"


@dataclass(frozen=True)
class Case:
    """One table. `inverter` : a hidden inverter with a nonlinear model and a filter before its PLL.
    `noise_db` : None: clean.

    Raises IbridError for an unknown name, and for an inverter that the table cannot be made of.
    """

    inverter: str
    noise_db: float | None = None

    def __post_init__(self) -> None:
        truth = inverter(self.inverter).truth
        if (
            plant_of(self.inverter) is None
            or truth is None
            or not any(one.name == LEFT_OUT for one in truth.instances)
        ):
            raise IbridError(
                "the baselines need an inverter with a nonlinear model and a filter before its "
                "PLL, which the wrong "
                f"textbook diagram leaves out; {self.inverter} is none, try {', '.join(INVERTERS)}"
            )

    @property
    def name(self) -> str:
        """Inverter and data, for headings."""
        return f"{self.inverter}, {self.trial(1).data}"

    def trial(self, budget: int) -> Trial:
        """The search to make, and the options of every fit of a diagram."""
        return rules_trial(self.inverter, budget, self.noise_db)

    @cached_property
    def clean(self) -> Hidden:
        """The truth."""
        return inverter(self.inverter)

    @cached_property
    def hidden(self) -> Hidden:
        """What the methods see of it: `hidden.sweep`, with its noise."""
        return self.trial(1).hidden()

    @property
    def truth(self) -> Diagram:
        """The diagram that made the data."""
        return parse_program(self.clean.program, f"hidden inverter {self.inverter}")

    @property
    def values(self) -> Mapping[str, float]:
        """Its true parameters, keyed as in `truth`."""
        return self.clean.values or {}

    @cached_property
    def held_out(self) -> PointSweep:
        """Clean, seen by no method."""
        return self._at(
            (self.clean.held_out.points[0].op if self.clean.held_out else HALF_LOAD,)
        ).points[0]

    def wrong(self) -> Diagram:
        """The textbook diagram of the same filter without `LEFT_OUT`."""
        kinds = {one.kind for one in self.truth.instances}
        return textbook("gfl_exact" if "LCL" in kinds else "gfl_l_filter")

    def grid(self) -> tuple[Sweep, Sweep]:
        """`GRID` measured with the same noise, and the truth there; OperatingPointError where the
        inverter is unstable.
        """
        truth = self._at(GRID)
        if self.noise_db is None:
            return truth, truth
        return add_noise(
            truth, self.noise_db, rng=np.random.default_rng([self.trial(1).seed, len(GRID)])
        ), truth

    def _at(self, points: Sequence[OperatingPoint]) -> Sweep:
        plant = plant_of(self.inverter)
        if plant is None:
            raise IbridError(f"{self.inverter} has no nonlinear model; try {', '.join(INVERTERS)}")
        return sweep(plant, points, FREQUENCY)


def cases_of(inverters: Sequence[str]) -> list[Case]:
    """All tables of these inverters, each with every noise."""
    return [Case(name, noise) for name in dict.fromkeys(inverters) for noise in NOISE_DB]
