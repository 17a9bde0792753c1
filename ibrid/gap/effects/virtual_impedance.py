"""Feedback of the grid current as a voltage drop that is not there: the virtual impedance."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.effects.current_control import cross_coupling, other_form
from ibrid.gap.effects.feedback import damping_gains
from ibrid.gap.paths import path
from ibrid.gap.places import grid_current, join, loops

#: Kinds of a reactance, at the nominal frequency and at the controller's.
REACTANCES = ("JMul", "JMul_omega")


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
    found = []
    for name in draft.named("Gain_dq", *REACTANCES):
        if name in (*damping_gains(model), *loops(model)):
            continue
        before = path(draft, i_g, f"{name}.in_", without=loops(model))
        after = path(draft, f"{name}.out", target, without=[one for one in loops(model) if f"{one}.in_" != target])
        if before is None or after is None:
            continue
        signs = [one for one in (*before, *after) if draft.instances[one].kind == "Negate_dq"]
        if draft.instances[name].kind == "Gain_dq" or len(signs) % 2 == 1:
            found.append(name)
    return found


def _virtual_impedance(model: Model) -> Iterator[Insertion]:
    roles = model.roles
    if roles.current_loop is None and roles.voltage_loop is None and roles.frequency is None:
        return  # without any control a drop of the command is proportional current control
    for where, target in _places(model).items():
        where = f"{grid_current(model)} to {where}"
        present = _drops(model, target)
        if present:

            def without(draft: Edit, present: list[str] = present) -> None:
                for name in present:
                    draft.remove(name)

            yield from model.edited("virtual_impedance", "remove", f"{' and '.join(present)}, {where}", without)
            yield from _other_forms(model, present, where)
            continue
        for kind in _forms(model):
            words = where if kind == "JMul" else f"{where}, with the controller's frequency ({kind})"
            yield from model.edited("virtual_impedance", "add", words, _drop(model, target, kind))


def _forms(model: Model) -> tuple[str, ...]:
    """The nominal frequency; the controller's where the model has that in another cross coupling."""
    return REACTANCES if model.roles.frequency is not None and model.draft.named("JMul_omega") else REACTANCES[:1]


def _drop(model: Model, target: str, kind: str):
    def drop(draft: Edit) -> dict[str, Strength]:
        minus = draft.negated(grid_current(model))
        resistance, reactance = draft.add("Gain_dq", "virtual_resistance"), draft.add(kind, "virtual_reactance")
        for name in (resistance, reactance):
            draft.connect(minus, f"{name}.in_")
            join(draft, f"{name}.out", target, model.roles.command)
        return {
            f"{resistance}.k": Strength((0.02, 0.07, 0.2), 0.0),
            **cross_coupling(draft, model, reactance, kind, vanishes=True),
        }

    return drop


def _other_forms(model: Model, present: list[str], where: str) -> Iterator[Insertion]:
    """A reactance with the controller's frequency for one with the nominal frequency, or the other way round."""
    for name in present:
        kind = model.draft.instances[name].kind
        if kind not in REACTANCES or model.roles.frequency is None:
            continue
        other = REACTANCES[kind == "JMul"]
        words = f"{other} in place of {kind} {name}, {where}"
        edit = other_form(model, name, other, stem="virtual_reactance")
        yield from model.edited("virtual_impedance", "replace", words, edit)


VIRTUAL_IMPEDANCE = Effect(
    id="virtual_impedance",
    law="(R_v I + X_v J) i_g subtracted from the voltage command or reference, or from the current reference; X_v at the "
    "nominal frequency (JMul) or at the controller's (JMul_omega)",
    places="from the grid current to the command, to the voltage loop's reference, to the current reference",
    signature="10 Hz to 1 kHz; dd and qq by R_v, dq and qd by X_v, the same at every operating point",
    confused_with=("current_loop_missing", "decoupling"),
    told_apart_by="points below 10 Hz, where an integrating current loop hides a drop of the command and not one of its "
    "reference",
    insertions=_virtual_impedance,
)
