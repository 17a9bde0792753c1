"""Trials of edits of a program: glances at all, a race of the first of them, and fits of those in
front.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.gap.datasets.sweep_dataset import start_values
from ibrid.gap.recordings.event_fitter import EventFit, EventFitter, select_events
from ibrid.gap.recordings.event_misfit import EventDescent
from ibrid.gap.recordings.limit_candidates import rank_entrants, run_rungs
from ibrid.gap.recordings.trial_context import (
    HALF,
    RIVAL,
    EditKey,
    TrialContext,
    TrialMemory,
    edit_key,
)
from ibrid.gap.refitting.model import Model, Values
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Insertion

#: Edits of a model of which all records are predicted: the first by a glance at one record, and the
#: first by one at the sweep beside them. Those of them that predict best race.
GLANCED, SWEPT, RACED = 32, 8, 16
#: Where what is missing has bent the model far from what is believed, the first so many by a glance
#: from what is believed race, too: of 56 edits of a grid-forming model the right one was the 44th
#: by a glance from the bent model, and the first by that.
PUT_BACK = 8
#: Rounds of the race, steps of each, and how many go on: the right one was the fifth at its end in
#: one of 21 drawn devices, else the first. Of those at its end so many are fitted in any case, and
#: the others while none explains the records.
HEATS, FITS = ((1, 3, 8), (3, 2, 6), (5, 2, 6)), 4
#: Factor on the cost of the first in a race up to which another edit is fitted where one explains
#: all.
CLOSE = 2.0

#: An edit, and a glance at the model with it.
_Look = tuple[Insertion, Model]


class EditScreener:
    """Trials on records of one weight."""

    def __init__(self, weighed: TrialContext) -> None:
        self.weighed, self.fitter = weighed, weighed.fitter
        self._tried = TrialMemory()
        self._alone: dict[str, EventFitter] = {}

    def of(self, model: Model) -> dict[EditKey, Model]:
        """The model with every edit of the program; those in front of a race of the first by their
        glances are fitted.

        What is missing has bent the rest of the model, so that a glance at the records ranks what
        explains them among the first thirty and no higher. A sweep beside them ranks it better,
        where it shows there.
        """
        if (known := self._tried.of(model)) is not None:
            return known
        edits = insertions(model.diagram, self.weighed.kinds, self.weighed.catalogue)
        swept = self._screen_on_sweep(model, edits)
        first, *others = (self._rank_edits(model, edits, origin) for origin in self._origins(model))
        least = first[0][1].cost() - model.cost() if first else 0.0
        rivals = [
            glance for _, glance in first[:GLANCED] if glance.cost() - model.cost() <= RIVAL * least
        ]
        runners = [
            ((edit, glance), one)
            for edit, glance in first
            if glance in rivals or edit_key(edit) in swept
            for one in self._start_edit(
                model, edit, [glance.refit.values, swept.get(edit_key(edit))]
            )
        ]
        reset_implausible = [
            runner for ranked in others for runner in self._enter_edits(model, ranked[:PUT_BACK])
        ]
        models, fits = {edit_key(edit): glance for edit, glance in first}, list[EventFit]()
        front = run_rungs([*rank_entrants(runners, RACED), *reset_implausible], HEATS)
        if (
            model.is_adequate()
            and front
            and front[0][1].cost > HALF * self.weighed.prediction_cost(model)
        ):
            front = []  # nothing is clearly better than what the records allow
        for number, ((edit, glance), descent) in enumerate(front):
            lags = number >= FITS or descent.cost > CLOSE * front[0][1].cost
            if lags and any(fit.is_adequate() for fit in fits):
                break
            starts = [descent.values, *start_values(edit, [model.refit.values])]
            if (
                fit := self.fitter.fit(
                    edit.diagram, self.weighed.limits_of(glance), starts, led=False
                )
            ) is not None:
                fits.append(fit)
                fitted = replace(glance, refit=fit)
                models[edit_key(edit)] = min(
                    models.get(edit_key(edit), fitted), fitted, key=lambda one: one.refit.cost
                )
        return self._tried.store(model, models)

    def fit_from(self, model: Model, edits: Sequence[Insertion], values: Values) -> list[Model]:
        """A model with each of the first edits, fitted from values of the rest of it."""
        runners = self._enter_edits(model, self._rank_edits(model, edits, values)[:GLANCED])
        models = list[Model]()
        for (edit, glance), descent in run_rungs(rank_entrants(runners, RACED), HEATS)[:FITS]:
            fit = self.fitter.fit(
                edit.diagram, self.weighed.limits_of(glance), [descent.values], led=False
            )
            models += [] if fit is None else [replace(glance, refit=fit)]
        return models

    def _rank_edits(self, model: Model, edits: Sequence[Insertion], origin: Values) -> list[_Look]:
        """Edits of a model with a glance at each from an origin, the best first."""
        glances = [
            (edit, glance)
            for edit in edits
            if (glance := self._screen_on_worst_event(model, edit, origin)) is not None
        ]
        return sorted(glances, key=lambda pair: pair[1].refit.cost)

    def _enter_edits(
        self, model: Model, ranked: Sequence[_Look]
    ) -> list[tuple[_Look, EventDescent]]:
        """Edits of a model, each begun where a glance at it ended."""
        return [
            ((edit, glance), one)
            for edit, glance in ranked
            for one in self._start_edit(model, edit, [glance.refit.values])
        ]

    def _start_edit(
        self, model: Model, edit: Insertion, starts: Sequence[Values | None]
    ) -> list[EventDescent]:
        """An edit of a model at the best start of a race by predictions of all records; none where
        no start has an answer.
        """
        misfit = self.fitter.misfit(
            edit.diagram, self.weighed.limits_of(self.weighed.with_edit(model, edit))
        )
        return misfit.prediction.coarse.start_descents_from(
            [one for one in starts if one is not None], 1
        )

    def _screen_on_sweep(self, model: Model, edits: Sequence[Insertion]) -> dict[EditKey, Values]:
        """The edits that explain most of the sweep at a glance, with their values there; none
        without a sweep.
        """
        if (refitter := self.fitter.refitter) is None:
            return {}
        looks = [
            (one, refitter.screen(one.diagram, start_values(one, (model.refit.values, {}))))
            for one in edits
        ]
        found = sorted(
            ((one, look) for one, look in looks if look is not None), key=lambda pair: pair[1].cost
        )
        return {edit_key(one): look.values for one, look in found[:SWEPT]}

    def _screen_on_worst_event(
        self, model: Model, insertion: Insertion, origin: Values
    ) -> Model | None:
        """A model with an edit, ranked by predictions of the record that the model misses most, a
        step from an origin.

        Its cost is that of the model and the misfit of the predictions: it ranks glances, and never
        beats a fit.
        """
        changed, name = self.weighed.with_edit(model, insertion), self._worst_event(model)
        if name not in self._alone:
            self._alone[name] = self.fitter.of(select_events(self.weighed.noise, name, hold=True))
        starts = [*start_values(insertion, (origin,))]
        descent = self._alone[name].screen(
            insertion.diagram, self.weighed.limits_of(changed), starts
        )
        if descent is None:
            return None
        misfit = self.fitter.misfit(insertion.diagram, self.weighed.limits_of(changed))
        refit = replace(
            model.refit,
            values=descent.values,
            chi2=model.refit.cost + descent.cost,
            penalty=0.0,
            parameter_count=len(descent.x),
            misfit=misfit,
            diagram=insertion.diagram,
            limits=self.weighed.limits_of(changed),
            x=descent.x,
        )
        return replace(changed, refit=refit)

    def _origins(self, model: Model) -> list[Values]:
        """Where glances at edits of a model begin: where predictions lead it; and, where that is
        far from what is believed, since what is missing has bent it, at what is believed.
        """
        led, parameter_prior = (
            self.weighed.predicted_values(model),
            self.fitter.misfit(model.diagram, self.weighed.limits_of(model)).parameter_prior,
        )
        x = parameter_prior.start(led)
        return [led] if np.array_equal(parameter_prior.reset_implausible(x), x) else [led, {}]

    def _worst_event(self, model: Model) -> str:
        pairs = zip(self.weighed.noise.events.names, model.refit.residuals, strict=False)
        return max(pairs, key=lambda pair: float((np.abs(pair[1]) ** 2).mean()))[0]
