"""The axes of the current reference: what regulates each, on which measured quantity, and how another takes its place."""

from ibrid.gap.effect import Model
from ibrid.gap.paths import path
from ibrid.gap.places import grid_current
from ibrid.structure.drafting import Draft


def packs(model: Model) -> list[str]:
    """PackDQ modules that give the reference its two axes."""
    roles = model.roles
    return [
        name for name in model.draft.named("PackDQ") if path(model.draft, f"{name}.out", roles.reference) is not None
    ]


def regulator(model: Model, axis: str) -> str | None:
    """The scalar regulator that drives an axis, "in_d" or "in_q", of the reference; None where nothing does."""
    for pack in packs(model):
        for name in model.roles.outer:
            if path(model.draft, f"{name}.out", f"{pack}.{axis}") is not None:
                return name
    return None


def regulates(model: Model, name: str | None) -> str | None:
    """What a scalar regulator acts on: "p", "q", "voltage" (a magnitude), "dc" (a DC voltage); None for anything else."""
    if name is None:
        return None
    draft = model.draft
    measured = {f"{one}.{axis}": axis for one in model.roles.power for axis in ("p", "q")}
    measured |= {f"{one}.v_dc": "dc" for one in draft.named("DC_link")}
    measured |= {f"{one}.out": "voltage" for one in draft.named("Magnitude", "SliceD")}
    return next((what for port, what in measured.items() if path(draft, port, f"{name}.in_") is not None), None)


def drive_axis(draft: Draft, source: str, reference: str, axis: str) -> None:
    """Let a scalar drive one axis of a dq input, in place of what drove that axis before."""
    found = [name for name in draft.named("PackDQ") if path(draft, f"{name}.out", reference) is not None]
    pack = found[0] if found else draft.add("PackDQ", "i_ref")
    for old in draft.sources(f"{pack}.{axis}"):
        draft.disconnect(old, f"{pack}.{axis}")
    draft.connect(source, f"{pack}.{axis}")
    if not found:
        draft.connect(f"{pack}.out", reference)


def power_block(draft: Draft, model: Model) -> str:
    """The module that computes p and q; a new one of the measured voltage and the grid current if there is none."""
    found = draft.named("PQ_calc")
    if found:
        return found[0]
    name = draft.add("PQ_calc", "power")
    draft.chain(model.roles.voltage, f"{name}.e", grid_current(model), f"{name}.i")
    return name
