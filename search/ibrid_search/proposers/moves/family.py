"""A family of edits: one engineering idea, the places where it applies, and where in frequency it usually shows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles, roles
from ibrid_search.proposers.moves.command import follow_command, followers
from ibrid_search.proposers.moves.devices import Device, device_parts


@dataclass(frozen=True)
class Move:
    """One edit. `note` : what changes, in a line. `change` : makes it in a draft of the parent. `weight` : how usual it is
    among the edits of its family."""

    note: str
    change: Callable[[Draft], None]
    weight: float = 1.0


@dataclass(frozen=True)
class View:
    """The parent as the moves see it: its diagram, a draft to look at, its roles and the kinds that may be used.

    Of two devices behind one PCC a view shows one, as if it were alone; `device` : how it lies in the `whole`.
    """

    diagram: Diagram
    draft: Draft
    roles: Roles
    kinds: Vocabulary
    device: Device

    @property
    def whole(self) -> Diagram:
        """The parent with all its devices."""
        return self.device.whole

    @property
    def alone(self) -> bool:
        """True when there is no other device."""
        return self.diagram is self.device.whole

    @property
    def wires(self) -> list[tuple[str, str]]:
        """The wires that may be changed one by one: those into inputs that follow the command are not among them."""
        bound = followers(self.draft)
        return [(source, target) for source, target in self.draft.wires if target not in bound]

    def known(self, *names: str) -> tuple[str, ...]:
        """Of some kinds, those that this vocabulary has."""
        return tuple(name for name in names if name in self.draft.vocabulary)

    def knows(self, *names: str) -> bool:
        """True when this vocabulary has all of some kinds."""
        return len(self.known(*names)) == len(names)

    def words(self, move: Move) -> str:
        """What a move changes; of two devices also in which."""
        return move.note if self.alone else f"{move.note}, in the device of {self.roles.plant}"

    def after(self, move: Move) -> Diagram:
        """The whole after a move: what follows the command follows it still, and nothing is left undriven or unused.

        A move that takes every module away takes the device away.
        """
        draft = Draft(self.diagram, self.kinds)
        move.change(draft)
        if not draft.instances:
            return self.device.without_part(self.kinds)
        follow_command(draft, followers(self.draft))
        draft.tidy()
        return self.device.with_part(draft.diagram(), self.kinds)


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
    `first` : it puts in a part that every controller has, so it comes before the rest. `any_time` : it need not wait for
    those. `if_gross` : its weight while the parent's error is gross; None: the same. Another structure is tried then, and
    details later.
    """

    name: str
    scale: str
    bands: tuple[float, float, float, float]
    weight: float
    moves: Moves
    first: bool = False
    any_time: bool = False
    if_gross: float | None = None

    def __post_init__(self) -> None:
        if self.weight <= 0 or (self.if_gross is not None and self.if_gross <= 0):
            raise ValueError(f"the family {self.name!r} must have a positive weight; leave it out instead")

    def readiness(self, *, gross: bool) -> float:
        """The weight for a parent whose error is gross, or not."""
        return self.if_gross if gross and self.if_gross is not None else self.weight


def views_of(diagram: Diagram, kinds: Vocabulary) -> tuple[View, ...]:
    """A parent as the moves see it, once for each of its devices; empty when the roles of none can be told."""
    found = []
    for device in device_parts(diagram, kinds):
        seen = roles(device.part, kinds)
        if seen is not None:
            found.append(View(device.part, Draft(device.part, kinds), seen, kinds, device))
    return tuple(found)


def view_of(diagram: Diagram, kinds: Vocabulary, *, device: int = 0) -> View | None:
    """One of a parent's devices as the moves see it; None when there is none of which the roles can be told."""
    found = views_of(diagram, kinds)
    return found[device] if device < len(found) else None
