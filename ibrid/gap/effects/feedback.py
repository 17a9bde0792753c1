"""Further feedback of currents: active damping by the capacitor's, a virtual impedance by the grid's."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.effects.current_control import NOMINAL
from ibrid.gap.paths import path
from ibrid.gap.places import grid_current, join, joins_command, loops
from ibrid.gap.strengths import cutoff


def _reaches(model: Model, port: str, name: str) -> bool:
    return path(model.draft, port, f"{name}.in_", without=loops(model)) is not None


def _damping_gains(model: Model) -> list[str]:
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
    present, i_c = _damping_gains(model), f"{roles.plant}.i_C"
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


def _places(model: Model) -> dict[str, str]:
    """Where a virtual voltage drop may act: in words -> the sum that takes it."""
    roles = model.roles
    found = {"voltage command": roles.command}
    if roles.voltage_loop:
        found["voltage reference"] = f"{roles.voltage_loop}.in_"
    if roles.current_loop:
        found["current reference"] = roles.reference
    return {f"the {words} at {port}": port for words, port in found.items()}


def _drops(model: Model, target: str) -> list[str]:
    """Gains of the grid current alone and cross couplings of minus it that a sum gets, past the loops."""
    draft, i_g = model.draft, grid_current(model)
    damping = _damping_gains(model)
    found = []
    for name in draft.named("Gain_dq", "JMul"):
        way = path(draft, i_g, f"{name}.in_", without=loops(model))
        negative = sum(draft.instances[one].kind == "Negate_dq" for one in way or ()) % 2 == 1
        crossed = draft.instances[name].kind == "JMul"
        if way is None or name in (*damping, *loops(model)) or (crossed and not negative):
            continue
        if (
            path(draft, f"{name}.out", target, without=[one for one in loops(model) if f"{one}.in_" != target])
            is not None
        ):
            found.append(name)
    return found


def _virtual_impedance(model: Model) -> Iterator[Insertion]:
    roles, i_g = model.roles, grid_current(model)
    if roles.current_loop is None and roles.voltage_loop is None and roles.frequency is None:
        return  # without any control a drop of the command is proportional current control
    for where, target in _places(model).items():
        present = _drops(model, target)
        if present:

            def without(draft: Edit, present: list[str] = present) -> None:
                for name in present:
                    draft.remove(name)

            yield from model.edited(
                "virtual_impedance", "remove", f"{' and '.join(present)}, {i_g} to {where}", without
            )
            continue

        def drop(draft: Edit, target: str = target) -> dict[str, Strength]:
            minus = draft.negated(i_g)
            resistance, reactance = draft.add("Gain_dq", "virtual_resistance"), draft.add("JMul", "virtual_reactance")
            for name in (resistance, reactance):
                draft.connect(minus, f"{name}.in_")
                join(draft, f"{name}.out", target, roles.command)
            couplings = tuple(one / NOMINAL for one in (0.03, 0.1, 0.3))
            return {
                f"{resistance}.k": Strength((0.02, 0.07, 0.2), 0.0),
                f"{reactance}.L": Strength(couplings, 0.0),
            }

        yield from model.edited("virtual_impedance", "add", f"{i_g} to {where}", drop)


VIRTUAL_IMPEDANCE = Effect(
    id="virtual_impedance",
    law="(R_v I + X_v J) i_g subtracted from the voltage command or reference, or from the current reference",
    places="from the grid current to the command, to the voltage loop's reference, to the current reference",
    signature="10 Hz to 1 kHz; dd and qq by R_v, dq and qd by X_v, the same at every operating point",
    confused_with=("current_loop_missing", "decoupling"),
    told_apart_by="points below 10 Hz, where an integrating current loop hides a drop of the command and not one of its "
    "reference",
    insertions=_virtual_impedance,
)
