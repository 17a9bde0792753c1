"""The grammar: is a diagram legal, and if not, why, where, and what would mend it (paper, section IV, A.1)."""

from collections.abc import Sequence
from functools import cached_property

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError, near, some
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary, choose_vocabulary, usual_kind
from ibrid.structure.algebraic_loops import LARGEST_LOOP, TIGHTEST_LOOP, algebraic_loops, largest_loop
from ibrid.structure.canonical import structure_hash
from ibrid.structure.connection_rules import check_connections, check_modules
from ibrid.structure.devices import check_plants, devices
from ibrid.structure.diagram import TERMINAL_CURRENT, Diagram
from ibrid.structure.habits import check_habits
from ibrid.structure.parameters import EQUILIBRIA, parameter_table
from ibrid.structure.steady_state import lost_at, steady_order, unknown_equilibria
from ibrid.structure.violation import Violation, Violations
from ibrid.structure.wiring import PLANT, Wiring, split_port, wire

__all__ = ["HIGHEST_ORDER", "Violation", "require_legal", "violations", "warnings"]

HIGHEST_ORDER = 30
#: Together with `LARGEST_LOOP` they bound what an evaluation takes between two looks at the clock, and its memory.
MOST_FREE = 100
MOST_MODULES, MOST_CONNECTIONS = 200, 1000
#: Violations that an error tells.
SHOWN = 8


@takes_kinds
def violations(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> tuple[Violation, ...]:
    """Every breach of the grammar, by line; empty for a legal diagram.

    Whether loops can be solved and operating points be found is asked once all else is right.
    Raises DiagramError for an unknown vocabulary or equilibrium mode.
    """
    kinds_allowed = choose_vocabulary(vocabulary)
    if equilibrium not in EQUILIBRIA:
        raise DiagramError(f"no equilibrium mode is called {equilibrium!r}; {near(equilibrium, EQUILIBRIA)}")
    findings = Violations()
    _check_size(diagram, findings)
    if findings:
        return findings.sorted
    kinds = check_modules(diagram, kinds_allowed, equilibrium, findings)
    check_connections(diagram, kinds, findings)
    _check_whole(diagram, kinds, kinds_allowed, findings)
    if findings:
        return findings.sorted
    wiring = wire(diagram, kinds_allowed)
    _check_effort(wiring, equilibrium, findings)
    if not findings:
        _check_loops(diagram, wiring, equilibrium, findings)
        if equilibrium == "exact":
            for device in devices(wiring):
                _check_equilibria(device, findings)
    return findings.sorted


def warnings(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> tuple[Violation, ...]:
    """What is legal but probably a mistake, by line; empty for a diagram that is not legal."""
    return examine(diagram, vocabulary, equilibrium=equilibrium)[1]


def examine(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> tuple[tuple[Violation, ...], tuple[Violation, ...]]:
    """Violations and warnings at the cost of one check."""
    breaches = violations(diagram, vocabulary, equilibrium=equilibrium)
    findings = Violations()
    if not breaches:
        check_habits(diagram, choose_vocabulary(vocabulary), equilibrium, findings)
    return breaches, findings.sorted


def require_legal(
    diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY, *, equilibrium: str = "exact"
) -> None:
    """Raise DiagramError that joins all violations, unless the diagram is legal."""
    found = violations(diagram, vocabulary, equilibrium=equilibrium)
    if found:
        more = f"; and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
        raise DiagramError("; ".join(str(one) for one in found[:SHOWN]) + more)


def _check_size(diagram: Diagram, findings: Violations) -> None:
    for what, number, most in (
        ("modules", len(diagram.instances), MOST_MODULES),
        ("connections", len(diagram.connections), MOST_CONNECTIONS),
    ):
        if number > most:
            findings.add(None, "size", f"the diagram has {number} {what}, more than {most}; leave some out")


def _check_whole(
    diagram: Diagram, kinds: dict[str, ModuleKind | None], vocabulary: Sequence[ModuleKind], findings: Violations
) -> None:
    check_plants(diagram, kinds, vocabulary, findings)
    if all(connection.target != TERMINAL_CURRENT for connection in diagram.connections):
        findings.add(
            None, "no_terminal_current", f"nothing drives {TERMINAL_CURRENT}; {_terminal_remedy(kinds, vocabulary)}"
        )
    orders = {name: kind.order for name, kind in kinds.items() if kind is not None and kind.order}
    if (order := sum(orders.values())) > HIGHEST_ORDER:
        largest = sorted(orders, key=lambda name: -orders[name])
        listed = some(f"{name} {orders[name]}" for name in largest)
        findings.add(None, "order", f"the order is {order}, above {HIGHEST_ORDER}; leave out some of {listed}")


def _terminal_remedy(kinds: dict[str, ModuleKind | None], vocabulary: Sequence[ModuleKind]) -> str:
    for name, kind in kinds.items():
        if kind is not None and kind.element is Element.ROTATION_OUT:
            return f"connect {name}.i_DQ to it"
    turned = usual_kind(Element.ROTATION_OUT, kinds=vocabulary).name
    for name, kind in kinds.items():
        if kind is not None and kind.family == PLANT and "i_g" in kind.outputs:
            return f"connect {name}.i_g to it, through a {turned} if the controller has a frame of its own"
    return "connect the plant's grid current to it"


def _check_effort(wiring: Wiring, equilibrium: str, findings: Violations) -> None:
    if (free := len(parameter_table(wiring, equilibrium).free)) > MOST_FREE:
        message = f"there are {free} free parameters, more than {MOST_FREE}; give some a number or a common name"
        findings.add(None, "size", message)
    loop, pairs = largest_loop(wiring)
    if len(loop) > LARGEST_LOOP or pairs > TIGHTEST_LOOP:
        message = (
            f"direct terms join {len(loop)} modules round a loop, in {pairs} pairs, more than {LARGEST_LOOP} or "
            f"{TIGHTEST_LOOP}: {some(loop)}; put a filter in it, or leave some out"
        )
        findings.add(None, "algebraic_loop", message)


def _check_loops(diagram: Diagram, wiring: Wiring, equilibrium: str, findings: Violations) -> None:
    cycles = dict.fromkeys(
        loop.singular for loop in algebraic_loops(wiring, equilibrium=equilibrium) if loop.singular
    )  # d and q are alike
    for cycle in cycles:
        around = dict(zip(cycle, cycle[1:] + cycle[:1], strict=True))
        lines = [
            one.line
            for one in diagram.connections
            if one.line is not None and around.get(split_port(one.source)[0]) == split_port(one.target)[0]
        ]
        path = " -> ".join((*cycle, cycle[0]))
        message = (
            f"the algebraic loop {path} has a gain of exactly 1, so that its signals have no unique value; "
            f"put a filter or a {usual_kind(Element.DELAY).name} in it, or change a gain"
        )
        findings.add(max(lines, default=None), "algebraic_loop", message)


def _check_equilibria(wiring: Wiring, findings: Violations) -> None:
    lines = {instance.name: instance.line for instance in wiring.instances}
    steady = steady_order(wiring)
    for name, port in unknown_equilibria(wiring, steady):
        culprit = lost_at(wiring, f"{name}.{port}", steady)
        if culprit is None:
            why = "runs round a loop"
        elif wiring.kinds[culprit].bilinear:
            why = f"is made from the product in {culprit} ({wiring.kinds[culprit].name})"
        else:
            why = f"comes from behind the integrator of {culprit} ({wiring.kinds[culprit].name})"
        message = (
            f"{name} ({wiring.kinds[name].name}) needs the operating point at {name}.{port}, but that signal {why}; "
            "wire it to a plant signal, to a sum of them, or to one behind filters and gains"
        )
        findings.add(lines[name], "equilibrium", message)


#: Programs that are remembered.
REMEMBERED = 4096


class Examined:
    """`hash` : of the structure, "" where a kind or port does not exist. `violations`, `warnings` : of the grammar, which
    is slower and therefore asked only when they are wanted."""

    def __init__(self, diagram: Diagram, kinds: Vocabulary, equilibrium: str) -> None:
        self._diagram, self._kinds, self._equilibrium = diagram, kinds, equilibrium

    @cached_property
    def hash(self) -> str:
        try:
            return structure_hash(self._diagram, self._kinds, equilibrium=self._equilibrium)
        except DiagramError:
            return ""  # the grammar says which

    @property
    def violations(self) -> tuple[Violation, ...]:
        return self._found[0]

    @property
    def warnings(self) -> tuple[Violation, ...]:
        return self._found[1]

    @cached_property
    def _found(self) -> tuple[tuple[Violation, ...], tuple[Violation, ...]]:
        return examine(self._diagram, self._kinds, equilibrium=self._equilibrium)


class Examination:
    """The grammar of a run with a memory: proposers ask it about many edits, and it is asked again about the chosen one."""

    def __init__(self, kinds: Vocabulary, equilibrium: str) -> None:
        self._kinds, self._equilibrium = kinds, equilibrium
        self._known: dict[str, Examined] = {}

    def __call__(self, diagram: Diagram, text: str) -> Examined:
        """What is to be said of a diagram whose canonical print is `text`."""
        if text not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[text] = Examined(diagram, self._kinds, self._equilibrium)
        return self._known[text]
