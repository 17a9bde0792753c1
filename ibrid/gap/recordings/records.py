"""Records of events, alone or beside a sweep, as a kind of `Data`: an edit is of the program, or a limit beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.recordings.event_fit import EventFit, EventFitter, without
from ibrid.gap.recordings.event_misfit import Descending
from ibrid.gap.recordings.event_noise import FITTED, NOMINAL, EventNoise
from ibrid.gap.recordings.event_places import LimitPlace, limit_places
from ibrid.gap.recordings.limit_race import ahead, in_front, led_again, race
from ibrid.gap.refitting.held_out import HeldOut
from ibrid.gap.refitting.kept import Kept
from ibrid.gap.refitting.model import Fitted, Model, Values
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.refit import Refitter
from ibrid.gap.trials.budget import Budget
from ibrid.gap.trials.data import Data
from ibrid.gap.trials.trial import explains_nearly_all, strengths, threshold
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.playback.limits import Limit
from ibrid.structure.diagrams.diagram import Diagram

#: Draws beside the nominal values, of the given model.
DRAWS = 3
#: Edits of a model of which all records are predicted: the first by a glance at one record, and the first by one at the sweep
#: beside them. Those of them that predict best race.
GLANCED, SWEPT, RACED = 32, 8, 16
#: Where what is missing has bent the model far from what is believed, the first so many by a glance from what is believed race,
#: too: of 56 edits of a grid-forming model the right one was the 44th by a glance from the bent model, and the first by that.
PUT_BACK = 8
#: Rounds of the race, steps of each, and how many go on: the right one was the fifth at its end in one of 21 drawn devices, else
#: the first. Of those at its end so many are fitted in any case, and the others while none explains the records.
HEATS, FITS = ((1, 3, 8), (3, 2, 6), (5, 2, 6)), 4
#: Where sampling leaves most of what is open: part of it beyond which a model that explains is doubted all the same, and part of
#: what that leaves that the right one leaves. Of drawn devices the right model left 0.002 of what is open at most.
WRONG, RIGHT = 0.03, 0.1
#: Kinds of limits whose first in a race is led once more.
LED_ON = 3
#: Factor on what the first of the glances leaves beyond which another one does not race: the right one left 2 times as much at
#: most in three drawn devices.
RIVAL = 6.0
#: Factor on the cost of the first in a race up to which another edit is fitted where one explains all.
CLOSE = 2.0
#: What is said of records that are the steps of a program.
IN_FIXED_STEPS = (
    "The samples are played as the steps of a program, by the trapezoidal rule; its other files want the key solver: "
    "trapezoidal."
)
#: Part of what is left on one reading of the samples that must be left on another to take that.
HALF = 0.5
#: Records from which on each is left out in turn.
FEWEST = 3

#: An edit's effect, change and place.
_Edit = tuple[str, str, str]
#: An edit, and a glance at the model with it.
_Look = tuple[Insertion, Model]
#: By what it is known what was tried on a model: its fit, and its edits.
_Key = Fitted | tuple[_Edit, ...]


class Records(Data):
    """Records and perhaps a small-signal sweep, weighed by a noise. Their rest says p, q, v: no convention is asked of them.
    No transfer at a port stands for a limit.

    refitter : of the sweep, None without one. limits : beside the given model.
    """

    noise: EventNoise  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        noise: EventNoise,
        kinds: Vocabulary,
        prior: Prior,
        catalogue: Sequence[Effect],
        seed: int,
        refitter: Refitter | None,
        limits: Sequence[Limit] = (),
        budget: Budget | None = None,
    ) -> None:
        super().__init__(budget)
        self.noise, self.kinds = noise, kinds
        self.catalogue = tuple(one for one in catalogue if refitter is not None or not one.form)
        self.fitter = EventFitter(noise, kinds, prior, refitter)
        self.limits, self.rng = tuple(limits), np.random.default_rng(seed)
        self.remarks = (IN_FIXED_STEPS,) if any(record.stepped for record in noise.events.records) else ()
        self._roughly: tuple[EventFitter, Model] | None = None
        self._small = Kept[Fitted | None]()
        self._loose = self.fitter  # by what nominal values leave open
        self.reweigh(self.fitter)

    def reweigh(self, fitter: EventFitter) -> None:
        """Weigh what follows by a fitter's noise."""
        self.noise, self.fitter = fitter.noise, fitter
        self._alone: dict[str, EventFitter] = {}
        self._fits: dict[_Key, dict[_Edit, Model]] = {}
        self._races: dict[_Key, dict[_Edit, Model]] = {}
        self._predicted: dict[Fitted, Values] = {}

    def beside(self, model: Model) -> tuple[Limit, ...]:
        """The limits of a model: those of the given one, and what its edits did to them."""
        limits = list(self.limits)
        for edit in model.edits:
            if isinstance(edit, LimitPlace) and edit.change == "add":
                limits.append(edit.limit)
            elif isinstance(edit, LimitPlace):
                limits.remove(edit.limit)
        return tuple(limits)

    def _given(self, diagram: Diagram) -> Model | None:
        """The given model from its nominal values and draws about them; beside a sweep from what that alone says, too.

        A sweep that it explains tells better than nominal values what it makes of the voltage between samples.
        """
        small = self._by_sweep(diagram)
        if small is not None and small.adequate():
            self.weigh_by(diagram, small.values)
        try:
            misfit = self.fitter.misfit(diagram, self.limits)
        except IbridError:
            return None
        middle = misfit.beliefs.start({})
        width = np.minimum(misfit.beliefs.width(middle), 0.7)
        drawn = middle + 0.5 * width * self.rng.standard_normal((DRAWS, len(middle)))
        starts: list[Values] = [{}, *(misfit.values(one) for one in np.clip(drawn, *misfit.box))]
        fit = self.fitter.fit(diagram, self.limits, starts if small is None else [*starts, small.values])
        if fit is None or not fit.adequate():
            return None if fit is None else Model(diagram, Convention(), fit)
        self._roughly = self.fitter, Model(diagram, Convention(), fit)
        self.weigh_by(diagram, fit.values, FITTED)
        return Model(diagram, Convention(), self.fitter.fit(diagram, self.limits, [fit.values], led=False) or fit)

    def roughly(self) -> Model | None:
        """The given model where it explains the records as far as nominal values tell what sampling leaves open; they are weighed
        by that again. None where it does not."""
        if self._roughly is None:
            return None
        fitter, model = self._roughly
        self.reweigh(fitter)
        return model

    def weigh_by(self, diagram: Diagram, values: Values, pulse_error: float = NOMINAL) -> None:
        """Weigh the records by what a model makes of the voltage between their samples."""
        noise = self.fitter.noise_seen(diagram, self.limits, values, pulse_error)
        self.reweigh(self.fitter.of(noise))
        if pulse_error == NOMINAL:
            self._loose = self.fitter

    def doubts(self, best: Model) -> bool:
        """Whether an answer does not explain the records as far as it tells itself what sampling leaves open; they are weighed by
        that from now on. Nominal values may make so much of the voltage between samples that nearly any answer is within it.
        """
        if not self.noise.sampled:
            return False
        before, limits = self.fitter, self.beside(best)
        self.reweigh(before.of(before.noise_seen(best.diagram, limits, best.refit.values, FITTED)))
        fit = self.fitter.fit(best.diagram, limits, [best.refit.values], led=False)
        if fit is None or fit.adequate():
            self.reweigh(before)
            return False
        return True

    def as_weighed(self, model: Model) -> Model:
        """A model as it is, by the weights of now."""
        return replace(model, refit=self.fitter.at_values(model.diagram, self.beside(model), model.refit.values))

    def rivals(self, given: Model, best: Model) -> list[Model]:
        """The given model, as it is, with each single edit begun where an answer has brought the rest of it; the best first.

        What explains nearly all has unbent the rest, so that a glance ranks what is right among the first.
        """
        given = self.as_weighed(given)
        values = best.refit.values
        places = self._limit_places(given)
        raced = race(self.fitter, places, lambda place: self.beside(self._changed(given, place)), [values])
        models = [
            replace(self._changed(given, place), refit=fit)
            for place, fit in zip(places, raced, strict=True)
            if fit is not None
        ]
        ranked = self._ranked(given, insertions(given.diagram, self.kinds, self.catalogue), values)
        runners = self._set_out(given, ranked[:GLANCED])
        for (edit, glance), descent in in_front(ahead(runners, RACED), HEATS)[:FITS]:
            fit = self.fitter.fit(edit.diagram, self.beside(glance), [descent.values], led=False)
            models += [] if fit is None else [replace(glance, refit=fit)]
        return sorted(models, key=lambda one: one.bic())

    def _by_sweep(self, diagram: Diagram) -> Fitted | None:
        """What the sweep alone says of a diagram; None without one, or without an answer."""
        refitter = self.fitter.refitter
        return None if refitter is None else self._small.of(diagram, lambda: refitter.refit(diagram, [{}], draws=16))

    def _refitted(self, model: Model, starts: Sequence[Values], *, draws: int, spread: float) -> Model | None:
        """A model fitted from starts."""
        fit = self.fitter.fit(model.diagram, self.beside(model), starts)
        return None if fit is None else replace(model, refit=fit)

    def _again(self, model: Model, starts: Sequence[Values]) -> Model:
        """A model fitted from further starts; the better of both."""
        fit = self.fitter.fit(model.diagram, self.beside(model), starts, led=False)
        return model if fit is None or fit.cost >= model.refit.cost else replace(model, refit=fit)

    def begun_from_beliefs(self, model: Model) -> Model:
        """A repaired model begun once more from what is believed, and from what was found of the rest: along what records hardly
        see, such as a scale of filter and controller, a descent from elsewhere stops anywhere."""
        prior, values = self.fitter.prior, model.refit.values
        rest = {name: value for name, value in values.items() if name not in prior}
        return self.again(model, [rest]) if prior else model

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """Limits; and all edits of the program where neither the model nor one limit alone explains the records, or nearly all
        that the model leaves: what else is missing shows beside that limit. Edits alone where the sweep already asks for one
        that explains all."""
        limits = self._limit_places(model)
        if model.adequate() and not self._may_pay(model):
            return tuple(one for one in limits if one.change != "add")
        if not self._doubtful(model):
            return limits
        edits = tuple(insertions(model.diagram, self.kinds, self.catalogue))
        if self._refuted_by_sweep(model) and any(self._explains(model, one) for one in self._fitted(model).values()):
            return edits
        if any(self._explains(model, one) for one in self._raced(model).values()):
            return limits
        return (*limits, *edits)

    def _refuted_by_sweep(self, model: Model) -> bool:
        """Whether the sweep beside the records, which shows no limit, is not explained."""
        small = self._by_sweep(model.diagram)
        return small is not None and not small.adequate()

    def would_try(self, model: Model, edit: Insertion | Convention) -> bool:
        """Edits of the program are for records that nothing else explains: small numbers then stand for errors of simulation."""
        return isinstance(edit, LimitPlace) or self._doubtful(model)

    def pays(self, before: Model, after: Model) -> bool:
        """Beside a model that the records allow as far as sampling tells, an edit of the program pays that takes nearly all of
        what it leaves: what is right does, and what takes a part is bent to errors of the voltage."""
        allowed = self.noise.sampled and before.adequate()
        of_program = bool(after.edits) and not isinstance(after.edits[-1], LimitPlace)
        return not (allowed and of_program) or self._explains(before, after)

    def _explains(self, before: Model, after: Model) -> bool:
        """Whether an edit explains the records, or nearly all that a model leaves."""
        if before.adequate():
            return after.cost() <= RIGHT * before.cost()
        return after.adequate() or explains_nearly_all(before, after)

    def _doubtful(self, model: Model) -> bool:
        """Whether a model does not explain the records; or, of the given one where sampling leaves much open, leaves as much as
        something wrong does: how much is open was estimated, and what is right leaves a hundredth of it."""
        doubted = self.noise.sampled and not model.edits and self._may_pay(model)
        return not model.adequate() or (doubted and model.cost() > WRONG * model.refit.dof)

    def _may_pay(self, model: Model) -> bool:
        """Whether a model leaves so much that a further number could pay."""
        return model.cost() >= threshold(1, len(self._limit_places(model)))

    def _limit_places(self, model: Model) -> tuple[LimitPlace, ...]:
        beside = self.beside(model)
        return tuple(limit_places(model.diagram, self.kinds, beside, self.noise.events, given=self.limits))

    def _raced(self, model: Model) -> Mapping[_Edit, Model]:
        """The model with every limit that it lacks, or without one that it has, fitted together."""
        if (known := _known(self._races, model)) is not None:
            return known
        places, led = self._limit_places(model), self._doubtful(model)
        small = None if model.adequate() else self._by_sweep(model.diagram)
        first: Values = {} if small is None or not small.adequate() else small.values
        origins = [first, model.refit.values, self._led(model)] if led else [model.refit.values]
        fits = race(self.fitter, places, lambda one: self.beside(self._changed(model, one)), origins, led=led)
        raced = {
            _edit(place): replace(self._changed(model, place), refit=fit)
            for place, fit in zip(places, fits, strict=True)
            if fit is not None
        }
        raced |= self._led_on(model, raced)
        for edit, one in self._races.get(_edits(model), {}).items():  # of a model that has a better fit since
            raced[edit] = min(raced.get(edit, one), one, key=lambda each: each.refit.cost)
        self._races[model.refit] = self._races[_edits(model)] = raced
        return raced

    def _led_on(self, model: Model, raced: Mapping[_Edit, Model]) -> dict[_Edit, Model]:
        """The first of each kind of limit in a race led once more, where they are near each other, take much of what the model
        leaves and do not explain all."""
        firsts: dict[str, tuple[_Edit, Model]] = {}
        for edit, one in sorted(raced.items(), key=lambda pair: pair[1].refit.cost):
            firsts.setdefault(edit[0], (edit, one))
        least = min((one.refit.cost for _, one in firsts.values()), default=np.inf)
        most = min(RIVAL * least, HALF * model.refit.cost)
        near = [pair for pair in firsts.values() if pair[1].refit.cost < most][:LED_ON]
        if not near or self._explains(model, near[0][1]):
            return {}
        return {
            edit: replace(one, refit=led_again(one.refit, self.fitter, self._loose, model.refit.values))
            for edit, one in near
        }

    def _edited(self, model: Model, insertion: Insertion, *, quick: Sequence[Values]) -> Model | None:
        """A model with an edit, tried with all others of its kind at once; as a glance leaves it where it lags behind, since a
        fit takes seconds."""
        tried = self._raced(model) if isinstance(insertion, LimitPlace) else self._fitted(model)
        return tried.get(_edit(insertion))

    def _glanced(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """The same: what is tried at once needs no further glance."""
        return self._edited(model, insertion, quick=())

    def _fitted(self, model: Model) -> dict[_Edit, Model]:
        """The model with every edit of the program; those in front of a race of the first by their glances are fitted.

        What is missing has bent the rest of the model, so that a glance at the records ranks what explains them among the first
        thirty and no higher. A sweep beside them ranks it better, where it shows there.
        """
        if (known := _known(self._fits, model)) is not None:
            return known
        edits = insertions(model.diagram, self.kinds, self.catalogue)
        swept = self._swept(model, edits)
        first, *others = (self._ranked(model, edits, origin) for origin in self._origins(model))
        least = first[0][1].cost() - model.cost() if first else 0.0
        rivals = [glance for _, glance in first[:GLANCED] if glance.cost() - model.cost() <= RIVAL * least]
        runners = [
            ((edit, glance), one)
            for edit, glance in first
            if glance in rivals or _edit(edit) in swept
            for one in self._begun(model, edit, [glance.refit.values, swept.get(_edit(edit))])
        ]
        put_back = [runner for ranked in others for runner in self._set_out(model, ranked[:PUT_BACK])]
        models, fits = {_edit(edit): glance for edit, glance in first}, list[EventFit]()
        front = in_front([*ahead(runners, RACED), *put_back], HEATS)
        if model.adequate() and front and front[0][1].cost > HALF * self._predicted_cost(model):
            front = []  # nothing is clearly better than what the records allow
        for number, ((edit, glance), descent) in enumerate(front):
            lags = number >= FITS or descent.cost > CLOSE * front[0][1].cost
            if lags and any(fit.adequate() for fit in fits):
                break
            starts = [descent.values, *strengths(edit, [model.refit.values])]
            if (fit := self.fitter.fit(edit.diagram, self.beside(glance), starts, led=False)) is not None:
                fits.append(fit)
                fitted = replace(glance, refit=fit)
                models[_edit(edit)] = min(models.get(_edit(edit), fitted), fitted, key=lambda one: one.refit.cost)
        self._fits[model.refit] = self._fits[_edits(model)] = models
        return models

    def _predicted_cost(self, model: Model) -> float:
        """Of predictions of all records by a model, where they lead it."""
        misfit = self.fitter.misfit(model.diagram, self.beside(model)).predicting.coarse
        return min((one.cost for one in misfit.best_of([self._led(model)], 1)), default=np.inf)

    def _ranked(self, model: Model, edits: Sequence[Insertion], origin: Values) -> list[_Look]:
        """Edits of a model with a glance at each from an origin, the best first."""
        glances = [(edit, glance) for edit in edits if (glance := self._glance(model, edit, origin)) is not None]
        return sorted(glances, key=lambda pair: pair[1].refit.cost)

    def _set_out(self, model: Model, ranked: Sequence[_Look]) -> list[tuple[_Look, Descending]]:
        """Edits of a model, each begun where a glance at it ended."""
        return [
            ((edit, glance), one) for edit, glance in ranked for one in self._begun(model, edit, [glance.refit.values])
        ]

    def _begun(self, model: Model, edit: Insertion, starts: Sequence[Values | None]) -> list[Descending]:
        """An edit of a model at the best start of a race by predictions of all records; none where no start has an answer."""
        misfit = self.fitter.misfit(edit.diagram, self.beside(self._changed(model, edit)))
        return misfit.predicting.coarse.best_of([one for one in starts if one is not None], 1)

    def _swept(self, model: Model, edits: Sequence[Insertion]) -> dict[_Edit, Values]:
        """The edits that explain most of the sweep at a glance, with their values there; none without a sweep."""
        if (refitter := self.fitter.refitter) is None:
            return {}
        looks = [(one, refitter.glance(one.diagram, strengths(one, (model.refit.values, {})))) for one in edits]
        found = sorted(((one, look) for one, look in looks if look is not None), key=lambda pair: pair[1].cost)
        return {_edit(one): look.values for one, look in found[:SWEPT]}

    def _glance(self, model: Model, insertion: Insertion, origin: Values) -> Model | None:
        """A model with an edit, ranked by predictions of the record that the model misses most, a step from an origin.

        Its cost is that of the model and the misfit of the predictions: it ranks glances, and never beats a fit.
        """
        changed, name = self._changed(model, insertion), self._worst(model)
        if name not in self._alone:
            self._alone[name] = self.fitter.of(without(self.noise, name, hold=True))
        starts = [*strengths(insertion, (origin,))]
        descent = self._alone[name].glance(insertion.diagram, self.beside(changed), starts)
        if descent is None:
            return None
        misfit = self.fitter.misfit(insertion.diagram, self.beside(changed))
        refit = replace(
            model.refit, values=descent.values, chi2=model.refit.cost + descent.cost, penalty=0.0, free=len(descent.x),
            misfit=misfit, diagram=insertion.diagram, limits=self.beside(changed), x=descent.x,
        )  # fmt: skip
        return replace(changed, refit=refit)

    def _changed(self, model: Model, insertion: Insertion) -> Model:
        return replace(model, diagram=insertion.diagram, edits=(*model.edits, insertion))

    def _led(self, model: Model) -> Values:
        if not self._doubtful(model):
            return model.refit.values
        if model.refit not in self._predicted:
            led = self.fitter.predicted(model.diagram, self.beside(model), [model.refit.values, {}])
            self._predicted[model.refit] = led
        return self._predicted[model.refit]

    def _origins(self, model: Model) -> list[Values]:
        """Where glances at edits of a model begin: where predictions lead it; and, where that is far from what is believed, since
        what is missing has bent it, at what is believed."""
        led, beliefs = self._led(model), self.fitter.misfit(model.diagram, self.beside(model)).beliefs
        x = beliefs.start(led)
        return [led] if np.array_equal(beliefs.put_back(x), x) else [led, {}]

    def _worst(self, model: Model) -> str:
        pairs = zip(self.noise.events.names, model.refit.residuals, strict=False)
        return max(pairs, key=lambda pair: float((np.abs(pair[1]) ** 2).mean()))[0]

    def answers_better(self, models: Sequence[Model], other: "Records") -> tuple[bool, list[Model]]:
        """Whether models of another reading of the same samples leave less than `HALF` here of what they leave there, the best of
        each, weights aside; and those models, begun again from where they fit here, so that no valley decides."""
        fits = [self.fitter.fit(one.diagram, self.beside(one), [one.refit.values]) for one in models]
        left = min((one.misfit.left(one.x) for one in fits if one is not None), default=np.inf)
        if left >= HALF * _left(models):
            return False, [*models]
        there = [one if fit is None else other.again(one, [fit.values]) for one, fit in zip(models, fits, strict=True)]
        return left < HALF * _left(there), there

    def stable(self, model: Model) -> bool:
        """True for a model whose simulation stays in every record."""
        return bool(np.isfinite(model.refit.chi2))

    def held_out(self, model: Model) -> HeldOut | None:
        """Each record predicted from the others, where there are enough."""
        names, squares = self.noise.events.names, []
        if len(names) < FEWEST or not isinstance(model.refit, EventFit):
            return None
        for name in names:
            others = self.fitter.of(without(self.noise, name))
            fit = others.fit(model.diagram, self.beside(model), [model.refit.values], led=False)
            if fit is None:
                return HeldOut(None, None, None)
            left = self.fitter.of(without(self.noise, name, hold=True))
            misfit = left.misfit(model.diagram, self.beside(model))
            squares.append(float(np.mean(misfit.played(fit.x[None])[0] ** 2)))
        found = float(np.sqrt(np.mean(squares)))
        return HeldOut(None, None, found if np.isfinite(found) else None)


def _left(models: Sequence[Model]) -> float:
    """The least norm of what models leave of the samples."""
    return min(one.refit.misfit.left(one.refit.x) for one in models)


def _edit(insertion: Insertion) -> _Edit:
    return insertion.effect, insertion.change, insertion.where


def _edits(model: Model) -> tuple[_Edit, ...]:
    return tuple(_edit(one) for one in model.edits if isinstance(one, Insertion))


def _known(tried: Mapping[_Key, dict[_Edit, Model]], model: Model) -> dict[_Edit, Model] | None:
    """What was tried on a model; where that explains all, also on another fit with the same edits, since little differs."""
    known = tried.get(model.refit)
    return tried.get(_edits(model)) if known is None and model.adequate() else known
