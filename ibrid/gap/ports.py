"""Ports of a diagram: the places at which one unknown transfer may join it, each as an edited diagram.

In series, a block 1 + Delta lies in a signal; a missing path is such a block beside a wire of -1, so that Delta alone is
added. At Delta = 0 every edited diagram is the given one, with the same parameters.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from ibrid.gap.axes import packs, regulates, regulator
from ibrid.gap.effect import Edit, Model, model_of
from ibrid.gap.effects.feedforward import feedforward
from ibrid.gap.places import command_entries, current_entries, into_whole_command, measured_current
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.check import violations
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram


@dataclass(frozen=True)
class Port:
    """A place for one unknown transfer.

    `name` : of the place, in names of the user's program. `words` : what an engineer calls it. `diagram` : the given one
    with the block in it, of the kinds given and `PORT_KINDS`. `block` : name of that module.
    """

    name: str
    words: str
    diagram: Diagram
    block: str


def _unknown():
    return [[-1]], [[1]], [[1]], [[0]]


def _unknown_dq():
    return [[-1, 0], [0, -1]], [[1, 0], [0, 1]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]


def _quarter_turn():
    return [], [], [[], []], [[0, -1], [1, 0]]


def _port_kind(name: str, law: str, signal: Signal, states: tuple[str, ...], state_space, gain: float | None):
    return ModuleKind(
        name=name,
        family="static" if gain is None else "dynamic control",
        law=law,
        inputs={"in_": signal},
        outputs={"out": signal},
        states=states,
        parameters={},
        state_space=state_space,
        dc_gain=gain,
        extended=True,
        reference="the port map of the gap workflow",
    )


_LAW = "out = (1 + Delta) in_, Delta unknown; where numbers are needed, a lag of 1 s whose row is replaced"
#: The blocks of ports, on a scalar and on both axes, and J. One row of a model belongs to each state of the first two.
UNKNOWN = _port_kind("Unknown", _LAW, Signal.SCALAR, ("through",), _unknown, 1.0)
UNKNOWN_DQ = _port_kind("Unknown_dq", _LAW, Signal.DQ_VEC, ("through_d", "through_q"), _unknown_dq, 1.0)
QUARTER_TURN = _port_kind("Quarter_turn", "out = J in_", Signal.DQ_VEC, (), _quarter_turn, None)
PORT_KINDS: Vocabulary = (UNKNOWN, UNKNOWN_DQ, QUARTER_TURN)

#: Name, words, and the edit that puts the block in and returns its name.
Place = tuple[str, str, Callable[[Edit], str]]


def ports(diagram: Diagram, kinds: Vocabulary) -> tuple[Port, ...]:
    """Every port that a legal diagram has, each with a legal diagram; () where there is not one plant with a command.

    Places at which an unknown transfer says exactly the same come once: what joins the current reference also joins the
    command, behind the current regulator.
    """
    model = model_of(diagram, (*kinds, *PORT_KINDS))
    if model is None:
        return ()
    found = []
    for name, words, edit in (*_in_series(model), *_missing_paths(model)):
        draft = Edit(model.diagram, model.kinds)
        block = edit(draft)
        port = Port(name, words, draft.diagram(), block)
        if not violations(port.diagram, model.kinds):
            found.append(port)
    return tuple(found)


# --- in series -------------------------------------------------------------------------------------------------------


def _in_series(model: Model) -> Iterator[Place]:
    roles, draft = model.roles, model.draft
    yield (
        roles.command,
        "the whole voltage command",
        lambda draft: into_whole_command(draft, roles.command, "Unknown_dq", "port"),
    )
    for pll in draft.named("SRF_PLL"):
        yield f"{pll}.e_q", "input of the PLL", _before(f"{pll}.e_q", "Unknown")
    for block in roles.power:
        yield from _measured_power(model, block)
    entries = list(current_entries(model).items())
    for what, targets in entries:
        alone = len(targets) == 1
        name = targets[0] if alone else measured_current(model)
        yield name, f"measured current, for {what}", _behind(measured_current(model), targets)
    found = feedforward(model)
    if found is not None:
        targets = command_entries(draft, roles.command)
        yield f"{found.voltage} -> {roles.command}", "feedforward of the voltage", _behind(found.last, targets)
    for pack in packs(model):
        yield f"{pack}.out", "current reference", _behind(f"{pack}.out")
    for name in roles.outer:
        what = {"in_d": "d", "in_q": "q"}
        axes = [axis for port, axis in what.items() if regulator(model, port) == name]
        yield f"{name}.out", f"outer loop of the {' and '.join(axes) or 'reference'} axis", _behind(f"{name}.out")
    for name, words in ((roles.current_loop, "current regulator"), (roles.voltage_loop, "voltage regulator")):
        if name is not None:
            yield f"{name}.out", f"output of the {words}", _behind(f"{name}.out")


def _before(target: str, kind: str) -> Callable[[Edit], str]:
    return lambda draft: draft.insert_before(target, kind, "port")


def _behind(source: str, targets: Iterable[str] = ()) -> Callable[[Edit], str]:
    """A block behind an output, for all that takes it or for some inputs."""

    def edit(draft: Edit) -> str:
        kind = "Unknown_dq" if draft.signal(source) is Signal.DQ_VEC else "Unknown"
        return draft.insert(source, targets or draft.targets(source), kind, "port")

    return edit


def _measured_power(model: Model, block: str) -> Iterator[Place]:
    used = {axis: f"{block}.{axis}" for axis in "pq" if model.draft.targets(f"{block}.{axis}")}
    if len(used) == 1:
        ((axis, port),) = used.items()
        yield port, f"measured {axis}", _behind(port)
    elif used:

        def edit(draft: Edit) -> str:
            pack, name = draft.add("PackDQ", "port_in"), draft.add("Unknown_dq", "port")
            for (axis, port), kind, entry in zip(used.items(), ("SliceD", "SliceQ"), ("in_d", "in_q"), strict=True):
                out = draft.add(kind, f"port_{axis}")
                for target in draft.targets(port):
                    draft.disconnect(port, target)
                    draft.connect(f"{out}.out", target)
                draft.chain(port, f"{pack}.{entry}", f"{name}.out", f"{out}.in_")
            draft.connect(f"{pack}.out", f"{name}.in_")
            return name

        yield " and ".join(used.values()), "measured p and q together", edit


# --- missing paths ---------------------------------------------------------------------------------------------------


def _missing_paths(model: Model) -> Iterator[Place]:
    roles, draft = model.roles, model.draft
    plant, command = roles.plant, command_entries(draft, roles.command)
    outputs = draft.kind(plant).outputs
    current, grid = f"{plant}.i_ti", f"{plant}.i_g"
    if feedforward(model) is None:
        yield _path(roles.voltage, command, roles.command, "a path from the filter voltage to the command")
    measured = measured_current(model) if roles.current_loop else None
    if "i_ti" in outputs:
        if measured != current:  # else a block for the current loop alone
            yield _path(current, command, roles.command, "a path from the converter current to the command")
        yield _path(f"{plant}.i_C", command, roles.command, "a path from the capacitor current to the command")
        yield _path(current, command, roles.command, "coupling of the axes by the converter current", turned=True)
    reference = [roles.reference] if roles.current_loop else command
    if measured != grid:
        yield _path(grid, reference, roles.reference, "a path from the grid current to the current reference")
    yield _path(grid, reference, roles.reference, "coupling of the axes by the grid current", turned=True)
    loop = regulator(model, "in_d")
    if roles.frequency is not None and loop is not None and regulates(model, loop) == "p":
        (frequency, *_) = draft.sources(f"{plant}.delta_omega")
        yield _path(frequency, [f"{loop}.in_"], f"{loop}.in_", "a path from the frequency to the loop of p")
    yield _path(TERMINAL_VOLTAGE, [TERMINAL_CURRENT], TERMINAL_CURRENT, "a shunt conductance at the PCC")
    yield _path(TERMINAL_VOLTAGE, [TERMINAL_CURRENT], TERMINAL_CURRENT, "a shunt susceptance at the PCC", turned=True)


def _path(source: str, targets: Iterable[str], joined: str, words: str, *, turned: bool = False) -> Place:
    """Delta times a source, or J times that, added to inputs."""

    def edit(draft: Edit) -> str:
        start = source
        if turned:
            turn = draft.add("Quarter_turn", "port_J")
            draft.connect(source, f"{turn}.in_")
            start = f"{turn}.out"
        vector = draft.signal(start) is Signal.DQ_VEC
        name = draft.add("Unknown_dq" if vector else "Unknown", "port")
        minus = draft.add("Negate_dq" if vector else "Negate", "port_minus")
        for block in (name, minus):
            draft.connect(start, f"{block}.in_")
            for target in targets:
                draft.connect(f"{block}.out", target)
        return name

    return f"{'J ' if turned else ''}{source} -> {joined}", words, edit
