"""Records, and perhaps a sweep beside them, weighed by one noise: what a model is there, and
whether it is doubted.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.limit_edits import LimitEdit, list_limit_edits
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

#: Where sampling leaves most of what is open: part of it beyond which a model that explains is
#: doubted all the same, and part of what that leaves that the right one leaves. Of drawn devices
#: the right model left 0.002 of what is open at most.
WRONG, RIGHT = 0.03, 0.1
#: Factor on what the first of some trials leaves beyond which another one is no rival: the right
#: one left 2 times as much at most in three drawn devices.
RIVAL = 6.0
#: Part of what another answer leaves that is clearly less.
HALF = 0.5

#: An edit's effect, change and place, by which it is known.
EditKey = tuple[str, str, str]


class TrialContext:
    """What every trial asks of records. `fitter` : by the noise that they are weighed by. `limits`
    : beside the given model.
    `small` : what the sweep alone says of diagrams, for all weights.
    """

    def __init__(
        self,
        fitter: EventFitter,
        kinds: Vocabulary,
        catalogue: Sequence[Effect],
        limits: Sequence[Limit],
        small: DiagramCache[FitResult | None],
    ) -> None:
        self.fitter, self.noise = fitter, fitter.noise
        self.kinds, self.catalogue, self.limits = kinds, catalogue, tuple(limits)
        self._small = small
        self._predicted: dict[FitResult, Values] = {}

    def with_fitter(self, fitter: EventFitter) -> "TrialContext":
        """The same records by another fitter's noise."""
        return TrialContext(fitter, self.kinds, self.catalogue, self.limits, self._small)

    def limits_of(self, model: Model) -> tuple[Limit, ...]:
        """The limits of a model: those of the given one, and what its edits did to them."""
        limits = list(self.limits)
        for edit in model.edits:
            if isinstance(edit, LimitEdit) and edit.change == "add":
                limits.append(edit.limit)
            elif isinstance(edit, LimitEdit):
                limits.remove(edit.limit)
        return tuple(limits)

    def list_limit_edits(self, model: Model) -> tuple[LimitEdit, ...]:
        """Where a model could have a limit more, or one less."""
        beside = self.limits_of(model)
        return tuple(
            list_limit_edits(
                model.diagram, self.kinds, beside, self.noise.events, given=self.limits
            )
        )

    def with_edit(self, model: Model, insertion: Insertion) -> Model:
        """A model with an edit, not fitted yet."""
        return replace(model, diagram=insertion.diagram, edits=(*model.edits, insertion))

    def sweep_fit(self, diagram: Diagram) -> FitResult | None:
        """What the sweep alone says of a diagram; None without one, or without an answer."""
        refitter = self.fitter.refitter
        return (
            None
            if refitter is None
            else self._small.of(diagram, lambda: refitter.fit(diagram, [{}], draws=16))
        )

    def predicted_values(self, model: Model) -> Values:
        """Where predictions lead a model that does not explain the records; its values where it
        does.
        """
        if not self.is_doubtful(model):
            return model.refit.values
        if model.refit not in self._predicted:
            led = self.fitter.fit_predictions(
                model.diagram, self.limits_of(model), [model.refit.values, {}]
            )
            self._predicted[model.refit] = led
        return self._predicted[model.refit]

    def prediction_cost(self, model: Model) -> float:
        """Of predictions of all records by a model, where they lead it."""
        misfit = self.fitter.misfit(model.diagram, self.limits_of(model)).prediction.coarse
        return min(
            (one.cost for one in misfit.start_descents_from([self.predicted_values(model)], 1)),
            default=np.inf,
        )

    def explains(self, before: Model, after: Model) -> bool:
        """Whether an edit explains the records, or nearly all that a model leaves."""
        if before.is_adequate():
            return after.cost() <= RIGHT * before.cost()
        return after.is_adequate() or explains_nearly_all(before, after)

    def is_doubtful(self, model: Model) -> bool:
        """Whether a model does not explain the records; or, of the given one where sampling leaves
        much open, leaves as much as something wrong does: how much is open was estimated, and what
        is right leaves a hundredth of it.
        """
        doubted = self.noise.sampled and not model.edits and self.may_pay(model)
        return not model.is_adequate() or (doubted and model.cost() > WRONG * model.refit.dof)

    def is_refuted_by_sweep(self, model: Model) -> bool:
        """Whether the sweep beside the records, which shows no limit, is not explained."""
        small = self.sweep_fit(model.diagram)
        return small is not None and not small.is_adequate()

    def may_pay(self, model: Model) -> bool:
        """Whether a model leaves so much that a further number could pay."""
        return model.cost() >= significance_threshold(1, len(self.list_limit_edits(model)))


class TrialMemory:
    """Models with each edit that was tried on a model, known again by its fit; where that explains
    all, also by its edits, since another fit with the same differs little.
    """

    def __init__(self) -> None:
        self._by_fit: dict[FitResult, dict[EditKey, Model]] = {}
        self._by_edits: dict[tuple[EditKey, ...], dict[EditKey, Model]] = {}

    def of(self, model: Model) -> dict[EditKey, Model] | None:
        """What was tried on a model; None where nothing was."""
        known = self._by_fit.get(model.refit)
        return self.of_same_edits(model) if known is None and model.is_adequate() else known

    def of_same_edits(self, model: Model) -> dict[EditKey, Model] | None:
        """What was last tried on a model with the same edits."""
        return self._by_edits.get(_edit_keys(model))

    def store(self, model: Model, tried: dict[EditKey, Model]) -> dict[EditKey, Model]:
        """What was tried on a model, kept."""
        self._by_fit[model.refit] = self._by_edits[_edit_keys(model)] = tried
        return tried


def edit_key(insertion: Insertion) -> EditKey:
    """By what an edit is known: a diagram is no key."""
    return insertion.effect, insertion.change, insertion.where


def _edit_keys(model: Model) -> tuple[EditKey, ...]:
    return tuple(edit_key(one) for one in model.edits if isinstance(one, Insertion))
