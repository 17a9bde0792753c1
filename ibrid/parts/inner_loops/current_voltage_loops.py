"""The inner loops of current and voltage, each added or taken away whole."""

from collections.abc import Iterator
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, pi_gains
from ibrid.parts.editing.paths import (
    command_entry,
    current_path,
    grid_current,
    has_line,
    measured_current,
)
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.parts.frames.synchronisation import grid_forming
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port


def _current_loop(view: View) -> Iterator[Move]:
    roles = view.roles
    loop = roles.current_loop
    if loop is not None:
        way = current_path(view)
        source = f"{way[-2]}.out" if len(way) > 1 else measured_current(view)

        def without(draft: Edit) -> None:
            draft.disconnect(source, f"{loop}.in_")
            draft.bypass(loop)

        yield Move.at("remove", f"{loop}, so that its reference is the command", without)
        return
    currents = (roles.current, grid_current(view)) if has_line(view) else (roles.current,)
    for current in dict.fromkeys(currents):
        for reference, how in _REFERENCES.items():
            added = partial(_loop, view=view, current=current, reference=reference)
            yield Move.at("add", f"{current} to {roles.command}, {how}", added)


_REFERENCES = {
    "none": "beside what drives the command",
    "all": "with what drove the command as its reference",
    "outer": "with the outer loops as its reference, beside what else drives the command",
}


def _loop(draft: Edit, view: View, current: str, reference: str) -> None:
    """A PI controller of minus a current that drives the command.

    reference : what of that which drove the command becomes the loop's: "none" (it stays beside),
    "outer" (what comes from outer loops; the rest stays beside), "packed" (the same; the rest goes)
    or "all".
    """
    gains = pi_gains((0.1, 0.4, 1.0), (5.0, 20.0, 100.0), vanishes=reference == "none")
    entry, name = command_entry(draft, view), draft.add("PI_dq", "current", **gains)
    for source in draft.sources(entry) if reference != "none" else []:
        outer = _packed(draft, source)
        if outer or reference != "outer":
            draft.disconnect(source, entry)
        if outer or reference == "all":
            draft.connect(source, f"{name}.in_")
    draft.chain(draft.negated(current), f"{name}.in_", f"{name}.out", entry)


CURRENT_LOOP_MISSING = Effect(
    id="current_loop_missing",
    law="u_r = (k_P + k_I/s)(i_ref - i)",
    places="between the current reference and the command",
    signature="everywhere below 1 kHz; dd and qq alike, the same at every operating point",
    confused_with=("virtual_impedance",),
    told_apart_by="points below 50 Hz, where an integrating loop leaves no admittance",
    moves=_current_loop,
)


def current_loop(view: View) -> Iterator[Move]:
    """A PI controller of the measured current; what drove the command becomes its reference or
    stays beside it.

    Alone it keeps of that only what comes from outer loops, as its reference.
    """
    roles = view.roles
    if roles.current_loop is not None or not view.known("PI_dq"):
        return
    currents = [(roles.current, "converter current" if roles.lcl else "current")]
    if roles.lcl:
        currents.append((grid_current(view), "grid current"))
    ways = {
        "alone": ("packed", 2.0),
        "with the old command as its reference": ("all", 0.5),
        "beside the old command": ("none", 0.5),
    }
    for port, words in currents:
        for what, (reference, usual) in ways.items():
            loop = partial(_loop, view=view, current=port, reference=reference)
            yield Move(f"a PI controller of the {words}, {what}", loop, usual)


def _packed(draft: Draft, source: str) -> bool:
    """True for what comes from a pack of two axes, as references of outer loops do."""
    name = split_port(source)[0]
    return bool(name) and draft.kind(name).element is Element.PACK


def voltage_loop(view: View) -> Iterator[Move]:
    """A PI controller of the filter's voltage in front of the current loop or on the command
    (grid-forming).
    """
    roles = view.roles
    if roles.voltage_loop is not None or not roles.lcl or not view.known("PI_dq"):
        return
    ways = ["with the outer loops as its reference", "beside the outer loops"]
    if any(view.element(name) is Element.PI for name in roles.outer):
        ways.append("in place of the outer loops")
    for what in ways:

        def loop(draft: Edit, what: str = what) -> None:
            name = draft.add("PI_dq", "voltage", **pi_gains((0.2, 0.5, 1.5), (10.0, 70.0, 500.0)))
            if what == "in place of the outer loops":
                draft.remove(*roles.outer)
            for source in draft.sources(roles.reference) if what.startswith("with") else []:
                if _packed(draft, source):
                    draft.disconnect(source, roles.reference)
                    draft.connect(source, f"{name}.in_")
            draft.chain(draft.negated(roles.voltage), f"{name}.in_", f"{name}.out", roles.reference)

        yield Move(f"a PI controller of the filter voltage, {what}", loop)


def loop_removals(view: View) -> Iterator[Move]:
    """One loop less; its reference takes its place."""
    roles = view.roles
    inner = (
        (roles.current_loop, "current", roles.current),
        (roles.voltage_loop, "voltage", roles.voltage),
    )
    for name, words, port in inner:
        if name is None:
            continue

        def drop(draft: Edit, name: str = name, port: str = port) -> None:
            for source in draft.sources(f"{name}.in_"):
                before = split_port(source)[0]
                if (
                    before
                    and draft.kind(before).element is Element.SIGN
                    and port in draft.sources(f"{before}.in_")
                ):
                    draft.disconnect(source, f"{name}.in_")
            draft.bypass(name)

        yield Move(f"no {words} loop", drop)
    for name in roles.outer:
        yield Move(
            f"without {name}, an outer {view.kind(name)}",
            lambda draft, name=name: draft.remove(name),
        )
    if len(roles.outer) > 1:
        yield Move("without outer loops", lambda draft: draft.remove(*roles.outer))


_BANDS = (1.0, 1.0, 0.5, 0.1)
_ALONE = where_present(voltage_loop, lambda view: grid_forming(view) and not view.roles.outer)
_BESIDE = where_present(voltage_loop, lambda view: grid_forming(view) and bool(view.roles.outer))

#: A grid-forming inverter controls the voltage of a capacitor, so the filter comes before that
#: loop.
FAMILIES = (
    Family("current loop", "structural", (0.5, 1.0, 1.0, 0.5), 9.0, current_loop, True),
    Family("voltage loop", "structural", _BANDS, 9.0, _ALONE, True),
    Family("voltage loop too", "structural", _BANDS, 6.0, _BESIDE),
    Family(
        "other voltage loop",
        "structural",
        _BANDS,
        0.3,
        where_missing(voltage_loop, grid_forming),
        if_gross=1.5,
    ),
)
LESS = (
    Family("one loop less", "structural", (0.5, 0.5, 0.3, 0.2), 0.3, loop_removals, if_gross=0.5),
)
