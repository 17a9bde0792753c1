"""The measured current: its filter, its delay, which current it is, and where it is taken."""

from collections.abc import Iterable, Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Strength, cutoff
from ibrid.parts.editing.paths import (
    current_entries,
    current_path,
    decouplings,
    grid_current,
    measured_current,
)
from ibrid.parts.editing.practice import Effect, Family
from ibrid.parts.editing.shaping import DELAY_TIME, in_line, put_behind, shapers
from ibrid.parts.editing.view import Move, View, of_circuit
from ibrid.parts.plant.command import DELAYS
from ibrid.signals import Signal
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port

CORNER = cutoff(4000, 1500, 500)


def _shaped(
    view: View,
    kind: str,
    stem: str,
    elements: tuple[Element, ...],
    says: str,
    **strengths: Strength,
):
    """A block on the measured current: for current loop and decoupling together, for the loop
    alone.
    """
    current = measured_current(view)
    present = [name for name in current_path(view) if view.element(name) in elements]
    places = {
        f"behind {current}, for {what}": lambda draft, entries=entries: draft.insert(
            current, entries, kind, stem, **strengths
        )
        for what, entries in current_entries(view).items()
    }
    return in_line(present, f"{{}}{says} {current}", places)


def _measurement_delay(view: View) -> Iterator[Move]:
    return _shaped(view, "Delay", "current_delay", DELAYS, ", which delays", T_d=DELAY_TIME)


MEASUREMENT_DELAY = Effect(
    id="measurement_delay",
    law="the controller gets exp(-s T_d) i, while voltages and powers come prompt",
    places="behind the measured current: for loop and decoupling together, for the loop alone",
    signature="100 Hz to 2 kHz; all entries alike, the same at every operating point; the "
    "feedforward stays prompt",
    confused_with=("control_delay", "current_filter", "delay_form"),
    told_apart_by="the top of the band, where the feedforward is delayed by a control delay and "
    "not by this one",
    moves=_measurement_delay,
)


def _current_filter(view: View) -> Iterator[Move]:
    filters = (Element.LOW_PASS,)
    for move in _shaped(view, "LPF1_dq", "current_filter", filters, " behind", omega_c=CORNER):
        yield move
        if move.change == "remove":
            yield from _other_extent(view, move.where.split()[0])


def _other_extent(view: View, name: str) -> Iterator[Move]:
    """The decoupling takes the filtered current where it took the other, or the other way round."""
    current, inputs = measured_current(view), [f"{one}.in_" for one in decouplings(view)]
    for old, new, what in (
        (f"{name}.out", current, "unfiltered"),
        (current, f"{name}.out", "filtered"),
    ):
        moved = [one for one in inputs if view.draft.sources(one) == [old]]
        if moved:
            yield rewired("", old, new, moved, where=f"the {what} current at {' and '.join(moved)}")


def rewired(note: str, old: str, new: str, targets: Iterable[str], where: str = "") -> Move:
    """Inputs that take one source take another."""
    return Move(note, lambda draft: draft.rewire(old, new, *targets), where=where)


CURRENT_FILTER = Effect(
    id="current_filter",
    law="the controller gets omega_c/(s + omega_c) i",
    places="behind the measured current: for loop and decoupling together, for the loop alone",
    signature="above 100 Hz, around the current loop's bandwidth; all entries alike, the same at "
    "every operating point",
    confused_with=(
        "command_filter",
        "control_delay",
        "current_sensor",
        "measurement_delay",
        "measurement_filter",
    ),
    told_apart_by="the resonance, where the feedforward is not filtered, and points above the "
    "corner frequency",
    moves=_current_filter,
)


def _current_sensor(view: View) -> Iterator[Move]:
    if not view.roles.lcl:
        return
    both = (view.roles.current, grid_current(view))
    measured = measured_current(view)
    other = both[1] if measured == both[0] else both[0]
    for what, entries in current_entries(view).items():
        yield rewired("", measured, other, entries, f"{other} in place of {measured} for {what}")
    for name in view.roles.power:
        for old, new in (both, both[::-1]):
            if old in view.draft.sources(f"{name}.i"):
                yield rewired("", old, new, [f"{name}.i"], f"{new} in place of {old} at {name}.i")


CURRENT_SENSOR = Effect(
    id="current_sensor",
    law="the controller takes the grid current where the model takes the converter's, or the other "
    "way round",
    places="at current loop and decoupling together, at the loop alone, at the powers",
    signature="above 200 Hz, most at the resonance; all entries alike. At the powers: below 50 Hz, "
    "qq",
    confused_with=("active_damping", "current_filter"),
    told_apart_by="ten points or more across the resonance",
    moves=_current_sensor,
)


def in_control(draft: Draft, source: str) -> list[str]:
    """Inputs of the controller that take a measured current, those of the powers left out."""
    powers = draft.having(Element.POWER)
    return [
        one
        for one in draft.targets(source)
        if not of_circuit(draft, one) and split_port(one)[0] not in powers
    ]


def current_filters(view: View) -> Iterator[Move]:
    """On the measured current: for the whole controller, or for one of its blocks."""
    current = view.roles.current
    control = in_control(view.draft, current)
    for kind in shapers(view, Signal.DQ_VEC) if control else ():
        yield put_behind(
            f"{kind} on the measured current", current, kind, "current", CORNER, control, 2.0
        )
        for target in control if len(control) > 1 else []:
            note = f"{kind} on the measured current to {split_port(target)[0]} alone"
            yield put_behind(note, current, kind, "current", CORNER, [target])


def other_current(view: View) -> Iterator[Move]:
    """The current loop measures the other one of converter and grid current; alone, or the whole
    controller does.
    """
    roles, draft = view.roles, view.draft
    if roles.current_loop is None or not roles.lcl:
        return
    both = (roles.current, grid_current(view))
    for old, new in (both, both[::-1]):
        for target in draft.targets(old):
            name, port = split_port(target)
            if name and view.element(name) in (Element.SIGN, Element.LOW_PASS) and port == "in_":
                yield rewired(f"{new} instead of {old} at {target}", old, new, [target])
        yield everywhere(old, new)


def everywhere(old: str, new: str) -> Move:
    """Another measured signal wherever the controller takes one."""
    words = f"{new} instead of {old} in the whole controller"
    return Move(words, lambda draft: draft.rewire(old, new, *in_control(draft, old)))


FAMILIES = (Family("current filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, current_filters),)
OTHER_CURRENT = (Family("other current", "local", (0.3, 0.6, 1.0, 0.7), 3.0, other_current),)
