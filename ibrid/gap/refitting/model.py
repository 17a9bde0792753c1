"""A model under repair: a diagram, how the data are read, and what its fit to any kind of data ends in."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, log
from typing import Generic, TypeVar

from ibrid.evaluation.adequacy import is_adequate, p_value
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

Values = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its best parameters. `values` : of the free ones, by name. `chi2` : of the data alone, `penalty` : of the
    prior, `cost` : both together. `dof` : degrees of freedom of chi2. `numbers` : measured real ones. `free` : numbers that were
    fitted."""

    values: Values
    chi2: float
    penalty: float
    dof: float
    numbers: int
    free: int
    cost: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", self.chi2 + self.penalty)

    @property
    def told_by(self) -> float:
        """Degrees of freedom of the estimate of the noise; infinite where it is known."""
        return inf

    def p_value(self, scale: float = 1.0) -> float:
        """Probability of so large a misfit by noise alone, its standard deviation `scale` times what was stated."""
        return p_value(self.chi2 / scale**2, self.dof, self.told_by)

    def adequate(self, scale: float = 1.0) -> bool:
        """True when it fits as well as the noise allows, or too nearly so to matter."""
        return is_adequate(self.chi2 / scale**2, self.dof, self.told_by)


Fit = TypeVar("Fit", bound=Fitted)


@dataclass(frozen=True, eq=False)
class Model(Generic[Fit]):
    """A diagram, how the data are read, and its best refit. `edits` : what led to it, in order. `free` : free numbers, those of
    the convention, `extra`, included."""

    diagram: Diagram
    convention: Convention
    refit: Fit
    edits: tuple[Insertion | Convention, ...] = ()
    extra: int = 0
    free: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "free", self.refit.free + self.extra)

    def bic(self, scale: float = 1.0) -> float:
        """chi2 and prior, with ln(n) for every free number; `scale` : of the noise. Rounded, so that exact twins, such as p and
        q on another scale and another base, stay in the order in which they were tried, on every machine."""
        return round(self.cost(scale) + self.free * log(self.refit.numbers), 6)

    def cost(self, scale: float = 1.0) -> float:
        """chi2 and prior."""
        return self.refit.chi2 / scale**2 + self.refit.penalty

    def adequate(self, scale: float = 1.0) -> bool:
        """True when it fits as well as the noise allows."""
        return self.refit.adequate(scale)
