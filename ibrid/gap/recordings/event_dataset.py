"""Recordings, alone or with a sweep, as a dataset of the gap workflow.

An edit changes the program, or adds or removes a limit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.recordings.edit_fitter import EditFitter
from ibrid.gap.recordings.event_fitter import EventFit, EventFitter, select_events
from ibrid.gap.recordings.event_misfit import EventMisfit
from ibrid.gap.recordings.event_noise import FITTED_PULSE_ERROR, NOMINAL_PULSE_ERROR, EventNoise
from ibrid.gap.recordings.limit_edits import LimitEdit
from ibrid.gap.recordings.limit_fitter import LimitFitter
from ibrid.gap.recordings.settings import SCREENING
from ibrid.gap.recordings.trial_context import EditKey, TrialContext, edit_key
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

#: Random starts of the given model beside the nominal values; they are sampled within this part of
#: the prior's standard deviations, which count as at most so much in search coordinates.
DRAWS = 3
SPREAD = 0.5
WIDEST = 0.7
#: Remark on records that are the steps of a program.
IN_FIXED_STEPS = (
    "The samples are played as the steps of a program, by the trapezoidal rule; its other files "
    "want the key solver: "
    "trapezoidal."
)
#: Records from which on each is held out in turn.
LEAST_RECORDS = 3


class EventDataset(Dataset):
    """Recordings, and perhaps a small-signal sweep, weighted by their noise.

    Their steady state gives p, q and v, so that no convention is in doubt. There is no port map: no
    linear transfer function stands for a limit.

    Parameters
    ----------
    noise : EventNoise
        Of the recordings; holds these.
    kinds : Vocabulary
        Module kinds that edits may use.
    prior : Prior
        Nominal values with tolerances.
    catalogue : sequence of Effect
        Effects that may be missing in the program.
    seed : int
        Of the random starts.
    sweep_fitter : SweepFitter or None
        Of the sweep; None without one.
    limits : sequence of Limit
        Of the given model.
    budget : Budget
        Of the search.
    """

    noise: EventNoise  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        noise: EventNoise,
        kinds: Vocabulary,
        prior: Prior,
        catalogue: Sequence[Effect],
        seed: int,
        sweep_fitter: SweepFitter | None,
        limits: Sequence[Limit] = (),
        budget: Budget | None = None,
    ) -> None:
        super().__init__(budget)
        self.kinds = kinds
        self.limits = tuple(limits)
        has_sweep = sweep_fitter is not None
        self.catalogue = tuple(effect for effect in catalogue if has_sweep or not effect.form)
        self.rng = np.random.default_rng(seed)
        is_stepped = any(record.stepped for record in noise.events.records)
        self.remarks = (IN_FIXED_STEPS,) if is_stepped else ()
        # the given model where nominal noise is enough to explain the data
        self._nominal_fit: tuple[EventFitter, Model] | None = None
        fitter = EventFitter(noise, kinds, prior, sweep_fitter)
        self._context = TrialContext(fitter, kinds, self.catalogue, self.limits, DiagramCache())
        self._nominal_fitter = fitter
        self.use_noise_of(fitter)

    # --- the noise

    def use_noise_of(self, fitter: EventFitter) -> None:
        """Weight the data by a fitter's noise from now on."""
        self.noise = fitter.noise
        self.fitter = fitter
        self._context = self._context.with_fitter(fitter)
        self._limit_fitter = LimitFitter(self._context, self._nominal_fitter)
        self._edit_fitter = EditFitter(self._context)

    def estimate_sampling_noise(
        self, diagram: Diagram, values: Values, pulse_error: float = NOMINAL_PULSE_ERROR
    ) -> None:
        """Weight the recordings by what a model makes of the voltage between their samples."""
        noise = self.fitter.noise_for_model(diagram, self.limits, values, pulse_error)
        fitter = self.fitter.with_noise(noise)
        if pulse_error == NOMINAL_PULSE_ERROR:
            self._nominal_fitter = fitter
        self.use_noise_of(fitter)

    def fall_back_to_nominal_noise(self) -> Model | None:
        """Return the given model where it explains the recordings by the noise of nominal values.

        They are weighted by that again; unchanged and None where it does not.
        """
        if self._nominal_fit is None:
            return None
        fitter, model = self._nominal_fit
        self.use_noise_of(fitter)
        return model

    def is_refuted_by_own_noise(self, best: Model) -> bool:
        """Whether a model fails to explain the recordings by the noise that it implies itself.

        They are weighted by that from now on where it fails. Nominal values may imply so much noise
        by the voltage between samples that nearly any model is within it.
        """
        if not self.noise.sampled:
            return False
        before = self.fitter
        limits = self.limits_of(best)
        noise = before.noise_for_model(best.diagram, limits, best.refit.values, FITTED_PULSE_ERROR)
        self.use_noise_of(before.with_noise(noise))
        fit = self.fitter.fit(best.diagram, limits, [best.refit.values], predict_first=False)
        if fit is None or fit.is_adequate():
            self.use_noise_of(before)
            return False
        return True

    # --- fits

    def limits_of(self, model: Model) -> tuple[Limit, ...]:
        """Return the limits of a model: those of the given one as its edits changed them."""
        return self._context.limits_of(model)

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """Fit the given model from nominal values, random starts and the fit to the sweep alone.

        A model that explains the sweep estimates what is unknown of the voltage better than nominal
        values do.
        """
        sweep_fit = self._context.fit_sweep(diagram)
        if sweep_fit is not None and sweep_fit.is_adequate():
            self.estimate_sampling_noise(diagram, sweep_fit.values)
        try:
            misfit = self.fitter.misfit(diagram, self.limits)
        except IbridError:
            return None
        starts = self._sample_starts(misfit)
        if sweep_fit is not None:
            starts.append(sweep_fit.values)
        fit = self.fitter.fit(diagram, self.limits, starts)
        if fit is None:
            return None
        model = Model(diagram, Convention(), fit)
        if not fit.is_adequate():
            return model
        self._nominal_fit = self.fitter, model
        self.estimate_sampling_noise(diagram, fit.values, FITTED_PULSE_ERROR)
        refit = self.fitter.fit(diagram, self.limits, [fit.values], predict_first=False)
        return Model(diagram, Convention(), refit or fit)

    def _sample_starts(self, misfit: EventMisfit) -> list[Values]:
        """Return the nominal values, and random starts around them."""
        prior = misfit.parameter_prior
        nominal = prior.start({})
        width = np.minimum(prior.width(nominal), WIDEST)
        samples = nominal + SPREAD * width * self.rng.standard_normal((DRAWS, len(nominal)))
        return [{}, *(misfit.values(x) for x in np.clip(samples, *misfit.box))]

    def reevaluate(self, model: Model) -> Model:
        """Evaluate a model at its values in the present weights."""
        refit = self.fitter.evaluate_values(
            model.diagram, self.limits_of(model), model.refit.values
        )
        return replace(model, refit=refit)

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """Refit a model from starts."""
        fit = self.fitter.fit(model.diagram, self.limits_of(model), starts)
        return None if fit is None else replace(model, refit=fit)

    def _refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """Refit a model from further starts and return the better fit."""
        fit = self.fitter.fit(model.diagram, self.limits_of(model), starts, predict_first=False)
        return model if fit is None or fit.cost >= model.refit.cost else replace(model, refit=fit)

    def refit_from_prior(self, model: Model) -> Model:
        """Refit a repaired model from the nominal values, and return the better fit.

        Parameters without a nominal value keep their fitted ones. Along directions that recordings
        hardly determine, such as a common scale of filter and controller, a descent stops anywhere.
        """
        prior = self.fitter.prior
        if not prior:
            return model
        values = model.refit.values
        start = {name: value for name, value in values.items() if name not in prior}
        return self.refit_from(model, [start])

    # --- edits

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """List the edits that are tried on a model.

        Limits always. Edits of the program where the model is doubtful and no single limit explains
        the recordings, or nearly all that the model leaves: what else is missing is visible beside
        that limit. Edits of the program alone where the sweep refutes the model and one of them
        explains everything.
        """
        context = self._context
        limit_edits = context.list_limit_edits(model)
        if model.is_adequate() and not context.can_gain(model):
            return tuple(edit for edit in limit_edits if edit.change != "add")
        if not context.is_doubtful(model):
            return limit_edits
        program_edits = insertions(model.diagram, self.kinds, self.catalogue)
        if context.is_refuted_by_sweep(model):
            trials = self._edit_fitter.fit_all(model)
            if self._has_explaining(model, trials):
                return tuple(program_edits)
        if self._has_explaining(model, self._limit_fitter.fit_all(model)):
            return limit_edits
        return (*limit_edits, *program_edits)

    def _has_explaining(self, model: Model, trials: Mapping[EditKey, Model]) -> bool:
        """Whether one of several edits alone explains what a model leaves."""
        return any(self._context.explains(model, trial) for trial in trials.values())

    def list_rivals(self, given: Model, best: Model) -> list[Model]:
        """Return the given model with each single edit, lowest BIC first.

        Fitted from the values of the best model for the rest of it. That explains nearly all, so
        that its other parameters are hardly biased and screening ranks the right edit among the
        first.
        """
        given = self.reevaluate(given)
        values = best.refit.values
        edits = insertions(given.diagram, self.kinds, self.catalogue)
        with_limits = self._limit_fitter.screen_from(given, [values])
        with_edits = self._edit_fitter.fit_from(given, edits, values)
        return sorted([*with_limits.values(), *with_edits], key=lambda rival: rival.bic())

    def would_try_edit(self, model: Model, edit: Insertion | Convention) -> bool:
        """Whether an edit is among those that are tried: of the program on doubtful models only.

        Small corrections of the program would otherwise stand for errors of the simulation.
        """
        return isinstance(edit, LimitEdit) or self._context.is_doubtful(model)

    def accepts_edit(self, before: Model, after: Model) -> bool:
        """Whether a significant edit is accepted.

        On a model that is adequate because the voltage between samples is unknown, an edit of the
        program must take nearly all of what that leaves, as the right one does; an edit that takes
        a part may be fitted to errors of the voltage.
        """
        is_program_edit = bool(after.edits) and not isinstance(after.edits[-1], LimitEdit)
        if self.noise.sampled and before.is_adequate() and is_program_edit:
            return self._context.explains(before, after)
        return True

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """Return a model with an edit, which is fitted together with all others of its kind.

        As screening leaves it where others lead, since a fit takes seconds.
        """
        if isinstance(insertion, LimitEdit):
            trials = self._limit_fitter.fit_all(model)
        else:
            trials = self._edit_fitter.fit_all(model)
        return trials.get(edit_key(insertion))

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """Return the same as `_fit_edit`, where all edits have been screened."""
        return self._fit_edit(model, insertion, quick=())

    # --- comparison and validation

    def explains_better_than(
        self, models: Sequence[Model], other: "EventDataset"
    ) -> tuple[bool, list[Model]]:
        """Compare how two readings of the same samples are explained by the same models.

        The residuals are compared without weights. Not done where the noise of the current alone
        leaves half of the other reading's residual.

        Parameters
        ----------
        models : sequence of Model
            As fitted to the other reading.

        Returns
        -------
        tuple of bool and list of Model
            Whether the best residual here is below `SCREENING.clear_gain` of the best there; and
            the models as fitted there, from the values here, too, so that no local minimum decides.
        """
        least_norm = _least_residual_norm(models)
        if SCREENING.clear_gain * least_norm <= self.noise.norm_of_current:
            return False, [*models]
        fits = [
            self.fitter.fit(model.diagram, self.limits_of(model), [model.refit.values])
            for model in models
        ]
        norms = [fit.misfit.residual_norm(fit.x) for fit in fits if fit is not None]
        norm_here = min(norms, default=np.inf)
        if norm_here >= SCREENING.clear_gain * least_norm:
            return False, [*models]
        refitted = [
            model if fit is None else other.refit_from(model, [fit.values])
            for model, fit in zip(models, fits, strict=True)
        ]
        is_better = norm_here < SCREENING.clear_gain * _least_residual_norm(refitted)
        return is_better, refitted

    def is_stable(self, model: Model) -> bool:
        """Whether the simulation of a model diverges in no record."""
        return bool(np.isfinite(model.refit.chi2))

    def cross_validate(self, model: Model) -> ValidationErrors | None:
        """Refit a model without each record in turn and return its error there.

        None with fewer than `LEAST_RECORDS` records.
        """
        names = self.noise.events.names
        if len(names) < LEAST_RECORDS or not isinstance(model.refit, EventFit):
            return None
        limits = self.limits_of(model)
        start = model.refit.values
        squares: list[float] = []
        for name in names:
            training = self.fitter.with_noise(select_events(self.noise, name))
            fit = training.fit(model.diagram, limits, [start], predict_first=False)
            if fit is None:
                return ValidationErrors(None, None, None)
            held_out = self.fitter.with_noise(select_events(self.noise, name, hold=True))
            misfit = held_out.misfit(model.diagram, limits)
            squares.append(float(np.mean(misfit.whitened_residuals(fit.x[None])[0] ** 2)))
        error = float(np.sqrt(np.mean(squares)))
        return ValidationErrors(None, None, error if np.isfinite(error) else None)


def _least_residual_norm(models: Sequence[Model]) -> float:
    """Return the least unweighted residual norm of several models, per unit."""
    return min(model.refit.misfit.residual_norm(model.refit.x) for model in models)
