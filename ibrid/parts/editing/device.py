"""Two devices behind one PCC, edited one at a time: a part of the diagram taken out, changed as if
alone, and put back.
"""

from dataclasses import dataclass, replace

from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE, Connection, Diagram, Instance
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port, wire

Wire = tuple[str, str]


@dataclass(frozen=True)
class Device:
    """A device of a diagram. `names` : its modules in the `whole`. `share` : its Share, None for a
    device without one.
    `part` : the device as if it were alone, its Share left out.
    """

    whole: Diagram
    names: frozenset[str]
    share: str | None
    part: Diagram

    @property
    def taken(self) -> frozenset[str]:
        """Names that no new module of this device may get: what is beside it, and owners of
        parameters shared there.
        """
        rest = [
            one
            for one in self.whole.instances
            if one.name not in self.names or one.name == self.share
        ]
        owners = {
            value.split(".")[0]
            for one in rest
            for value in one.bindings.values()
            if isinstance(value, str)
        }
        return frozenset({*owners, *(one.name for one in rest)} - (self.names - {self.share}))

    def with_part(self, part: Diagram, kinds: Vocabulary) -> Diagram:
        """The whole with another part in this one's place; nothing, which is not legal, when
        nothing is left of it.
        """
        if len(self.names) == len(self.whole.instances) or not part.instances:
            return part
        rest, others = self._beside()
        draft = Draft(part, kinds)
        own, links = list(draft.instances.values()), list(draft.wires)
        if self.share:
            own = [one for one in self.whole.instances if one.name == self.share] + own
            links = [
                (TERMINAL_VOLTAGE, f"{self.share}.v_DQ"),
                *(_through(self.share, ends, draft) for ends in links),
            ]
        first = self.whole.instances[0].name in self.names
        joined = Diagram(self.whole.name).behind(self.whole.outside)
        joined.extend(
            [*own, *rest] if first else [*rest, *own],
            [Connection(*wire) for wire in ([*links, *others] if first else [*others, *links])],
        )
        return joined

    def without_part(self, kinds: Vocabulary) -> Diagram:
        """The whole without this device: the other delivers everything, so it needs no share."""
        rest, wires = self._beside()
        diagram = Diagram(self.whole.name).behind(self.whole.outside)
        diagram.extend(rest, [Connection(*one) for one in wires])
        draft = Draft(diagram, kinds)
        for share in draft.having(Element.SHARE):
            draft.connect(TERMINAL_VOLTAGE, *draft.targets(f"{share}.v"))
            draft.remove(share)
        return draft.diagram()

    def _beside(self) -> tuple[list[Instance], list[Wire]]:
        """Modules and wires of the other device."""
        wires = [(one.source, one.target) for one in self.whole.connections]
        rest = [one for one in self.whole.instances if one.name not in self.names]
        return rest, [ends for ends in wires if not _touches(ends, self.names)]


def device_parts(diagram: Diagram, kinds: Vocabulary) -> tuple[Device, ...]:
    """The devices of a legal diagram, in the order of their plants; none where there is no
    plant.
    """
    wiring = wire(diagram, kinds)
    if not any(kind.family == PLANT for kind in wiring.kinds.values()):
        return ()
    return tuple(_device(diagram, one) for one in wiring.devices)


def _device(diagram: Diagram, own: Wiring) -> Device:
    names = frozenset(own.kinds)
    if len(names) == len(diagram.instances):
        return Device(diagram, names, None, diagram)
    share = next(iter(own.having(Element.SHARE)), None)
    part = Diagram(diagram.name).behind(diagram.outside)
    wires = []
    for connection in diagram.connections:
        if (
            _touches((connection.source, connection.target), names)
            and split_port(connection.target)[0] != share
        ):
            from_share = share is not None and split_port(connection.source)[0] == share
            wires.append(
                Connection(TERMINAL_VOLTAGE, connection.target)
                if from_share
                else replace(connection, line=None)
            )
    part.extend(
        [one for one in diagram.instances if one.name in names and one.name != share], wires
    )
    return Device(diagram, names, share, part)


def _touches(ends: Wire, names: frozenset[str]) -> bool:
    return bool(names & {split_port(end)[0] for end in ends})


def _through(share: str, ends: Wire, draft: Draft) -> Wire:
    """A wire of the part as it is in the whole: the terminal voltage comes through the share, but
    for what is outside.
    """
    source, target = ends
    name = split_port(target)[0]
    outside = name and draft.kind(name).element is Element.SHUNT
    return (f"{share}.v", target) if source == TERMINAL_VOLTAGE and not outside else ends
