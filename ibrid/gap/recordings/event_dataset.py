"""Event records, alone or with a sweep, as a dataset: an edit changes the program, or adds or
removes a limit.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.recordings.edit_screener import EditScreener
from ibrid.gap.recordings.event_fitter import EventFit, EventFitter, select_events
from ibrid.gap.recordings.event_noise import FITTED, NOMINAL, EventNoise
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.recordings.limit_screener import LimitScreener
from ibrid.gap.recordings.trial_context import HALF, TrialContext, edit_key
from ibrid.gap.refitting.cross_validation import ValidationErrors
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import Model, Values
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.playback.limits import Limit
from ibrid.structure.diagrams.diagram import Diagram

#: Draws beside the nominal values, of the given model.
DRAWS = 3
#: What is said of records that are the steps of a program.
IN_FIXED_STEPS = (
    "The samples are played as the steps of a program, by the trapezoidal rule; its other files "
    "want the key solver: "
    "trapezoidal."
)
#: Records from which on each is left out in turn.
FEWEST = 3


class EventDataset(Dataset):
    """Records and perhaps a small-signal sweep, weighed by a noise. Their rest says p, q, v: no
    convention is asked of them. No transfer at a port stands for a limit.

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
        refitter: SweepFitter | None,
        limits: Sequence[Limit] = (),
        budget: Budget | None = None,
    ) -> None:
        super().__init__(budget)
        self.kinds, self.limits = kinds, tuple(limits)
        self.catalogue = tuple(one for one in catalogue if refitter is not None or not one.form)
        self.rng = np.random.default_rng(seed)
        self.remarks = (
            (IN_FIXED_STEPS,) if any(record.stepped for record in noise.events.records) else ()
        )
        self._roughly: tuple[EventFitter, Model] | None = None
        fitter = EventFitter(noise, kinds, prior, refitter)
        self._weighed = TrialContext(fitter, kinds, self.catalogue, self.limits, DiagramCache())
        self._loose = fitter  # by what nominal values leave open
        self.use_noise_of(fitter)

    def use_noise_of(self, fitter: EventFitter) -> None:
        """Weigh what follows by a fitter's noise."""
        self.noise, self.fitter = fitter.noise, fitter
        self._weighed = self._weighed.with_fitter(fitter)
        self._limits, self._edits = (
            LimitScreener(self._weighed, self._loose),
            EditScreener(self._weighed),
        )

    def limits_of(self, model: Model) -> tuple[Limit, ...]:
        """The limits of a model: those of the given one, and what its edits did to them."""
        return self._weighed.limits_of(model)

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """The given model from its nominal values and draws about them; beside a sweep from what
        that alone says, too.

        A sweep that it explains tells better than nominal values what it makes of the voltage
        between samples.
        """
        small = self._weighed.sweep_fit(diagram)
        if small is not None and small.is_adequate():
            self.estimate_sampling_noise(diagram, small.values)
        try:
            misfit = self.fitter.misfit(diagram, self.limits)
        except IbridError:
            return None
        middle = misfit.parameter_prior.start({})
        width = np.minimum(misfit.parameter_prior.width(middle), 0.7)
        drawn = middle + 0.5 * width * self.rng.standard_normal((DRAWS, len(middle)))
        starts: list[Values] = [{}, *(misfit.values(one) for one in np.clip(drawn, *misfit.box))]
        fit = self.fitter.fit(
            diagram, self.limits, starts if small is None else [*starts, small.values]
        )
        if fit is None or not fit.is_adequate():
            return None if fit is None else Model(diagram, Convention(), fit)
        self._roughly = self.fitter, Model(diagram, Convention(), fit)
        self.estimate_sampling_noise(diagram, fit.values, FITTED)
        return Model(
            diagram,
            Convention(),
            self.fitter.fit(diagram, self.limits, [fit.values], led=False) or fit,
        )

    def fall_back_to_nominal_noise(self) -> Model | None:
        """The given model where it explains the records as far as nominal values tell what sampling
        leaves open; they are weighed by that again. None where it does not.
        """
        if self._roughly is None:
            return None
        fitter, model = self._roughly
        self.use_noise_of(fitter)
        return model

    def estimate_sampling_noise(
        self, diagram: Diagram, values: Values, pulse_error: float = NOMINAL
    ) -> None:
        """Weigh the records by what a model makes of the voltage between their samples."""
        fitter = self.fitter.of(
            self.fitter.noise_for_model(diagram, self.limits, values, pulse_error)
        )
        self._loose = fitter if pulse_error == NOMINAL else self._loose
        self.use_noise_of(fitter)

    def is_refuted_by_own_noise(self, best: Model) -> bool:
        """Whether an answer does not explain the records as far as it tells itself what sampling
        leaves open; they are weighed by that from now on. Nominal values may make so much of the
        voltage between samples that nearly any answer is within it.
        """
        if not self.noise.sampled:
            return False
        before, limits = self.fitter, self.limits_of(best)
        self.use_noise_of(
            before.of(before.noise_for_model(best.diagram, limits, best.refit.values, FITTED))
        )
        fit = self.fitter.fit(best.diagram, limits, [best.refit.values], led=False)
        if fit is None or fit.is_adequate():
            self.use_noise_of(before)
            return False
        return True

    def reevaluate(self, model: Model) -> Model:
        """A model as it is, by the weights of now."""
        return replace(
            model,
            refit=self.fitter.evaluate_values(
                model.diagram, self.limits_of(model), model.refit.values
            ),
        )

    def rivals(self, given: Model, best: Model) -> list[Model]:
        """The given model, as it is, with each single edit begun where an answer has brought the
        rest of it; the best first.

        What explains nearly all has unbent the rest, so that a glance ranks what is right among the
        first.
        """
        given, values = self.reevaluate(given), best.refit.values
        edits = insertions(given.diagram, self.kinds, self.catalogue)
        screened = self._limits.screen_from(given, [values])
        models = [*screened.values(), *self._edits.fit_from(given, edits, values)]
        return sorted(models, key=lambda one: one.bic())

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """A model fitted from starts."""
        fit = self.fitter.fit(model.diagram, self.limits_of(model), starts)
        return None if fit is None else replace(model, refit=fit)

    def _refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """A model fitted from further starts; the better of both."""
        fit = self.fitter.fit(model.diagram, self.limits_of(model), starts, led=False)
        return model if fit is None or fit.cost >= model.refit.cost else replace(model, refit=fit)

    def refit_from_prior(self, model: Model) -> Model:
        """A repaired model begun once more from what is believed, and from what was found of the
        rest: along what records hardly see, such as a scale of filter and controller, a descent
        from elsewhere stops anywhere.
        """
        prior, values = self.fitter.prior, model.refit.values
        rest = {name: value for name, value in values.items() if name not in prior}
        return self.refit_from(model, [rest]) if prior else model

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """Limits; and all edits of the program where neither the model nor one limit alone explains
        the records, or nearly all that the model leaves: what else is missing shows beside that
        limit. Edits alone where the sweep already asks for one that explains all.
        """
        weighed = self._weighed
        limits = weighed.list_limit_edits(model)
        if model.is_adequate() and not weighed.may_pay(model):
            return tuple(one for one in limits if one.change != "add")
        if not weighed.is_doubtful(model):
            return limits
        edits = insertions(model.diagram, self.kinds, self.catalogue)
        if weighed.is_refuted_by_sweep(model) and self._has_explaining_edit(model, self._edits):
            return tuple(edits)
        if self._has_explaining_edit(model, self._limits):
            return limits
        return (*limits, *edits)

    def _has_explaining_edit(self, model: Model, trials: LimitScreener | EditScreener) -> bool:
        """Whether one edit alone explains what a model leaves."""
        return any(self._weighed.explains(model, one) for one in trials.of(model).values())

    def would_try_edit(self, model: Model, edit: Insertion | Convention) -> bool:
        """Edits of the program are for records that nothing else explains: small numbers then stand
        for errors of simulation.
        """
        return isinstance(edit, LimitEdit) or self._weighed.is_doubtful(model)

    def accepts_edit(self, before: Model, after: Model) -> bool:
        """Beside a model that the records allow as far as sampling tells, an edit of the program
        pays that takes nearly all of what it leaves: what is right does, and what takes a part is
        bent to errors of the voltage.
        """
        allowed = self.noise.sampled and before.is_adequate()
        of_program = bool(after.edits) and not isinstance(after.edits[-1], LimitEdit)
        return not (allowed and of_program) or self._weighed.explains(before, after)

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """A model with an edit, tried with all others of its kind at once; as a glance leaves it
        where it lags behind, since a fit takes seconds.
        """
        trials = self._limits if isinstance(insertion, LimitEdit) else self._edits
        return trials.of(model).get(edit_key(insertion))

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """The same: what is tried at once needs no further glance."""
        return self._fit_edit(model, insertion, quick=())

    def explains_better_than(
        self, models: Sequence[Model], other: "EventDataset"
    ) -> tuple[bool, list[Model]]:
        """Whether models of another reading of the same samples leave less than `HALF` here of what
        they leave there, the best of each, weights aside; and those models, begun again from where
        they fit here, so that no valley decides. Where the noise of the current alone leaves half
        of that, no reading is asked.
        """
        if HALF * _least_residual_norm(models) <= self.noise.norm_of_current:
            return False, [*models]
        fits = [
            self.fitter.fit(one.diagram, self.limits_of(one), [one.refit.values]) for one in models
        ]
        left = min(
            (one.misfit.residual_norm(one.x) for one in fits if one is not None), default=np.inf
        )
        if left >= HALF * _least_residual_norm(models):
            return False, [*models]
        there = [
            one if fit is None else other.refit_from(one, [fit.values])
            for one, fit in zip(models, fits, strict=True)
        ]
        return left < HALF * _least_residual_norm(there), there

    def is_stable(self, model: Model) -> bool:
        """True for a model whose simulation stays in every record."""
        return bool(np.isfinite(model.refit.chi2))

    def cross_validate(self, model: Model) -> ValidationErrors | None:
        """Each record predicted from the others, where there are enough."""
        names, squares = self.noise.events.names, []
        if len(names) < FEWEST or not isinstance(model.refit, EventFit):
            return None
        for name in names:
            others = self.fitter.of(select_events(self.noise, name))
            fit = others.fit(model.diagram, self.limits_of(model), [model.refit.values], led=False)
            if fit is None:
                return ValidationErrors(None, None, None)
            left = self.fitter.of(select_events(self.noise, name, hold=True))
            misfit = left.misfit(model.diagram, self.limits_of(model))
            squares.append(float(np.mean(misfit.whitened_residuals(fit.x[None])[0] ** 2)))
        found = float(np.sqrt(np.mean(squares)))
        return ValidationErrors(None, None, found if np.isfinite(found) else None)


def _least_residual_norm(models: Sequence[Model]) -> float:
    """The least norm of what models leave of the samples."""
    return min(one.refit.misfit.residual_norm(one.refit.x) for one in models)
