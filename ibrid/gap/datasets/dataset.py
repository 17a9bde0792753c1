"""The interface of a kind of measured data in which a gap is searched.

`workflow` and `repair` are the same for all kinds: fit the given model, locate the misfit, fit
every edit, rank, and go on from the best. A subclass of `Dataset` does the fits for one kind:

- `SweepDataset`: small-signal sweeps. Edits are those of control practice, and other conventions of
  the data.
- `AmplitudeDataset`: sweeps at several injection amplitudes. Edits are nonlinearities at ports of
  the linear model.
- `EventDataset`: recordings of events, alone or with a sweep; chi2 is the sum over both. Edits are
  limits beside the program, and those of control practice; there is no port map.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from ibrid.gap.budget import Budget
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.cross_validation import ValidationErrors
from ibrid.gap.refitting.model import Model, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

#: Spread of random starts, in standard deviations of the prior.
SPREAD = 0.7


class Dataset(ABC):
    """One kind of measured data, to which models and their edits are fitted.

    Attributes
    ----------
    noise : Noise
        What the data are weighted by.
    kinds : Vocabulary
        Module kinds that edits may use.
    budget : Budget
        Of the search; every fit and screening fit is an experiment.
    beam_width : int
        First edits with different residuals from which pairs are tried where no single edit
        explains the data.
    remarks : tuple of str
        How the data were read, where that had to be decided.
    """

    noise: Noise
    kinds: Vocabulary
    beam_width = 1
    remarks: tuple[str, ...] = ()

    def __init__(self, budget: Budget | None = None) -> None:
        self.budget = budget or Budget()

    # fits; each is an experiment, whether or not its result is cached

    def fit_given(self, diagram: Diagram) -> Model | None:
        """Fit the given model; None where it has no response."""
        self.budget.spend()
        return self._fit_given(diagram)

    def refit_model(self, model: Model, starts: Sequence[Values], *, draws: int) -> Model | None:
        """Refit a model; None where it has no response.

        starts, draws : as of `SweepFitter.fit`.
        """
        self.budget.spend()
        return self._refit_model(model, starts, draws=draws, spread=SPREAD)

    def refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """Refit a model from further starts and return the better fit."""
        self.budget.spend()
        return self._refit_from(model, starts)

    def fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values] = ()
    ) -> Model | None:
        """Fit a model with an edit; None where it has no response.

        quick : values from which alone it is fitted.
        """
        self.budget.spend()
        return self._fit_edit(model, insertion, quick=quick)

    def screen_edit(
        self, model: Model, insertion: Insertion, *, near: bool = False
    ) -> Model | None:
        """Fit a model with an edit by a few steps, at most as well as `fit_edit`.

        near : the model explains the data already.
        """
        self.budget.spend()
        return self._screen_edit(model, insertion, near=near)

    # the same for one kind of data

    @abstractmethod
    def _fit_given(self, diagram: Diagram) -> Model | None:
        """Do what `fit_given` says."""

    @abstractmethod
    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """Do what `refit_model` says."""

    def _refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """Do what `refit_from` says."""
        other = self._refit_model(model, starts, draws=0, spread=SPREAD)
        return model if other is None or other.refit.cost >= model.refit.cost else other

    @abstractmethod
    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """Do what `fit_edit` says."""

    @abstractmethod
    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """Do what `screen_edit` says."""

    # edits and models

    @abstractmethod
    def insertions(self, model: Model) -> Sequence[Insertion]:
        """List all edits of a model."""

    def would_try_edit(self, model: Model, edit: Insertion | Convention) -> bool:
        """Whether an edit is among those that are tried on a model."""
        return True

    def accepts_edit(self, before: Model, after: Model) -> bool:
        """Whether a significant edit is accepted."""
        return True

    @abstractmethod
    def is_stable(self, model: Model) -> bool:
        """Whether a device can be like the model."""

    def refit_from_prior(self, model: Model) -> Model:
        """Refit a repaired model from the nominal values, and return the better fit."""
        return model

    def fall_back_to_nominal_noise(self) -> Model | None:
        """Return the given model where it explains the data by a first estimate of their noise.

        The data are weighted by that again. None where there is no other estimate, or it does not.
        """
        return None

    def fit_other_conventions(self, model: Model, enough: float) -> Iterator[Model]:
        """Fit a model to the data as they read in other conventions.

        Each screening fit and each fit is an experiment.

        enough : cost that another trial reaches.
        """
        return iter(())

    def compute_port_map(
        self, given: Model, steps: list[str], repaired: Model | None = None
    ) -> tuple[PortFit, ...]:
        """Compute the port map of the given model; () where there is none.

        Each port is an experiment.

        Parameters
        ----------
        steps : list of str
            Is given a reason where the port map is missing.
        repaired : Model or None
            A model that explains the data, from whose values a few steps are enough.
        """
        return ()

    def cross_validate(self, model: Model) -> ValidationErrors | None:
        """Refit a model on parts of the data and return its error on the rest; None where that is
        not possible.
        """
        return None
