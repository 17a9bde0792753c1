"""Which signals of a diagram have an operating point that follows from the plant, whatever the
controller contains.

It starts at the terminal voltage and the plant's outputs and is carried through sums, memoryless
modules and the DC gain of filters and delays. Behind an integrator or a product it is lost; a loop
of modules has none either. What drives the plant's command comes from behind integrators and
constants, but together it rests where the plant's u_r does.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass
from typing import TypeVar

from ibrid.border import takes_kinds
from ibrid.modules.behaviour import ROTATIONS
from ibrid.modules.kind import ModuleKind
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port

Maker = TypeVar("Maker", bound=Hashable)
Made = TypeVar("Made", bound=Hashable)


@dataclass(frozen=True)
class Steady:
    """Signals at rest.

    `order` : modules whose outputs follow from the plant, each after the modules that it needs; the
    plant itself is not among them. `known` : every output, "NAME.port" or `v_DQ`, whose operating
    point follows from the plant, and its u_r.
    `entering` : of each input, what adds up there at rest (see `entering`).
    """

    order: tuple[str, ...]
    known: frozenset[str]
    entering: Mapping[str, tuple[str, ...]]


def carries(kind: ModuleKind) -> bool:
    """True for a kind whose outputs at rest follow linearly from its inputs at rest."""
    if kind.family == PLANT or kind.bilinear:
        return False
    return kind.static or kind.dc_gain is not None


def steady_inputs(kind: ModuleKind) -> tuple[str, ...]:
    """The inputs that set a kind's outputs at rest.

    Where the operating point enters the law (Rot_v, Rot_i, JMul_omega), the other inputs, angle and
    frequency, are deviations from it and zero at rest.
    """
    return tuple(port for port in kind.inputs if port in kind.equilibrium_ports) or tuple(
        kind.inputs
    )


def command_of(wiring: Wiring) -> frozenset[str]:
    """The outputs that drive the plant's command, as the controller makes them; none where all of
    them are measured signals.
    """
    sources = frozenset(wiring.sources.get(f"{wiring.plant}.u_r", ()))
    return frozenset() if all(_measured(wiring, one) for one in sources) else sources


def entering(wiring: Wiring, command: Set[str]) -> dict[str, tuple[str, ...]]:
    """Input -> what adds up there; where the whole `command` does, the plant's u_r in its place."""
    own = f"{wiring.plant}.u_r"
    summands = {port: tuple(sources) for port, sources in wiring.sources.items()}
    for port, sources in wiring.sources.items():
        if command and port != own and command <= set(sources):
            summands[port] = (own, *(one for one in sources if one not in command))
    return summands


def _measured(wiring: Wiring, source: str) -> bool:
    """Whether a source is a signal of the plant or of the terminals, at most turned, filtered or
    delayed.
    """
    for _ in wiring.kinds:  # a loop of filters ends nowhere
        kind = wiring.kinds.get(name := split_port(source)[0])
        if kind is None or kind.family == PLANT:
            return True
        before = wiring.sources[f"{name}.{steady_inputs(kind)[0]}"] if kind.inputs else ()
        if len(before) != 1 or not (kind.element in ROTATIONS or kind.dc_gain == 1.0):
            return False
        (source,) = before
    return False


@takes_kinds
def steady_order(wiring: Wiring) -> Steady:
    """Carry the operating point from the plant through the diagram."""
    known, arriving = (
        {TERMINAL_VOLTAGE, f"{wiring.plant}.u_r"},
        entering(wiring, command_of(wiring)),
    )
    outputs = {
        name: [f"{name}.{port}" for port in kind.outputs] for name, kind in wiring.kinds.items()
    }
    known.update(
        one for name, kind in wiring.kinds.items() if kind.family == PLANT for one in outputs[name]
    )
    needs = {
        name: {source for port in steady_inputs(kind) for source in arriving[f"{name}.{port}"]}
        for name, kind in wiring.kinds.items()
        if carries(kind) and not known.issuperset(outputs[name])
    }
    order = in_order(needs, known, outputs.__getitem__)
    return Steady(
        tuple(order), frozenset(known.union(*(outputs[name] for name in order))), arriving
    )


def in_order(
    needs: Mapping[Maker, Set[Made]], known: Set[Made], makes: Callable[[Maker], Iterable[Made]]
) -> list[Maker]:
    """What follows from the `known`, each after what makes all that it needs; what nothing leads to
    is left out.
    """
    users: dict[Made, list[Maker]] = {}
    for one, needed in needs.items():
        for made in needed - known:
            users.setdefault(made, []).append(one)
    left = {one: len(needed - known) for one, needed in needs.items()}
    order = [one for one, number in left.items() if not number]
    for maker in order:  # grows while it is walked
        for user in (user for made in makes(maker) for user in users.get(made, ())):
            left[user] -= 1
            if not left[user]:
                order.append(user)
    return order


@takes_kinds
def unknown_equilibria(wiring: Wiring, steady: Steady | None = None) -> tuple[tuple[str, str], ...]:
    """(instance, port) wherever a module needs the operating point of a signal that does not follow
    from the plant.
    """
    steady = steady or steady_order(wiring)
    return tuple(
        (name, port)
        for name, kind in wiring.kinds.items()
        if kind.family != PLANT
        for port in kind.equilibrium_ports
        if not steady.known.issuperset(steady.entering[f"{name}.{port}"])
    )


def lost_at(wiring: Wiring, port: str, steady: Steady | None = None) -> str | None:
    """The nearest module upstream of an input at which its operating point is lost; None when that
    is a loop.
    """
    steady = steady or steady_order(wiring)
    front, seen = list(_unknown(port, steady)), set[str]()
    for name in front:  # breadth first; grows while it is walked
        if name in seen:
            continue
        seen.add(name)
        kind = wiring.kinds[name]
        if not carries(kind):
            return name
        for one in steady_inputs(kind):
            front += _unknown(f"{name}.{one}", steady)
    return None


def _unknown(port: str, steady: Steady) -> Iterator[str]:
    return (split_port(source)[0] for source in steady.entering[port] if source not in steady.known)
