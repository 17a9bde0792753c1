"""Filters of the outer loops: on the measured powers, and behind the loops on the current
reference.
"""

from collections.abc import Iterator, Sequence
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, cutoff
from ibrid.parts.editing.paths import packs, path
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.shaping import in_line, put_behind, shape, shapers, stem, usual
from ibrid.parts.editing.view import Move, View
from ibrid.signals import Signal
from ibrid.structure.reading.wiring import split_port

CORNER = cutoff(100, 30, 8)


def _power_filter(view: View) -> Iterator[Move]:
    for block in view.roles.power:
        used = [axis for axis in "pq" if view.draft.targets(f"{block}.{axis}")]
        there = {axis: name for axis in used if (name := _filter_of(view, f"{block}.{axis}"))}
        if there:
            yield _without([*there.values()], f"{' and '.join(there.values())} behind {block}")
            for axis, name in there.items() if len(there) > 1 else ():
                yield _without([name], f"{name} behind {block}.{axis}, the other stays")
        free = [axis for axis in used if axis not in there]
        for axes in dict.fromkeys((tuple(free), *((axis,) for axis in free))) if free else ():
            words = " and ".join(f"{block}.{axis}" for axis in axes)
            where = f"behind {words}" + (", one corner frequency" if len(axes) > 1 else "")

            yield Move.at("add", where, partial(_put, block=block, axes=axes, kind="LPF1"))


def _filter_of(view: View, power: str) -> str | None:
    """The low-pass right behind a power, if there is one that everything takes."""
    targets = view.draft.targets(power)
    name = split_port(targets[0])[0]
    return name if len(targets) == 1 and view.element(name) is Element.LOW_PASS else None


def _without(names: Sequence[str], where: str) -> Move:
    last_first = tuple(reversed(names))  # the first lends its parameters to the others
    return Move.at("remove", where, lambda draft: draft.bypass(*last_first))


def _put(draft: Edit, block: str, axes: Sequence[str], kind: str) -> None:
    """A shaper behind each power, with parameters in common."""
    names = [
        draft.insert(
            port,
            draft.targets(port),
            kind,
            f"{port[-1]}_{stem(kind)}",
            **shape(draft, kind, CORNER),
        )
        for port in (f"{block}.{axis}" for axis in axes)
    ]
    shared = draft.free_name(f"power_{stem(kind)}")
    for name in names if len(names) > 1 else ():
        draft.bind(name, **{key: f"{shared}.{key}" for key in draft.kind(name).parameters})


POWER_FILTER = Effect(
    id="power_filter",
    law="the loops take omega_c/(s + omega_c) of p and q, one corner frequency",
    places="behind p and q together, behind one of them",
    signature="below 100 Hz, around the corner frequency; all entries, in proportion to voltage "
    "and current at rest",
    confused_with=("power_gains", "reference_filter"),
    told_apart_by="nothing at the terminals when one filter serves both axes: ask for the "
    "firmware's block diagram, or "
    "step a reference",
    moves=_power_filter,
)


def _reference_filter(view: View) -> Iterator[Move]:
    reference = view.roles.reference
    for pack in packs(view):
        port = f"{pack}.out"
        present = [
            name
            for name in path(view.draft, port, reference) or ()
            if view.element(name) is Element.LOW_PASS
        ]
        places = {
            f"behind {port}": lambda draft, port=port: draft.insert(
                port, draft.targets(port), "LPF1_dq", "reference_filter", omega_c=CORNER
            )
        }
        yield from in_line(present, f"{{}} between {port} and {reference}", places)


REFERENCE_FILTER = Effect(
    id="reference_filter",
    law="i_ref = omega_c/(s + omega_c) (the outer loops' output)",
    places="between the outer loops and the current loop",
    signature="as a filter of p and q with one corner frequency: the two commute with the loops",
    confused_with=("power_filter",),
    told_apart_by="a step of the current reference; at the terminals only loops that differ on the "
    "two axes",
    moves=_reference_filter,
)


def power_filters(view: View) -> Iterator[Move]:
    """On the measured powers: both with one parameter, or one of them."""
    for block in view.roles.power:
        used = [axis for axis in "pq" if view.draft.targets(f"{block}.{axis}")]
        for kind in shapers(view, Signal.SCALAR):
            both = partial(_put, block=block, axes=used, kind=kind)
            yield Move(f"{kind} on the measured powers", both, 2 * usual(kind))
            for axis in used:
                yield put_behind(f"{kind} on {axis}", f"{block}.{axis}", kind, axis, CORNER)


def filtered_powers(view: View) -> bool:
    """True when a measured power is filtered."""
    targets = [
        target
        for name in view.roles.power
        for axis in "pq"
        for target in view.draft.targets(f"{name}.{axis}")
    ]
    return any(view.draft.kind(split_port(target)[0]).shapes for target in targets)


_BANDS = (0.5, 1.0, 0.3, 0.1)

FAMILIES = (
    Family("power filters", "module", _BANDS, 4.0, where_missing(power_filters, filtered_powers)),
    Family(
        "other power filters", "module", _BANDS, 0.5, where_present(power_filters, filtered_powers)
    ),
)
