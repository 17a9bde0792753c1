"""The filter's resonance damped by the controller: the capacitor's current, or the fast part of its
voltage, fed back.
"""

from collections.abc import Iterator
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff
from ibrid.parts.editing.paths import grid_current, join, joins_command, loops, path
from ibrid.parts.editing.practice import Effect, Family, where_missing
from ibrid.parts.editing.view import Move, View
from ibrid.signals import Signal


def damping_gains(view: View) -> list[str]:
    """Gains that add the capacitor's current, or the difference of the others, to the command."""
    if not view.roles.lcl:
        return []
    i_c, i_ti, i_g = f"{view.roles.plant}.i_C", view.roles.current, grid_current(view)

    def reaches(port: str, name: str) -> bool:
        return path(view.draft, port, f"{name}.in_", without=loops(view)) is not None

    return [
        name
        for name in view.draft.having(Element.GAIN, signal=Signal.DQ_VEC)
        if name not in loops(view)
        and joins_command(view, f"{name}.out")
        and (reaches(i_c, name) or (reaches(i_ti, name) and reaches(i_g, name)))
    ]


def active_damping(view: View) -> Iterator[Move]:
    """By the capacitor's current, or by the fast part of it or of its voltage, fed to the command.

    An effect has its gain in the sense of its law, above zero; of what a search tries the gain
    carries the sign.
    """
    roles = view.roles
    if not roles.lcl:
        return
    present, i_c = damping_gains(view), f"{roles.plant}.i_C"
    where = f"{i_c} to {roles.command}"
    for name in present:
        yield Move.at("remove", f"{name}, {where}", lambda draft, name=name: draft.remove(name))
    for fast in (False, True) if not present else ():
        yield Move.at(
            "add",
            f"{where}{', high-passed' * fast}",
            partial(_damp, view=view, port=i_c, fast=fast),
        )
    if view.known("Gain_dq"):
        signed = partial(_damp, view=view, signed=True)
        yield Move("active damping by the capacitor current", partial(signed, port=i_c, fast=False))
        if view.known("LPF1_dq"):
            fast = partial(signed, port=roles.voltage, fast=True)
            yield Move("active damping by the fast part of the filter voltage", fast)


def _damp(draft: Edit, view: View, port: str, *, fast: bool, signed: bool = False) -> None:
    """Minus a gain of a signal, or of that less its low-pass, added to the command; `signed` : the
    gain has the sign.
    """
    strength = Strength((-0.05, -0.2, -0.7), 0.0) if signed else Strength((0.05, 0.2, 0.7), 0.0)
    gain = draft.add("Gain_dq", "damping" if signed else "active_damping", k=strength)
    draft.connect(port if signed else draft.negated(port), f"{gain}.in_")
    if fast:
        corner = cutoff(*((200, 40, 8) if signed else (100, 200, 500)), nothing=None)
        slow = draft.after(port, "LPF1_dq", "damping_filter", omega_c=corner)
        draft.connect(draft.negated(slow) if signed else slow, f"{gain}.in_")
    join(draft, view, f"{gain}.out")


ACTIVE_DAMPING = Effect(
    id="active_damping",
    law="u_r -= k_ad (i_ti - i_g), or k_ad times that less its low-pass",
    places="from the capacitor's current to the command: plain, high-passed",
    signature="the resonance, usually 0.5 to 2 kHz; all entries alike, the same at every operating "
    "point",
    confused_with=("capacitor_damping", "current_sensor", "voltage_feedforward"),
    told_apart_by="ten points or more across the resonance; a delay of the command shows damping "
    "by the controller",
    moves=active_damping,
)


def damped(view: View) -> bool:
    """True when a gain of the capacitor's current, or of the fast part of the voltage, acts on the
    command.
    """
    gains = [name for name in view.draft.having(Element.GAIN) if joins_command(view, f"{name}.out")]
    entering = [view.draft.sources(f"{name}.in_") for name in gains]
    return bool(damping_gains(view)) or any(
        view.roles.voltage in some and len(some) > 1 for some in entering
    )


FAMILIES = (
    Family(
        "active damping",
        "module",
        (0.1, 0.5, 1.0, 1.0),
        0.3,
        where_missing(active_damping, damped),
        if_gross=1.5,
    ),
)
