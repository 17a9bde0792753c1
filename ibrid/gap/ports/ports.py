"""Ports of a diagram: where one unknown transfer function may be added, each as an edited diagram.

In series, a block 1 + Delta is inserted into a signal; a missing path is such a block in parallel
with -1, so that Delta alone is added. Equivalent ports are listed once: what is added to the
current reference can be added to the command, behind the current regulator, and a block in the
current of the current loop alone adds to the command what a path from that current does.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from ibrid.gap.ports.port_kinds import PORT_KINDS, QUARTER_TURN, unknown_kind
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.edit import Edit, NotInVocabulary
from ibrid.parts.editing.feedforward_path import feedforward
from ibrid.parts.editing.paths import (
    command_entry,
    current_entries,
    measured_current,
    packs,
    power_block,
    regulates,
    regulator,
)
from ibrid.parts.editing.view import View, views_of
from ibrid.signals import Signal
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram


@dataclass(frozen=True)
class Port:
    """A place in a diagram for one unknown transfer function.

    Parameters
    ----------
    name : str
        Of the place, in names of the user's program.
    words : str
        What an engineer calls it.
    diagram : Diagram
        The given one with the block in it, of the given kinds and `PORT_KINDS`. Its free parameters
        are those of the given one, and with Delta = 0 it is equivalent to that, or, where the port
        replaces a regulator, to that without the regulator's output.
    block : str
        Name of the block.
    series : bool
        True in a signal, where the transfer function is 1 + Delta; False for a path of its own,
        where it is Delta.
    """

    name: str
    words: str
    diagram: Diagram
    block: str
    series: bool


def ports(diagram: Diagram, kinds: Vocabulary) -> tuple[Port, ...]:
    """List the ports of a legal diagram, device by device, each with a legal diagram.

    () where no plant has a voltage command.

    Places at which an unknown transfer says exactly the same come once, but for those that an
    engineer tells apart.
    """
    return tuple(
        port for view in views_of(diagram, (*kinds, *PORT_KINDS)) for port in _ports_of(view)
    )


def _ports_of(view: View) -> list[Port]:
    """Return the ports of one device, those in series first."""
    legal: list[Port] = []
    in_series = tuple(list_series_locations(view))
    for location in (*in_series, *list_parallel_locations(view)):
        try:
            drawn = view.drawn(location.edit)
        except NotInVocabulary:
            continue
        if violations(drawn.diagram, view.kinds):
            continue
        is_series = location in in_series
        port = Port(location.name, location.words, drawn.diagram, drawn.result, is_series)
        legal.append(port)
    return legal


@dataclass(frozen=True)
class PortLocation:
    """Where a port may be added.

    Parameters
    ----------
    name, words : str
        As of `Port`.
    edit : callable
        Inserts the block into a draft and returns its name.
    """

    name: str
    words: str
    edit: Callable[[Edit], str]


# --- in series
# ----------------------------------------------------------------------------------------------


def list_series_locations(view: View) -> Iterator[PortLocation]:
    """Yield the signals of the controller, from the command back to what is measured."""
    roles = view.roles
    draft = view.draft
    yield PortLocation(
        roles.command,
        "the whole voltage command",
        lambda draft: draft.insert_before(roles.command, unknown_kind(Signal.DQ_VEC), "port"),
    )
    for pll in draft.having(Element.PLL):
        yield PortLocation(
            f"{pll}.e_q",
            "the input of the PLL",
            lambda draft, pll=pll: draft.insert_before(
                f"{pll}.e_q", unknown_kind(Signal.SCALAR), "port"
            ),
        )
    for block in roles.power:
        yield from _list_power_locations(view, block)
    current = measured_current(view)
    for what, targets in current_entries(view).items():
        name = current if len(targets) > 1 else targets[0]
        yield PortLocation(
            name, f"the measured current, for {what}", _insert_behind(current, targets)
        )
    measured = feedforward(view)
    if measured is not None:
        name = f"{measured.voltage} -> {roles.command}"
        yield PortLocation(
            name,
            f"the feedforward of {measured.voltage}",
            _insert_behind(measured.last, [command_entry(draft, view)]),
        )
    for pack in packs(view):
        yield PortLocation(f"{pack}.out", "the current reference", _insert_behind(f"{pack}.out"))
    for name in roles.outer:
        axes = [axis[-1] for axis in ("in_d", "in_q") if regulator(view, axis) == name]
        which = f"of the {' and '.join(axes)} axis" if axes else "beside another"
        yield PortLocation(
            f"{name}.out", f"the output of the outer loop {which}", _insert_behind(f"{name}.out")
        )
    for name, what in ((roles.current_loop, "current"), (roles.voltage_loop, "voltage")):
        if name is not None:
            yield PortLocation(
                f"{name}.out", f"the output of the {what} regulator", _insert_behind(f"{name}.out")
            )


def _insert_behind(source: str, targets: Iterable[str] = ()) -> Callable[[Edit], str]:
    """Insert a block behind an output, for all its targets or for some."""
    return lambda draft: draft.insert(
        source, targets or draft.targets(source), unknown_kind(draft.signal(source)), "port"
    )


def _list_power_locations(view: View, block: str) -> Iterator[PortLocation]:
    """Yield one block for p and q, or for the one of them that the model uses."""
    used = {axis: f"{block}.{axis}" for axis in "pq" if view.draft.targets(f"{block}.{axis}")}
    if len(used) < 2:
        yield from (
            PortLocation(port, f"the measured {axis}", _insert_behind(port))
            for axis, port in used.items()
        )
        return

    def edit(draft: Edit) -> str:
        pair = draft.add(draft.usual(Element.PACK), "port_pair")
        name = draft.add(unknown_kind(Signal.DQ_VEC), "port")
        draft.connect(f"{pair}.out", f"{name}.in_")
        for axis, element, entry in (
            ("p", Element.SLICE_D, "in_d"),
            ("q", Element.SLICE_Q, "in_q"),
        ):
            out = draft.add(draft.usual(element), f"port_{axis}")
            draft.rewire(used[axis], f"{out}.out", *draft.targets(used[axis]))
            draft.chain(used[axis], f"{pair}.{entry}", f"{name}.out", f"{out}.in_")
        return name

    yield PortLocation(" and ".join(used.values()), "the measured p and q", edit)


# --- missing paths
# ----------------------------------------------------------------------------------------------


def list_parallel_locations(view: View) -> Iterator[PortLocation]:
    """Yield missing paths from measured voltages and currents.

    To the voltage command and the current reference, to the axes of that, and shunts at the PCC.
    """
    roles = view.roles
    draft = view.draft
    plant = roles.plant
    command = (roles.command, [command_entry(draft, view)])
    reference = (roles.reference, [roles.reference]) if roles.current_loop else command
    measured = measured_current(view) if roles.current_loop else None
    outputs = draft.kind(plant).outputs
    if feedforward(view) is None:
        yield _parallel_location(
            roles.voltage, *command, "a path from the filter voltage to the command"
        )
    if "i_ti" in outputs:
        if measured != f"{plant}.i_ti":
            yield _parallel_location(
                f"{plant}.i_ti", *command, "a path from the converter current to the command"
            )
        yield _parallel_location(
            f"{plant}.i_C", *command, "a path from the capacitor current to the command"
        )
        yield _parallel_location(
            f"{plant}.i_ti",
            *command,
            "a coupling of the axes by the converter current",
            turned=True,
        )
    if measured != f"{plant}.i_g":
        yield _parallel_location(
            f"{plant}.i_g", *reference, "a path from the grid current to the current reference"
        )
    yield _parallel_location(
        f"{plant}.i_g", *reference, "a coupling of the axes by the grid current", turned=True
    )
    loop = regulator(view, "in_d")
    if roles.frequency is not None and loop is not None and regulates(view, loop) == "p":
        (frequency, *_) = draft.sources(f"{plant}.delta_omega")
        entry = f"{loop}.in_"
        yield _parallel_location(
            frequency, entry, [entry], "a path from the frequency to the loop of p"
        )
    yield from _list_axis_locations(view)
    pcc = (TERMINAL_VOLTAGE, TERMINAL_CURRENT, [TERMINAL_CURRENT])
    yield _parallel_location(*pcc, "a shunt at the PCC that acts on each axis")
    yield _parallel_location(*pcc, "a shunt at the PCC that couples the axes", turned=True)


def _parallel_location(
    source: str, joined: str, targets: Iterable[str], words: str, *, turned: bool = False
) -> PortLocation:
    """Add Delta times a source, or J times that, to inputs."""
    if not turned:
        return PortLocation(
            f"{source} -> {joined}", words, _insert_parallel(lambda draft: source, targets)
        )
    crossed = _insert_parallel(
        lambda draft: draft.after(source, QUARTER_TURN.name, "port_J"), targets
    )
    return PortLocation(f"J {source} -> {joined}", words, crossed)


def _list_axis_locations(view: View) -> Iterator[PortLocation]:
    """Yield paths to one axis of the current reference, from quantities that may regulate it.

    In place of the regulator that is there, where that regulates another quantity.
    """
    roles = view.roles

    def converter_power(draft: Edit) -> str:
        name = draft.add(draft.usual(Element.POWER), "port_power")
        draft.gather(f"{name}.e", *draft.sources(roles.command))
        draft.connect(roles.current, f"{name}.i")
        return f"{name}.p"

    def voltage_magnitude(draft: Edit) -> str:
        return draft.after(roles.voltage, draft.usual(Element.MAGNITUDE), "port_size")

    power = f"power at {roles.command}"
    voltage = f"|{roles.voltage}|"
    quantities = {
        "in_d": {
            "p": ("p", lambda draft: f"{power_block(draft, view)}.p"),
            "dc": (power, converter_power),
        },
        "in_q": {
            "q": ("q", lambda draft: f"{power_block(draft, view)}.q"),
            "voltage": (voltage, voltage_magnitude),
        },
    }
    for pack in packs(view):
        for axis, by_name in quantities.items():
            target = f"{pack}.{axis}"
            outer = regulator(view, axis)
            regulated = regulates(view, outer)
            for quantity, (name, start) in by_name.items():
                words = f"a path from {name} to the {axis[-1]} axis of the current reference"
                if regulated is None and outer is None:
                    yield PortLocation(
                        f"{name} -> {target}", words, _insert_parallel(start, [target])
                    )
                elif regulated != quantity:
                    instead = f" in place of {outer}"
                    yield PortLocation(
                        f"{name} -> {target}{instead}",
                        words + instead,
                        _insert_parallel(start, [target], instead=outer),
                    )
            if regulated == "q":
                words = f"a path from {voltage} to the q axis of the current reference"
                yield PortLocation(
                    f"{voltage} -> {target}", words, _insert_parallel(voltage_magnitude, [target])
                )


def _insert_parallel(
    start: Callable[[Edit], str], targets: Iterable[str], *, instead: str | None = None
) -> Callable[[Edit], str]:
    """Return an edit that adds Delta times a signal to inputs: 1 + Delta in parallel with -1.

    Parameters
    ----------
    start : callable
        Finds or makes the signal in a draft.
    instead : str or None
        A scalar module whose output is multiplied by 0; its parameters stay.
    """

    def edit(draft: Edit) -> str:
        source = start(draft)
        signal = draft.signal(source)
        name = draft.add(unknown_kind(signal), "port")
        minus = draft.add(draft.usual(Element.SIGN, signal), "port_minus")
        for block in (name, minus):
            draft.connect(source, f"{block}.in_")
            draft.connect(f"{block}.out", *targets)
        if instead is not None:
            draft.insert(
                f"{instead}.out",
                draft.targets(f"{instead}.out"),
                draft.usual(Element.GAIN, Signal.SCALAR),
                "port_off",
                k=0.0,
            )
        return name

    return edit
