"""From data to the best parameters: waves of starts, hops from the best answer, the more plausible twin, Ipopt last.

The procedure is fixed and its random numbers follow from the generator it is given, so that a score repeats exactly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit import ipopt
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.waves import Finished, Search
from ibrid.structure.reading.wiring import Wiring


@dataclass(frozen=True)
class Solution:
    """Ipopt's optimum x (P,), the root of the squared error per operating point (M,), and what supports it.
    `twins` : other x that fit equally well. `finished` : all ends, best first. `independent` : how many of them began
    independently. `agreeing` : how many of those are within `agreement` of the best.
    """

    x: np.ndarray
    errors: np.ndarray
    twins: tuple[np.ndarray, ...] = ()
    finished: tuple[Finished, ...] = ()
    independent: int = 1
    agreeing: int = 1
    waves: int = 0
    evaluations: int = 0
    ipopt_status: str = "nothing fitted"
    ipopt_iterations: int = 0


def fit(
    problem: Problem,
    wiring: Wiring,
    rng: np.random.Generator,
    settings: FitSettings,
    *,
    omega_0: float,
    warm: Sequence[Mapping[str, float]] = (),
) -> Solution | None:
    """Fit the free numbers of a problem; None when no start has a response (no operating point, say).

    warm : name -> value for each operating point, to try before anything else: the answer at the previous operating
    point, or of a diagram that differs little; what it lacks is drawn, names that the problem lacks are passed over.
    """
    search = Search(problem, wiring, rng, settings, omega_0)
    if warm:
        search.begin_from(warm)
    waves = 0
    while waves <= settings.restarts and not search.settled:
        search.wave(waves)
        waves += 1
    if not search.finished:
        return None
    search.hop()
    best, twins = search.most_plausible()
    x, status, iterations = ipopt.solve(search.believing, best, iterations=settings.ipopt_iterations)
    return Solution(
        x=x,
        errors=np.sqrt(search.believing.parts(x[None])[0][0, : len(problem.points)]),
        twins=search.distinct(twins, x),
        finished=tuple(sorted(search.finished, key=lambda one: one.error)),
        independent=len(search.independent),
        agreeing=len(search.agreeing),
        waves=waves,
        evaluations=problem.evaluations,
        ipopt_status=status,
        ipopt_iterations=iterations,
    )
