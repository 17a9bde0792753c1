"""A diagram being edited by an idea of control practice: new blocks with parameters of their own,
and how strong these are.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

from ibrid.border import methods_take_kinds
from ibrid.errors import IbridError
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.structure.diagrams.diagram import Binding, Diagram
from ibrid.structure.editing.drafting import Draft

#: Corner frequency in rad/s above which a low-pass does nothing in any sweep, to rounding.
FAR = 1e14


@methods_take_kinds
@dataclass(frozen=True)
class Strength:
    """How strong an effect may be, for one new parameter, in its unit.

    `bank` : finite strengths to start from, mild to gross; banks of one move have one length, their
    j-th numbers belong together. `nothing` : where the effect has vanished, to rounding where that
    is a limit; None where no value does that, or where another parameter's does.
    """

    bank: tuple[float, ...]
    nothing: float | None = None

    @classmethod
    def around(cls, box: Range) -> "Strength":
        """Of a parameter that no idea tells more about: a third of its typical value, that, and
        three times it.
        """
        return cls(
            tuple(min(max(factor * box.typical, box.low), box.high) for factor in (1 / 3, 1.0, 3.0))
        )


def cutoff(*hertz: float, nothing: float | None = FAR) -> Strength:
    """A low-pass, from corner frequencies in Hz."""
    return Strength(tuple(2 * pi * frequency for frequency in hertz), nothing)


def pi_gains(
    kP: tuple[float, ...], kI: tuple[float, ...], *, vanishes: bool = False
) -> dict[str, Strength]:
    """Both gains of a PI controller; `vanishes` : with gains of zero the diagram is as before."""
    nothing = 0.0 if vanishes else None
    return {"kP": Strength(kP, nothing), "kI": Strength(kI, nothing)}


def in_place(strengths: Mapping[str, Strength]) -> dict[str, Strength]:
    """Of a block that takes another's place: no value makes the diagram what it was."""
    return {name: Strength(one.bank) for name, one in strengths.items()}


class NotInVocabulary(IbridError):
    """An edit needs a kind that the vocabulary in use leaves out."""


@methods_take_kinds
class Edit(Draft):
    """A draft in which every new module has parameters of its own: no name that owns a shared one
    is given again.

    Where a module is put in, a `Strength` in place of a binding says how strong that parameter
    usually is; it stays free.
    taken : names that no new module may get, besides those in the diagram.
    """

    def __init__(
        self, diagram: Diagram, kinds: Vocabulary, taken: frozenset[str] = frozenset()
    ) -> None:
        super().__init__(diagram, kinds)
        self.taken = taken
        self.strengths: dict[str, Strength] = {}

    def add(self, kind: str, stem: str, **bindings: Binding | Strength) -> str:
        """Add a module, named after `stem`; raises NotInVocabulary."""
        bound = {key: value for key, value in bindings.items() if not isinstance(value, Strength)}
        name = super().add(self._at_hand(kind), self.free_name(stem), **bound)
        self.usually(
            name, **{key: value for key, value in bindings.items() if isinstance(value, Strength)}
        )
        return name

    def replace(self, name: str, kind: str, stem: str, **bindings: Binding | Strength) -> str:
        """Put another kind in a module's place; raises NotInVocabulary."""
        return super().replace(name, self._at_hand(kind), stem, **bindings)

    def redraw(self, name: str, kind: str, **bindings: Binding | Strength) -> None:
        """Let a block be of another kind with the same ports; raises NotInVocabulary."""
        bound = {key: value for key, value in bindings.items() if not isinstance(value, Strength)}
        super().redraw(name, self._at_hand(kind), **bound)
        self.usually(
            name, **{key: value for key, value in bindings.items() if isinstance(value, Strength)}
        )

    def usually(self, name: str, **strengths: Strength) -> None:
        """Say how strong parameters of a module usually are."""
        self.strengths |= {f"{name}.{key}": strength for key, strength in strengths.items()}

    def bind(self, name: str, **bindings: Binding) -> None:
        """Add or replace bindings of a module; a name shared by it is as strong as the parameter
        was.
        """
        for key, value in bindings.items():
            told = self.strengths.pop(f"{name}.{key}", None)
            if told is not None and isinstance(value, str):
                self.strengths.setdefault(value, told)
        super().bind(name, **bindings)

    def free(self) -> dict[str, Range]:
        """Free parameters of the modules, the shared ones once, with the box of the first that has
        them.
        """
        boxes: dict[str, Range] = {}
        for name, one in self.instances.items():
            for key, box in self.kind(name).parameters.items():
                bound = one.bindings.get(key)
                if not isinstance(bound, float):
                    boxes.setdefault(bound if isinstance(bound, str) else f"{name}.{key}", box)
        return boxes

    def free_name(self, stem: str) -> str:
        """`stem`, with a number where a module or the owner of a shared parameter is called so."""
        shared = (
            value
            for one in self.instances.values()
            for value in one.bindings.values()
            if isinstance(value, str)
        )
        taken = {*self.taken, *self.instances, *(value.split(".")[0] for value in shared)}
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem}_{number}", number + 1
        return name

    def after(self, source: str, kind: str, stem: str, **strengths: Strength) -> str:
        """The output of a new block behind a source; raises NotInVocabulary."""
        name = self.add(kind, stem, **strengths)
        self.connect(source, f"{name}.in_")
        return f"{name}.out"

    def _at_hand(self, kind: str) -> str:
        name = stand_in(kind, tuple(self.vocabulary.values()))
        if name is None:
            raise NotInVocabulary(f"this edit needs the kind {kind}; use the extended vocabulary.")
        return name


def stand_in(name: str, kinds: Vocabulary) -> str | None:
    """A kind by its name; where a vocabulary lacks it, one that does the same with the same
    parameters; None without either.
    """
    if any(kind.name == name for kind in kinds):
        return name
    shipped = [kind for kind in VOCABULARY if kind.name == name]
    return next((kind.name for one in shipped for kind in kinds if _alike(one, kind)), None)


def stands_for(kind: ModuleKind) -> str:
    """Name of the shipped kind that does the same; the kind's own where there is none."""
    same = (one.name for one in VOCABULARY if one.name == kind.name)
    return next(same, None) or next(
        (one.name for one in VOCABULARY if _alike(one, kind)), kind.name
    )


def _alike(first: ModuleKind, other: ModuleKind) -> bool:
    if (
        first.element is None
        or first.element is not other.element
        or first.signal is not other.signal
    ):
        return False
    if first.element is Element.PADE and len(first.states) != len(
        other.states
    ):  # forms of other orders are other laws
        return False
    return {*first.parameters} == {*other.parameters}
