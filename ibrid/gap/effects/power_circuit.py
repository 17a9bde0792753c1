"""What is built rather than programmed: line, shunt and capacitor branches, and the frame of the measurement."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength, no_edit
from ibrid.gap.places import has_line
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import split_port, wire

LINE = {"L_g": Strength((0.03, 0.1, 0.3), 0.0), "R_g": Strength((0.003, 0.01, 0.03), 0.0)}


def _exchange_plant(draft: Edit, plant: str, kind: str) -> None:
    """Another plant under the old name; parameters that both have keep what they were bound to."""
    bindings = draft.instances[plant].bindings
    draft.rename(draft.replace(plant, kind, "plant_to_be"), plant)
    draft.bind(plant, **{key: value for key, value in bindings.items() if key in draft.kind(plant).parameters})


def _control_inputs(model: Model, port: str) -> list[str]:
    """Inputs of the controller that a plant signal drives directly."""
    apart = ("Rot_i", "PQ_calc", "DC_link")
    targets = (one for one in model.draft.targets(port) if one != TERMINAL_CURRENT)
    return [one for one in targets if model.draft.instances[split_port(one)[0]].kind not in apart]


def _kind(model: Model) -> str:
    return model.draft.instances[model.roles.plant].kind


def _plant(model: Model, kind: str, strengths: dict[str, Strength]):
    """Another plant, with strengths for its new parameters."""

    def edit(draft: Edit) -> dict[str, Strength]:
        _exchange_plant(draft, model.roles.plant, kind)
        return {f"{model.roles.plant}.{key}": strength for key, strength in strengths.items()}

    return edit


def _series_impedance(model: Model) -> Iterator[Insertion]:
    plant = model.roles.plant
    if _kind(model) == "LFilter" and not _absorbed(model):
        where = f"between {plant}.e and {plant}.v_in"
        yield from model.edited("series_impedance", "add", where, _plant(model, "LLFilter", LINE))
    if _kind(model) == "LLFilter":
        where = f"L_g, R_g of {plant}, so that e is the PCC voltage"
        yield from model.edited("series_impedance", "remove", where, _plant(model, "LFilter", {}))
    bindings = model.draft.instances[plant].bindings
    fixed = {key: value for key in ("L_g", "R_g") if isinstance(value := bindings.get(key), float)}
    if fixed:

        def freed(draft: Edit) -> dict[str, Strength]:
            draft.unbind(plant, *fixed)
            return {f"{plant}.{key}": Strength((1.3 * one, 2 * one, 4 * one), one) for key, one in fixed.items()}

        where = f"{' and '.join(fixed)} of {plant}, which the program fixes"
        yield from model.edited("series_impedance", "add", where, freed)


def _absorbed(model: Model) -> tuple[str, ...]:
    """The inductance and resistance that a line in front of the PCC adds to; () where the measured voltage lies between."""
    plant = model.roles.plant
    measured = [one for port in ("e", "e_q") for one in model.draft.targets(f"{plant}.{port}")]
    if has_line(model):
        names = ("L_g", "R_g")
    elif not measured:
        names = ("L_F", "R_F")
    else:
        return ()
    table = parameter_table(wire(model.diagram, model.kinds), "exact")
    bound = (table.of(plant, name) for name in names)
    return tuple(one for one in bound if isinstance(one, str))


SERIES_IMPEDANCE = Effect(
    id="series_impedance",
    law="v_PCC = v - (R + L (s/omega_0 I + J)) i_g, a line or transformer in front of the PCC",
    places="between an L filter's measured voltage and the PCC; behind an LCL it is a change of L_g and R_g",
    signature="100 Hz to 2 kHz: the resonance moves; the same at every operating point",
    confused_with=("filter_capacitor",),
    told_apart_by="behind an LCL nothing: L_g and R_g take it up; else points above 500 Hz",
    insertions=_series_impedance,
    absorbed=_absorbed,
)


def _shunt_capacitance(model: Model) -> Iterator[Insertion]:
    for name in model.draft.named("Shunt_RC"):
        where = f"{name} between v_DQ and i_DQ"
        yield from model.edited("shunt_capacitance", "remove", where, lambda draft, name=name: draft.remove(name))
    if not model.draft.named("Shunt_RC"):

        def shunt(draft: Edit) -> dict[str, Strength]:
            name = draft.add("Shunt_RC", "shunt")
            draft.chain(TERMINAL_VOLTAGE, f"{name}.v", f"{name}.i", TERMINAL_CURRENT)
            return {f"{name}.R": Strength((0.05, 0.1, 0.2)), f"{name}.C": Strength((0.01, 0.04, 0.15), 1e-12)}

        yield from model.edited("shunt_capacitance", "add", "from the PCC (v_DQ, i_DQ) to neutral", shunt)


SHUNT_CAPACITANCE = Effect(
    id="shunt_capacitance",
    law="i_DQ -= Y_sh v_DQ, Y_sh of C with a series R, from the PCC to neutral outside the inverter",
    places="at the PCC, in the grid's frame",
    signature="above 1 kHz, rising with frequency; dd and qq half each, the same at every operating point",
    confused_with=("filter_capacitor",),
    told_apart_by="points above 2 kHz: the admittance of a capacitor rises, that of the inverter falls",
    insertions=_shunt_capacitance,
)

SERIES_R = {"R_C": Strength((0.02, 0.1, 0.5), 0.0)}
BRANCH = {"R_d": Strength((0.5, 0.5, 0.3), 1e12), "C_d": Strength((0.01, 0.03, 0.1))}
DAMPED = {"LCL_R": ("a resistor in series with C_F", SERIES_R), "LCL_RC": ("a series R_d, C_d beside C_F", BRANCH)}


def _capacitor_damping(model: Model) -> Iterator[Insertion]:
    kind, plant = _kind(model), model.roles.plant
    if kind in DAMPED:
        where = f"{DAMPED[kind][0]} of {plant}"
        yield from model.edited("capacitor_damping", "remove", where, _plant(model, "LCL", {}))
    for other, (words, strengths) in DAMPED.items() if kind in ("LCL", *DAMPED) else ():
        if kind == "LCL":
            yield from model.edited("capacitor_damping", "add", f"{words} of {plant}", _plant(model, other, strengths))
        elif kind != other:
            where = f"{words} of {plant}, in place of {DAMPED[kind][0]}"
            strengths = {key: Strength(one.bank) for key, one in strengths.items()}
            yield from model.edited("capacitor_damping", "replace", where, _plant(model, other, strengths))


CAPACITOR_DAMPING = Effect(
    id="capacitor_damping",
    law="e = v_C + R_C i_C, or a branch R_d, C_d beside C_F",
    places="at the LCL's capacitor: a resistor in series, an RC branch beside",
    signature="the resonance and above; all entries alike, the same at every operating point",
    confused_with=("active_damping",),
    told_apart_by="points above the resonance, where the resistor and not the capacitor remains",
    insertions=_capacitor_damping,
)


def _filter_capacitor(model: Model) -> Iterator[Insertion]:
    kind, plant = _kind(model), model.roles.plant
    capacitor = {"C_F": Strength((0.01, 0.05, 0.12), 1e-12)}
    line = {} if kind == "LLFilter" else {key: Strength(one.bank, 1e-12) for key, one in LINE.items()}
    if kind in ("LFilter", "LLFilter"):
        inputs = _control_inputs(model, f"{plant}.i_g")

        def converter_current(draft: Edit) -> dict[str, Strength]:
            strengths = _plant(model, "LCL", {**capacitor, **line})(draft)
            for target in inputs:
                draft.disconnect(f"{plant}.i_g", target)
                draft.connect(f"{plant}.i_ti", target)
            return strengths

        where = f"LCL in place of {kind} {plant}"
        yield from model.edited(
            "filter_capacitor", "replace", f"{where}, control of the converter's current", converter_current
        )
        grid_side = _plant(model, "LCL", {**capacitor, **line})
        yield from model.edited("filter_capacitor", "replace", f"{where}, control of the grid current", grid_side)
    for other in ("LLFilter", "LFilter") if model.roles.lcl else ():

        def without(draft: Edit, other: str = other) -> None:
            for target in draft.targets(f"{plant}.i_ti"):
                draft.connect(f"{plant}.i_g", target)
            _exchange_plant(draft, plant, other)

        kept = "L_g and R_g stay" if other == "LLFilter" else "the measured voltage is that of the PCC"
        where = f"{other} in place of {kind} {plant}, {kept}"
        yield from model.edited("filter_capacitor", "remove", where, without)


FILTER_CAPACITOR = Effect(
    id="filter_capacitor",
    law="the device has an LCL where the model has an L filter, or the other way round",
    places="the plant: control of the converter's or of the grid current",
    signature="a resonance, usually 0.5 to 3 kHz, and the fall above it; all entries alike, the same at every operating point",
    confused_with=("series_impedance", "shunt_capacitance"),
    told_apart_by="points up to twice the resonance",
    insertions=_filter_capacitor,
)


FRAME_MISALIGNMENT = Effect(
    id="frame_misalignment",
    law="Y' = R(a) Y R(-a), a constant angle of the measuring frame",
    places="in the measurement: no edit of the program describes it",
    signature="everywhere, in proportion to the asymmetry of Y; dq and qd half each, nothing in their sum with dd and qq",
    confused_with=("decoupling",),
    told_apart_by="a passive load of known impedance in the inverter's place; its admittance does not turn",
    insertions=no_edit,
    measurement=True,
)
