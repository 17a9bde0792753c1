"""Starts for a refit whose parameters nobody has stated: the answer of a whole fit, as `evaluate` makes it.

Draws around typical values find the right valley of a grid-following inverter. Of a cascade of voltage and current control, or of
two devices, they mostly do not, and a minimum that is missed looks exactly like a missing effect.
"""

import numpy as np

from ibrid.fit.multistart import fit
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.structure.wiring import Wiring

#: Root mean square of the whitened residual below which no further starts are needed; it is far below any noise.
SOLVED = 1e-2
#: Limit of one fit in seconds, far beyond what it takes on a machine that is free.
SECONDS = 300.0


def whole_fit(problem: Problem, wiring: Wiring, rng: np.random.Generator, omega_0: float) -> list[dict[str, float]]:
    """Free parameter -> value, of the best answer and of its twins; [] where no start has a response.

    problem : of data with a sigma at every point. omega_0 : rad/s.
    """
    settings = FitSettings(objective="sigma", solved=SOLVED, seconds=SECONDS)
    found = fit(problem, wiring, rng, settings, omega_0=omega_0)
    return [] if found is None else [problem.values_at(x, 0) for x in (found.x, *found.twins)]
