"""Where the controller's sensors sit: PCC or capacitor voltage, converter or grid current."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model
from ibrid.gap.effects.feedforward import feedforward
from ibrid.gap.paths import after, row_before
from ibrid.gap.places import (
    command_entries,
    current_entries,
    grid_current,
    has_line,
    measured_current,
    terminal_voltage,
)


def _voltage_sensor(model: Model) -> Iterator[Insertion]:
    if not has_line(model):
        return
    both = (model.roles.voltage, terminal_voltage(model))
    for old, new in (both, both[::-1]):
        places: dict[str, list[str]] = {}
        found = feedforward(model)
        if found is not None and found.voltage == old:
            places["the feedforward"] = _first(model, found.blocks)
        for name in model.roles.power:
            if old in model.draft.sources(f"{name}.e"):
                places[name] = [f"{name}.e"]
        locked = {entry: pll for pll, entry in _locked(model, old).items()}
        for what, targets in places.items():
            where = f"{what} takes {new} in place of {old}"
            yield from model.edited("voltage_sensor", "replace", where, _rewired(model, old, new, targets, []))
        for entry, pll in locked.items():
            where = f"{pll} locks to {new} in place of {old}"
            yield from model.edited("voltage_sensor", "replace", where, _rewired(model, old, new, [], [entry]))
        if len(places) + len(locked) > 1:
            targets = [one for some in places.values() for one in some]
            where = f"all of them take {new} in place of {old}"
            yield from model.edited(
                "voltage_sensor", "replace", where, _rewired(model, old, new, targets, list(locked))
            )


def _first(model: Model, blocks: tuple[str, ...]) -> list[str]:
    """The inputs at which the feedforward begins."""
    return [f"{blocks[0]}.in_"] if blocks else command_entries(model.draft, model.roles.command)


def _locked(model: Model, voltage: str) -> dict[str, str]:
    """PLL -> the scalar input that takes the q axis of a voltage on the way to it."""
    draft, found = model.draft, {}
    for pll in draft.named("SRF_PLL"):
        row = row_before(draft, f"{pll}.e_q")
        entry = f"{row[-1]}.in_" if row else f"{pll}.e_q"
        sources = draft.sources(entry)
        slices = [
            one for one in draft.named("SliceQ") if f"{one}.out" in sources and voltage in draft.sources(f"{one}.in_")
        ]
        own = f"{model.roles.plant}.e_q" in sources and voltage == model.roles.voltage
        if len(sources) == 1 and (slices or own):
            found[pll] = entry
    return found


def _rewired(model: Model, old: str, new: str, targets: list[str], scalars: list[str]):
    def edit(draft: Edit) -> None:
        for target in targets:
            draft.disconnect(old, target)
            draft.connect(new, target)
        for entry in scalars:
            for source in draft.sources(entry):
                draft.disconnect(source, entry)
            draft.connect(_q_axis(draft, model, new), entry)

    return edit


def _q_axis(draft: Edit, model: Model, voltage: str) -> str:
    if voltage == model.roles.voltage:
        return f"{model.roles.plant}.e_q"
    return after(draft, voltage, "SliceQ", "v_q")


VOLTAGE_SENSOR = Effect(
    id="voltage_sensor",
    law="the controller takes the PCC voltage where the model takes the capacitor's, or the other way round",
    places="at the feedforward, at the PLL, at the powers, at all of them",
    signature="from the PLL's bandwidth to the resonance; the more, the larger L_g is",
    confused_with=("pll_prefilter", "voltage_feedforward_filter"),
    told_apart_by="points at the resonance for the feedforward; operating points with different powers for the others",
    insertions=_voltage_sensor,
)


def _current_sensor(model: Model) -> Iterator[Insertion]:
    if not model.roles.lcl:
        return
    both = (model.roles.current, grid_current(model))
    measured = measured_current(model)
    other = both[1] if measured == both[0] else both[0]
    for what, entries in current_entries(model).items():
        where = f"{other} in place of {measured} for {what}"
        yield from model.edited("current_sensor", "replace", where, _moved(measured, other, entries))
    for name in model.roles.power:
        for old, new in (both, both[::-1]):
            if old in model.draft.sources(f"{name}.i"):
                where = f"{new} in place of {old} at {name}.i"
                yield from model.edited("current_sensor", "replace", where, _moved(old, new, [f"{name}.i"]))


def _moved(old: str, new: str, targets: list[str]):
    def edit(draft: Edit) -> None:
        for target in targets:
            draft.disconnect(old, target)
            draft.connect(new, target)

    return edit


CURRENT_SENSOR = Effect(
    id="current_sensor",
    law="the controller takes the grid current where the model takes the converter's, or the other way round",
    places="at current loop and decoupling together, at the loop alone, at the powers",
    signature="above 200 Hz, most at the resonance; all entries alike. At the powers: below 50 Hz, qq",
    confused_with=("active_damping", "current_filter"),
    told_apart_by="ten points or more across the resonance",
    insertions=_current_sensor,
)
