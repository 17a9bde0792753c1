"""A diagram as control practice sees it, device by device, and the moves that change one: what
follows the command follows it still, and nothing is left undriven or unused.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import Range
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.device import Device, device_parts
from ibrid.parts.editing.edit import Edit, Strength, stand_in, stands_for
from ibrid.structure.diagrams.diagram import Binding, Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.roles import Roles, roles
from ibrid.structure.reading.wiring import split_port

Change = Literal["add", "remove", "replace"]
Result = TypeVar("Result")

#: Ports that take a signal of the power circuit as it is, where a controller could not measure
#: another.
CIRCUIT_PORTS = ("v_in", "v_DQ", "i_dq")


@methods_take_kinds
@dataclass(frozen=True)
class Move:
    """One way to change a diagram.

    `note` : what changes, in a line, as a search says it; "" for what no search tries. `draw` :
    makes it in a draft, with the strengths of what it puts in. `weight` : how usual it is among the
    moves of its family. `change` : what is done.
    `where` : the place, in names of the user's program, as the catalogue says it; "" for what is no
    effect. `says` : of an effect what it says of the device, in words; "" for what its change, name
    and place say.
    """

    note: str
    draw: Callable[[Edit], object]
    weight: float = 1.0
    change: Change = "replace"
    where: str = ""
    says: str = ""

    @classmethod
    def at(cls, change: Change, where: str, draw: Callable[[Edit], object]) -> "Move":
        """A move of an effect."""
        return cls("", draw, change=change, where=where)


@dataclass(frozen=True, eq=False)
class Drawn(Generic[Result]):
    """What an edit makes: the whole diagram, and what the edit returned.

    `boxes` : new free parameters with their ranges. `told` : strengths that the edit tells of them.
    `was` : of those that were shared before, the name under which they were.
    """

    diagram: Diagram
    result: Result
    boxes: Mapping[str, Range] = field(default_factory=dict)
    told: Mapping[str, Strength] = field(default_factory=dict)
    was: Mapping[str, str] = field(default_factory=dict)

    @property
    def strengths(self) -> dict[str, Strength]:
        """Of each new free parameter: what the edit told, else what its kind calls typical."""
        return {
            name: self.told.get(name) or Strength.around(box) for name, box in self.boxes.items()
        }


@methods_take_kinds
@dataclass(frozen=True)
class View:
    """A diagram as ideas see it: a draft to look at, its roles and the kinds that may be used.

    Of two devices behind one PCC a view shows one, as if it were alone; `device` : how it lies in
    the `whole`.
    """

    diagram: Diagram
    draft: Draft
    roles: Roles
    kinds: Vocabulary
    device: Device

    @property
    def whole(self) -> Diagram:
        """The diagram with all its devices."""
        return self.device.whole

    @property
    def alone(self) -> bool:
        """True when there is no other device."""
        return self.diagram is self.device.whole

    @property
    def wires(self) -> list[tuple[str, str]]:
        """The wires that may be changed one by one: those into inputs that follow the command are
        not among them.
        """
        bound = followers(self.draft)
        return [(source, target) for source, target in self.draft.wires if target not in bound]

    def kind(self, name: str) -> str:
        """Name of a module's kind."""
        return self.draft.instances[name].kind

    def shipped(self, name: str) -> str:
        """Name of the shipped kind that does what a module does, else of its own."""
        return stands_for(self.draft.kind(name))

    def element(self, name: str) -> Element | None:
        """What a module is."""
        return self.draft.kind(name).element

    def bound(self, name: str) -> dict[str, Binding]:
        """What each parameter of a module is bound to, its own name where that is itself."""
        bindings = self.draft.instances[name].bindings
        return {key: bindings.get(key, f"{name}.{key}") for key in self.draft.kind(name).parameters}

    def known(self, *names: str) -> tuple[str, ...]:
        """Of some kinds, those that this vocabulary has, or what stands in for them."""
        found = (stand_in(name, self.kinds) for name in names)
        return tuple(name for name in found if name is not None)

    def knows(self, *names: str) -> bool:
        """True when this vocabulary has all of some kinds."""
        return len(self.known(*names)) == len(names)

    def words(self, move: Move) -> str:
        """What a move changes; of two devices also in which."""
        return move.note if self.alone else f"{move.note}, in the device of {self.roles.plant}"

    def after(self, move: Move) -> Diagram:
        """The whole after a move; raises NotInVocabulary for a kind that is not at hand."""
        return self.drawn(move.draw).diagram

    def drawn(self, draw: Callable[[Edit], Result]) -> Drawn[Result]:
        """What an edit makes, made whole again; raises NotInVocabulary.

        An edit that takes every module away takes the device away.
        """
        draft = Edit(self.diagram, self.kinds, self.device.taken)
        before = draft.free()
        result = draw(draft)
        if not draft.instances:
            return Drawn(self.device.without_part(self.kinds), result)
        follow_command(draft, followers(self.draft))
        draft.tidy()
        boxes = {name: box for name, box in draft.free().items() if name not in before}
        told = {name: strength for name, strength in draft.strengths.items() if name in boxes}
        shared = {
            f"{name}.{key}": value
            for name in self.draft.instances
            for key, value in self.bound(name).items()
        }
        was = {name: value for name in boxes if isinstance(value := shared.get(name), str)}
        return Drawn(self.device.with_part(draft.diagram(), self.kinds), result, boxes, told, was)


@takes_kinds
def views_of(diagram: Diagram, kinds: Vocabulary) -> tuple[View, ...]:
    """A legal diagram, once for each of its devices in the order of the plants; () when the roles
    of none can be told.
    """
    seen = ((device, roles(device.part, kinds)) for device in device_parts(diagram, kinds))
    return tuple(
        View(device.part, Draft(device.part, kinds), known, kinds, device)
        for device, known in seen
        if known is not None
    )


@takes_kinds
def view_of(diagram: Diagram, kinds: Vocabulary, *, device: int = 0) -> View | None:
    """One of a diagram's devices; None when there is none of which the roles can be told."""
    views = views_of(diagram, kinds)
    return views[device] if device < len(views) else None


# --- what follows the command
# ----------------------------------------------------------------------------------------------


def _command(draft: Draft) -> str | None:
    return next(
        (f"{name}.u_r" for name in draft.instances if "u_r" in draft.kind(name).inputs), None
    )


def _commanded(draft: Draft) -> list[str]:
    """Inputs that take what drives the plant's u_r: physics, so an edit of the command is one of
    these too.
    """
    return [f"{name}.u" for name in draft.having(Element.DC_LINK)]


def followers(draft: Draft) -> frozenset[str]:
    """Inputs of the circuit that take the same sources as the command, as a DC link does."""
    command = _command(draft)
    if command is None:
        return frozenset()
    return frozenset(
        port
        for port in _commanded(draft)
        if set(draft.sources(port)) == set(draft.sources(command))
    )


def follow_command(draft: Edit, bound: frozenset[str]) -> None:
    """Let inputs that follow the command take what drives it now; `bound` : those that did before
    the edit.

    A kind put in by the edit itself follows from the beginning.
    """
    command = _command(draft)
    if command is None:
        return
    for port in _commanded(draft):
        if port in bound or not draft.sources(port):  # any other stood for itself before
            draft.drive(port, *draft.sources(command))


def of_circuit(draft: Draft, target: str) -> bool:
    """True for an input that belongs to the power circuit, and for an outer port."""
    name, port = split_port(target)
    return (
        not name
        or port in CIRCUIT_PORTS
        or draft.kind(name).element in (Element.DC_LINK, Element.SHUNT, Element.CONVERTER_LOSS)
    )
