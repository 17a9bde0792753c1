"""The measured voltage added to the command: there or not, scaled, filtered."""

from collections.abc import Iterator
from dataclasses import dataclass

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.paths import path
from ibrid.gap.places import command_entries, join, lags, loops, terminal_voltage
from ibrid.gap.strengths import cutoff


@dataclass(frozen=True)
class Feedforward:
    """The way of a voltage to the command past the loops. `blocks` : on it, without the lags of the whole command."""

    voltage: str
    blocks: tuple[str, ...]

    @property
    def last(self) -> str:
        """The output that joins the command."""
        return f"{self.blocks[-1]}.out" if self.blocks else self.voltage


def feedforward(model: Model) -> Feedforward | None:
    """The feedforward of the filter's voltage, else of the PCC's; None where there is none, or no other control."""
    row, (entry, *_) = lags(model), command_entries(model.draft, model.roles.command)
    if len(model.draft.sources(entry)) < 2:
        return None
    for voltage in dict.fromkeys((model.roles.voltage, terminal_voltage(model))):
        found = path(model.draft, voltage, model.roles.command, without=loops(model))
        if found is not None:
            return Feedforward(voltage, tuple(name for name in found if name not in row))
    return None


def _voltage_feedforward(model: Model) -> Iterator[Insertion]:
    roles, draft = model.roles, model.draft
    found = feedforward(model)
    if found is None:
        where = f"{roles.voltage} to {roles.command}"

        def wire(draft: Edit) -> None:
            join(draft, roles.voltage, roles.command, roles.command)

        def scaled(draft: Edit) -> dict[str, Strength]:
            name = draft.add("Gain_dq", "feedforward")
            draft.connect(roles.voltage, f"{name}.in_")
            join(draft, f"{name}.out", roles.command, roles.command)
            return {f"{name}.k": Strength((0.1, 0.5, 1.0), 0.0)}

        yield from model.edited("voltage_feedforward", "add", f"{where}, as it is", wire)
        yield from model.edited("voltage_feedforward", "add", f"{where}, with a gain", scaled)
        return
    where = f"{found.voltage} to {roles.command}"

    def without(draft: Edit) -> None:
        for entry in command_entries(draft, roles.command):
            draft.disconnect(found.last, entry)

    yield from model.edited("voltage_feedforward", "remove", where, without)
    gains = [name for name in found.blocks if draft.instances[name].kind == "Gain_dq"]
    for name in gains:
        unscaled = f"{where}, as it is, without {name}"
        yield from model.bypassed("voltage_feedforward", "replace", unscaled, name)
    if not gains:

        def with_gain(draft: Edit) -> dict[str, Strength]:
            entries = command_entries(draft, roles.command)
            name = draft.insert(found.last, entries, "Gain_dq", "feedforward")
            return {f"{name}.k": Strength((0.9, 0.6, 0.2), 1.0)}

        yield from model.edited("voltage_feedforward", "replace", f"{where}, with a gain other than 1", with_gain)


VOLTAGE_FEEDFORWARD = Effect(
    id="voltage_feedforward",
    law="u_r += k_ff e, with k_ff = 1 or fitted",
    places="from the measured voltage to the command",
    signature="gross: 5 Hz to 2 kHz, most at 50 to 500 Hz; all entries, the same at every operating point",
    confused_with=("active_damping", "voltage_feedforward_filter"),
    told_apart_by="points below 20 Hz, where a filter of the feedforward does nothing and a missing one much",
    insertions=_voltage_feedforward,
)


def _feedforward_filter(model: Model) -> Iterator[Insertion]:
    found = feedforward(model)
    if found is None:
        return
    where = f"{found.voltage} to {model.roles.command}"
    present = [name for name in found.blocks if model.draft.instances[name].kind == "LPF1_dq"]
    for name in present:
        words = f"{name} on the way from {where}"
        yield from model.bypassed("voltage_feedforward_filter", "remove", words, name)
    if not present:

        def filtered(draft: Edit) -> dict[str, Strength]:
            entries = command_entries(draft, model.roles.command)
            return {
                f"{draft.insert(found.last, entries, 'LPF1_dq', 'feedforward_filter')}.omega_c": cutoff(2000, 500, 100)
            }

        yield from model.edited("voltage_feedforward_filter", "add", f"on the way from {where}", filtered)


VOLTAGE_FEEDFORWARD_FILTER = Effect(
    id="voltage_feedforward_filter",
    law="u_r += omega_c/(s + omega_c) k_ff e",
    places="in the path of the voltage feedforward",
    signature="around the corner frequency, usually 50 Hz to 5 kHz; all entries, the same at every operating point",
    confused_with=("control_delay", "voltage_feedforward", "voltage_sensor"),
    told_apart_by="points between 20 Hz and the corner frequency; a delay goes on turning the phase above it",
    insertions=_feedforward_filter,
)
