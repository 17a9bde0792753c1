"""Kinds of data in which a gap is sought.

`workflow` and `repair` are the same for all: fit the given model, locate the misfit, fit every
edit, rank, and go on from the best. A subclass of `Dataset` answers for one kind of data:

- `SweepDataset`: small-signal sweeps. Edits are those of control practice, and other conventions of
  the data.
- `AmplitudeDataset`: sweeps at several injection amplitudes. Edits are nonlinearities at ports of
  the linear model.
- `EventDataset`: records of events, alone or beside a sweep. The chi-square is the sum over both;
  edits are limits beside the program, and those of control practice; there is no port map.
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

    # experiments, each counted whether or not something of it is known already

    def fit_given(self, diagram: Diagram) -> Model | None:
        """The given model, fitted; None where it has no response."""
        self.budget.spend()
        return self._fit_given(diagram)

    def refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7
    ) -> Model | None:
        """A model fitted from starts, as `Refitter.refit` takes them; None where it has no
        response.
        """
        self.budget.spend()
        return self._refit_model(model, starts, draws=draws, spread=spread)

    def refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """A model fitted from further starts; the better of both."""
        self.budget.spend()
        return self._refit_from(model, starts)

    def fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values] = ()
    ) -> Model | None:
        """A model with an edit, fitted; quick : from these values alone."""
        self.budget.spend()
        return self._fit_edit(model, insertion, quick=quick)

    def screen_edit(
        self, model: Model, insertion: Insertion, *, near: bool = False
    ) -> Model | None:
        """A model with an edit after a few steps, at most as good as `fit_edit`; near : of a model
        that fits already.
        """
        self.budget.spend()
        return self._screen_edit(model, insertion, near=near)

    # what a kind of data does at each

    @abstractmethod
    def _fit_given(self, diagram: Diagram) -> Model | None:
        """As `fit_given`."""

    @abstractmethod
    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """As `refit_model`."""

    def _refit_from(self, model: Model, starts: Sequence[Values]) -> Model:
        """As `refit_from`."""
        other = self._refit_model(model, starts, draws=0, spread=0.7)
        return model if other is None or other.refit.cost >= model.refit.cost else other

    @abstractmethod
    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """As `fit_edit`."""

    @abstractmethod
    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """As `screen_edit`."""

    # the rest

    def fall_back_to_nominal_noise(self) -> Model | None:
        """The given model where it explains the data by a first estimate of their noise, by which
        they are weighed again; None where there is no other estimate, or it does not.
        """
        return None

    def refit_from_prior(self, model: Model) -> Model:
        """A repaired model begun once more from what is believed; the better of both."""
        return model

    @abstractmethod
    def insertions(self, model: Model) -> Sequence[Insertion]:
        """All edits of a model."""

    def would_try_edit(self, model: Model, edit: Insertion | Convention) -> bool:
        """Whether an edit is among those that are tried on a model."""
        return True

    def accepts_edit(self, before: Model, after: Model) -> bool:
        """Whether an edit that is significant is worth a name."""
        return True

    def fit_other_conventions(self, model: Model, enough: float) -> Iterator[Model]:
        """A model on the data as they read in other conventions, fitted; enough : cost that
        something else reaches. Each look and each fit is an experiment.
        """
        return iter(())

    @abstractmethod
    def is_stable(self, model: Model) -> bool:
        """True for a model that a device may be."""

    def compute_port_map(
        self, given: Model, steps: list[str], repaired: Model | None = None
    ) -> tuple[PortFit, ...]:
        """Where one unknown transfer would explain what is left; () and perhaps a step that says
        why not.

        repaired : a model that explains all: a look from its values is enough. Each place is an
        experiment.
        """
        return ()

    def cross_validate(self, model: Model) -> ValidationErrors | None:
        """Its errors where it was not fitted; None where the data do not tell."""
        return None
