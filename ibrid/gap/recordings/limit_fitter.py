"""Fits of a model with each limit that it lacks, or without one that it has."""

from dataclasses import replace

import numpy as np

from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.limit_candidates import refit_by_predictions, screen_limits
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.recordings.trial_context import EditKey, TrialContext, TrialMemory, Trials, edit_key
from ibrid.gap.refitting.model import Model, Values
from ibrid.playback.limits import Limit


class LimitFitter:
    """Fits a model with every edit of its limits at once.

    Parameters
    ----------
    context : TrialContext
        The weighted recordings.
    loose : EventFitter
        Of the same recordings in looser weights: those of the nominal model.
    """

    def __init__(self, context: TrialContext, loose: EventFitter) -> None:
        self.context = context
        self.loose = loose
        self._memory = TrialMemory()

    def fit_all(self, model: Model) -> Trials:
        """Fit a model with each edit of its limits; by successive halving where it is doubtful."""
        known = self._memory.get(model)
        if known is not None:
            return known
        is_doubtful = self.context.is_doubtful(model)
        origins = self._list_origins(model) if is_doubtful else [model.refit.values]
        trials = self.screen_from(model, origins, predict_first=is_doubtful)
        trials |= self._refit_leading(model, trials)
        # of a model that has been fitted better since
        earlier_trials = self._memory.get_same_edits(model) or {}
        for key, earlier in earlier_trials.items():
            pair = (trials.get(key, earlier), earlier)
            trials[key] = min(pair, key=lambda trial: trial.refit.cost)
        return self._memory.store(model, trials)

    def screen_from(
        self, model: Model, origins: list[Values], *, predict_first: bool = True
    ) -> Trials:
        """Screen all edits of the limits, from values of the rest of the model."""
        context = self.context

        def limits_with(edit: LimitEdit) -> tuple[Limit, ...]:
            return context.limits_of(context.apply_edit(model, edit))

        edits = context.list_limit_edits(model)
        fits = screen_limits(
            context.fitter, edits, limits_with, origins, predict_first=predict_first
        )
        return {
            edit_key(edit): replace(context.apply_edit(model, edit), refit=fit)
            for edit, fit in zip(edits, fits, strict=True)
            if fit is not None
        }

    def _list_origins(self, model: Model) -> list[Values]:
        """List values to begin with: of the sweep where that is explained, of the model, and where
        prediction errors lead it.
        """
        sweep_fit = None if model.is_adequate() else self.context.fit_sweep(model.diagram)
        sweep_values: Values = {}
        if sweep_fit is not None and sweep_fit.is_adequate():
            sweep_values = sweep_fit.values
        return [sweep_values, model.refit.values, self.context.predicted_values(model)]

    def _refit_leading(self, model: Model, trials: Trials) -> Trials:
        """Refit by predictions the best trial of each kind of limit among the leading ones.

        Those that are near the best of all and take much of what the model leaves; none where the
        best explains everything.
        """
        best_by_kind: dict[str, tuple[EditKey, Model]] = {}
        for key, trial in sorted(trials.items(), key=lambda pair: pair[1].refit.cost):
            effect, _, _ = key
            best_by_kind.setdefault(effect, (key, trial))
        least_cost = min((trial.refit.cost for _, trial in best_by_kind.values()), default=np.inf)
        limit = min(SCREENING.rival_cost * least_cost, SCREENING.clear_gain * model.refit.cost)
        leading = [pair for pair in best_by_kind.values() if pair[1].refit.cost < limit]
        leading = leading[: SCREENING.repredicted_limits]
        if not leading or self.context.explains(model, leading[0][1]):
            return {}
        fitter = self.context.fitter
        refitted: Trials = {}
        for key, trial in leading:
            refit = refit_by_predictions(trial.refit, fitter, self.loose, model.refit.values)
            refitted[key] = replace(trial, refit=refit)
        return refitted
