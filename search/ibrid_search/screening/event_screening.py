"""Screening of candidates where recordings of events are the only data.

For small deviations recordings stand for a sweep, and screening fits to that sweep rank all
diagrams and edits at little cost. The best of them are then compared on the recordings themselves
by successive halving (Jamieson & Talwalkar, AISTATS 2016): every candidate descends a few steps,
and only those of least misfit go on.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from math import inf, sqrt

from ibrid.fit.anchor import Decades
from ibrid.fit.objective import objective_for
from ibrid.fit.problem import Misfit, Problem
from ibrid.gap.recordings.event_evaluation import limit_to_decade
from ibrid.gap.recordings.event_misfit import EventDescent
from ibrid.gap.recordings.event_problem import event_problem_of_study
from ibrid.gap.recordings.successive_halving import Entrant, rank_entrants
from ibrid.study import Study
from ibrid.telling import Tell, silent
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.candidate_problems import NO_FIT_ERRORS
from ibrid_search.screening.edit_screening import (
    EditScreener,
    ScreeningFit,
    Values,
    rank_fits,
)
from ibrid_search.screening.plausibility import PlausibilityIssues, count_absurd_values
from ibrid_search.screening.selection_criterion import SelectionCriterion
from ibrid_search.screening.settings import SCREENING


class EventEditScreener(EditScreener):
    """Screen candidates on the recordings of a study.

    The sweep that small deviations give has one direction of Y only and more local minima, so more
    samples descend.
    """

    library_draws = SCREENING.events_factor * SCREENING.library_draws
    library_descents = SCREENING.events_factor * SCREENING.library_descents

    def __init__(self, study: Study, criterion: SelectionCriterion) -> None:
        super().__init__(study.blind, criterion)
        self._halving_results: dict[str, list[ScreeningFit]] = {}

    def screen_library(self, devices: int = 1, tell: Tell = silent) -> tuple[ScreeningFit, ...]:
        """Screen the library diagrams on the recordings; those near the least error, the best
        first.
        """
        fits = super().screen_library(devices, lambda words, share: tell(words, 0.5 * share))
        entrants = fits[: SCREENING.event_library_entrants]
        tell(f"comparing the best {len(entrants)} on the recordings", 0.5)
        survivors = self._halve(entrants)
        least_error = min((fit.error for fit in survivors), default=0.0)
        largest_error = SCREENING.event_error_ratio * least_error
        return tuple(fit for fit in survivors if fit.error <= largest_error)

    def rank_edits(
        self, edits: Iterable[CandidateEdit], values: Values, *, at_noise: bool = False
    ) -> list[ScreeningFit]:
        """Rank edits of a fitted parent on the recordings; the best first.

        Quick screening fits select the entrants of the successive halving. If the parent leaves
        nothing but noise, their order is the result.
        """
        quick_fits = [self.screen_from_parent(edit, values, quick=True) for edit in edits]
        fits = rank_fits(fit for fit in quick_fits if fit.error < inf)
        entrants = fits[: SCREENING.event_edit_entrants]
        if at_noise:
            return entrants
        structures = [self.study.hash_of(fit.edit.diagram) for fit in entrants]
        key = f"{structures} {[fit.values for fit in entrants]}"
        if key not in self._halving_results:
            self._halving_results[key] = self._halve(entrants)
        return self._halving_results[key]

    def _misfits(self, problem: Problem) -> tuple[Misfit, Misfit]:
        """Return the two sums of squares with a log-normal prior around typical values.

        Small deviations leave some parameters open; a mode far beyond the recorded band could then
        not be simulated.
        """
        prior = Decades(problem)
        return (
            Misfit(problem, "log", prior),
            Misfit(problem, objective_for(problem.points), prior),
        )

    def _halve(self, fits: Sequence[ScreeningFit]) -> list[ScreeningFit]:
        """Compare screening fits on the recordings by successive halving; the best first.

        A candidate that cannot be simulated drops out.
        """
        entrants: list[Entrant[CandidateEdit]] = []
        for fit in fits:
            descent = _descend_or_none(partial(self._begin_descent, fit))
            if descent is not None:
                entrants.append(Entrant(fit.edit, descent))
        for rung in SCREENING.rungs:
            advanced: list[Entrant[CandidateEdit]] = []
            for edit, descent in entrants:
                further = _descend_or_none(partial(descent.run, rung.rounds, rung.steps))
                if further is not None:
                    advanced.append(Entrant(edit, further))
            entrants = rank_entrants(advanced, rung.survivors)
        return rank_fits(self._screening_fit(edit, descent) for edit, descent in entrants)

    def _begin_descent(self, fit: ScreeningFit) -> EventDescent:
        """Begin the descent of a screening fit on the recordings, at coarse time steps."""
        question = event_problem_of_study(fit.edit.diagram, self.study)
        fitter = limit_to_decade(question, {}, sampled=False).fitter
        misfit = fitter.misfit(question.diagram, ()).coarse
        return misfit.start_descent(misfit.parameter_prior.start(fit.values[0]))

    def _screening_fit(self, edit: CandidateEdit, descent: EventDescent) -> ScreeningFit:
        """Return the result of a descent on the recordings, its error on the scale of the run."""
        residual_over_noise = sqrt(descent.cost / descent.misfit.count)
        error = residual_over_noise * self.criterion.floor.level
        free_parameters = len(descent.x)
        absurd = count_absurd_values(edit.diagram, descent.values, self.study.kinds)
        score = self.score(error, free_parameters, PlausibilityIssues(absurd=absurd))
        values = (descent.values,) * len(self.study.fitted.names)
        return ScreeningFit(edit, error, free_parameters, score, values)


def _descend_or_none(descend: Callable[[], EventDescent]) -> EventDescent | None:
    """Return the result of a descent; None where the diagram has no system matrices or no steady
    state, or where a user's module fails.
    """
    try:
        return descend()
    except NO_FIT_ERRORS:
        return None
