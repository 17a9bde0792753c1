"""From data to the best parameters: waves of starts, hops from the best answer, the more plausible
twin, Ipopt last.

The procedure is fixed and its random numbers follow from the generator it is given, so that a score
repeats exactly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit import ipopt
from ibrid.fit.anchor import Decades, nearest
from ibrid.fit.least_squares import LEVENBERG, Batch
from ibrid.fit.objective import mean_error
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import TEXTBOOK_DECADES, StartDrawer
from ibrid.fit.twins import Twins, twins_of

#: Two answers whose errors differ by less than this part are twins.
TWIN_TOLERANCE = 1e-6
#: Twins whose gains differ by less than this (logarithm) are one minimum seen twice.
SAME_MINIMUM = 0.3
#: Below this error the fit is so good that agreement proves less: more ends must agree.
NEARLY_EXACT = 1e-4
#: Ends that may be the likeliest where the noise is known.
LIKELY = 4
#: Iterations that each kicked copy gets before the better ones are carried to the end.
HOP_ITERATIONS = 12


@dataclass(frozen=True)
class Finished:
    """A start carried to its end: x (P,) and its error (`ibrid.fit.objective.mean_error`).

    `wave` : the wave of independent starts it came from; None for what was derived from another
    end.
    """

    x: np.ndarray
    error: float
    wave: int | None


@dataclass(frozen=True)
class Solution:
    """Ipopt's optimum x (P,), the root of the squared error per operating point (M,), and what
    supports it.
    `twins` : other x that fit equally well. `finished` : all ends, best first. `independent` : how
    many of them began independently. `agreeing` : how many of those are within `agreement` of the
    best.
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
    drawer: StartDrawer,
    twins: Twins,
    rng: np.random.Generator,
    settings: FitSettings,
    *,
    warm: Sequence[Mapping[str, float]] = (),
) -> Solution | None:
    """Fit the free numbers of a problem; None when no start has a response (no operating point,
    say).

    drawer, twins : what the structure of the diagram tells of the problem: where starts lie, what
    can be exchanged.
    warm : name -> value for each operating point, to try before anything else: the answer at the
    previous operating point, or of a diagram that differs little; what it lacks is drawn, names
    that the problem lacks are passed over.
    """
    search = Search(problem, drawer, twins, rng, settings)
    if warm:
        search.begin_from(warm)
    waves = 0
    while waves <= settings.restarts and not search.settled:
        search.wave(waves)
        waves += 1
    if not search.finished:
        return None
    search.hop()
    best, beside = search.most_plausible()
    x, status, iterations = ipopt.solve(
        search.believing, best, iterations=settings.ipopt_iterations
    )
    return Solution(
        x=x,
        errors=np.sqrt(search.believing.parts(x[None])[0][0, : len(problem.points)]),
        twins=search.distinct(beside, x),
        finished=tuple(sorted(search.finished, key=lambda one: one.error)),
        independent=len(search.independent),
        agreeing=len(search.agreeing),
        waves=waves,
        evaluations=problem.evaluations,
        ipopt_status=status,
        ipopt_iterations=iterations,
    )


class Search:
    """Starts under way and at their ends."""

    def __init__(
        self,
        problem: Problem,
        drawer: StartDrawer,
        twins: Twins,
        rng: np.random.Generator,
        settings: FitSettings,
    ) -> None:
        self.problem, self.drawer, self.rng, self.settings = problem, drawer, rng, settings
        self.logarithmic, self.final = Misfit(problem, "log"), Misfit(problem, settings.minimised)
        self.believing = (
            Misfit(problem, settings.minimised, Decades(problem))
            if self.final.noise
            else self.final
        )
        self.cascades, self.corners = twins.cascades, twins.corners
        self.swaps = (*self.cascades, *self.corners)
        self.finished: list[Finished] = []

    @property
    def best(self) -> Finished:
        """The end of least error."""
        return min(self.finished, key=lambda one: one.error)

    @property
    def solved(self) -> bool:
        """True when the best end is exact."""
        return bool(self.finished) and self.best.error < self.settings.solved

    @property
    def independent(self) -> list[Finished]:
        """Ends of independent starts."""
        return [one for one in self.finished if one.wave is not None]

    @property
    def agreeing(self) -> list[Finished]:
        """Ends of independent starts that agree with the best of all; among exact fits, all that
        are exact.
        """
        bound = max(self.best.error * (1 + self.settings.agreement), self.settings.solved)
        return [one for one in self.independent if one.error <= bound]

    @property
    def settled(self) -> bool:
        """True when the fit is exact, or enough ends of at least two waves agree."""
        if not self.finished:
            return False
        enough = self.settings.agreeing + (2 if self.best.error < NEARLY_EXACT else 0)
        return self.solved or (
            len(self.agreeing) >= enough and len({one.wave for one in self.agreeing}) >= 2
        )

    def wave(self, number: int) -> None:
        """Screen new starts, descend with halving, finish the survivors and the twins of the best
        of them.
        """
        settings, problem = self.settings, self.problem
        decades = TEXTBOOK_DECADES[number % len(TEXTBOOK_DECADES)]
        seeded = number % len(TEXTBOOK_DECADES) == 0 or not self.finished
        x = self.drawer.draw(self.rng, settings.starts, decades, seeded=seeded)
        costs = problem.costs(x, "log").sum(axis=1)
        usable = np.flatnonzero(np.isfinite(costs))
        if not usable.size:
            return
        order = usable[np.argsort(costs[usable], kind="stable")]
        kept = x[order[: max(settings.kept, settings.kept_misfit)]]
        self.finish(self._descend(LEVENBERG.begin(self.logarithmic, kept)).x, number)

    def begin_from(self, warm: Sequence[Mapping[str, float]]) -> None:
        """Descend from known values, name -> value for each operating point; the numbers they lack
        are drawn.
        """
        settings = self.settings
        batch = LEVENBERG.begin(self.final, self.drawer.completed(self.rng, warm, settings.warm))
        if np.isfinite(batch.cost).any():
            self.finish(batch.best(settings.warm_kept).x, None)

    def _descend(self, batch: Batch) -> Batch:
        settings, model = self.settings, self.logarithmic
        wide = batch
        batch = batch.best(settings.kept)
        for iterations, kept in settings.halving:
            batch = LEVENBERG.go(model, batch, iterations)
            if np.sqrt(batch.cost.min()) < settings.misfit:
                batch = batch.best(kept)
        if np.sqrt(batch.cost.min()) >= settings.misfit and len(wide.x) > settings.kept:
            more = LEVENBERG.go(model, wide, sum(one for one, _ in settings.halving))
            batch = more.best(settings.kept_misfit)
        return LEVENBERG.go(model, batch, settings.iterations)

    def hop(self) -> None:
        """Kick some coordinates of the best answer and descend again, until a few rounds in a row
        gain nothing.
        """
        settings = self.settings
        idle = 0
        for _ in range(settings.most_hops):
            if idle >= settings.hops or self.solved:
                break
            before = self.best.error
            x = self._kicked(self.best.x, redistribute=idle % 2 == 1)
            batch = LEVENBERG.go(self.final, LEVENBERG.begin(self.final, x), HOP_ITERATIONS)
            self._keep(
                LEVENBERG.go(self.final, batch.best(settings.kept), settings.iterations), None
            )
            idle = 0 if self.best.error < before * (1 - settings.agreement) else idle + 1

    def _kicked(self, x: np.ndarray, *, redistribute: bool) -> np.ndarray:
        """Copies of x with some coordinates moved, redrawn in their boxes, or the gains of a
        cascade redistributed.
        """
        number, size = self.settings.kicked, self.problem.size
        low, high = self.problem.coordinates.x_low, self.problem.coordinates.x_high
        chosen = self.rng.uniform(size=(number, size)) < np.linspace(0.15, 0.6, number)[:, None]
        moved = x + self.rng.normal(0.0, 1.5, (number, size))
        anywhere = low + (high - low) * self.rng.uniform(size=(number, size))
        kicked = np.where(chosen, np.where(np.arange(number)[:, None] % 2 == 1, anywhere, moved), x)
        if redistribute and self.cascades:
            group = list(self.cascades[0].entries)
            kicked = np.tile(x, (number, 1))
            kicked[:, group] = anywhere[:, group]
        if redistribute and self.corners:  # every second one where there is a cascade too
            here = np.arange(number) % 2 == 1 if self.cascades else np.ones(number, dtype=bool)
            kicked[here] = self._spread(x, int(here.sum()))
        return kicked

    def _spread(self, x: np.ndarray, number: int) -> np.ndarray:
        """Copies of x with other slow corners of a current control and the damping beside it."""
        coordinates = self.problem.coordinates
        which = self.rng.integers(len(self.corners), size=number)
        spread = np.array(
            [self.corners[one].spread(coordinates.to_theta(x), self.rng) for one in which]
        )
        return coordinates.to_x(np.clip(spread, coordinates.low, coordinates.high))

    def finish(self, x: np.ndarray, wave: int | None) -> None:
        """Carry starts x (S, P) to the end in the final objective, and the twins of the best of
        them too.
        """
        batch = self._to_the_end(x)
        self._keep(batch, wave)
        if self.finished and not self.solved:
            self._keep(self._twin_batch(batch.x[int(np.argmin(batch.cost))]), None)

    def most_plausible(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Of the best answer and its twins that fit equally well, the least implausible one, and
        the others.

        Where the data leave a scale open they are of the usual one, since a twin of another may lie
        outside the boxes.
        """
        if self.final.noise is not None:
            return self._likeliest()
        best = self._nearest_to_typical(self.best.x)
        batch = self._twin_batch(best)
        bound = max(float(self._errors(best[None])[0]) * (1 + TWIN_TOLERANCE), self.settings.solved)
        equal = [best, *batch.x[self._errors(batch.x) <= bound]]
        if len(equal) > 1:
            equal.sort(key=self.swaps[0].implausibility)
        best = self._nearest_to_typical(equal[0])
        return best, equal[1:]

    def _nearest_to_typical(self, x: np.ndarray) -> np.ndarray:
        return nearest(self.problem, x, self.problem.typical, self.settings.minimised)

    def _likeliest(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """The same where the noise is known: by the data and by what is typical; a twin is as good
        within one of chi2.
        """
        ends = [one.x for one in sorted(self.finished, key=lambda one: one.error)[:LIKELY]]
        starts = np.array([*ends, *twins_of(self.problem.coordinates, self.swaps, ends[0])])
        best = self._to_the_end(starts, self.believing).best(1).x[0]
        twins = self._twin_batch(best, self.believing).x
        costs = self.problem.costs(
            np.concatenate([best[None], twins]), self.settings.minimised
        ).sum(axis=1)
        return best, list(twins[costs[1:] <= costs[0] + (self.final.noise or 0.0)])

    def distinct(self, twins: list[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Twins on the scale of x, so that they differ in what the swap changes alone; not those
        that end near x.
        """
        entries = [entry for swap in self.swaps for entry in swap.entries]
        beside = [
            nearest(self.problem, twin, x, self.settings.minimised, ignoring=entries)
            for twin in twins
        ]
        return tuple(twin for twin in beside if np.abs(twin - x)[entries].max() > SAME_MINIMUM)

    def _twin_batch(self, x: np.ndarray, misfit: Misfit | None = None) -> Batch:
        twins = twins_of(self.problem.coordinates, self.swaps, x)
        return self._to_the_end(np.array(twins).reshape(len(twins), self.problem.size), misfit)

    def _to_the_end(self, x: np.ndarray, misfit: Misfit | None = None) -> Batch:
        misfit = misfit or self.final
        return LEVENBERG.go(misfit, LEVENBERG.begin(misfit, x), self.settings.iterations)

    def _errors(self, x: np.ndarray) -> np.ndarray:
        return mean_error(self.problem.costs(x, self.settings.minimised), self.settings.minimised)

    def _keep(self, batch: Batch, wave: int | None) -> None:
        for x, error in zip(batch.x, self._errors(batch.x), strict=True):
            if np.isfinite(error):
                self.finished.append(Finished(x.copy(), float(error), wave))
