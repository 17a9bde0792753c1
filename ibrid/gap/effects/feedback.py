"""Feedback of the capacitor's current: active damping."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.paths import path
from ibrid.gap.places import join, joins_command, loops
from ibrid.gap.strengths import cutoff


def _reaches(model: Model, port: str, name: str) -> bool:
    return path(model.draft, port, f"{name}.in_", without=loops(model)) is not None


def damping_gains(model: Model) -> list[str]:
    """Gains that add the capacitor's current, or the difference of the others, to the command."""
    if not model.roles.lcl:
        return []
    i_c, i_ti, i_g = (f"{model.roles.plant}.{port}" for port in ("i_C", "i_ti", "i_g"))
    return [
        name
        for name in model.draft.named("Gain_dq")
        if name not in loops(model)
        and joins_command(model, f"{name}.out")
        and (_reaches(model, i_c, name) or (_reaches(model, i_ti, name) and _reaches(model, i_g, name)))
    ]


def _active_damping(model: Model) -> Iterator[Insertion]:
    roles = model.roles
    if not roles.lcl:
        return
    present, i_c = damping_gains(model), f"{roles.plant}.i_C"
    where = f"{i_c} to {roles.command}"
    for name in present:
        yield from model.edited(
            "active_damping", "remove", f"{name}, {where}", lambda draft, name=name: draft.remove(name)
        )
    for high_passed in (False, True) if not present else ():

        def damping(draft: Edit, high_passed: bool = high_passed) -> dict[str, Strength]:
            name, strengths = draft.add("Gain_dq", "active_damping"), {}
            draft.connect(draft.negated(i_c), f"{name}.in_")
            if high_passed:
                slow = draft.add("LPF1_dq", "damping_filter")
                draft.chain(i_c, f"{slow}.in_", f"{slow}.out", f"{name}.in_")
                strengths = {f"{slow}.omega_c": Strength(cutoff(100, 200, 500).bank)}
            join(draft, f"{name}.out", roles.command, roles.command)
            return {f"{name}.k": Strength((0.05, 0.2, 0.7), 0.0), **strengths}

        yield from model.edited("active_damping", "add", f"{where}{', high-passed' * high_passed}", damping)


ACTIVE_DAMPING = Effect(
    id="active_damping",
    law="u_r -= k_ad (i_ti - i_g), or k_ad times that less its low-pass",
    places="from the capacitor's current to the command: plain, high-passed",
    signature="the resonance, usually 0.5 to 2 kHz; all entries alike, the same at every operating point",
    confused_with=("capacitor_damping", "current_sensor", "voltage_feedforward"),
    told_apart_by="ten points or more across the resonance; a delay of the command shows damping by the controller",
    insertions=_active_damping,
)
