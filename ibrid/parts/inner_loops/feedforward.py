"""The measured voltage added to the command: there or not, scaled, filtered."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff
from ibrid.parts.editing.feedforward_path import feedforward
from ibrid.parts.editing.paths import command_entry, join, loops, path
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.shaping import bypassed, in_line
from ibrid.parts.editing.view import Move, View

SCALED = {"k": Strength((0.1, 0.5, 1.0), 0.0)}
FILTERED = {"omega_c": cutoff(2000, 500, 100)}


def _voltage_feedforward(view: View) -> Iterator[Move]:
    roles, present = view.roles, feedforward(view)
    if present is None:
        where = f"{roles.voltage} to {roles.command}"

        def scaled(draft: Edit) -> None:
            join(draft, view, draft.after(roles.voltage, "Gain_dq", "feedforward", **SCALED))

        yield Move.at("add", f"{where}, as it is", lambda draft: join(draft, view, roles.voltage))
        yield Move.at("add", f"{where}, with a gain", scaled)
        return
    where = f"{present.voltage} to {roles.command}"
    entry = command_entry(view.draft, view)
    yield Move.at("remove", where, lambda draft: draft.disconnect(present.last, entry))
    gains = [name for name in present.blocks if view.element(name) is Element.GAIN]
    for name in gains:
        yield bypassed(name, f"{where}, as it is, without {name}", "replace")
    if not gains:

        def with_gain(draft: Edit) -> None:
            draft.insert(
                present.last, [entry], "Gain_dq", "feedforward", k=Strength((0.9, 0.6, 0.2), 1.0)
            )

        yield Move.at("replace", f"{where}, with a gain other than 1", with_gain)


VOLTAGE_FEEDFORWARD = Effect(
    id="voltage_feedforward",
    law="u_r += k_ff e, with k_ff = 1 or fitted",
    places="from the measured voltage to the command",
    signature="gross: 5 Hz to 2 kHz, most at 50 to 500 Hz; all entries, the same at every "
    "operating point",
    confused_with=("active_damping", "voltage_feedforward_filter"),
    told_apart_by="points below 20 Hz, where a filter of the feedforward does nothing and a "
    "missing one much",
    moves=_voltage_feedforward,
)


def _feedforward_filter(view: View) -> Iterator[Move]:
    branch = feedforward(view)
    if branch is None:
        return iter(())
    way, entry = (
        f"on the way from {branch.voltage} to {view.roles.command}",
        command_entry(view.draft, view),
    )
    present = [name for name in branch.blocks if view.element(name) is Element.LOW_PASS]
    places = {
        way: lambda draft: draft.insert(
            branch.last, [entry], "LPF1_dq", "feedforward_filter", **FILTERED
        )
    }
    return in_line(present, f"{{}} {way}", places)


VOLTAGE_FEEDFORWARD_FILTER = Effect(
    id="voltage_feedforward_filter",
    law="u_r += omega_c/(s + omega_c) k_ff e",
    places="in the path of the voltage feedforward",
    signature="around the corner frequency, usually 50 Hz to 5 kHz; all entries, the same at every "
    "operating point",
    confused_with=(
        "control_delay",
        "delay_form",
        "feedforward_band_pass",
        "measurement_filter",
        "voltage_feedforward",
        "voltage_sensor",
    ),
    told_apart_by="points between 20 Hz and the corner frequency; a delay goes on turning the "
    "phase above it",
    moves=_feedforward_filter,
)


def feedforwards(view: View) -> Iterator[Move]:
    """The measured voltage added to the command, as it is, scaled or filtered."""
    voltage, entry = view.roles.voltage, command_entry(view.draft, view)
    if entry not in view.draft.targets(voltage):
        yield Move("voltage feedforward", lambda draft: draft.connect(voltage, entry))
    for kind, words, strengths in (
        ("Gain_dq", "scaled ", SCALED),
        ("LPF1_dq", "filtered ", FILTERED),
    ):
        if view.known(kind):

            def shaped(
                draft: Edit, kind: str = kind, strengths: dict[str, Strength] = strengths
            ) -> None:
                draft.disconnect(voltage, entry)
                draft.connect(draft.after(voltage, kind, "feedforward", **strengths), entry)

            yield Move(f"{words}voltage feedforward", shaped)


def fed_forward(view: View) -> bool:
    """True when the measured voltage reaches the command without passing a regulator."""
    return path(view.draft, view.roles.voltage, view.roles.command, without=loops(view)) is not None


_BANDS = (0.3, 1.0, 1.0, 0.5)

FAMILIES = (
    Family("voltage feedforward", "module", _BANDS, 10.0, where_missing(feedforwards, fed_forward)),
    Family("other feedforward", "module", _BANDS, 0.5, where_present(feedforwards, fed_forward)),
)
