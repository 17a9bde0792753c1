"""From data to the best parameters: seeds, screening, batched descent on a logarithmic residual, Ipopt last.

The procedure is fixed and its random numbers follow from the generator it is given, so that a score repeats exactly.
"""

import time
from dataclasses import dataclass

import numpy as np

from ibrid.fit import ipopt
from ibrid.fit.anchor import nearest, nearest_to_typical
from ibrid.fit.gauss_newton import Batch, begin, descend
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import TEXTBOOK_DECADES, StartDrawer
from ibrid.fit.twins import find_swaps, twins_of
from ibrid.fit.vector_fitting import fitted_poles, pole_distances
from ibrid.structure.wiring import Wiring


@dataclass(frozen=True)
class Finished:
    """A start carried to its end: x (P,), squared error, and the wave it came from."""

    x: np.ndarray
    cost: float
    wave: int


@dataclass(frozen=True)
class Solution:
    """Ipopt's optimum x (P,), the root of the squared error per operating point (M,), and what supports it.

    `twins` : other x that fit equally well. `agreeing` : finished starts within `agreement` of the best, of all
    `finished`.
    """

    x: np.ndarray
    errors: np.ndarray
    twins: tuple[np.ndarray, ...]
    agreeing: int
    finished: tuple[Finished, ...]
    waves: int
    evaluations: int
    ipopt_status: str
    ipopt_iterations: int


#: Part of the hard limit after which no further wave begins.
SOFT_LIMIT = 0.6
#: Two answers whose squared errors differ by less than this part are twins.
TWIN_TOLERANCE = 1e-6
#: Twins whose gains differ by less than this (logarithm) are one minimum seen twice.
SAME_MINIMUM = 0.3


def fit(
    problem: Problem,
    wiring: Wiring,
    rng: np.random.Generator,
    settings: FitSettings,
    *,
    omega_0: float,
    warm: np.ndarray | None = None,
) -> Solution | None:
    """Fit the free numbers of a problem; None when no start has a response (no operating point, say).

    warm : x (P,) to try before anything else, such as the answer at the previous operating point.

    After most of `settings.seconds` no further wave begins; what has ended by then is the answer. TimeoutError when
    nothing has begun by then.
    """
    started = time.monotonic()
    search = _Search(problem, wiring, rng, settings, omega_0)
    if warm is not None:
        search.finish(begin(problem, warm[None], settings.objective), 0)
    wave = 0
    hops = 0
    while wave <= settings.restarts and not (search.settled(wave) and (hops := search.hop(hops)) >= settings.hops):
        if time.monotonic() - started > SOFT_LIMIT * settings.seconds:
            break
        search.wave(wave)
        wave += 1
    if not search.finished:
        if not wave:
            raise TimeoutError(f"stopped after {settings.seconds:g} s, before the first start")
        return None
    best, twins = search.most_plausible()
    left = settings.seconds - (time.monotonic() - started)
    best = nearest_to_typical(problem, best, settings.objective)
    optimum = ipopt.solve(problem, best, settings.objective, iterations=settings.ipopt_iterations, seconds=left)
    return Solution(
        optimum.x,
        np.sqrt(optimum.costs),
        search.distinct(twins, optimum.x),
        len(search.near_best()),
        tuple(sorted(search.finished, key=lambda one: one.cost)),
        wave,
        problem.evaluations,
        optimum.status,
        optimum.iterations,
    )


class _Search:
    def __init__(
        self, problem: Problem, wiring: Wiring, rng: np.random.Generator, settings: FitSettings, omega_0: float
    ) -> None:
        self.problem, self.rng, self.settings = problem, rng, settings
        self.drawer = StartDrawer(problem, wiring, omega_0)
        self.swaps = find_swaps(problem, wiring)
        self.measured_poles = fitted_poles(problem) if settings.seeds == "vector-fitting" else None
        self.finished: list[Finished] = []

    def best(self) -> Finished:
        return min(self.finished, key=lambda one: one.cost)

    def near_best(self) -> list[Finished]:
        """Finished starts that agree with the best; among exact fits, all that are exact."""
        bound = max(self.best().cost * (1 + 2 * self.settings.agreement), self.settings.solved**2)
        return [one for one in self.finished if one.cost <= bound]

    def most_plausible(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Of the best answer and its twins that fit equally well, the one with the least R_F, and the others."""
        best = self.best()
        starts = twins_of(self.problem, self.swaps, best.x)
        if not starts:
            return best.x, []
        settings = self.settings
        batch = descend(
            self.problem,
            begin(self.problem, np.array(starts), settings.objective),
            settings.objective,
            settings.iterations,
        )
        bound = max(best.cost * (1 + TWIN_TOLERANCE), settings.solved**2)
        equal = [best.x, *(x for x, cost in zip(batch.x, batch.cost, strict=True) if cost <= bound)]
        resistance = self.swaps[0].resistance
        equal.sort(key=lambda x: x[resistance])
        return equal[0], equal[1:]

    def distinct(self, twins: list[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Twins on the scale of x, so that they differ in what the swap changes alone; not those that end near x."""
        entries = [entry for swap in self.swaps for entry in swap.entries]
        beside = [nearest(self.problem, twin, x, self.settings.objective, ignoring=entries) for twin in twins]
        return tuple(twin for twin in beside if np.abs(twin - x)[entries].max() > SAME_MINIMUM)

    def settled(self, waves: int) -> bool:
        """True when the fit is exact, or enough ends of at least two waves agree."""
        if not self.finished:
            return False
        best = self.best().cost
        if best < self.settings.solved**2:
            return True
        near = self.near_best()
        enough = self.settings.agreeing if best > 1e-4**2 else self.settings.agreeing + 2
        return waves >= 2 and len(near) >= enough and len({one.wave for one in near}) >= 2

    def wave(self, number: int) -> None:
        """Screen new starts, descend with halving, finish the survivors and their twins in the final objective."""
        settings, problem = self.settings, self.problem
        decades = TEXTBOOK_DECADES[number % len(TEXTBOOK_DECADES)]
        x = self.drawer.draw(self.rng, settings.starts, decades)
        if self.finished:  # a quarter of the starts are perturbations of the best answer
            near = settings.starts // 4
            x[:near] = self.best().x + self.rng.normal(0.0, 0.7, (near, problem.size))
        x = np.clip(x, problem.coordinates.x_low, problem.coordinates.x_high)
        costs = problem.costs(x, "log").sum(axis=1)
        if self.measured_poles is not None:
            costs = np.where(np.isfinite(costs), pole_distances(problem, x, self.measured_poles), np.inf)
        usable = np.flatnonzero(np.isfinite(costs))
        if not usable.size:
            return
        order = usable[np.argsort(costs[usable], kind="stable")]
        batch = begin(problem, x[order[: max(settings.kept, settings.kept_misfit)]], "log")
        batch = self._descend(batch)
        self.finish(begin(problem, batch.x, settings.objective), number)

    def _descend(self, batch: Batch) -> Batch:
        settings, problem = self.settings, self.problem
        wide = batch
        batch = batch.best(settings.kept)
        for iterations, kept in settings.halving:
            batch = descend(problem, batch, "log", iterations)
            if np.sqrt(batch.cost.min()) < settings.misfit:
                batch = batch.best(kept)
        if np.sqrt(batch.cost.min()) >= settings.misfit and len(wide.x) > settings.kept:
            more = descend(problem, wide, "log", sum(one for one, _ in settings.halving))
            batch = more.best(settings.kept_misfit)
        return descend(problem, batch, "log", settings.iterations)

    def hop(self, done: int) -> int:
        """Kick a few coordinates of the best answer, descend again; the number of rounds in a row without gain."""
        settings, problem = self.settings, self.problem
        if self.best().cost < settings.solved**2:
            return settings.hops
        while done < settings.hops:
            before = self.best().cost
            x = self._kicked(self.best().x, redistribute=done % 2 == 1)
            batch = descend(problem, begin(problem, x, settings.objective), settings.objective, 12)
            self._keep(descend(problem, batch.best(settings.kept), settings.objective, settings.iterations), -1)
            done = 0 if self.best().cost < before * (1 - settings.agreement) else done + 1
        return done

    def _kicked(self, x: np.ndarray, *, redistribute: bool) -> np.ndarray:
        """Copies of x with some coordinates moved, redrawn in their boxes, or the gains of a cascade redistributed."""
        number, size = self.settings.kicked, self.problem.size
        low, high = self.problem.coordinates.x_low, self.problem.coordinates.x_high
        chosen = self.rng.uniform(size=(number, size)) < np.linspace(0.15, 0.6, number)[:, None]
        moved = x + self.rng.normal(0.0, 1.5, (number, size))
        anywhere = low + (high - low) * self.rng.uniform(size=(number, size))
        kicked = np.where(chosen, np.where(np.arange(number)[:, None] % 2 == 1, anywhere, moved), x)
        if redistribute and self.swaps:
            group = list(self.swaps[0].entries)
            kicked = np.tile(x, (number, 1))
            kicked[:, group] = anywhere[:, group]
        return kicked

    def finish(self, batch: Batch, wave: int) -> None:
        """Carry starts to the end in the final objective, and the twins of the best of them too."""
        settings, problem = self.settings, self.problem
        batch = descend(problem, batch, settings.objective, settings.iterations)
        self._keep(batch, wave)
        best = int(np.argmin(batch.cost))
        others = twins_of(problem, self.swaps, batch.x[best])
        if others and batch.cost[best] > settings.solved**2:
            self._keep(descend(problem, begin(problem, np.array(others), settings.objective), settings.objective,
                               settings.iterations), wave)  # fmt: skip

    def _keep(self, batch: Batch, wave: int) -> None:
        for x, cost in zip(batch.x, batch.cost, strict=True):
            if np.isfinite(cost):
                self.finished.append(Finished(x.copy(), float(cost), wave))
