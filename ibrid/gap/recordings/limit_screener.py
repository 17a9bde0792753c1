"""Trials of limits beside a program: a model with every limit that it lacks, or without one that it
has, fitted together.
"""

from dataclasses import replace

import numpy as np

from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.limit_candidates import refit_by_predictions, screen_limits
from ibrid.gap.recordings.trial_context import (
    HALF,
    RIVAL,
    EditKey,
    TrialContext,
    TrialMemory,
    edit_key,
)
from ibrid.gap.refitting.model import Model, Values

#: Kinds of limits whose first in a race is led once more.
LED_ON = 3


class LimitScreener:
    """Trials on records of one weight. `loose` : by what nominal values leave open."""

    def __init__(self, weighed: TrialContext, loose: EventFitter) -> None:
        self.weighed, self.loose = weighed, loose
        self._tried = TrialMemory()

    def of(self, model: Model) -> dict[EditKey, Model]:
        """The model with, or without, each limit."""
        if (known := self._tried.of(model)) is not None:
            return known
        led = self.weighed.is_doubtful(model)
        origins = self._origins(model) if led else [model.refit.values]
        screened = self.screen_from(model, origins, led=led)
        screened |= self._refit_leading(model, screened)
        for edit, one in (
            self._tried.of_same_edits(model) or {}
        ).items():  # of a model that has a better fit since
            screened[edit] = min(screened.get(edit, one), one, key=lambda each: each.refit.cost)
        return self._tried.store(model, screened)

    def screen_from(
        self, model: Model, origins: list[Values], *, led: bool = True
    ) -> dict[EditKey, Model]:
        """As a race leaves them that begins at values of the rest of the model."""
        weighed, places = self.weighed, self.weighed.list_limit_edits(model)
        fits = screen_limits(
            weighed.fitter,
            places,
            lambda one: weighed.limits_of(weighed.with_edit(model, one)),
            origins,
            led=led,
        )
        return {
            edit_key(place): replace(weighed.with_edit(model, place), refit=fit)
            for place, fit in zip(places, fits, strict=True)
            if fit is not None
        }

    def _origins(self, model: Model) -> list[Values]:
        """What the sweep says where it is explained, what the model has, and where predictions lead
        it.
        """
        small = None if model.is_adequate() else self.weighed.sweep_fit(model.diagram)
        first: Values = {} if small is None or not small.is_adequate() else small.values
        return [first, model.refit.values, self.weighed.predicted_values(model)]

    def _refit_leading(self, model: Model, screened: dict[EditKey, Model]) -> dict[EditKey, Model]:
        """The first of each kind of limit in a race led once more, where they are near each other,
        take much of what the model leaves and do not explain all.
        """
        firsts: dict[str, tuple[EditKey, Model]] = {}
        for edit, one in sorted(screened.items(), key=lambda pair: pair[1].refit.cost):
            firsts.setdefault(edit[0], (edit, one))
        least = min((one.refit.cost for _, one in firsts.values()), default=np.inf)
        most = min(RIVAL * least, HALF * model.refit.cost)
        near = [pair for pair in firsts.values() if pair[1].refit.cost < most][:LED_ON]
        if not near or self.weighed.explains(model, near[0][1]):
            return {}
        fitter = self.weighed.fitter
        return {
            edit: replace(
                one, refit=refit_by_predictions(one.refit, fitter, self.loose, model.refit.values)
            )
            for edit, one in near
        }
