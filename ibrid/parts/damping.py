"""The filter's resonance damped by the controller: the capacitor's current, or the fast part of its voltage, fed back."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.edit import Edit, Strength, cutoff
from ibrid.parts.paths import grid_current, join, joins_command, loops, path
from ibrid.parts.practice import Effect, Family, where_missing
from ibrid.parts.view import Move, View
from ibrid.signals import Signal
from ibrid.structure.wiring import split_port


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


def _active_damping(view: View) -> Iterator[Move]:
    roles = view.roles
    if not roles.lcl:
        return
    present, i_c = damping_gains(view), f"{roles.plant}.i_C"
    where = f"{i_c} to {roles.command}"
    for name in present:
        yield Move.at("remove", f"{name}, {where}", lambda draft, name=name: draft.remove(name))
    for high_passed in (False, True) if not present else ():

        def damping(draft: Edit, high_passed: bool = high_passed) -> dict[str, Strength]:
            name, strengths = draft.add("Gain_dq", "active_damping"), {}
            draft.connect(draft.negated(i_c), f"{name}.in_")
            if high_passed:
                slow = draft.after(i_c, "LPF1_dq", "damping_filter")
                draft.connect(slow, f"{name}.in_")
                strengths = {f"{split_port(slow)[0]}.omega_c": cutoff(100, 200, 500, nothing=None)}
            join(draft, view, f"{name}.out")
            return {f"{name}.k": Strength((0.05, 0.2, 0.7), 0.0), **strengths}

        yield Move.at("add", f"{where}{', high-passed' * high_passed}", damping)


ACTIVE_DAMPING = Effect(
    id="active_damping",
    law="u_r -= k_ad (i_ti - i_g), or k_ad times that less its low-pass",
    places="from the capacitor's current to the command: plain, high-passed",
    signature="the resonance, usually 0.5 to 2 kHz; all entries alike, the same at every operating point",
    confused_with=("capacitor_damping", "current_sensor", "voltage_feedforward"),
    told_apart_by="ten points or more across the resonance; a delay of the command shows damping by the controller",
    moves=_active_damping,
)


def active_damping(view: View) -> Iterator[Move]:
    """By the capacitor's current, or by the fast part of its voltage, fed to the command; the sign is that of the gain."""
    roles = view.roles
    if not roles.lcl or not view.known("Gain_dq"):
        return

    def current(draft: Edit) -> None:
        join(draft, view, draft.after(f"{roles.plant}.i_C", "Gain_dq", "damping"))

    yield Move("active damping by the capacitor current", current)
    if view.known("LPF1_dq"):

        def fast(draft: Edit) -> None:
            slow, gain = draft.after(roles.voltage, "LPF1_dq", "damping_filter"), draft.add("Gain_dq", "damping")
            draft.chain(roles.voltage, f"{gain}.in_", draft.negated(slow), f"{gain}.in_")
            join(draft, view, f"{gain}.out")

        yield Move("active damping by the fast part of the filter voltage", fast)


def damped(view: View) -> bool:
    """True when a gain of the capacitor's current, or of the fast part of the voltage, acts on the command."""
    gains = [name for name in view.draft.having(Element.GAIN) if joins_command(view, f"{name}.out")]
    entering = [view.draft.sources(f"{name}.in_") for name in gains]
    return bool(damping_gains(view)) or any(view.roles.voltage in some and len(some) > 1 for some in entering)


FAMILIES = (
    Family("active damping", "module", (0.1, 0.5, 1.0, 1.0), 0.3, where_missing(active_damping, damped), if_gross=1.5),
)
