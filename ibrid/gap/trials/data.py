"""Kinds of data in which a gap is sought.

The workflow (`workflow`, `repair`) is one: fit the given model, see where it misses, try every
edit, weigh, go on from the best. What it asks, a kind of data answers:

- a small-signal sweep, `trial.Workshop`: edits are those of the catalogue and the ways to read the
  data otherwise;
- sweeps at several injection amplitudes, `amplitudes.Amplitudes`: edits are nonlinearities at ports
  of the linear model;
- records of events, `records.Records`, alone or beside a sweep: the chi2 is the sum over both,
  edits are limits beside the program, and those of the catalogue; no port map.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.held_out import HeldOut
from ibrid.gap.refitting.model import Model, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.trials.budget import Budget
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram


class Data(ABC):
    """One kind of data. `noise` : what the data are weighed by. `kinds` : that edits may use.
    `budget` : of the search.
    `ahead` : first edits, apart in what they leave, from which every second one is looked at where
    no single one is enough.
    `remarks` : how they are read, where that was decided, sentences.
    """

    noise: Noise
    kinds: Vocabulary
    ahead = 1
    remarks: tuple[str, ...] = ()

    def __init__(self, budget: Budget | None = None) -> None:
        self.budget = budget or Budget()

    # experiments, each counted whether or not something of it is known already

    def given(self, diagram: Diagram) -> Model | None:
        """The given model, fitted; None where it has no response."""
        self.budget.spend()
        return self._given(diagram)

    def refitted(
        self, model: Model, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7
    ) -> Model | None:
        """A model fitted from starts, as `Refitter.refit` takes them; None where it has no
        response.
        """
        self.budget.spend()
        return self._refitted(model, starts, draws=draws, spread=spread)

    def again(self, model: Model, starts: Sequence[Values]) -> Model:
        """A model fitted from further starts; the better of both."""
        self.budget.spend()
        return self._again(model, starts)

    def edited(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values] = ()
    ) -> Model | None:
        """A model with an edit, fitted; quick : from these values alone."""
        self.budget.spend()
        return self._edited(model, insertion, quick=quick)

    def glanced(self, model: Model, insertion: Insertion, *, near: bool = False) -> Model | None:
        """A model with an edit after a few steps, at most as good as `edited`; near : of a model
        that fits already.
        """
        self.budget.spend()
        return self._glanced(model, insertion, near=near)

    # what a kind of data does at each

    @abstractmethod
    def _given(self, diagram: Diagram) -> Model | None:
        """As `given`."""

    @abstractmethod
    def _refitted(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """As `refitted`."""

    def _again(self, model: Model, starts: Sequence[Values]) -> Model:
        """As `again`."""
        other = self._refitted(model, starts, draws=0, spread=0.7)
        return model if other is None or other.refit.cost >= model.refit.cost else other

    @abstractmethod
    def _edited(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """As `edited`."""

    @abstractmethod
    def _glanced(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """As `glanced`."""

    # the rest

    def roughly(self) -> Model | None:
        """The given model where it explains the data by a first estimate of their noise, by which
        they are weighed again; None where there is no other estimate, or it does not.
        """
        return None

    def begun_from_beliefs(self, model: Model) -> Model:
        """A repaired model begun once more from what is believed; the better of both."""
        return model

    @abstractmethod
    def insertions(self, model: Model) -> Sequence[Insertion]:
        """All edits of a model."""

    def would_try(self, model: Model, edit: Insertion | Convention) -> bool:
        """Whether an edit is among those that are tried on a model."""
        return True

    def pays(self, before: Model, after: Model) -> bool:
        """Whether an edit that is significant is worth a name."""
        return True

    def read_otherwise(self, model: Model, enough: float) -> Iterator[Model]:
        """A model on the data as they read in other conventions, fitted; enough : cost that
        something else reaches. Each look and each fit is an experiment.
        """
        return iter(())

    @abstractmethod
    def stable(self, model: Model) -> bool:
        """True for a model that a device may be."""

    def ports(
        self, given: Model, steps: list[str], repaired: Model | None = None
    ) -> tuple[PortFit, ...]:
        """Where one unknown transfer would explain what is left; () and perhaps a step that says
        why not.

        repaired : a model that explains all: a look from its values is enough. Each place is an
        experiment.
        """
        return ()

    def held_out(self, model: Model) -> HeldOut | None:
        """Its errors where it was not fitted; None where the data do not tell."""
        return None
