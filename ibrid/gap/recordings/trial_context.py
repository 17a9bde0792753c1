"""What all trials of edits on recordings share: the weighted data, the limits of a model, and
whether a model or an edit explains the data.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.limit_edits import LimitEdit, list_limit_edits
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import (
    FitResult,
    Model,
    Values,
    explains_nearly_all,
    significance_threshold,
)
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.playback.limits import Limit
from ibrid.structure.diagrams.diagram import Diagram

#: Random starts of a fit to the sweep alone.
SWEEP_DRAWS = 16

#: Effect, change and location of an edit, which identify it.
EditKey = tuple[str, str, str]
#: Models by their last edit.
Trials = dict[EditKey, Model]


class TrialContext:
    """Recordings, and perhaps a sweep, weighted by one noise.

    Parameters
    ----------
    fitter : EventFitter
        Fits diagrams to the recordings, weighted by its noise.
    kinds : Vocabulary
        Module kinds that edits may use.
    catalogue : sequence of Effect
        Effects that may be missing in the program.
    limits : sequence of Limit
        Of the given model.
    sweep_fits : DiagramCache
        Fits of diagrams to the sweep alone, which no weight of the recordings changes.
    """

    def __init__(
        self,
        fitter: EventFitter,
        kinds: Vocabulary,
        catalogue: Sequence[Effect],
        limits: Sequence[Limit],
        sweep_fits: DiagramCache[FitResult | None],
    ) -> None:
        self.fitter = fitter
        self.noise = fitter.noise
        self.kinds = kinds
        self.catalogue = catalogue
        self.limits = tuple(limits)
        self._sweep_fits = sweep_fits
        self._predicted_values: dict[FitResult, Values] = {}

    def with_fitter(self, fitter: EventFitter) -> "TrialContext":
        """Return the context of the same data in the weights of another fitter."""
        return TrialContext(fitter, self.kinds, self.catalogue, self.limits, self._sweep_fits)

    def limits_of(self, model: Model) -> tuple[Limit, ...]:
        """Return the limits of a model: those of the given one as its edits changed them."""
        limits = list(self.limits)
        for edit in model.edits:
            if isinstance(edit, LimitEdit) and edit.change == "add":
                limits.append(edit.limit)
            elif isinstance(edit, LimitEdit):
                limits.remove(edit.limit)
        return tuple(limits)

    def list_limit_edits(self, model: Model) -> tuple[LimitEdit, ...]:
        """List the limits that a model could have in addition, and those that it could lose."""
        limits = self.limits_of(model)
        events = self.noise.events
        edits = list_limit_edits(model.diagram, self.kinds, limits, events, given=self.limits)
        return tuple(edits)

    def apply_edit(self, model: Model, edit: Insertion) -> Model:
        """Return a model with an edit, still with the fit of the model before."""
        return replace(model, diagram=edit.diagram, edits=(*model.edits, edit))

    def fit_sweep(self, diagram: Diagram) -> FitResult | None:
        """Fit a diagram to the sweep alone; None without a sweep or without a response."""
        sweep_fitter = self.fitter.sweep_fitter
        if sweep_fitter is None:
            return None
        return self._sweep_fits.get_or_make(
            diagram, lambda: sweep_fitter.fit(diagram, [{}], draws=SWEEP_DRAWS)
        )

    def predicted_values(self, model: Model) -> Values:
        """Return the values to which prediction errors lead a model that is doubtful.

        Of another model, its fitted values.
        """
        if not self.is_doubtful(model):
            return model.refit.values
        if model.refit not in self._predicted_values:
            starts = [model.refit.values, {}]
            values = self.fitter.fit_predictions(model.diagram, self.limits_of(model), starts)
            self._predicted_values[model.refit] = values
        return self._predicted_values[model.refit]

    def prediction_cost(self, model: Model) -> float:
        """Return the cost of the prediction errors of all records at `predicted_values`."""
        misfit = self.fitter.misfit(model.diagram, self.limits_of(model)).prediction.coarse
        descents = misfit.start_descents_from([self.predicted_values(model)], 1)
        return min((descent.cost for descent in descents), default=np.inf)

    def explains(self, before: Model, after: Model) -> bool:
        """Whether an edit explains the recordings, or nearly all that a model leaves."""
        if before.is_adequate():
            return after.cost() <= SCREENING.explained_cost * before.cost()
        return after.is_adequate() or explains_nearly_all(before, after)

    def is_doubtful(self, model: Model) -> bool:
        """Whether something may be missing in a model: it is not adequate, or barely so.

        The second where the voltage between samples dominates the noise, whose level is then only
        estimated: the right model leaves far less.
        """
        if not model.is_adequate():
            return True
        is_noise_estimated = self.noise.sampled and not model.edits
        if not (is_noise_estimated and self.can_gain(model)):
            return False
        return model.cost() > SCREENING.doubtful_cost * model.refit.dof

    def is_refuted_by_sweep(self, model: Model) -> bool:
        """Whether a model does not explain the sweep, which shows no limit."""
        sweep_fit = self.fit_sweep(model.diagram)
        return sweep_fit is not None and not sweep_fit.is_adequate()

    def can_gain(self, model: Model) -> bool:
        """Whether the cost of a model is large enough for a further parameter to be significant."""
        return model.cost() >= significance_threshold(1, len(self.list_limit_edits(model)))


class TrialMemory:
    """The trials of edits of models, so that each is fitted once.

    They are found by the fit of the model; of an adequate model also by its edits, since another
    fit with the same edits differs little.
    """

    def __init__(self) -> None:
        self._by_fit: dict[FitResult, Trials] = {}
        self._by_edits: dict[tuple[EditKey, ...], Trials] = {}

    def get(self, model: Model) -> Trials | None:
        """Return the trials of a model; None where there are none."""
        trials = self._by_fit.get(model.refit)
        return self.get_same_edits(model) if trials is None and model.is_adequate() else trials

    def get_same_edits(self, model: Model) -> Trials | None:
        """Return the last trials of a model with the same edits."""
        return self._by_edits.get(_list_edit_keys(model))

    def store(self, model: Model, trials: Trials) -> Trials:
        """Store the trials of a model and return them."""
        self._by_fit[model.refit] = trials
        self._by_edits[_list_edit_keys(model)] = trials
        return trials


def edit_key(edit: Insertion) -> EditKey:
    """Return what identifies an edit; its diagram cannot be hashed."""
    return edit.effect, edit.change, edit.where


def _list_edit_keys(model: Model) -> tuple[EditKey, ...]:
    return tuple(edit_key(edit) for edit in model.edits if isinstance(edit, Insertion))
