"""Global fit of the parameters: multistart in batches, basin hopping, choice among equivalent
parameter sets, and Ipopt from the best minimum.

1. Multistart: samples of the textbook ranges descend on ln(Y / data) by successive halving, the
   survivors on the final objective. Batches ("waves") follow until one is exact, noise alone is
   left, or enough of their minima agree. Where there are many frequencies, some of them serve
   (`ibrid.fit.thinning`); the best minima descend on all.
2. Basin hopping (Wales & Doye, J. Phys. Chem. A 101, 1997): perturbed copies of the best minimum
   descend again, until several rounds gain nothing. Only improvements are accepted.
3. Exchanges of poles or zeros that leave the response (nearly) unchanged lead to equivalent
   parameter sets (`ibrid.fit.twins`); the most plausible is chosen.
4. Ipopt polishes it.

Every step is counted and random numbers come from the given generator, so that a fit repeats
exactly. Agreement of minima is evidence of a global minimum, no proof.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit import ipopt
from ibrid.fit.adequacy import LEAST_P, p_value
from ibrid.fit.anchor import Decades, nearest
from ibrid.fit.least_squares import GEODESIC, Batch
from ibrid.fit.objective import mean_error
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import TEXTBOOK_DECADES, StartDrawer
from ibrid.fit.twins import Twins, twins_of
from ibrid.measurement.sweeps.sweep import measured_numbers

#: Relative difference of errors up to which two parameter sets are equivalent.
TWIN_TOLERANCE = 1e-6
#: Relative difference of errors up to which two descents ended in the same minimum.
SAME_ERROR = 1e-5
#: Difference of ln(gain) up to which two equivalent sets are the same minimum.
SAME_MINIMUM = 0.3
#: Error below which agreement of minima is weaker evidence, since the differences are rounding.
NEARLY_EXACT = 1e-4
#: Further minima that must agree below `NEARLY_EXACT`.
MORE_AGREEING = 2
#: Separate minima of least error among which the maximum likelihood with the prior is looked for.
LIKELY = 4
#: Iterations of starts that fit poorly, after which it is asked again whether one of them fits.
SLICE = 16
#: Waves that a fit takes at least, unless it is exact.
LEAST_WAVES = 2
#: Iterations of a perturbed copy, after which the best of them go on to convergence.
HOP_ITERATIONS = 12
#: Share of the coordinates that a hop perturbs: from the first to the last copy.
HOP_SHARES = (0.15, 0.6)
#: Standard deviation of a perturbation, in search coordinates (a factor of 4.5 for positive ones).
HOP_DEVIATION = 1.5


@dataclass(frozen=True, eq=False)
class LocalMinimum:
    """Hold the end of a descent: x (P,) and its error (`ibrid.fit.objective.mean_error`).

    `wave` : number of the multistart batch; None where the start was derived from another minimum
    or from known values.
    """

    x: np.ndarray
    error: float
    wave: int | None


@dataclass(frozen=True)
class Solution:
    """Hold the result of a fit and the evidence that it is the global minimum.

    `x` : (P,), search coordinates of Ipopt's optimum. `errors` : (M,), root of the squared error at
    each operating point. `twins` : equivalent parameter sets, (P,) each. `finished` : all minima,
    the best first. `independent` : number of minima from multistart samples. `agreeing` : how many
    of those are within `FitSettings.agreement` of the best.
    """

    x: np.ndarray
    errors: np.ndarray
    twins: tuple[np.ndarray, ...] = ()
    finished: tuple[LocalMinimum, ...] = ()
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
    """Fit the free parameters of a problem globally.

    Parameters
    ----------
    drawer : StartDrawer
        Samples starts around the typical values of the diagram's blocks.
    twins : Twins
        Exchanges of poles or zeros that the diagram admits.
    warm : Sequence[Mapping[str, float]]
        Known values, "instance.parameter" -> value for each operating point, that are descended
        from first, such as the fit of a similar diagram. Missing ones are sampled, unknown names
        ignored.

    Returns
    -------
    Solution or None
        None if no start has a response, for instance where no equilibrium exists.
    """
    thinned = problem.thinned(settings.frequencies)
    search = MultistartSearch(thinned, drawer, twins, rng, settings)
    if warm:
        search.begin_from(warm)
    waves = 0
    while waves <= settings.restarts and not search.has_converged:
        search.run_wave(waves)
        waves += 1
    if not search.finished:
        return None
    search.hop()
    if thinned is not problem:
        problem.evaluations += thinned.evaluations
        search = search.continued(problem)
        if not search.finished:
            return None
    best, equivalents = search.most_plausible()
    x, status, iterations = ipopt.solve(
        search.posterior, best, iterations=settings.ipopt_iterations
    )
    return Solution(
        x=x,
        errors=np.sqrt(search.posterior.parts(x[None])[0][0, : len(problem.points)]),
        twins=search.select_distinct(equivalents, x),
        finished=tuple(sorted(search.finished, key=lambda minimum: minimum.error)),
        independent=len(search.independent),
        agreeing=len(search.agreeing),
        waves=waves,
        evaluations=problem.evaluations,
        ipopt_status=status,
        ipopt_iterations=iterations,
    )


class MultistartSearch:
    """Run the steps of a global fit and collect the local minima they find."""

    def __init__(
        self,
        problem: Problem,
        drawer: StartDrawer,
        twins: Twins,
        rng: np.random.Generator,
        settings: FitSettings,
    ) -> None:
        self.problem = problem
        self.drawer = drawer
        self.twins = twins
        self.rng = rng
        self.settings = settings
        self.logarithmic = Misfit(problem, "log", curved=True)
        self.final = Misfit(problem, settings.minimised, curved=True)
        self.posterior = self.final  # with a prior only where the noise is known
        if self.final.noise:
            self.posterior = Misfit(problem, settings.minimised, Decades(problem), curved=True)
        self.cascades = twins.cascades
        self.corners = twins.corners
        self.swaps = (*self.cascades, *self.corners)
        self.finished: list[LocalMinimum] = []

    def continued(self, problem: Problem) -> "MultistartSearch":
        """Return the search on more frequencies: its best minima and those that agree with them,
        descended to convergence there, and the others as they are.
        """
        search = MultistartSearch(problem, self.drawer, self.twins, self.rng, self.settings)
        minima = sorted(self.finished, key=lambda minimum: minimum.error)
        wanted = [*minima[: self.settings.kept], *self.agreeing]
        chosen = [index for index, minimum in enumerate(minima) if minimum in wanted]
        x = np.array([minimum.x for minimum in minima])
        x[chosen] = search._descend_to_convergence(x[chosen]).x
        for minimum, end, error in zip(minima, x, search._errors(x), strict=True):
            if np.isfinite(error):
                search.finished.append(LocalMinimum(end, float(error), minimum.wave))
        return search

    @property
    def best(self) -> LocalMinimum:
        """Return the minimum of least error."""
        return min(self.finished, key=lambda minimum: minimum.error)

    @property
    def solved(self) -> bool:
        """Return True if the best minimum fits exactly."""
        return bool(self.finished) and self.best.error < self.settings.solved

    @property
    def residual_is_noise(self) -> bool:
        """Return True if the best minimum leaves no more than the noise, where that is known."""
        if self.final.noise is None:
            return False
        numbers = measured_numbers(self.problem.points)
        chi2 = self.best.error**2 * numbers
        return p_value(chi2, numbers - self.problem.size) > LEAST_P

    @property
    def independent(self) -> list[LocalMinimum]:
        """Return the minima reached from multistart samples."""
        return [minimum for minimum in self.finished if minimum.wave is not None]

    @property
    def agreeing(self) -> list[LocalMinimum]:
        """Return the independent minima whose error agrees with the least error, or is exact."""
        bound = max(self.best.error * (1 + self.settings.agreement), self.settings.solved)
        return [minimum for minimum in self.independent if minimum.error <= bound]

    @property
    def has_converged(self) -> bool:
        """Return True if the fit is exact, or if after two waves noise alone is left or enough
        minima of both agree.
        """
        if not self.finished:
            return False
        if self.solved:
            return True
        if (
            self.residual_is_noise
            and len({minimum.wave for minimum in self.independent}) >= LEAST_WAVES
        ):
            return True
        needed = self.settings.agreeing
        if self.best.error < NEARLY_EXACT:
            needed += MORE_AGREEING
        agreeing = self.agreeing
        agreeing_waves = {minimum.wave for minimum in agreeing}
        return len(agreeing) >= needed and len(agreeing_waves) >= LEAST_WAVES

    def run_wave(self, number: int) -> None:
        """Run one batch of the multistart.

        Samples are screened by the squared residual ln(Y / data); the best descend on it by
        successive halving, and the survivors converge on the final objective. Waves alternate
        between the widths of `TEXTBOOK_DECADES`.
        """
        settings = self.settings
        problem = self.problem
        decades = TEXTBOOK_DECADES[number % len(TEXTBOOK_DECADES)]
        seeded = number % len(TEXTBOOK_DECADES) == 0 or not self.finished
        x = self.drawer.draw(self.rng, settings.starts, decades, seeded=seeded)
        costs = problem.costs(x, "log").sum(axis=1)
        usable = np.flatnonzero(np.isfinite(costs))
        if not usable.size:
            return
        order = usable[np.argsort(costs[usable], kind="stable")]
        kept = x[order[: max(settings.kept, settings.kept_misfit)]]
        batch = self._descend_by_halving(GEODESIC.begin(self.logarithmic, kept))
        self.converge(batch.x, number)

    def begin_from(self, warm: Sequence[Mapping[str, float]]) -> None:
        """Converge from known values of each operating point; missing parameters are sampled."""
        settings = self.settings
        batch = GEODESIC.begin(self.final, self.drawer.completed(self.rng, warm, settings.warm))
        if np.isfinite(batch.cost).any():
            self.converge(batch.best(settings.warm_kept).x, None)

    def _descend_by_halving(self, batch: Batch) -> Batch:
        """Descend starts on ln(Y / data), dropping the worst after each stage.

        As long as none fits the structure is hard to fit or wrong, so nothing is dropped and, after
        the last stage, more starts are descended.
        """
        settings = self.settings
        model = self.logarithmic
        all_starts = batch
        batch = batch.best(settings.kept)
        for iterations, kept in settings.halving:
            batch = GEODESIC.go(model, batch, iterations)
            if np.sqrt(batch.cost.min()) < settings.misfit:
                batch = batch.best(kept)
        fits_poorly = np.sqrt(batch.cost.min()) >= settings.misfit
        if fits_poorly and len(all_starts.x) > settings.kept:
            total_iterations = sum(iterations for iterations, _ in settings.halving)
            more = GEODESIC.go(model, all_starts, total_iterations)
            batch = more.best(settings.kept_misfit)
        for _ in range(0, settings.iterations, SLICE):
            batch = GEODESIC.go(model, batch, SLICE)
            if np.sqrt(batch.cost.min()) < settings.misfit:
                batch = batch.best(settings.survivors)
        return batch

    def hop(self) -> None:
        """Perturb the best minimum and descend again, until several rounds in a row gain nothing
        (basin hopping): fewer where noise alone is left.
        """
        settings = self.settings
        idle = 0  # rounds without gain
        for _ in range(settings.most_hops):
            enough = settings.hops_in_noise if self.residual_is_noise else settings.hops
            if idle >= enough or self.solved:
                break
            before = self.best.error
            x = self._perturb(self.best.x, redistribute=idle % 2 == 1)
            batch = GEODESIC.go(self.final, GEODESIC.begin(self.final, x), HOP_ITERATIONS)
            self._keep(
                GEODESIC.go(self.final, batch.best(settings.kept), settings.iterations), None
            )
            idle = 0 if self.best.error < before * (1 - settings.agreement) else idle + 1

    def _perturb(self, x: np.ndarray, *, redistribute: bool) -> np.ndarray:
        """Return perturbed copies (S, P) of x (P,).

        Some coordinates of every second copy are resampled within their bounds, of the others moved
        by a normal deviation. With `redistribute` the gains of a cascade are resampled instead, or
        the slow poles of a current control, where the diagram has them.
        """
        number = self.settings.kicked
        size = self.problem.size
        low = self.problem.coordinates.x_low
        high = self.problem.coordinates.x_high
        shares = np.linspace(*HOP_SHARES, number)[:, None]
        chosen = self.rng.uniform(size=(number, size)) < shares
        moved = x + self.rng.normal(0.0, HOP_DEVIATION, (number, size))
        anywhere = low + (high - low) * self.rng.uniform(size=(number, size))
        is_odd = np.arange(number) % 2 == 1
        perturbed = np.where(chosen, np.where(is_odd[:, None], anywhere, moved), x)
        if redistribute and self.cascades:
            group = list(self.cascades[0].entries)
            perturbed = np.tile(x, (number, 1))
            perturbed[:, group] = anywhere[:, group]
        if redistribute and self.corners:  # every second copy where there is a cascade too
            affected = is_odd if self.cascades else np.ones(number, dtype=bool)
            perturbed[affected] = self._resample_slow_poles(x, int(affected.sum()))
        return perturbed

    def _resample_slow_poles(self, x: np.ndarray, number: int) -> np.ndarray:
        """Return copies (S, P) of x with other slow poles of a current control and its active
        damping (`CornerSwap.spread`).
        """
        coordinates = self.problem.coordinates
        chosen = self.rng.integers(len(self.corners), size=number)
        spread = np.array(
            [self.corners[index].spread(coordinates.to_theta(x), self.rng) for index in chosen]
        )
        return coordinates.to_x(np.clip(spread, coordinates.low, coordinates.high))

    def converge(self, x: np.ndarray, wave: int | None) -> None:
        """Descend starts x (S, P) to convergence on the final objective, and the equivalent sets of
        the best of them too.
        """
        batch = self._descend_to_convergence(x)
        self._keep(batch, wave)
        if self.finished and not self.solved:
            self._keep(self._twin_batch(batch.x[int(np.argmin(batch.cost))]), None)

    def most_plausible(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the most plausible of the equivalent parameter sets, and the others.

        Where a common scale is not identifiable the best minimum is first moved to typical values,
        since an exchange at another scale may lead out of bounds.
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
        """Move x (P,) along non-identifiable directions to the typical values."""
        return nearest(self.problem, x, self.problem.typical, self.settings.minimised)

    def _likeliest(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the maximum a posteriori estimate (P,), and the equivalent sets.

        With known noise: data and log-normal prior around typical values. The gains of a cascade
        are redistributed too, since noise hides how they are shared. Equivalent is what raises
        chi2 by one at most, one standard deviation of a parameter.
        """
        minima = [minimum.x for minimum in self._separate_minima(LIKELY)]
        exchanged = twins_of(self.problem.coordinates, self.swaps, minima[0])
        redistributed = self._perturb(minima[0], redistribute=True) if self.swaps else []
        starts = np.array([*minima, *exchanged, *redistributed])
        model, settings = self.posterior, self.settings
        batch = GEODESIC.go(model, GEODESIC.begin(model, starts), HOP_ITERATIONS)
        batch = GEODESIC.go(model, batch.best(settings.kept), settings.iterations)
        best = batch.best(1).x[0]
        twins = self._twin_batch(best, self.posterior).x
        costs = self.problem.costs(
            np.concatenate([best[None], twins]), self.settings.minimised
        ).sum(axis=1)
        return best, list(twins[costs[1:] <= costs[0] + (self.final.noise or 0.0)])

    def _separate_minima(self, number: int) -> list[LocalMinimum]:
        """Return minima of least error, of several ends in the same one the first."""
        separate: list[LocalMinimum] = []
        for minimum in sorted(self.finished, key=lambda minimum: minimum.error):
            if not separate or minimum.error > separate[-1].error * (1 + SAME_ERROR):
                separate.append(minimum)
        return separate[:number]

    def select_distinct(self, twins: list[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the equivalent sets that differ from x (P,) in the exchanged parameters.

        Each is first moved to x along non-identifiable directions, so that only the exchange
        remains.
        """
        entries = [entry for swap in self.swaps for entry in swap.entries]
        rescaled = [
            nearest(self.problem, twin, x, self.settings.minimised, ignoring=entries)
            for twin in twins
        ]
        return tuple(twin for twin in rescaled if np.abs(twin - x)[entries].max() > SAME_MINIMUM)

    def _twin_batch(self, x: np.ndarray, misfit: Misfit | None = None) -> Batch:
        """Descend every exchange of x (P,) to convergence."""
        twins = twins_of(self.problem.coordinates, self.swaps, x)
        return self._descend_to_convergence(
            np.array(twins).reshape(len(twins), self.problem.size), misfit
        )

    def _descend_to_convergence(self, x: np.ndarray, misfit: Misfit | None = None) -> Batch:
        """Descend starts x (S, P), on the final objective unless another is given."""
        misfit = misfit or self.final
        return GEODESIC.go(misfit, GEODESIC.begin(misfit, x), self.settings.iterations)

    def _errors(self, x: np.ndarray) -> np.ndarray:
        """Return the errors (S,) at x (S, P)."""
        return mean_error(self.problem.costs(x, self.settings.minimised), self.settings.minimised)

    def _keep(self, batch: Batch, wave: int | None) -> None:
        """Add the ends of a batch that have a response to the minima."""
        for x, error in zip(batch.x, self._errors(batch.x), strict=True):
            if np.isfinite(error):
                self.finished.append(LocalMinimum(x.copy(), float(error), wave))
