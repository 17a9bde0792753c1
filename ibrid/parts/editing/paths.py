"""Ways and places in a controller: what hands a signal on, where paths join, what is measured, what
drives each axis.
"""

from collections.abc import Iterable

from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.parts.editing.edit import Edit
from ibrid.parts.editing.view import View
from ibrid.signals import Signal
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port

# --- ways
# ----------------------------------------------------------------------------------------------


def path(
    draft: Draft, source: str, target: str, *, without: Iterable[str | None] = ()
) -> tuple[str, ...] | None:
    """The blocks that hand a signal on from an output to an input, () for a wire; None where there
    is no way.

    without : modules through which no way counts.
    """
    seen = set(without)

    def behind(port: str) -> tuple[str, ...] | None:
        if source in draft.sources(port):
            return ()
        for entering in draft.sources(port):
            name = split_port(entering)[0]
            if name and name not in seen and draft.kind(name).passes:
                seen.add(name)
                before = behind(f"{name}.in_")
                if before is not None:
                    return (*before, name)
        return None

    return behind(target)


def row_before(draft: Draft, target: str) -> tuple[str, ...]:
    """Filters and delays in a row right before an input, the nearest first, each the only source of
    the next.
    """
    row: list[str] = []
    while len(sources := commanded_by(draft, target)) == 1:
        name = split_port(sources[0])[0]
        if not name or name in row or not draft.kind(name).shapes:
            break
        row.append(name)
        target = f"{name}.in_"
    return tuple(row)


def commanded_by(draft: Draft, target: str) -> list[str]:
    """What drives an input, but for what is lost in the converter."""
    losses = [f"{name}.out" for name in draft.having(Element.CONVERTER_LOSS)]
    return [source for source in draft.sources(target) if source not in losses]


# --- the command
# ----------------------------------------------------------------------------------------------


def lags(view: View) -> tuple[str, ...]:
    """Delays and filters of the whole command, the nearest to the plant first."""
    return row_before(view.draft, view.roles.command)


def command_entry(draft: Draft, view: View) -> str:
    """The input at which paths to the command add up: before what delays or filters the whole
    command.
    """
    row = row_before(draft, view.roles.command)
    return f"{row[-1]}.in_" if row else view.roles.command


def join(draft: Draft, view: View, source: str, target: str | None = None) -> None:
    """Add a source to a sum, that of the command unless told otherwise."""
    draft.connect(
        source, command_entry(draft, view) if target in (None, view.roles.command) else target
    )


def loops(view: View) -> tuple[str | None, ...]:
    """The current and voltage loops, through which no feedforward counts."""
    return view.roles.current_loop, view.roles.voltage_loop


def joins_command(view: View, source: str) -> bool:
    """True when an output reaches the command past the loops."""
    return path(view.draft, source, view.roles.command, without=loops(view)) is not None


# --- measured signals
# ----------------------------------------------------------------------------------------------


def terminal_voltage(view: View) -> str:
    """The voltage of the PCC in the controller's frame."""
    return view.draft.sources(f"{view.roles.plant}.v_in")[0]


def grid_current(view: View) -> str:
    """The current into the grid."""
    return f"{view.roles.plant}.i_g"


def has_line(view: View) -> bool:
    """True when the measured voltage is not that of the PCC."""
    return view.draft.kind(view.roles.plant).has_line


def measured_current(view: View) -> str:
    """The current that the current loop measures, else that of the converter."""
    both = (view.roles.current, grid_current(view))
    return next(
        (one for one in both if view.roles.current_loop and _loop_path(view, one) is not None),
        both[0],
    )


def _loop_path(view: View, current: str) -> tuple[str, ...] | None:
    drops = view.draft.having(Element.GAIN, signal=Signal.DQ_VEC)  # of a virtual impedance
    return path(view.draft, current, f"{view.roles.current_loop}.in_", without=drops)


def current_path(view: View) -> tuple[str, ...]:
    """Blocks between the measured current and the current loop, the loop at the end; () without
    such a loop.
    """
    loop = view.roles.current_loop
    way = _loop_path(view, measured_current(view)) if loop else None
    return () if way is None or loop is None else (*way, loop)


def current_entries(view: View) -> dict[str, list[str]]:
    """Inputs of the measured current, for current loop and decoupling together, and for the loop
    alone.
    """
    way, current = current_path(view), measured_current(view)
    if not way:
        return {}
    alone = [f"{way[0]}.in_"]
    others = [f"{name}.in_" for name in decouplings(view)]
    together = alone + [
        one for one in others if one not in alone and current in view.draft.sources(one)
    ]
    return (
        {"current loop and decoupling": together, "the current loop alone": alone}
        if len(together) > 1
        else {"the current loop": alone}
    )


def decouplings(view: View) -> list[str]:
    """Modules that add J times the measured current to the command, whatever filters are in
    between.
    """
    draft, current = view.draft, measured_current(view)
    couplings = []
    for name in draft.having(*COUPLINGS):
        before = path(draft, current, f"{name}.in_")
        if (
            before is not None
            and not odd_signs(view, before)
            and joins_command(view, f"{name}.out")
        ):
            couplings.append(name)
    return couplings


def odd_signs(view: View, blocks: Iterable[str]) -> bool:
    """True when the blocks of a way turn the sign of a dq signal."""
    return sum(view.element(name) is Element.SIGN for name in blocks) % 2 == 1


def frequency_sources(draft: Draft, view: View) -> list[str]:
    """What makes the frequency of the controller's frame: all that adds up at the plant, but for
    zeros.
    """
    sources = draft.sources(f"{view.roles.plant}.delta_omega")
    return [one for one in sources if draft.kind(split_port(one)[0]).element is not Element.ZERO]


# --- the axes of the current reference
# ----------------------------------------------------------------------------------------------


def packs(view: View) -> list[str]:
    """PackDQ modules that give the reference its two axes."""
    return _packs(view.draft, view.roles.reference)


def _packs(draft: Draft, target: str) -> list[str]:
    return [
        name
        for name in draft.having(Element.PACK)
        if path(draft, f"{name}.out", target) is not None
    ]


def regulator(view: View, axis: str) -> str | None:
    """The scalar regulator that drives an axis, "in_d" or "in_q", of the reference; None where
    nothing does.
    """
    ways = ((name, f"{pack}.{axis}") for pack in packs(view) for name in view.roles.outer)
    return next(
        (name for name, target in ways if path(view.draft, f"{name}.out", target) is not None), None
    )


def regulates(view: View, name: str | None) -> str | None:
    """What a scalar regulator acts on: "p", "q", "voltage" (a magnitude), "dc" (a DC voltage); None
    for anything else.
    """
    if name is None:
        return None
    draft = view.draft
    measured = {f"{one}.{axis}": axis for one in view.roles.power for axis in ("p", "q")}
    measured |= {f"{one}.v_dc": "dc" for one in draft.having(Element.DC_LINK)}
    measured |= {
        f"{one}.out": "voltage" for one in draft.having(Element.MAGNITUDE, Element.SLICE_D)
    }
    return next(
        (what for port, what in measured.items() if path(draft, port, f"{name}.in_") is not None),
        None,
    )


def drive_axis(draft: Edit, source: str, target: str, axis: str) -> None:
    """Let a scalar drive one axis of a dq input, in place of what drove that axis before."""
    found = _packs(draft, target)
    pack = found[0] if found else draft.add("PackDQ", "reference")
    draft.drive(f"{pack}.{axis}", source)
    if not found:
        draft.connect(f"{pack}.out", target)


def power_block(draft: Edit, view: View) -> str:
    """The module that computes p and q; a new one of the measured voltage and the grid current if
    there is none.
    """
    found = draft.having(Element.POWER)
    if found:
        return found[0]
    name = draft.add("PQ_calc", "power")
    draft.chain(view.roles.voltage, f"{name}.e", grid_current(view), f"{name}.i")
    return name
