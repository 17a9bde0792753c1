"""Screening fits: a few damped Gauss-Newton steps for each candidate edit, instead of a full fit.

A screening fit descends from the values of the fitted parent, completed by initial values of the
new parameters, and from random samples: first on the residual ln(Y / data), whose minimum is wider,
then on the final error. It costs about a hundredth of a full fit. Its error is an upper bound of
the error of the full fit, so screening only orders the candidates; results rest on full fits.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf, isfinite, log, sqrt
from types import MappingProxyType

import numpy as np

from ibrid.fit import kernel
from ibrid.fit.least_squares import LEVENBERG, Batch
from ibrid.fit.objective import objective_for
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.starts import TEXTBOOK_DECADES, StartDrawer
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.parts.editing.device import device_parts
from ibrid.structure.diagrams.library import (
    published_names,
    published_values,
    shipped_names,
    textbook,
)
from ibrid.study import Study
from ibrid.telling import Tell, silent
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.candidate_problems import (
    NO_FIT_ERRORS,
    PARAMETER_COST,
    pose_problems,
)
from ibrid_search.screening.plausibility import (
    NO_ISSUES,
    PlausibilityIssues,
    count_absurd_values,
)
from ibrid_search.screening.selection_criterion import SelectionCriterion, credited_error
from ibrid_search.screening.settings import SCREENING
from ibrid_search.screening.time_slices import TimeSlice

#: Parameter values "instance.parameter" -> value, one mapping for each fitted operating point.
Values = Sequence[Mapping[str, float]]
#: Descends the starts of one fit problem; returns the final batch.
DescentMethod = Callable[[Problem, StartDrawer, np.random.Generator], Batch]

NO_VALUES: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class ScreeningFit:
    """Hold the result of a screening fit.

    `error` : as the run measures it (`NoiseFloor`), infinite without a response. `free` : free
    parameters of one operating point. `score` : ln(error) with the cost of the parameters, by which
    fits are ranked, the lower the better. `values` : fitted, one mapping for each operating point;
    empty without a response.
    """

    edit: CandidateEdit
    error: float
    free: int
    score: float
    values: Values = ()


def rank_fits(fits: Iterable[ScreeningFit]) -> list[ScreeningFit]:
    """Sort screening fits by their score, the best first."""
    return sorted(fits, key=lambda fit: fit.score)


class EditScreener:
    """Fit candidate edits briefly to the sweep of a study.

    Fits are deterministic, their random generator being seeded by the study and the structure, and
    cached.
    """

    library_draws = SCREENING.library_draws
    library_descents = SCREENING.library_descents

    def __init__(self, study: Study, criterion: SelectionCriterion) -> None:
        kernel.load()
        self.study = study
        self.criterion = criterion
        self.groups = [
            coarse(group, SCREENING.max_operating_points, SCREENING.max_frequencies)
            for group in study.groups
        ]
        self._cache: dict[str, ScreeningFit] = {}
        self._time_slice: TimeSlice[ScreeningFit] | None = None

    @contextmanager
    def time_slice(self, seconds: float | None) -> Iterator[TimeSlice[ScreeningFit]]:
        """Limit the wall time of the screening fits within; TimeSliceOver is raised after it.

        With None there is no limit, and the slice only collects the fits.
        """
        time_slice = TimeSlice[ScreeningFit](seconds)
        self._time_slice = time_slice
        try:
            yield time_slice
        finally:
            self._time_slice = None

    def begin_stage(self, candidates: Sequence[object]) -> None:
        """Announce the candidates that are about to be screened to the current time slice."""
        if self._time_slice is not None:
            self._time_slice.begin_stage(candidates)

    def library_edits(
        self, devices: int, tell: Tell
    ) -> Iterator[tuple[CandidateEdit, Mapping[str, float]]]:
        """Yield the library diagrams of a number of devices, with published parameter values.

        Diagrams with modules that the vocabulary lacks are left out. `tell` gets the progress.
        """
        names = shipped_names()
        for index, name in enumerate(names):
            tell(f"first look at {name}, {index + 1} of {len(names)}", index / len(names))
            diagram = textbook(name)
            if self.study.examined(diagram, name).violations:
                continue
            if len(device_parts(diagram, self.study.kinds)) != devices:
                continue
            values = published_values(name) if name in published_names() else {}
            yield CandidateEdit(diagram, f"the shipped diagram {name}", name, {}), values

    def screen_library(self, devices: int = 1, tell: Tell = silent) -> tuple[ScreeningFit, ...]:
        """Screen the library diagrams of a number of devices; the best first.

        Diagrams without a response at the operating points are left out.
        """
        candidates = list(self.library_edits(devices, tell))
        self.begin_stage(candidates)
        fits = [self.screen_from_scratch(edit, values) for edit, values in candidates]
        return tuple(rank_fits(fit for fit in fits if isfinite(fit.error)))

    def rank_edits(
        self, edits: Iterable[CandidateEdit], values: Values, *, at_noise: bool = False
    ) -> list[ScreeningFit]:
        """Screen edits of a fitted parent; the best first.

        Parameters
        ----------
        values : Values
            Fitted values of the parent.
        at_noise : bool
            The parent leaves nothing but noise; screening of recordings then saves work.
        """
        edits = list(edits)
        self.begin_stage(edits)
        return rank_fits(self.screen_from_parent(edit, values) for edit in edits)

    def score(
        self,
        error: float,
        free_parameters: float,
        issues: PlausibilityIssues = NO_ISSUES,
    ) -> float:
        """Return ln(error) plus the cost of free parameters and issues, the lower the better.

        The criterion of the final selection, per operating point.
        """
        equivalent_parameters = free_parameters + SCREENING.implausibility_cost * issues.total
        return log(credited_error(error, issues)) + self.parameter_cost * equivalent_parameters

    @property
    def parameter_cost(self) -> float:
        """Return the cost of a free parameter, in ln(error)."""
        if not self.criterion.floor.known:
            return PARAMETER_COST
        return self.criterion.parameter_cost / self.criterion.parameter_sets

    def screen_from_scratch(
        self, edit: CandidateEdit, known_values: Mapping[str, float] = NO_VALUES
    ) -> ScreeningFit:
        """Screen a diagram without a fitted parent, from samples of the textbook ranges.

        The best samples descend on ln(Y / data) in two rounds, between which the worst are dropped,
        then on the final error. `known_values` of some parameters give further starts.
        """

        def descend(problem: Problem, drawer: StartDrawer, rng: np.random.Generator) -> Batch:
            log_misfit, final_misfit = self._misfits(problem)
            x = drawer.draw(rng, self.library_draws, TEXTBOOK_DECADES[0])
            if known_values:
                by_point = [known_values] * len(problem.points)
                completed = drawer.completed(rng, by_point, SCREENING.completion_draws)
                x = np.concatenate([x, completed])
            batch = LEVENBERG.begin(log_misfit, x).best(self.library_descents)
            for _ in range(2):
                batch = LEVENBERG.go(log_misfit, batch, SCREENING.log_steps)
                batch = batch.best(SCREENING.log_descents)
            return LEVENBERG.go(
                final_misfit,
                LEVENBERG.begin(final_misfit, batch.x),
                SCREENING.library_error_steps,
            )

        structure_hash = self.study.hash_of(edit.diagram)
        key = f"from scratch {structure_hash} {sorted(known_values.items())}"
        return self._cached(key, edit, lambda: self._fit(edit, [descend] * len(self.groups)))

    def screen_from_parent(
        self, edit: CandidateEdit, values: Values, *, quick: bool = False
    ) -> ScreeningFit:
        """Screen an edit from the fitted values of its parent.

        Parameters
        ----------
        values : Values
            Of the parent, one mapping for each fitted operating point.
        quick : bool
            Descend from the values of the parent alone: a third of the work, sufficient unless
            these values are biased by what the parent lacks.
        """
        by_point = [sorted(point.items()) for point in values]
        key = f"quick={quick} {self.study.hash_of(edit.diagram)} {by_point}"
        return self._cached(key, edit, lambda: self._fit_from_parent(edit, values, quick))

    def _cached(
        self, key: str, edit: CandidateEdit, compute: Callable[[], ScreeningFit]
    ) -> ScreeningFit:
        """Return the cached screening fit of a key, or compute and cache it.

        Edits with different descriptions may lead to the same structure and share a fit.
        """
        if key not in self._cache:
            if self._time_slice is not None:
                self._time_slice.check_time()
            if len(self._cache) >= SCREENING.cached_fits:
                self._cache.clear()
            self._cache[key] = compute()
        fit = replace(self._cache[key], edit=edit)
        if self._time_slice is not None:
            self._time_slice.add(fit)
        return fit

    def _fit_from_parent(self, edit: CandidateEdit, values: Values, quick: bool) -> ScreeningFit:
        """Fit an edit to each group of operating points from the values of its parent."""
        values_at = dict(zip(self.study.fitted.names, values, strict=True))
        methods = [
            self._descent_from_parent(edit, [values_at[point.op.name] for point in group], quick)
            for group in self.groups
        ]
        return self._fit(edit, methods)

    def _descent_from_parent(
        self, edit: CandidateEdit, values: Values, quick: bool
    ) -> DescentMethod:
        """Return the descent of an edit from its parent's values at one group of points.

        The starts are the parent's values with each set of initial values of the new parameters,
        and with samples of them. They descend on the final error. Unless `quick`, their ends and
        the best samples of all parameters then descend on ln(Y / data) and on the final error
        again, and the better of the two results counts.
        """
        initial_values = _initial_value_sets(edit)

        def descend(problem: Problem, drawer: StartDrawer, rng: np.random.Generator) -> Batch:
            log_misfit, final_misfit = self._misfits(problem)
            starts = [
                drawer.completed(rng, [{**point, **initial} for point in values], 1)
                for initial in initial_values
            ]
            starts.append(drawer.completed(rng, values, SCREENING.completion_draws))
            x = np.concatenate(starts)
            batch = LEVENBERG.begin(final_misfit, x).best(SCREENING.parent_descents)
            local = LEVENBERG.go(final_misfit, batch, SCREENING.error_steps)
            if quick:
                return local

            samples = drawer.draw(rng, SCREENING.global_draws, TEXTBOOK_DECADES[0])
            sample_costs = problem.costs(samples, "log").sum(axis=1)
            order = np.argsort(sample_costs, kind="stable")[: SCREENING.log_descents]
            x = np.concatenate([local.x, samples[order]])
            batch = LEVENBERG.begin(log_misfit, x)
            batch = LEVENBERG.go(log_misfit, batch, SCREENING.log_steps)
            batch = batch.best(SCREENING.polished_starts)
            batch = LEVENBERG.begin(final_misfit, batch.x)
            distant = LEVENBERG.go(final_misfit, batch, SCREENING.error_steps)
            return local if local.cost.min() <= distant.cost.min() else distant

        return descend

    def _fit(self, edit: CandidateEdit, methods: Sequence[DescentMethod]) -> ScreeningFit:
        """Fit a candidate to each group of operating points by the descent method of the group.

        The error is the mean over the groups, and infinite where the diagram has no system matrices
        or a user's module fails; its full evaluation reports the reason.
        """
        study = self.study
        errors: list[float] = []
        values_at: dict[str, Mapping[str, float]] = {}
        free_parameters = 0
        at_bound = 0
        try:
            compiled = study.compiled(edit.diagram)
            rng = np.random.default_rng([study.seed, int(compiled.structure_hash[:8], 16)])
            problems = pose_problems(compiled, study, self.groups)
            for group, problem, descend in zip(self.groups, problems, methods, strict=True):
                drawer = StartDrawer(problem, compiled.wiring, study.sweep.omega_0)
                batch = descend(problem, drawer, rng)
                best = int(np.argmin(batch.cost))
                x = batch.x[best]
                at_bound = max(at_bound, int(problem.at_bound(x).sum()))
                errors.append(self._error(float(batch.cost[best]), group))
                for index, point in enumerate(group):
                    values_at[point.op.name] = problem.values_at(x, index)
                free_parameters = problem.size
        except NO_FIT_ERRORS:
            return ScreeningFit(edit, inf, 0, inf)
        error = float(np.mean(errors))
        if not isfinite(error):
            return ScreeningFit(edit, inf, free_parameters, inf)

        first = next(iter(values_at.values()))
        values = tuple(values_at.get(name, first) for name in study.fitted.names)
        absurd = max(count_absurd_values(edit.diagram, point, study.kinds) for point in values)
        issues = PlausibilityIssues(at_bound=at_bound, absurd=absurd)
        uncommon_cost = 0 if edit.usual else SCREENING.uncommon_edit_cost
        score = self.score(error, free_parameters + uncommon_cost, issues)
        return ScreeningFit(edit, error, free_parameters, score, values)

    def _error(self, cost: float, group: Sequence[PointSweep]) -> float:
        """Return the error of a cost (a sum over the points of a group) as the run measures it."""
        scale = self.criterion.floor.level if objective_for(group) == "sigma" else 1.0
        return sqrt(cost / len(group)) * scale

    def _misfits(self, problem: Problem) -> tuple[Misfit, Misfit]:
        """Return the sums of squares of ln(Y / data) and of the final error."""
        return Misfit(problem, "log"), Misfit(problem, objective_for(problem.points))


def _initial_value_sets(edit: CandidateEdit) -> list[dict[str, float]]:
    """Combine the initial values of the new parameters of an edit: the j-th of each, or its last.

    {"a": (1, 2), "b": (3,)} gives [{"a": 1, "b": 3}, {"a": 2, "b": 3}].
    """
    set_count = max((len(values) for values in edit.initial_values.values()), default=0)
    return [
        {name: values[min(j, len(values) - 1)] for name, values in edit.initial_values.items()}
        for j in range(set_count)
    ]
