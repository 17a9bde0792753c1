"""The measured voltage: its filter, and whether it is that of the capacitor or of the PCC."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, cutoff
from ibrid.parts.editing.feedforward_path import feedforward
from ibrid.parts.editing.paths import command_entry, has_line, terminal_voltage
from ibrid.parts.editing.practice import Effect, Family
from ibrid.parts.editing.shaping import put_behind, shapers
from ibrid.parts.editing.view import Move, View, followers
from ibrid.parts.frames.sequence import locked_vector
from ibrid.parts.inner_loops.current_measurement import rewired
from ibrid.signals import Signal
from ibrid.structure.reading.wiring import split_port

CORNER = cutoff(2000, 500, 100)


def _voltage_sensor(view: View) -> Iterator[Move]:
    if not has_line(view):
        return
    both = (view.roles.voltage, terminal_voltage(view))
    for old, new in (both, both[::-1]):
        places: dict[str, list[str]] = {}
        present = feedforward(view)
        if present is not None and present.voltage == old:
            first = (
                f"{present.blocks[0]}.in_" if present.blocks else command_entry(view.draft, view)
            )
            places["the feedforward"] = [first]
        for name in view.roles.power:
            if old in view.draft.sources(f"{name}.e"):
                places[name] = [f"{name}.e"]
        locked = _locked(view, old)
        for what, targets in places.items():
            yield rewired("", old, new, targets, f"{what} takes {new} in place of {old}")
        for pll, entry in locked.items():
            yield _sensed(view, old, new, [], [entry], f"{pll} locks to {new} in place of {old}")
        if len(places) + len(locked) > 1:
            targets = [one for some in places.values() for one in some]
            yield _sensed(
                view,
                old,
                new,
                targets,
                [*locked.values()],
                f"all of them take {new} in place of {old}",
            )


def _locked(view: View, voltage: str) -> dict[str, str]:
    """PLL -> the scalar input that takes the q axis of a voltage on the way to it."""
    entries = {}
    for pll in view.draft.having(Element.PLL):
        entry, q_axis = locked_vector(view, pll) or ("", None)
        measured = view.draft.sources(f"{q_axis}.in_") if q_axis else [view.roles.voltage]
        if entry and voltage in measured:
            entries[pll] = entry
    return entries


def _sensed(
    view: View, old: str, new: str, targets: list[str], scalars: list[str], where: str
) -> Move:
    def draw(draft: Edit) -> None:
        draft.rewire(old, new, *targets)
        for entry in scalars:
            own = new == view.roles.voltage
            draft.drive(
                entry, f"{view.roles.plant}.e_q" if own else draft.after(new, "SliceQ", "v_q")
            )

    return Move.at("replace", where, draw)


VOLTAGE_SENSOR = Effect(
    id="voltage_sensor",
    law="the controller takes the PCC voltage where the model takes the capacitor's, or the other "
    "way round",
    places="at the feedforward, at the PLL, at the powers, at all of them",
    signature="from the PLL's bandwidth to the resonance; the more, the larger L_g is",
    confused_with=("pll_prefilter", "voltage_feedforward_filter"),
    told_apart_by="points at the resonance for the feedforward; operating points with different "
    "powers for the others",
    moves=_voltage_sensor,
)


def voltage_filter(view: View) -> Iterator[Move]:
    """On the measured voltage: in the feedforward, or for the whole controller."""
    voltage, bound = view.roles.voltage, followers(view.draft)
    targets = [target for target in view.draft.targets(voltage) if target not in bound]
    for kind in shapers(view, Signal.DQ_VEC):
        for target in targets:
            note = f"{kind} on the measured voltage to {split_port(target)[0]}"
            yield put_behind(note, voltage, kind, "voltage", CORNER, [target])
        if len(targets) > 1:
            yield put_behind(f"{kind} on the measured voltage", voltage, kind, "voltage", CORNER)


FAMILIES = (Family("voltage filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, voltage_filter),)
