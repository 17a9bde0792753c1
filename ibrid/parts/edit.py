"""A diagram being edited by an idea of control practice: new blocks with parameters of their own, and how strong these are."""

from dataclasses import dataclass
from math import pi

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.structure.diagram import Binding, Diagram
from ibrid.structure.drafting import Draft

#: Corner frequency in rad/s above which a low-pass does nothing in any sweep, to rounding.
FAR = 1e14


@dataclass(frozen=True)
class Strength:
    """How strong an effect may be, for one new parameter, in its unit.

    `bank` : finite strengths to start from, mild to gross; banks of one move have one length, their j-th numbers
    belong together. `nothing` : where the effect has vanished, to rounding where that is a limit; None where no value
    does that, or where another parameter's does.
    """

    bank: tuple[float, ...]
    nothing: float | None = None


def cutoff(*hertz: float, nothing: float | None = FAR) -> Strength:
    """A low-pass, from corner frequencies in Hz."""
    return Strength(tuple(2 * pi * frequency for frequency in hertz), nothing)


def pi_gains(name: str, kP: tuple[float, ...], kI: tuple[float, ...], *, vanishes: bool) -> dict[str, Strength]:
    """Both gains of the PI controller `name`; `vanishes` : with gains of zero the diagram is as before."""
    nothing = 0.0 if vanishes else None
    return {f"{name}.kP": Strength(kP, nothing), f"{name}.kI": Strength(kI, nothing)}


class NotInVocabulary(IbridError):
    """An edit needs a kind that the vocabulary in use leaves out."""


class Edit(Draft):
    """A draft in which every new module has parameters of its own: no name that owns a shared one is given again.

    taken : names that no new module may get, besides those in the diagram.
    """

    def __init__(self, diagram: Diagram, kinds: Vocabulary, taken: frozenset[str] = frozenset()) -> None:
        super().__init__(diagram, kinds)
        self.taken = taken

    def add(self, kind: str, stem: str, **bindings: Binding) -> str:
        """Add a module, named after `stem`; raises NotInVocabulary."""
        return super().add(self._at_hand(kind), self.free_name(stem), **bindings)

    def replace(self, name: str, kind: str, stem: str) -> str:
        """Put another kind in a module's place; raises NotInVocabulary."""
        return super().replace(name, self._at_hand(kind), stem)

    def free_name(self, stem: str) -> str:
        """`stem`, with a number where a module or the owner of a shared parameter is called so."""
        shared = (value for one in self.instances.values() for value in one.bindings.values() if isinstance(value, str))
        taken = {*self.taken, *self.instances, *(value.split(".")[0] for value in shared)}
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem}_{number}", number + 1
        return name

    def after(self, source: str, kind: str, stem: str) -> str:
        """The output of a new block behind a source; raises NotInVocabulary."""
        name = self.add(kind, stem)
        self.connect(source, f"{name}.in_")
        return f"{name}.out"

    def rewire(self, old: str, new: str, *targets: str) -> None:
        """Let inputs that take one source take another."""
        for target in targets:
            self.disconnect(old, target)
            self.connect(new, target)

    def drive(self, target: str, *sources: str) -> None:
        """Let these sources and no others drive an input."""
        for old in self.sources(target):
            self.disconnect(old, target)
        for source in sources:
            self.connect(source, target)

    def _at_hand(self, kind: str) -> str:
        name = stand_in(kind, tuple(self.vocabulary.values()))
        if name is None:
            raise NotInVocabulary(f"this edit needs the kind {kind}; use the extended vocabulary.")
        return name


def stand_in(name: str, kinds: Vocabulary) -> str | None:
    """A kind by its name; where a vocabulary lacks it, one that does the same with the same parameters; None without either."""
    if any(kind.name == name for kind in kinds):
        return name
    shipped = [kind for kind in VOCABULARY if kind.name == name]
    return next((kind.name for one in shipped for kind in kinds if _alike(one, kind)), None)


def stands_for(kind: ModuleKind) -> str:
    """Name of the shipped kind that does the same; the kind's own where there is none."""
    same = (one.name for one in VOCABULARY if one.name == kind.name)
    return next(same, None) or next((one.name for one in VOCABULARY if _alike(one, kind)), kind.name)


def _alike(one: ModuleKind, other: ModuleKind) -> bool:
    if one.element is None or one.element is not other.element or one.signal is not other.signal:
        return False
    return {*one.parameters} == {*other.parameters}
