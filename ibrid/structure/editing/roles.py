"""What an engineer sees in a diagram: which blocks are the plant, the synchronisation, the current
and outer loops.
"""

from dataclasses import dataclass

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port


@dataclass(frozen=True)
class Roles:
    """Ports and modules by what they do; None or empty where the diagram has no such thing.

    `plant` : its module. `current` : the converter's current, which a current loop measures.
    `voltage` : the voltage at the filter. `command` : the input that the controller drives.
    `frequency` : the module that makes the frequency, a PLL or another. `rotated` : True when the
    controller has a frame of its own. `current_loop`, `voltage_loop` : regulators of the current,
    and of the voltage in front of it. `reference` : the input at which outer loops give the current
    loop its reference; the command when there is no current loop. `power` : modules that compute p,
    q. `outer` : scalar regulators that act through a pack of two axes on the reference.
    """

    plant: str
    lcl: bool
    current: str
    voltage: str
    command: str
    frequency: str | None
    rotated: bool
    current_loop: str | None
    voltage_loop: str | None
    reference: str
    power: tuple[str, ...]
    outer: tuple[str, ...]

    @property
    def missing_layers(self) -> int:
        """Of synchronisation, an inner loop of current or voltage, and outer loops: those that are
        not there.
        """
        inner = self.current_loop is not None or self.voltage_loop is not None
        return (
            (self.frequency is None) + (not inner) + (not self.outer and self.voltage_loop is None)
        )


def roles(diagram: Diagram, kinds: Vocabulary) -> Roles | None:
    """Recognise the roles in a legal diagram; None where the plant is not one with a command
    input.
    """
    draft = Draft(diagram, kinds)
    plants = [name for name in draft.instances if "u_r" in draft.kind(name).inputs]
    if len(plants) != 1:
        return None
    plant = plants[0]
    lcl = draft.kind(plant).has_capacitor
    current, voltage, command = f"{plant}.{'i_ti' if lcl else 'i_g'}", f"{plant}.e", f"{plant}.u_r"
    current_loop = _regulator(draft, command, (current, f"{plant}.i_g"))
    reference = f"{current_loop}.in_" if current_loop else command
    voltage_loop = _regulator(draft, reference, (voltage,), apart_from=current_loop)
    makers = [split_port(one)[0] for one in draft.sources(f"{plant}.delta_omega")]
    frequency = next(
        (name for name in makers if name and draft.kind(name).element is not Element.ZERO), None
    )
    packs = [
        name
        for name in draft.having(Element.PACK)
        if name in draft.upstream(reference, without=plant)
    ]
    outer = [
        name
        for name in draft.instances
        if _regulates(draft.kind(name), Signal.SCALAR)
        and any(_leads(draft, name, pack) for pack in packs)
    ]
    return Roles(
        plant=plant,
        lcl=lcl,
        current=current,
        voltage=voltage,
        command=command,
        frequency=frequency,
        rotated=any(
            draft.kind(split_port(one)[0]).element is Element.ROTATION_OUT
            for one in draft.sources(TERMINAL_CURRENT)
            if "." in one
        ),
        current_loop=current_loop,
        voltage_loop=voltage_loop,
        reference=reference,
        power=tuple(draft.having(Element.POWER)),
        outer=tuple(outer),
    )


def _regulator(
    draft: Draft, target: str, measured: tuple[str, ...], apart_from: str | None = None
) -> str | None:
    """The regulator that drives `target`, maybe through other dq blocks, from an error with a
    negated measurement.
    """
    seen: set[str] = set()
    waiting = [split_port(one)[0] for one in draft.sources(target)]
    while waiting:
        name = waiting.pop(0)
        if not name or name in seen:
            continue
        seen.add(name)
        kind = draft.kind(name)
        if list(kind.inputs.values()) != [Signal.DQ_VEC] or list(kind.outputs.values()) != [
            Signal.DQ_VEC
        ]:
            continue
        if (
            _regulates(kind, Signal.DQ_VEC)
            and name != apart_from
            and _subtracts(draft, f"{name}.in_", measured)
        ):
            return name
        waiting += [split_port(one)[0] for one in draft.sources(f"{name}.in_")]
    return None


def _regulates(kind: ModuleKind, signal: Signal) -> bool:
    return kind.regulates and kind.signal is signal


def _subtracts(draft: Draft, target: str, measured: tuple[str, ...]) -> bool:
    """True when an input gets a measurement through a sign, filters between them allowed."""
    for source in draft.sources(target):
        negative, port, passed = False, source, set()
        while port not in measured and port not in passed:  # blocks may feed themselves
            passed.add(port)
            name = split_port(port)[0]
            if not name or not (
                draft.kind(name).shapes or draft.kind(name).element is Element.SIGN
            ):
                break
            negative ^= draft.kind(name).element is Element.SIGN
            before = draft.sources(f"{name}.in_")
            if len(before) != 1:
                break
            port = before[0]
        if negative and port in measured:
            return True
    return False


def _leads(draft: Draft, name: str, pack: str) -> bool:
    """True when a scalar block's output reaches an axis of a pack through scalar blocks."""
    waiting, seen = [f"{name}.out"], set()
    while waiting:
        port = waiting.pop()
        for target in draft.targets(port):
            owner = split_port(target)[0]
            if owner == pack:
                return True
            if (
                owner
                and owner not in seen
                and list(draft.kind(owner).outputs.values()) == [Signal.SCALAR]
            ):
                seen.add(owner)
                waiting.append(f"{owner}.out")
    return False
