"""The rules of the grammar for a whole diagram, and the order in which they are asked (paper,
section IV, A.1).
"""

from collections.abc import Sequence

from ibrid.errors import some
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import usual_kind
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, Connection, Instance
from ibrid.structure.grammar_rules.algebraic_loops import LARGEST_LOOP, TIGHTEST_LOOP, AlgebraicLoop
from ibrid.structure.grammar_rules.connection_rules import check_connections, check_modules
from ibrid.structure.grammar_rules.devices import check_plants
from ibrid.structure.grammar_rules.violation import Violations
from ibrid.structure.reading.steady_state import lost_at, steady_order, unknown_equilibria
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port

HIGHEST_ORDER = 30
#: Together with `LARGEST_LOOP` they bound what an evaluation takes between two looks at the clock,
#: and its memory.
MOST_FREE = 100
MOST_MODULES, MOST_CONNECTIONS = 200, 1000


def check_program(
    instances: Sequence[Instance],
    connections: Sequence[Connection],
    vocabulary: Sequence[ModuleKind],
    equilibrium: str,
    findings: Violations,
) -> None:
    """Report what can be seen before a diagram is wired: its size, its modules, its connections,
    and the whole of them.
    """
    for what, number, most in (
        ("modules", len(instances), MOST_MODULES),
        ("connections", len(connections), MOST_CONNECTIONS),
    ):
        if number > most:
            findings.add(
                None, "size", f"the diagram has {number} {what}, more than {most}; leave some out"
            )
    if findings:
        return
    kinds = check_modules(instances, vocabulary, equilibrium, findings)
    check_connections(instances, connections, kinds, findings)
    check_plants(instances, connections, kinds, vocabulary, findings)
    if all(connection.target != TERMINAL_CURRENT for connection in connections):
        findings.add(
            None,
            "no_terminal_current",
            f"nothing drives {TERMINAL_CURRENT}; {_terminal_remedy(kinds, vocabulary)}",
        )
    orders = {name: kind.order for name, kind in kinds.items() if kind is not None and kind.order}
    if (order := sum(orders.values())) > HIGHEST_ORDER:
        largest = sorted(orders, key=lambda name: -orders[name])
        listed = some(f"{name} {orders[name]}" for name in largest)
        findings.add(
            None,
            "order",
            f"the order is {order}, above {HIGHEST_ORDER}; leave out some of {listed}",
        )


def _terminal_remedy(kinds: dict[str, ModuleKind | None], vocabulary: Sequence[ModuleKind]) -> str:
    for name, kind in kinds.items():
        if kind is not None and kind.element is Element.ROTATION_OUT:
            return f"connect {name}.i_DQ to it"
    turned = usual_kind(Element.ROTATION_OUT, kinds=vocabulary).name
    for name, kind in kinds.items():
        if kind is not None and kind.family == PLANT and "i_g" in kind.outputs:
            return (
                f"connect {name}.i_g to it, through a {turned} if the controller has a frame of "
                "its own"
            )
    return "connect the plant's grid current to it"


def check_effort(
    free: int, largest_loop: tuple[tuple[str, ...], int], findings: Violations
) -> None:
    """Report more free parameters, or more modules round a loop of direct terms, than a fit can
    take.

    largest_loop : its modules and the pairs of them (`DirectTerms.largest_loop`).
    """
    if free > MOST_FREE:
        message = (
            f"there are {free} free parameters, more than {MOST_FREE}; give some a number or a "
            "common name"
        )
        findings.add(None, "size", message)
    loop, pairs = largest_loop
    if len(loop) > LARGEST_LOOP or pairs > TIGHTEST_LOOP:
        message = (
            f"direct terms join {len(loop)} modules round a loop, in {pairs} pairs, more than "
            f"{LARGEST_LOOP} or "
            f"{TIGHTEST_LOOP}: {some(loop)}; put a filter in it, or leave some out"
        )
        findings.add(None, "algebraic_loop", message)


def check_loops(
    connections: Sequence[Connection], loops: Sequence[AlgebraicLoop], findings: Violations
) -> None:
    """Report each loop of direct terms whose signals have no unique value."""
    cycles = dict.fromkeys(loop.singular for loop in loops if loop.singular)  # d and q are alike
    for cycle in cycles:
        around = dict(zip(cycle, cycle[1:] + cycle[:1], strict=True))
        lines = [
            one.line
            for one in connections
            if one.line is not None
            and around.get(split_port(one.source)[0]) == split_port(one.target)[0]
        ]
        path = " -> ".join((*cycle, cycle[0]))
        message = (
            f"the algebraic loop {path} has a gain of exactly 1, so that its signals have no "
            "unique value; "
            f"put a filter or a {usual_kind(Element.DELAY).name} in it, or change a gain"
        )
        findings.add(max(lines, default=None), "algebraic_loop", message)


def check_equilibria(devices: Sequence[Wiring], findings: Violations) -> None:
    """Report each module that needs an operating point which does not follow from the plant of its
    device.
    """
    for device in devices:
        kinds, lines = device.kinds, {instance.name: instance.line for instance in device.instances}
        steady = steady_order(device)
        for name, port in unknown_equilibria(device, steady):
            culprit = lost_at(device, f"{name}.{port}", steady)
            if culprit is None:
                why = "runs round a loop"
            elif kinds[culprit].bilinear:
                why = f"is made from the product in {culprit} ({kinds[culprit].name})"
            else:
                why = f"comes from behind the integrator of {culprit} ({kinds[culprit].name})"
            message = (
                f"{name} ({kinds[name].name}) needs the operating point at {name}.{port}, but that "
                f"signal {why}; "
                "wire it to a plant signal, to a sum of them, or to one behind filters and gains"
            )
            findings.add(lines[name], "equilibrium", message)
