"""Fits of a model with each edit of its program: screening of all, successive halving of the
leading ones, and fits of the survivors.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ibrid.gap.datasets.sweep_dataset import start_values
from ibrid.gap.recordings.event_fitter import EventFit, EventFitter, select_events
from ibrid.gap.recordings.event_misfit import EventDescent
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.recordings.successive_halving import Entrant, rank_entrants, run_rungs
from ibrid.gap.recordings.trial_context import EditKey, TrialContext, TrialMemory, Trials, edit_key
from ibrid.gap.refitting.model import Model, Values
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Insertion


class ScreenedEdit(NamedTuple):
    """An edit, and the model with it as screening leaves it."""

    edit: Insertion
    model: Model


EditEntrant = Entrant[ScreenedEdit]


class EditFitter:
    """Fits a model with every edit of its program at once, on recordings of one weight."""

    def __init__(self, context: TrialContext) -> None:
        self.context = context
        self.fitter = context.fitter
        self._memory = TrialMemory()
        self._single_event_fitters: dict[str, EventFitter] = {}

    def fit_all(self, model: Model) -> Trials:
        """Return the model with every edit of its program: the survivors of the halving fitted,
        the others as screening leaves them.

        What is missing biases the rest of the model, so that screening on the recordings ranks the
        right edit among the first thirty and no higher. A sweep ranks it better, where it is
        visible there.
        """
        known = self._memory.get(model)
        if known is not None:
            return known
        edits = insertions(model.diagram, self.context.kinds, self.context.catalogue)
        sweep_values = self._screen_on_sweep(model, edits)
        fitted_origin, *nominal_origin = self._list_origins(model)
        ranked = self._rank_edits(model, edits, fitted_origin)
        entrants = self._enter_leading(model, ranked, sweep_values)
        entrants = rank_entrants(entrants, SCREENING.edit_entrants)
        for origin in nominal_origin:
            leading = self._rank_edits(model, edits, origin)[: SCREENING.edits_from_nominal]
            entrants += self._enter_edits(model, leading)
        survivors = run_rungs(entrants, SCREENING.edit_rungs)
        if model.is_adequate() and survivors:
            limit = SCREENING.clear_gain * self.context.prediction_cost(model)
            if survivors[0].descent.cost > limit:
                survivors = []  # nothing is clearly better than the adequate model
        trials = {edit_key(screened.edit): screened.model for screened in ranked}
        self._fit_survivors(model, survivors, trials)
        return self._memory.store(model, trials)

    def _fit_survivors(
        self, model: Model, survivors: Sequence[EditEntrant], trials: Trials
    ) -> None:
        """Fit the survivors in their order and store those that improve on the trials.

        The first few always; the others while none explains the recordings.
        """
        fits: list[EventFit] = []
        for number, ((edit, screened), descent) in enumerate(survivors):
            is_close = descent.cost <= SCREENING.close_cost * survivors[0].descent.cost
            is_leading = number < SCREENING.edit_fits and is_close
            if not is_leading and any(fit.is_adequate() for fit in fits):
                break
            starts = [descent.values, *start_values(edit, [model.refit.values])]
            limits = self.context.limits_of(screened)
            fit = self.fitter.fit(edit.diagram, limits, starts, predict_first=False)
            if fit is None:
                continue
            fits.append(fit)
            fitted = replace(screened, refit=fit)
            pair = (trials.get(edit_key(edit), fitted), fitted)
            trials[edit_key(edit)] = min(pair, key=lambda trial: trial.refit.cost)

    def fit_from(self, model: Model, edits: Sequence[Insertion], values: Values) -> list[Model]:
        """Fit a model with the leading edits, from values of the rest of it."""
        ranked = self._rank_edits(model, edits, values)
        entrants = self._enter_edits(model, ranked[: SCREENING.edits_by_event])
        entrants = rank_entrants(entrants, SCREENING.edit_entrants)
        survivors = run_rungs(entrants, SCREENING.edit_rungs)
        models: list[Model] = []
        for (edit, screened), descent in survivors[: SCREENING.edit_fits]:
            limits = self.context.limits_of(screened)
            fit = self.fitter.fit(edit.diagram, limits, [descent.values], predict_first=False)
            if fit is not None:
                models.append(replace(screened, refit=fit))
        return models

    def _enter_leading(
        self, model: Model, ranked: Sequence[ScreenedEdit], sweep_values: dict[EditKey, Values]
    ) -> list[EditEntrant]:
        """Begin the edits that lead on a record or on the sweep, from their values on each."""
        if not ranked:
            return []
        limit = SCREENING.rival_cost * (ranked[0].model.cost() - model.cost())
        entrants: list[EditEntrant] = []
        for number, screened in enumerate(ranked):
            key = edit_key(screened.edit)
            gap = screened.model.cost() - model.cost()
            leads_on_event = number < SCREENING.edits_by_event and gap <= limit
            if leads_on_event or key in sweep_values:
                starts = [screened.model.refit.values]
                starts += [sweep_values[key]] if key in sweep_values else []
                descents = self._start_edit(model, screened.edit, starts)
                entrants += [Entrant(screened, descent) for descent in descents]
        return entrants

    def _enter_edits(self, model: Model, ranked: Sequence[ScreenedEdit]) -> list[EditEntrant]:
        """Begin edits of a model where screening left them."""
        return [
            Entrant(screened, descent)
            for screened in ranked
            for descent in self._start_edit(model, screened.edit, [screened.model.refit.values])
        ]

    def _start_edit(
        self, model: Model, edit: Insertion, starts: Sequence[Values]
    ) -> list[EventDescent]:
        """Begin an edit at the best start by the prediction errors of all records.

        Empty where no start can be simulated.
        """
        limits = self.context.limits_of(self.context.apply_edit(model, edit))
        misfit = self.fitter.misfit(edit.diagram, limits)
        return misfit.prediction.coarse.start_descents_from(starts, 1)

    def _rank_edits(
        self, model: Model, edits: Sequence[Insertion], origin: Values
    ) -> list[ScreenedEdit]:
        """Screen edits of a model from an origin and return them, least cost first."""
        screened: list[ScreenedEdit] = []
        for edit in edits:
            trial = self._screen_on_worst_event(model, edit, origin)
            if trial is not None:
                screened.append(ScreenedEdit(edit, trial))
        return sorted(screened, key=lambda pair: pair.model.refit.cost)

    def _screen_on_sweep(self, model: Model, edits: Sequence[Insertion]) -> dict[EditKey, Values]:
        """Return the edits that lead on the sweep, with their values there; {} without a sweep."""
        sweep_fitter = self.fitter.sweep_fitter
        if sweep_fitter is None:
            return {}
        fits = []
        for edit in edits:
            starts = start_values(edit, (model.refit.values, {}))
            fit = sweep_fitter.screen(edit.diagram, starts)
            if fit is not None:
                fits.append((edit, fit))
        ranked = sorted(fits, key=lambda pair: pair[1].cost)
        return {edit_key(edit): fit.values for edit, fit in ranked[: SCREENING.edits_by_sweep]}

    def _screen_on_worst_event(self, model: Model, edit: Insertion, origin: Values) -> Model | None:
        """Screen an edit by the predictions of the record that the model misses most.

        One step from an origin. The cost is that of the model plus the misfit of the predictions:
        it ranks screened edits, and is never below the cost of a fit. None without a simulation.
        """
        name = self._find_worst_event(model)
        if name not in self._single_event_fitters:
            noise = select_events(self.context.noise, name, hold=True)
            self._single_event_fitters[name] = self.fitter.with_noise(noise)
        changed = self.context.apply_edit(model, edit)
        limits = self.context.limits_of(changed)
        starts = start_values(edit, (origin,))
        descent = self._single_event_fitters[name].screen(edit.diagram, limits, starts)
        if descent is None:
            return None
        refit = replace(
            model.refit,
            values=descent.values,
            chi2=model.refit.cost + descent.cost,
            penalty=0.0,
            parameter_count=len(descent.x),
            misfit=self.fitter.misfit(edit.diagram, limits),
            diagram=edit.diagram,
            limits=limits,
            x=descent.x,
        )
        return replace(changed, refit=refit)

    def _list_origins(self, model: Model) -> list[Values]:
        """List values at which screening begins: where prediction errors lead the model, and the
        nominal values where that is implausibly far from them.
        """
        values = self.context.predicted_values(model)
        limits = self.context.limits_of(model)
        parameter_prior = self.fitter.misfit(model.diagram, limits).parameter_prior
        x = parameter_prior.start(values)
        is_plausible = np.array_equal(parameter_prior.reset_implausible(x), x)
        return [values] if is_plausible else [values, {}]

    def _find_worst_event(self, model: Model) -> str:
        """Return the name of the record with the largest mean squared residual."""
        pairs = zip(self.context.noise.events.names, model.refit.residuals, strict=False)
        return max(pairs, key=lambda pair: float((np.abs(pair[1]) ** 2).mean()))[0]
