"""A family of edits: one engineering idea, the places where it applies, and where in frequency it usually shows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles, roles


@dataclass(frozen=True)
class Move:
    """One edit. `note` : what changes, in a line. `change` : makes it in a draft of the parent. `weight` : how usual it is
    among the edits of its family."""

    note: str
    change: Callable[[Draft], None]
    weight: float = 1.0


@dataclass(frozen=True)
class View:
    """The parent as the moves see it: its diagram, a draft to look at, its roles and the kinds that may be used."""

    diagram: Diagram
    draft: Draft
    roles: Roles
    kinds: Vocabulary

    def known(self, *names: str) -> tuple[str, ...]:
        """Of some kinds, those that this vocabulary has."""
        return tuple(name for name in names if name in self.draft.vocabulary)


Moves = Callable[[View], Iterator[Move]]


def where_missing(moves: Moves, present: Callable[[View], bool]) -> Moves:
    """The moves where the diagram has no such part yet; what an engineer expects is tried readily."""
    return lambda view: iter(()) if present(view) else moves(view)


def where_present(moves: Moves, present: Callable[[View], bool]) -> Moves:
    """The moves where the diagram has such a part already."""
    return lambda view: moves(view) if present(view) else iter(())


@dataclass(frozen=True)
class Family:
    """`scale` : local, module or structural. `bands` : how much it usually matters in each frequency band, 0 to 1, in
    the order of the record. `weight` : how readily an engineer tries it. `moves` : the edits that apply to a parent.
    `first` : it puts in a part that every controller has, so it comes before the rest.
    """

    name: str
    scale: str
    bands: tuple[float, float, float, float]
    weight: float
    moves: Moves
    first: bool = False


def view_of(diagram: Diagram, kinds: Vocabulary) -> View | None:
    """A parent as the moves see it; None when its roles cannot be told."""
    found = roles(diagram, kinds)
    return None if found is None else View(diagram, Draft(diagram, kinds), found, kinds)
