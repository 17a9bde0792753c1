"""Feedback of the grid current as a voltage drop that is not there: the virtual impedance, and
other feedback of dq signals.
"""

from collections.abc import Iterator
from functools import partial

from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.paths import grid_current, join, loops, odd_signs, path
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.parts.frames.synchronisation import grid_forming
from ibrid.parts.inner_loops.decoupling import (
    REACTANCES,
    coupled,
    couplings_at_hand,
    other_form,
    virtual_reactances,
)
from ibrid.parts.plant.damping import damping_gains
from ibrid.signals import Signal

RESISTANCE = Strength((0.02, 0.07, 0.2), 0.0)


def _places(view: View) -> dict[str, str]:
    """Sums that a dq signal may be fed to, in words."""
    roles = view.roles
    places = {"voltage command": roles.command}
    if roles.voltage_loop:
        places["voltage reference"] = f"{roles.voltage_loop}.in_"
    if roles.current_loop:
        places["current reference"] = roles.reference
    return places


def _drops(view: View, target: str) -> list[str]:
    """Gains of the grid current alone and cross couplings of minus it that a sum gets, past the
    loops.
    """
    draft, i_g = view.draft, grid_current(view)
    drops = []
    for name in draft.having(Element.GAIN, *COUPLINGS):
        if draft.signal(f"{name}.in_") is Signal.SCALAR or name in (
            *damping_gains(view),
            *loops(view),
        ):
            continue
        before = path(draft, i_g, f"{name}.in_", without=loops(view))
        after = path(
            draft,
            f"{name}.out",
            target,
            without=[one for one in loops(view) if f"{one}.in_" != target],
        )
        if before is None or after is None:
            continue
        if view.element(name) is Element.GAIN or odd_signs(view, (*before, *after)):
            drops.append(name)
    return drops


def _virtual_impedance(view: View) -> Iterator[Move]:
    roles = view.roles
    if roles.current_loop is None and roles.voltage_loop is None and roles.frequency is None:
        return  # without any control a drop of the command is proportional current control
    for place, target in _places(view).items():
        where = f"{grid_current(view)} to the {place} at {target}"
        present = _drops(view, target)
        if present:
            without = f"{' and '.join(present)}, {where}"
            yield Move.at("remove", without, lambda draft, present=present: draft.remove(*present))
            for name in present:
                if view.element(name) in COUPLINGS and roles.frequency is not None:
                    words = (
                        f"{REACTANCES[view.element(name) is Element.COUPLING]} in place of "
                        f"{view.kind(name)} {name}"
                    )
                    if move := other_form(view, name, "virtual_reactance", f"{words}, {where}"):
                        yield move
        else:  # the controller's frequency where the model has that in another cross coupling
            measured = roles.frequency is not None and view.draft.having(
                Element.COUPLING_AT_FREQUENCY
            )
            for kind in REACTANCES if measured else REACTANCES[:1]:
                words = (
                    where
                    if kind == "JMul"
                    else f"{where}, with the controller's frequency ({kind})"
                )
                both = partial(
                    _drop,
                    view=view,
                    target=target,
                    resistance=True,
                    reactance=kind,
                    sign_last=False,
                )
                yield Move.at("add", words, both)
            if place != "current reference":
                alone = partial(
                    _drop, view=view, target=target, resistance=True, reactance="", sign_last=False
                )
                yield Move.at("add", f"{where}, its resistance alone", alone)


def _drop(
    draft: Edit, view: View, target: str, *, resistance: bool, reactance: str, sign_last: bool
) -> None:
    """A drop of the grid current taken off a sum: a resistance, a reactance of this kind ("":
    none), or both.

    sign_last : minus the drop rather than the drop of minus the current.
    """
    current = grid_current(view)
    source = current if sign_last else draft.negated(current)
    ports = (
        [draft.after(source, "Gain_dq", "virtual_resistance", k=RESISTANCE)] if resistance else []
    )
    ports += [coupled(draft, view, source, reactance, "virtual_reactance")] if reactance else []
    for port in ports:
        join(draft, view, draft.negated(port) if sign_last else port, target)


VIRTUAL_IMPEDANCE = Effect(
    id="virtual_impedance",
    law="(R_v I + X_v J) i_g subtracted from the voltage command or reference, or from the current "
    "reference; X_v at the "
    "nominal frequency (JMul) or at the controller's (JMul_omega)",
    places="from the grid current to the command, to the voltage loop's reference, to the current "
    "reference; or R_v alone",
    signature="10 Hz to 1 kHz; dd and qq by R_v, dq and qd by X_v, the same at every operating "
    "point",
    confused_with=("current_loop_missing", "dead_time", "decoupling"),
    told_apart_by="points below 10 Hz, where an integrating current loop hides a drop of the "
    "command and not one of its "
    "reference",
    moves=_virtual_impedance,
)


def virtual_drop(view: View) -> Iterator[Move]:
    """A voltage drop of the grid current taken off the voltage that a grid-forming controller
    makes.
    """
    roles = view.roles
    if roles.voltage_loop is None and roles.current_loop is not None:
        return  # there is no voltage to take it off
    target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.command
    draw = partial(_drop, view=view, target=target, sign_last=True)
    for kind in reversed(couplings_at_hand(view)):
        measured = view.draft.vocabulary[kind].element is Element.COUPLING_AT_FREQUENCY
        words = "a virtual reactance" + " with the controller's frequency" * measured
        yield Move(words, partial(draw, resistance=False, reactance=kind))
    if view.known("Gain_dq"):
        yield Move("a virtual resistance", partial(draw, resistance=True, reactance=""), 0.5)


def feedback(view: View) -> Iterator[Move]:
    """Further feedback of measured dq signals, as it is, scaled or crossed, wherever references and
    commands add up.
    """
    roles, grid = view.roles, grid_current(view)
    targets = {roles.command: "command", roles.reference: "current reference"}
    targets |= {f"{roles.voltage_loop}.in_": "voltage reference"} if roles.voltage_loop else {}
    signals = [(f"{roles.plant}.i_C", "capacitor current")] if roles.lcl else []
    signals += [(grid, "grid current"), (roles.voltage, "filter voltage")]
    for port, what in signals:
        for target, where in targets.items():
            if view.known("Gain_dq"):
                yield Move(
                    f"the {what} fed to the {where}",
                    partial(_scaled, view=view, port=port, target=target),
                )
            if view.known("JMul"):
                yield Move(
                    f"the crossed {what} fed to the {where}",
                    partial(_crossed, view=view, port=port, target=target),
                )
            if port == grid and target != roles.command:
                yield Move(
                    f"the {what} added to the {where}",
                    lambda draft, port=port, target=target: draft.connect(port, target),
                )


def _scaled(draft: Edit, view: View, port: str, target: str) -> None:
    join(
        draft,
        view,
        draft.after(port, "Gain_dq", "feedback", k=Strength((-0.3, -0.1, 0.1, 0.3), 0.0)),
        target,
    )


def _crossed(draft: Edit, view: View, port: str, target: str) -> None:
    join(draft, view, coupled(draft, view, port, "JMul", "feedback"), target)


def _virtual_or_following(view: View) -> bool:
    return bool(virtual_reactances(view)) or not grid_forming(view)


_BANDS = (1.0, 1.0, 0.5, 0.1)

FAMILIES = (
    Family(
        "virtual impedance",
        "module",
        _BANDS,
        4.0,
        where_missing(virtual_drop, _virtual_or_following),
    ),
    Family(
        "other virtual impedance",
        "module",
        _BANDS,
        0.2,
        where_present(virtual_drop, _virtual_or_following),
    ),
)
FEEDBACK = (Family("other feedback", "module", (0.3, 0.7, 1.0, 0.7), 0.7, feedback, usual=False),)
