"""An effect: a physical cause of a gap between model and device, and the edits by which a model gets, loses or changes it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from ibrid.errors import IbridError
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.diagram import Binding, Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles, roles

Change = Literal["add", "remove", "replace"]


@dataclass(frozen=True)
class Strength:
    """How strong an effect may be, for one new parameter, in its unit.

    `bank` : finite strengths to start from, mild to gross; banks of one insertion have one length, their j-th numbers
    belong together. `nothing` : where the effect has vanished, to rounding where that is a limit; None where no value
    does that, or where another parameter's does.
    """

    bank: tuple[float, ...]
    nothing: float | None = None


@dataclass(frozen=True)
class Insertion:
    """One way in which an effect changes one given model.

    `effect` : its id. `change` : what is done to the model. `where` : the place, in names of the user's program.
    `diagram` : the edited program; modules that stay keep their names. `parameters` : new free parameters -> bank of
    strengths (see `Strength`). `nothing` : values of new parameters at which the edited model is the given one, whatever
    the others are; {} where there are none.
    """

    effect: str
    change: Change
    where: str
    diagram: Diagram
    parameters: Mapping[str, tuple[float, ...]]
    nothing: Mapping[str, float]


class NotInVocabulary(IbridError):
    """An edit needs a kind that the vocabulary in use leaves out."""


class Edit(Draft):
    """A draft in which every new module has parameters of its own: no name that owns a shared one is given again.

    beside : modules of another device, which are there and are not looked for.
    """

    def __init__(self, diagram: Diagram, kinds: Vocabulary, beside: frozenset[str] = frozenset()) -> None:
        super().__init__(diagram, kinds)
        self.beside = beside

    def named(self, *kinds: str) -> list[str]:
        """Modules of some kinds, in order; those of another device left out."""
        return [name for name in super().named(*kinds) if name not in self.beside]

    def having(self, *elements: Element, signal: Signal | None = None) -> list[str]:
        """Modules that are one of these elements, in order; those of another device left out."""
        return [name for name in super().having(*elements, signal=signal) if name not in self.beside]

    def add(self, kind: str, stem: str, **bindings: Binding) -> str:
        """Add a module, named after `stem`; raises NotInVocabulary."""
        self._require(kind)
        return super().add(kind, self.free_name(stem), **bindings)

    def replace(self, name: str, kind: str, stem: str) -> str:
        """Put another kind in a module's place; raises NotInVocabulary."""
        self._require(kind)
        return super().replace(name, kind, stem)

    def free_name(self, stem: str) -> str:
        """`stem`, with a number where a module or the owner of a shared parameter is called so."""
        shared = (value for one in self.instances.values() for value in one.bindings.values() if isinstance(value, str))
        taken = {*self.instances, *(value.split(".")[0] for value in shared)}
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem}_{number}", number + 1
        return name

    def _require(self, kind: str) -> None:
        if kind not in self.vocabulary:
            raise NotInVocabulary(f"this edit needs the kind {kind}; use the extended vocabulary.")


@dataclass(frozen=True)
class Model:
    """A given model as the effects see it: its diagram, the kinds that may be used, a draft to look at, its roles.

    Of two devices behind one PCC `draft` and `roles` are those of one, and `beside` are the modules of the other.
    """

    diagram: Diagram
    kinds: Vocabulary
    draft: Draft
    roles: Roles
    beside: frozenset[str] = frozenset()

    def edit(self) -> Edit:
        """A draft of the whole diagram, to be changed."""
        return Edit(self.diagram, self.kinds, self.beside)

    def edited(
        self, effect: str, change: Change, where: str, edit: Callable[[Edit], Mapping[str, Strength] | None]
    ) -> Iterator[Insertion]:
        """The one insertion that `edit` makes in a draft, which is tidied after it; none where a kind is not at hand.

        edit : returns the strengths of the free parameters that it brings in, by name.
        """
        draft = self.edit()
        try:
            strengths = edit(draft) or {}
        except NotInVocabulary:
            return
        draft.tidy()
        yield Insertion(
            effect,
            change,
            where,
            draft.diagram(),
            {name: one.bank for name, one in strengths.items()},
            {name: one.nothing for name, one in strengths.items() if one.nothing is not None},
        )

    def bypassed(self, effect: str, change: Change, where: str, name: str) -> Iterator[Insertion]:
        """The one insertion that takes a module out of its path."""
        return self.edited(effect, change, where, lambda draft: draft.bypass(name))


def model_of(diagram: Diagram, kinds: Vocabulary) -> Model | None:
    """A legal diagram as the effects see it; None when it has not one plant with a command."""
    found = roles(diagram, kinds)
    return None if found is None else Model(diagram, kinds, Draft(diagram, kinds), found)


def no_edit(model: Model) -> tuple[Insertion, ...]:
    """Of effects that no edit of a diagram describes."""
    return ()


def absorbed_by_nothing(model: Model) -> tuple[str, ...]:
    """Of most effects: no parameter of a model takes them up."""
    return ()


@dataclass(frozen=True)
class Effect:
    """A declaration of the catalogue.

    `id` : its name in results. `law` : in symbols, per unit. `places` : where it is tried. `signature` : in which bands,
    entries and operating points it shows. `confused_with` : ids of effects that look alike. `told_apart_by` : the
    measurement that separates them. `insertions` : all ways to change a given model, legal or not.
    `absorbed` : free parameters of a given model that take the effect up entirely, so that it cannot be seen as one.
    `measurement` : True when it lies in the measuring, not in the device, so that no edit of a diagram describes it.
    """

    id: str
    law: str
    places: str
    signature: str
    confused_with: tuple[str, ...]
    told_apart_by: str
    insertions: Callable[[Model], Iterable[Insertion]]
    absorbed: Callable[[Model], tuple[str, ...]] = absorbed_by_nothing
    measurement: bool = False
