"""What control practice is read as: effects that may be missing in a model, and families of moves
that a search tries.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass

from ibrid.border import methods_take_kinds
from ibrid.frozen import Frozen
from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import NotInVocabulary
from ibrid.parts.editing.view import Change, Move, View
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import Diagram

Moves = Callable[[View], Iterable[Move]]


@methods_take_kinds
@dataclass(frozen=True)
class Insertion(Frozen):
    """One way in which an effect changes one given model.

    `effect` : its id. `change` : what is done to the model. `where` : the place, in names of the
    user's program.
    `diagram` : the edited program; modules that stay keep their names. `parameters` : new free
    parameters -> bank of strengths (see `Strength`). `nothing` : values of new parameters at which
    the edited model is the given one, whatever the others are; {} where there are none. `says` :
    what it says of the device, "" for what change, id and place say.
    `form` : as of its `Effect`.
    """

    effect: str
    change: Change
    where: str
    diagram: Diagram
    parameters: Mapping[str, tuple[float, ...]]
    nothing: Mapping[str, float]
    _: KW_ONLY
    says: str = ""
    form: bool = False


def no_moves(view: View) -> tuple[Move, ...]:
    """Of effects that no edit of a diagram describes."""
    return ()


def absorbed_by_nothing(view: View) -> tuple[str, ...]:
    """Of most effects: no parameter of a model takes them up."""
    return ()


@methods_take_kinds
@dataclass(frozen=True)
class Effect:
    """A declaration of the catalogue: a physical cause of a gap between model and device.

    `id` : its name in results. `law` : in symbols, per unit. `places` : where it is tried.
    `signature` : in which bands, entries and operating points it shows. `confused_with` : ids of
    effects that look alike. `told_apart_by` : the measurement that separates them. `moves` : all
    ways to change a given model, legal or not; those with a `where` count.
    `absorbed` : free parameters of a given model that take the effect up entirely, so that it
    cannot be seen as one.
    `measurement` : True when it lies in the measuring, not in the device, so that no edit of a
    diagram describes it.
    `form` : True when it says in which form the device has a part; that is no physics, and only a
    sweep shows it.
    """

    id: str
    law: str
    places: str
    signature: str
    confused_with: tuple[str, ...]
    told_apart_by: str
    moves: Moves
    absorbed: Callable[[View], tuple[str, ...]] = absorbed_by_nothing
    measurement: bool = False
    form: bool = False

    def insertions(self, view: View) -> Iterator[Insertion]:
        """What each move makes of a model, tidied; none where a kind is not at hand."""
        for move in self.moves(view):
            if not move.where:
                continue
            try:
                drawn = view.drawn(move.draw)
            except NotInVocabulary:
                continue
            yield Insertion(
                self.id,
                move.change,
                move.where,
                drawn.diagram,
                {name: strength.bank for name, strength in drawn.told.items()},
                {name: one.nothing for name, one in drawn.told.items() if one.nothing is not None},
                says=move.says,
                form=self.form,
            )

    def __repr__(self) -> str:
        return f"<{self.id}>"


@methods_take_kinds
@dataclass(frozen=True)
class Family:
    """An engineering idea as a search tries it. `scale` : local, module or structural. `bands` :
    how much it usually matters in each frequency band, 0 to 1, in the order of the record. `weight`
    : how readily an engineer tries it.
    `moves` : the edits that apply to a diagram, each with a `note`. `first` : it puts in a part
    that every controller has, so it comes before the rest. `any_time` : it need not wait for those.
    `if_gross` : its weight while the error is gross; None: the same. Another structure is tried
    then, and details later. `usual` : False for a block or a wire put anywhere, which a diagnosis
    looks at last.
    """

    name: str
    scale: str
    bands: tuple[float, float, float, float]
    weight: float
    moves: Moves
    first: bool = False
    any_time: bool = False
    if_gross: float | None = None
    usual: bool = True

    def __post_init__(self) -> None:
        if self.weight <= 0 or (self.if_gross is not None and self.if_gross <= 0):
            raise ValueError(
                f"the family {self.name!r} must have a positive weight; leave it out instead"
            )

    def readiness(self, *, gross: bool) -> float:
        """The weight for a parent whose error is gross, or not."""
        return self.if_gross if gross and self.if_gross is not None else self.weight


def having(*elements: Element, signal: Signal | None = None) -> Callable[[View], bool]:
    """Whether a diagram has a module of one of these elements, of that signal."""
    return lambda view: bool(view.draft.having(*elements, signal=signal))


def always(moves: Moves) -> Moves:
    """Those that a search tries, of moves that are an effect's too."""
    return lambda view: (move for move in moves(view) if move.note)


def where_missing(moves: Moves, present: Callable[[View], bool]) -> Moves:
    """The same where the diagram has no such part yet; what an engineer expects is tried
    readily.
    """
    return lambda view: () if present(view) else always(moves)(view)


def where_present(moves: Moves, present: Callable[[View], bool]) -> Moves:
    """The same where the diagram has such a part already."""
    return lambda view: always(moves)(view) if present(view) else ()
