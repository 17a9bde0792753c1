"""What is built between converter and PCC: the output filter with its capacitor, its damping, a
line in front of the PCC.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, in_place
from ibrid.parts.editing.paths import grid_current, has_line
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.parts.frames.synchronisation import grid_forming
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import split_port, wire

LINE = {"L_g": Strength((0.03, 0.1, 0.3), 0.0), "R_g": Strength((0.003, 0.01, 0.03), 0.0)}
CAPACITOR = {"C_F": Strength((0.01, 0.05, 0.12), 1e-12)}
#: What an inverter without the capacitor has, and what stays as it was.
WITHOUT = {"LLFilter": "L_g and R_g stay", "LFilter": "the measured voltage is that of the PCC"}
#: Blocks that take the grid current whatever the control measures: what leaves the inverter, its
#: power, its oscillator.
OF_THE_GRID = (Element.ROTATION_OUT, Element.POWER, Element.OSCILLATOR)


def _exchange(draft: Edit, view: View, kind: str) -> str:
    """Another plant under the old name; parameters that both have keep what they were bound to."""
    plant = view.roles.plant
    bindings = draft.instances[plant].bindings
    draft.rename(draft.replace(plant, kind, "plant_to_be"), plant)
    draft.bind(
        plant,
        **{key: value for key, value in bindings.items() if key in draft.kind(plant).parameters},
    )
    return plant


def _plant(
    view: View, kind: str, strengths: Mapping[str, Strength], change, where: str
) -> Iterator[Move]:
    """Another plant, with strengths for its new parameters, where the vocabulary has it."""
    if view.known(kind):
        yield Move.at(
            change, where, lambda draft: draft.usually(_exchange(draft, view, kind), **strengths)
        )


def _with_capacitor(
    draft: Edit, view: View, strengths: Mapping[str, Strength], *, converter: bool
) -> None:
    """An LCL for an L filter; the control takes the converter's current or the grid's, a DC link
    the converter's.
    """
    plant = _exchange(draft, view, "LCL")
    draft.usually(plant, **strengths)
    for target in draft.targets(f"{plant}.i_g"):
        name = split_port(target)[0]
        element = draft.kind(name).element if name else Element.ROTATION_OUT
        if element is Element.DC_LINK or (converter and element not in OF_THE_GRID):
            draft.rewire(f"{plant}.i_g", f"{plant}.i_ti", target)


def _without_capacitor(draft: Edit, view: View, kind: str) -> None:
    draft.connect(grid_current(view), *draft.targets(f"{view.roles.plant}.i_ti"))
    _exchange(draft, view, kind)


def filter_capacitor(view: View) -> Iterator[Move]:
    """The other filter; with an LCL the controller measures the converter's or the grid's
    current.
    """
    kind, plant = view.kind(view.roles.plant), view.roles.plant
    if view.roles.lcl:
        for other, kept in WITHOUT.items():
            if not view.known(other):
                continue
            yield Move(
                "L filter instead of the LCL filter" if other == "LFilter" else "",
                lambda draft, other=other: _without_capacitor(draft, view, other),
                change="remove",
                where=f"{other} in place of {kind} {plant}, {kept}",
            )
        return
    line = {} if has_line(view) else {key: Strength(one.bank, 1e-12) for key, one in LINE.items()}
    for converter, words in ((True, "converter"), (False, "grid")) if view.known("LCL") else ():
        draw = partial(
            _with_capacitor, view=view, strengths={**CAPACITOR, **line}, converter=converter
        )
        whose = "the converter's" if converter else "the grid"
        yield Move(
            f"LCL filter instead of the L filter, control of the {words} current",
            draw,
            where=f"LCL in place of {kind} {plant}, control of {whose} current",
        )


FILTER_CAPACITOR = Effect(
    id="filter_capacitor",
    law="the device has an LCL where the model has an L filter, or the other way round",
    places="the plant: control of the converter's or of the grid current",
    signature="a resonance, usually 0.5 to 3 kHz, and the fall above it; all entries alike, the "
    "same at every operating point",
    confused_with=("series_impedance", "shunt_capacitance"),
    told_apart_by="points up to twice the resonance",
    moves=filter_capacitor,
)

SERIES_R = {"R_C": Strength((0.02, 0.1, 0.5), 0.0)}
BRANCH = {"R_d": Strength((0.5, 0.5, 0.3), 1e12), "C_d": Strength((0.01, 0.03, 0.1))}
DAMPED = {
    "LCL_R": ("a resistor in series with C_F", SERIES_R),
    "LCL_RC": ("a series R_d, C_d beside C_F", BRANCH),
}


def _capacitor_damping(view: View) -> Iterator[Move]:
    kind, plant = view.shipped(view.roles.plant), view.roles.plant
    present, _ = DAMPED.get(kind, ("", {}))
    if present:
        yield from _plant(view, "LCL", {}, "remove", f"{present} of {plant}")
    for other, (words, strengths) in DAMPED.items() if present or kind == "LCL" else ():
        if not present:
            yield from _plant(view, other, strengths, "add", f"{words} of {plant}")
        elif kind != other:
            yield from _plant(
                view,
                other,
                in_place(strengths),
                "replace",
                f"{words} of {plant}, in place of {present}",
            )


CAPACITOR_DAMPING = Effect(
    id="capacitor_damping",
    law="e = v_C + R_C i_C, or a branch R_d, C_d beside C_F",
    places="at the LCL's capacitor: a resistor in series, an RC branch beside",
    signature="the resonance and above; all entries alike, the same at every operating point",
    confused_with=("active_damping", "trap_filter"),
    told_apart_by="points above the resonance, where the resistor and not the capacitor remains",
    moves=_capacitor_damping,
)


TRAP = {
    "L_t": Strength((8e-3, 2e-3, 1e-3), 1e12),
    "C_t": Strength((0.02, 0.02, 0.05)),
    "R_t": Strength((2e-3, 2e-3, 0.01)),
}


def _trap_filter(view: View) -> Iterator[Move]:
    kind, plant = view.shipped(view.roles.plant), view.roles.plant
    if kind == "LCL_trap":
        yield from _plant(view, "LCL", {}, "remove", f"the trap of {plant}")
    elif kind == "LCL":
        trapped = _plant(
            view, "LCL_trap", TRAP, "add", f"a series L_t, R_t, C_t beside C_F of {plant}"
        )
        yield from (replace(move, note="a trap beside the capacitor") for move in trapped)


TRAP_FILTER = Effect(
    id="trap_filter",
    law="a series L_t, R_t, C_t beside C_F, tuned to the switching frequency",
    places="at the LCL's capacitor",
    signature="above the resonance: a narrow peak of the admittance between converter and node at "
    "the trap's frequency, and a "
    "lower resonance below; all entries alike, the same at every operating point",
    confused_with=("capacitor_damping",),
    told_apart_by="points up to the trap's frequency, usually above 3 kHz; below, a trap is more "
    "C_F",
    moves=_trap_filter,
)


CORE = {"I_s": Strength((2.0, 1.2, 4.0), 1e9)}


def _core_saturation(view: View) -> Iterator[Move]:
    kind, plant = view.shipped(view.roles.plant), view.roles.plant
    if kind == "LCL_saturated":
        yield from _plant(view, "LCL", {}, "remove", f"I_s of {plant}")
    elif kind == "LCL":
        yield from _plant(view, "LCL_saturated", CORE, "add", f"L_F of {plant} falls with |i_ti|")


CORE_SATURATION = Effect(
    id="core_saturation",
    law="L_F i_ti / sqrt(1 + |i_ti|^2/I_s^2) in place of the flux L_F i_ti",
    places="the converter's side of the LCL",
    signature="above the current loop: less inductance along the current than across it, and less "
    "of both at operating points "
    "with more current",
    confused_with=("dead_time",),
    told_apart_by="operating points with little and with much current; at one point by the two "
    "axes alone",
    moves=_core_saturation,
)

_UNTRAPPED = where_present(_trap_filter, lambda view: view.shipped(view.roles.plant) == "LCL")
TRAPS = (Family("trap", "module", (0.0, 0.0, 0.5, 1.0), 0.3, _UNTRAPPED),)


def _series_impedance(view: View) -> Iterator[Move]:
    plant = view.roles.plant
    if not view.roles.lcl and not has_line(view) and not _absorbed(view):
        yield from _plant(view, "LLFilter", LINE, "add", f"between {plant}.e and {plant}.v_in")
    if not view.roles.lcl and has_line(view):
        yield from _plant(
            view, "LFilter", {}, "remove", f"L_g, R_g of {plant}, so that e is the PCC voltage"
        )
    bindings = view.draft.instances[plant].bindings
    fixed = {key: value for key in ("L_g", "R_g") if isinstance(value := bindings.get(key), float)}
    if fixed:

        def freed(draft: Edit) -> None:
            draft.unbind(plant, *fixed)
            draft.usually(
                plant,
                **{key: Strength((1.3 * one, 2 * one, 4 * one), one) for key, one in fixed.items()},
            )

        yield Move.at("add", f"{' and '.join(fixed)} of {plant}, which the program fixes", freed)


def _absorbed(view: View) -> tuple[str, ...]:
    """The inductance and resistance that a line in front of the PCC adds to; () where the measured
    voltage lies between.
    """
    plant = view.roles.plant
    measured = [target for port in ("e", "e_q") for target in view.draft.targets(f"{plant}.{port}")]
    if measured and not has_line(view):
        return ()
    table = parameter_table(wire(view.diagram, view.kinds), "exact")
    bound = (
        table.of(plant, name) for name in (("L_g", "R_g") if has_line(view) else ("L_F", "R_F"))
    )
    return tuple(name for name in bound if isinstance(name, str))


SERIES_IMPEDANCE = Effect(
    id="series_impedance",
    law="v_PCC = v - (R + L (s/omega_0 I + J)) i_g, a line or transformer in front of the PCC",
    places="between an L filter's measured voltage and the PCC; behind an LCL it is a change of "
    "L_g and R_g",
    signature="100 Hz to 2 kHz: the resonance moves; the same at every operating point",
    confused_with=("filter_capacitor",),
    told_apart_by="behind an LCL nothing: L_g and R_g take it up; else points above 500 Hz",
    moves=_series_impedance,
    absorbed=_absorbed,
)


#: What an output filter may lack.
OF_THE_FILTER = (
    FILTER_CAPACITOR,
    CAPACITOR_DAMPING,
    TRAP_FILTER,
    CORE_SATURATION,
    SERIES_IMPEDANCE,
)

_BANDS = (0.2, 0.4, 1.0, 1.0)
_FOLLOWING = where_missing(filter_capacitor, lambda view: view.roles.lcl or grid_forming(view))
_FORMING = where_missing(filter_capacitor, lambda view: view.roles.lcl or not grid_forming(view))

#: A grid-forming inverter controls the voltage of a capacitor, so the filter comes before that
#: loop.
FAMILIES = (
    Family("filter", "structural", _BANDS, 9.0, _FOLLOWING, any_time=True),
    Family("capacitor", "structural", (1.0, 1.0, 1.0, 1.0), 9.0, _FORMING, True),
    Family(
        "other filter",
        "structural",
        _BANDS,
        0.5,
        where_present(filter_capacitor, lambda view: view.roles.lcl),
    ),
)
