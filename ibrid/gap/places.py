"""Places in a controller: where a path joins the command, where measured signals enter and which they are."""

from ibrid.gap.effect import Model
from ibrid.gap.paths import path, row_before
from ibrid.structure.drafting import Draft

# --- the command -----------------------------------------------------------------------------------------------------


def lags(model: Model) -> tuple[str, ...]:
    """Delays and filters of the whole command, the nearest to the plant first."""
    return row_before(model.draft, model.roles.command)


def command_entries(draft: Draft, command: str) -> list[str]:
    """The inputs at which paths to the command add up: before its lags; else the command, and what is wired like it."""
    row = row_before(draft, command)
    if row:
        return [f"{row[-1]}.in_"]
    return [command, *_wired_like(draft, command)]


def join(draft: Draft, source: str, target: str, command: str) -> None:
    """Add a source to a sum; to the command before what delays or filters it."""
    for one in command_entries(draft, command) if target == command else [target]:
        draft.connect(source, one)


def into_whole_command(draft: Draft, command: str, kind: str, stem: str) -> str:
    """Put a block before the command, and before whatever else takes the command; returns its name."""
    others = _wired_like(draft, command)
    name = draft.insert_before(command, kind, stem)
    for other in others:
        for source in draft.sources(other):
            draft.disconnect(source, other)
        draft.connect(f"{name}.out", other)
    return name


def _wired_like(draft: Draft, command: str) -> list[str]:
    inputs = [f"{name}.u" for name in draft.named("DC_link")]
    return [one for one in inputs if set(draft.sources(one)) == set(draft.sources(command))]


# --- measured signals ------------------------------------------------------------------------------------------------


def terminal_voltage(model: Model) -> str:
    """The voltage of the PCC in the controller's frame."""
    return model.draft.sources(f"{model.roles.plant}.v_in")[0]


def grid_current(model: Model) -> str:
    """The current into the grid."""
    return f"{model.roles.plant}.i_g"


def has_line(model: Model) -> bool:
    """True when the measured voltage is not that of the PCC."""
    return "L_g" in model.draft.kind(model.roles.plant).parameters


def measured_current(model: Model) -> str:
    """The current that the current loop measures, else that of the converter."""
    found = model.roles.current
    if model.roles.current_loop:
        ways = [one for one in (found, grid_current(model)) if _loop_path(model, one) is not None]
        return ways[0] if ways else found
    return found


def _loop_path(model: Model, current: str) -> tuple[str, ...] | None:
    drops = model.draft.named("Gain_dq")  # of a virtual impedance
    return path(model.draft, current, f"{model.roles.current_loop}.in_", without=drops)


def current_path(model: Model) -> tuple[str, ...]:
    """Blocks between the measured current and the current loop, the loop at the end; () without such a loop."""
    loop = model.roles.current_loop
    found = _loop_path(model, measured_current(model)) if loop else None
    return () if found is None or loop is None else (*found, loop)


def current_entries(model: Model) -> dict[str, list[str]]:
    """Inputs of the measured current, for current loop and decoupling together, and for the loop alone."""
    way, current = current_path(model), measured_current(model)
    if not way:
        return {}
    alone = [f"{way[0]}.in_"]
    others = [f"{name}.in_" for name in decouplings(model)]
    together = alone + [one for one in others if one not in alone and current in model.draft.sources(one)]
    return (
        {"current loop and decoupling": together, "the current loop alone": alone}
        if len(together) > 1
        else {"the current loop": alone}
    )


def decouplings(model: Model) -> list[str]:
    """Modules that add J times the measured current to the command, whatever filters are in between."""
    draft, current = model.draft, measured_current(model)
    found = []
    for name in draft.named("JMul", "JMul_omega"):
        before = path(draft, current, f"{name}.in_")
        signs = [one for one in before or () if draft.instances[one].kind == "Negate_dq"]
        if before is not None and len(signs) % 2 == 0 and joins_command(model, f"{name}.out"):
            found.append(name)
    return found


def loops(model: Model) -> tuple[str | None, ...]:
    """The current and voltage loops, through which no feedforward counts."""
    return model.roles.current_loop, model.roles.voltage_loop


def joins_command(model: Model, source: str) -> bool:
    """True when an output reaches the command past the loops."""
    return path(model.draft, source, model.roles.command, without=loops(model)) is not None
