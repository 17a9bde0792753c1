"""The loops of a controller as an engineer names them: synchronisation, current, voltage, power."""

from collections.abc import Mapping

from ibrid.errors import IbridError
from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.roles import roles
from ibrid.structure.reading.wiring import Wiring, owner_of, split_port, wire


def loops(diagram: Diagram, kinds: Vocabulary) -> Mapping[str, tuple[str, ...]]:
    """Name of a loop -> its modules, the regulator or what makes the frequency first; empty where
    nothing is recognised.

    With them are the blocks of one input and one output in front, back to a measurement, and the
    decoupling beside a regulator. Of several devices behind one PCC each has its loops, with its
    number behind their names.
    """
    try:
        parts = wire(diagram, kinds).devices
        if len(parts) == 1:
            return _of_one(diagram, kinds)
        each = [_of_one(_part(diagram, part), kinds) for part in parts]
    except (IbridError, KeyError):  # a diagram that the grammar refuses
        return {}
    return {
        f"{title} {number}": loop
        for number, own in enumerate(each, 1)
        for title, loop in own.items()
    }


def _part(diagram: Diagram, part: Wiring) -> Diagram:
    """The diagram of one device alone."""
    names = (*part.kinds, TERMINAL_VOLTAGE, TERMINAL_CURRENT)
    own = Diagram(diagram.name)
    own.extend(
        part.instances,
        [
            one
            for one in diagram.connections
            if owner_of(one.source) in names and owner_of(one.target) in names
        ],
    )
    return own


def _of_one(diagram: Diagram, kinds: Vocabulary) -> Mapping[str, tuple[str, ...]]:
    seen, draft = roles(diagram, kinds), Draft(diagram, kinds)
    if seen is None:
        return {}
    by_title: dict[str, tuple[str, ...]] = {}

    def put(title: str, *first: str | None, beside: str = "") -> None:
        names = [name for name in first if name]
        taken = {name for members in by_title.values() for name in members}
        for name in names:  # grows while it is walked
            names += [one for one in _before(draft, name) if one not in names]
        if beside and names:
            around = [split_port(one)[0] for one in draft.sources(beside)]
            names += [
                one
                for one in around
                if one and draft.kind(one).element in COUPLINGS and one not in names
            ]
        if kept := tuple(one for one in names if one not in taken):
            by_title[title] = kept

    if seen.frequency:
        pll = draft.kind(seen.frequency).element is Element.PLL
        put("PLL" if pll else "frequency", seen.frequency)
    put("current", seen.current_loop, beside=seen.command)
    put(
        "voltage",
        seen.voltage_loop,
        beside=f"{seen.current_loop}.in_" if seen.current_loop else seen.command,
    )
    put("power", *seen.outer, *seen.power)
    return by_title


def _before(draft: Draft, name: str) -> list[str]:
    """Blocks of one input and one output that drive a block and nothing else, and are no
    measurement.
    """
    sources = [one for port in draft.kind(name).inputs for one in draft.sources(f"{name}.{port}")]
    makers = dict.fromkeys(split_port(one)[0] for one in sources)
    return [
        one
        for one in makers
        if one
        and len(draft.kind(one).inputs) == len(draft.kind(one).outputs) == 1
        and len(
            [
                target
                for port in draft.kind(one).outputs
                for target in draft.targets(f"{one}.{port}")
            ]
        )
        == 1
        and not draft.kind(one).regulates
        and draft.kind(one).element not in (Element.PACK, Element.MAGNITUDE)
    ]
