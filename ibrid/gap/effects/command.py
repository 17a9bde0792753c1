"""What delays or smooths the whole voltage command, and what delays a measured signal."""

from collections.abc import Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.places import current_entries, current_path, into_whole_command, lags, measured_current
from ibrid.gap.strengths import cutoff

DELAY_TIME = Strength((5e-5, 1.5e-4, 4e-4), 0.0)


def _control_delay(model: Model) -> Iterator[Insertion]:
    command = model.roles.command
    present = [name for name in lags(model) if model.draft.instances[name].kind != "LPF1_dq"]
    for name in present:
        where = f"{name}, which delays {command}"
        yield from model.bypassed("control_delay", "remove", where, name)
    if not present:

        def delayed(draft: Edit) -> dict[str, Strength]:
            return {f"{into_whole_command(draft, command, 'Delay', 'delay')}.T_d": DELAY_TIME}

        yield from model.edited("control_delay", "add", f"before {command}, on all that drives it", delayed)


CONTROL_DELAY = Effect(
    id="control_delay",
    law="u_r = exp(-s T_d) (the whole command, feedforward included)",
    places="before the plant's u_r",
    signature="50 Hz to 2 kHz, most around the resonance and the current loop's bandwidth; all entries alike, the same at "
    "every operating point",
    confused_with=("command_filter", "current_filter", "measurement_delay", "voltage_feedforward_filter"),
    told_apart_by="points above 0.3/(2 pi T_d) with 2 % noise or less: the phase of a delay goes on falling",
    insertions=_control_delay,
)


def _command_filter(model: Model) -> Iterator[Insertion]:
    command = model.roles.command
    present = [name for name in lags(model) if model.draft.instances[name].kind == "LPF1_dq"]
    for name in present:
        where = f"{name}, which filters {command}"
        yield from model.bypassed("command_filter", "remove", where, name)
    if not present:

        def filtered(draft: Edit) -> dict[str, Strength]:
            name = into_whole_command(draft, command, "LPF1_dq", "command_filter")
            return {f"{name}.omega_c": cutoff(3000, 1000, 400)}

        yield from model.edited("command_filter", "add", f"before {command}, on all that drives it", filtered)


COMMAND_FILTER = Effect(
    id="command_filter",
    law="u_r = omega_c/(s + omega_c) (the whole command): a converter modelled or built as a lag",
    places="before the plant's u_r",
    signature="as a control delay, and less gain above the corner frequency",
    confused_with=("control_delay", "current_filter"),
    told_apart_by="points above the corner frequency: a filter lowers the gain, a delay does not",
    insertions=_command_filter,
)


def _measurement_delay(model: Model) -> Iterator[Insertion]:
    current = measured_current(model)
    present = [name for name in current_path(model) if model.draft.instances[name].kind in ("Delay", "Pade1_dq")]
    for name in present:
        where = f"{name}, which delays {current}"
        yield from model.bypassed("measurement_delay", "remove", where, name)
    for what, entries in current_entries(model).items() if not present else ():

        def delayed(draft: Edit, entries: list[str] = entries) -> dict[str, Strength]:
            return {f"{draft.insert(current, entries, 'Delay', 'current_delay')}.T_d": DELAY_TIME}

        yield from model.edited("measurement_delay", "add", f"behind {current}, for {what}", delayed)


MEASUREMENT_DELAY = Effect(
    id="measurement_delay",
    law="the controller gets exp(-s T_d) i, while voltages and powers come prompt",
    places="behind the measured current: for loop and decoupling together, for the loop alone",
    signature="100 Hz to 2 kHz; all entries alike, the same at every operating point; the feedforward stays prompt",
    confused_with=("control_delay", "current_filter"),
    told_apart_by="the top of the band, where the feedforward is delayed by a control delay and not by this one",
    insertions=_measurement_delay,
)
