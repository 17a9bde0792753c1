"""A block put on any wire, exchanged for another kind, or taken away: what has no name of its
own.
"""

from collections.abc import Iterator
from itertools import combinations

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.parts.editing.edit import Edit
from ibrid.parts.editing.practice import Family
from ibrid.parts.editing.shaping import ANYWHERE, STEMS, shape, shapers, stem
from ibrid.parts.editing.view import Move, View
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT
from ibrid.structure.reading.wiring import split_port

#: Kinds that take each other's place, by what they do.
EXCHANGES = (
    ("PI", "Gain", "Integrator"),
    ("PI_dq", "Gain_dq"),
    ("LPF1", "Notch", "Pade1"),
    ("LPF1_dq", "Delay", "Pade1_dq"),
    ("Gain_dq", "LPF1_dq"),
    ("Gain", "LPF1"),
)
#: Exchanges that often pay: something that fits anything for something with a meaning.
USUAL_EXCHANGES = {
    ("Notch", "LPF1"),
    ("Pade1", "LPF1"),
    ("Pade1_dq", "LPF1_dq"),
    ("Pade1_dq", "Delay"),
    ("Gain_dq", "PI_dq"),
    ("Gain", "PI"),
    ("Integrator", "PI"),
}


def exchange(view: View) -> Iterator[Move]:
    """Another kind of the same use in a block's place."""
    for name in view.draft.instances:
        does = view.shipped(name)
        for other in (
            other for group in EXCHANGES if does in group for other in group if other != does
        ):
            for kind in view.known(other):

                def swap(draft: Edit, name: str = name, kind: str = kind) -> None:
                    called = f"{name}_{kind.lower()}" if name in STEMS.values() else name
                    draft.replace(name, kind, called, **shape(draft, kind, ANYWHERE))

                weight = 2.0 if (does, other) in USUAL_EXCHANGES else 0.5
                yield Move(f"{kind} in place of the {view.kind(name)} {name}", swap, weight)


def removals(view: View) -> Iterator[Move]:
    """One block less: a block in line is bypassed or its path cut, any other goes with its path."""
    for name in view.draft.instances:
        kind = view.draft.kind(name)
        if name == view.roles.plant or kind.element in (Element.ZERO, Element.PACK, *ROTATIONS):
            continue
        if kind.in_line:
            yield Move(
                f"without the {kind.name} {name}", lambda draft, name=name: draft.bypass(name)
            )
        yield Move(f"without the path through {name}", lambda draft, name=name: draft.remove(name))


def twin_removals(view: View) -> Iterator[Move]:
    """Two blocks that share their parameters go together, as they came."""
    for block, twin in combinations(view.draft.instances, 2):
        kind = view.draft.kind(block)
        if (
            view.kind(twin) == kind.name
            and kind.in_line
            and kind.parameters
            and view.bound(block) == view.bound(twin)
        ):
            note = f"without the {kind.name}s {block} and {twin}"
            yield Move(note, lambda draft, block=block, twin=twin: draft.bypass(twin, block))


def any_wire(view: View) -> Iterator[Move]:
    """A shaper on any single wire: what the textbook has no name for."""
    for source, target in view.wires:
        name, port = split_port(target)
        if (
            target == TERMINAL_CURRENT
            or "delta" in port
            or port == "v_in"
            or view.element(name) is Element.DC_LINK
        ):
            continue
        for kind in shapers(view, view.draft.signal(source)):

            def put(
                draft: Edit, kind: str = kind, source: str = source, target: str = target
            ) -> None:
                draft.insert(source, [target], kind, stem(kind), **shape(draft, kind, ANYWHERE))

            yield Move(f"{kind} between {source} and {target}", put)


FAMILIES = (
    Family("exchange", "module", (0.5, 0.5, 0.5, 0.5), 3.0, exchange),
    Family("one block less", "module", (0.3, 0.3, 0.3, 0.3), 0.3, removals),
    Family("any wire", "module", (0.3, 0.3, 0.3, 0.3), 0.2, any_wire, usual=False),
)
