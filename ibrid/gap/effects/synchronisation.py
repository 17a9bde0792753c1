"""The PLL: there or not, filtered or not."""

from collections.abc import Iterator
from math import pi

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.paths import after, row_before
from ibrid.gap.places import has_line
from ibrid.gap.strengths import cutoff
from ibrid.structure.diagram import TERMINAL_VOLTAGE
from ibrid.structure.frames import put_into_frame, put_into_grid_frame

PLL_GAINS = {"kP_pll": Strength((20.0, 60.0, 200.0)), "kI_pll": Strength((150.0, 1500.0, 15000.0))}


def _pll_missing(model: Model) -> Iterator[Insertion]:
    if model.roles.frequency is None:
        yield from _with_a_pll(model)
    for name in model.draft.named("SRF_PLL"):
        yield from _without_pll(model, name)


def _with_a_pll(model: Model) -> Iterator[Insertion]:
    plant = model.roles.plant
    places = {f"{plant}.e_q": f"locked to {plant}.e_q"}
    if has_line(model):
        places[TERMINAL_VOLTAGE] = "locked to the q axis of the PCC voltage"
    for source, where in places.items():

        def pll(draft: Edit, source: str = source) -> dict[str, Strength]:
            name = draft.add("SRF_PLL", "pll")
            turned = put_into_frame(draft, plant, f"{name}.delta_omega", f"{name}.delta")
            e_q = source if source != TERMINAL_VOLTAGE else after(draft, turned, "SliceQ", "v_q")
            draft.connect(e_q, f"{name}.e_q")
            return {f"{name}.{key}": strength for key, strength in PLL_GAINS.items()}

        yield from model.edited("pll_missing", "add", f"{where}, with rotations at v_DQ and i_DQ", pll)


def _without_pll(model: Model, pll: str) -> Iterator[Insertion]:
    def nominal(draft: Edit) -> None:
        """What took the frequency takes zero, or goes."""
        for target in draft.targets(f"{pll}.delta_omega"):
            draft.disconnect(f"{pll}.delta_omega", target)
            if target.endswith(".delta_omega"):
                draft.connect(f"{draft.add('ConstZero', 'no_frequency')}.out", target)

    def in_the_grids_frame(draft: Edit) -> None:
        nominal(draft)
        put_into_grid_frame(draft)

    def at_a_constant_angle(draft: Edit) -> None:
        nominal(draft)
        zero = f"{draft.add('ConstZero', 'no_angle')}.out"
        for target in draft.targets(f"{pll}.delta"):
            draft.disconnect(f"{pll}.delta", target)
            draft.connect(zero, target)

    where = f"{pll} and the rotations, so that the controller works in the frame of the PCC voltage"
    yield from model.edited("pll_missing", "remove", where, in_the_grids_frame)
    where = f"{pll}, so that the rotations keep the angle at which the measured voltage lies on d"
    yield from model.edited("pll_missing", "remove", where, at_a_constant_angle)


PLL_MISSING = Effect(
    id="pll_missing",
    law="delta_omega = (kP_pll + kI_pll/s) e_q, delta = delta_omega/s, with rotations into and out of its frame",
    places="on the capacitor voltage, on the PCC voltage",
    signature="below the PLL's bandwidth, usually 5 to 50 Hz; qq most, in proportion to the current at rest",
    confused_with=("frequency_droop", "pll_prefilter"),
    told_apart_by="two operating points with different currents: the PLL's part scales with the current",
    insertions=_pll_missing,
)


def _pll_prefilter(model: Model) -> Iterator[Insertion]:
    for pll in model.draft.named("SRF_PLL"):
        row = row_before(model.draft, f"{pll}.e_q")
        for name in row:
            kind = model.draft.instances[name].kind
            yield from model.bypassed("pll_prefilter", "remove", f"{name} before {pll}.e_q", name)
            for other in {"LPF1": ("Notch",), "Notch": ("LPF1",), "Pade1": ("LPF1", "Notch")}[kind]:
                where = f"{other} in place of the {kind} {name} before {pll}.e_q"
                yield from model.edited("pll_prefilter", "replace", where, _exchanged(name, other))
        for kind in ("LPF1", "Notch"):
            further = "a further " if any(model.draft.instances[name].kind == kind for name in row) else ""
            yield from model.edited("pll_prefilter", "add", f"{further}{kind} before {pll}.e_q", _before(pll, kind))


def _exchanged(name: str, kind: str):
    return lambda draft: _prefilter(draft.replace(name, kind, _stem(kind)), kind, vanishes=False)


def _before(pll: str, kind: str):
    return lambda draft: _prefilter(draft.insert_before(f"{pll}.e_q", kind, _stem(kind)), kind)


def _stem(kind: str) -> str:
    return {"LPF1": "pll_filter", "Notch": "pll_notch"}[kind]


def _prefilter(name: str, kind: str, *, vanishes: bool = True) -> dict[str, Strength]:
    if kind == "LPF1":
        low_pass = cutoff(400, 100, 20)
        return {f"{name}.omega_c": low_pass if vanishes else Strength(low_pass.bank)}
    hertz, width = (120.0, 120.0, 60.0, 300.0), Strength((4.0, 1.0, 0.7, 0.7), 1e12 if vanishes else None)
    return {f"{name}.omega_n": Strength(tuple(2 * pi * one for one in hertz)), f"{name}.Q": width}


PLL_PREFILTER = Effect(
    id="pll_prefilter",
    law="SRF_PLL takes omega_c/(s + omega_c) e_q, or e_q behind a notch",
    places="before the PLL: LPF1, Notch; one for the other; a second one",
    signature="around the filter's corner, usually 5 to 500 Hz; qq most (about half), in proportion to the current at rest",
    confused_with=("pll_missing", "voltage_sensor"),
    told_apart_by="operating points with different currents, and points around the PLL's bandwidth, where its peak moves",
    insertions=_pll_prefilter,
)
