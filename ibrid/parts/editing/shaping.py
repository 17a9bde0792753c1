"""Filters and delays put in line on a signal, and taken out again: what ideas about them have in
common.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping

from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.editing.edit import Edit, Strength, cutoff, stands_for
from ibrid.parts.editing.view import Change, Move, View
from ibrid.signals import Signal

#: Blocks that shape a signal on its way, most usual first.
SHAPERS = {
    Signal.SCALAR: ("LPF1", "Notch", "Pade1"),
    Signal.DQ_VEC: ("LPF1_dq", "Delay", "Pade1_dq"),
}
#: How usual a shaper is, where it is not 1.
UNUSUAL = {"Notch": 0.25, "Pade1": 0.25, "Pade1_dq": 0.25}
#: Names for blocks that are put in, by kind.
STEMS = {
    "LPF1": "filter",
    "LPF1_dq": "filter",
    "Notch": "notch",
    "Pade1": "delay",
    "Pade1_dq": "delay",
    "Delay": "delay",
}
SHIPPED = {kind.name for kind in VOCABULARY}

DELAY_TIME = Strength((5e-5, 1.5e-4, 4e-4), 0.0)
NOTCH = {
    "omega_n": Strength(cutoff(120, 120, 60, 300).bank),
    "Q": Strength((4.0, 1.0, 0.7, 0.7), 1e12),
}
#: Corner frequencies where nothing is known about the place.
ANYWHERE = cutoff(2000, 200, 10)


def shapers(view: View, signal: Signal) -> tuple[str, ...]:
    """Filters and delays for a signal: the usual ones and in-line kinds of the user's own with
    parameters.
    """
    usual = view.known(*SHAPERS[signal])
    fitting = (kind for kind in view.kinds if kind.in_line and kind.signal is signal)
    return (
        *usual,
        *(
            kind.name
            for kind in fitting
            if stands_for(kind) == kind.name and kind.name not in SHIPPED
        ),
    )


def usual(kind: str) -> float:
    """How usual a shaper is."""
    return UNUSUAL.get(kind, 1.0)


def stem(kind: str) -> str:
    """What a shaper is called."""
    return STEMS.get(kind, kind.lower())


def shape(draft: Edit, kind: str, corner: Strength) -> dict[str, Strength]:
    """Strengths of a shaper. corner : of a low-pass at its place."""
    declared = draft.vocabulary.get(kind)
    usually = {
        "LPF1": {"omega_c": corner},
        "Notch": NOTCH,
        "Delay": {"T_d": DELAY_TIME},
        "Pade1": {"T_d": DELAY_TIME},
    }
    return usually.get((stands_for(declared) if declared else kind).removesuffix("_dq"), {})


def put_before(note: str, target: str, kind: str, place: str, corner: Strength) -> Move:
    """A shaper between an input and the sum of all that drives it, named after its place."""
    name = f"{place}_{stem(kind)}"
    return Move(
        note,
        lambda draft: draft.insert_before(target, kind, name, **shape(draft, kind, corner)),
        usual(kind),
    )


def put_behind(
    note: str,
    source: str,
    kind: str,
    place: str,
    corner: Strength,
    targets: Iterable[str] = (),
    weight: float = 1.0,
) -> Move:
    """A shaper between an output and all that takes it, or some of that."""
    name = f"{place}_{stem(kind)}"
    return Move(
        note,
        lambda draft: draft.insert(
            source, targets or draft.targets(source), kind, name, **shape(draft, kind, corner)
        ),
        weight * usual(kind),
    )


def bypassed(name: str, where: str, change: Change = "remove") -> Move:
    """An effect's move: a module taken out of its path."""
    return Move.at(change, where, lambda draft: draft.bypass(name))


def in_line(
    present: Iterable[str], says: str, places: Mapping[str, Callable[[Edit], object]]
) -> Iterator[Move]:
    """An effect that is a block in line: taken out where it is present, else put in at each place.

    present : names of such blocks. says : what is said of one, with its name in braces. places : in
    words -> puts the block in.
    """
    present = list(present)
    for name in present:
        yield bypassed(name, says.format(name))
    for where, put in places.items() if not present else ():
        yield Move.at("add", where, put)
