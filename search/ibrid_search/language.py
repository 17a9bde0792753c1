"""The language of programs in words: what may be written, which kinds there are, and when a diagram is legal.

Kinds, ports, boxes and limits are read from their declarations, so the words follow any vocabulary.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.check import HIGHEST_ORDER
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import kind_parameters
from ibrid.structure.wiring import PLANT


def api_text() -> str:
    """How a program is written."""
    return f"""\
A program is one Python function that is parsed, never executed:

    def build(g):
        g.add("KIND", "name")
        g.add("KIND", "other", parameter="name.parameter")
        g.connect("name.output", "other.input")

Nothing else is part of it: no imports, variables, loops, expressions or further calls; comments are allowed.
- g.add(KIND, NAME, parameter=binding, ...) adds a module under a name of its own. Its parameters stay free and are
  fitted by the evaluator within their boxes. A binding changes that: a string lets parameters share one value
  ("other_module.parameter", or any common word), a number fixes it, a pair (low, high) narrows its box.
- g.connect(SOURCE, TARGET) lets an output NAME.port drive an input NAME.port. {TERMINAL_VOLTAGE}, the terminal voltage, is
  a source; {TERMINAL_CURRENT}, the terminal current out of the inverter, is a target; both are dq_vec."""


def rules_text(kinds: Vocabulary, equilibrium: str) -> str:
    """When a diagram is legal, as a list."""
    return "\n".join(f"- {rule}" for rule in _rules(kinds, equilibrium))


def kinds_text(kinds: Vocabulary, equilibrium: str, *, short: bool = False) -> str:
    """The vocabulary by family: ports with their signals, law, order, parameters; `short` leaves the parameters' words out."""
    families = groupby(sorted(kinds, key=lambda kind: _first_of(kind.family, kinds)), key=lambda kind: kind.family)
    return "\n".join(
        line
        for family, members in families
        for line in (f"{family}:", *(f"  {_kind_text(kind, equilibrium, short)}" for kind in members))
    )


def _rules(kinds: Vocabulary, equilibrium: str) -> Iterator[str]:
    yield "Both ends of a connection carry the same kind of signal (scalar or dq_vec), and no connection is made twice."
    yield "Several sources of one target add up. There is no other way to add" + _negation(kinds) + "."
    zero = [kind.name for kind in kinds if not kind.inputs]
    yield "Every input of every module is driven" + (f"; {_listed(zero)} drives one with zero." if zero else ".")
    yield f"There is exactly one plant: {_listed([kind.name for kind in kinds if kind.family == PLANT], 'or')}."
    if dividing := [kind.name for kind in kinds if kind.shares]:
        yield (
            f"An exception are two devices that meet at {TERMINAL_VOLTAGE} and {TERMINAL_CURRENT} alone, each with a plant, when "
            f"one of them takes {TERMINAL_VOLTAGE} through a {_listed(dividing, 'or')}."
        )
    yield f"Something drives {TERMINAL_CURRENT}, and every module has a path to it; one without changes nothing."
    yield f"The orders of all modules add up to at most {HIGHEST_ORDER}."
    yield "A loop of modules without states must have a solution: its gain must not be exactly 1."
    inwards, outwards = ([kind.name for kind in kinds if kind.element is element] for element in ROTATIONS)
    if inwards and outwards:
        yield (
            f"{_listed(inwards, 'or')} and {_listed(outwards, 'or')} come together: the first turns the terminal voltage "
            "into the controller's frame, the second the plant's current back; the angle of both comes from the controller."
        )
    ports = [f"{kind.name}.{port}" for kind in kinds if kind.family != PLANT for port in kind.equilibrium_ports]
    if equilibrium == "exact" and ports:
        yield (
            f"The operating point at {_listed(ports)} must follow from the plant: wire them to plant signals, to sums of "
            "them, or to such signals behind filters and gains, never behind an integrator."
        )
    fitted = dict.fromkeys(name for kind in kinds for name in kind.paper_parameters)
    if equilibrium == "paper" and fitted:
        yield f"{_listed(list(fitted))} are numbers of the operating point: one value for the whole diagram, fitted."
    residual = [kind.name for kind in kinds if kind.residual]
    if residual:
        yield f"{_listed(residual)} are corrections that no designer would draw; they count as residual modules."


def _negation(kinds: Vocabulary) -> str:
    found = [kind.name for kind in kinds if kind.element is Element.SIGN]
    return f"; to subtract, put a {' or '.join(found)} in front of the sum" if found else ""


def _listed(names: Sequence[str], word: str = "and") -> str:
    return ", ".join(names[:-1]) + (f" {word} " if len(names) > 1 else "") + names[-1] if names else "none"


def _first_of(family: str, kinds: Vocabulary) -> int:
    return next(number for number, kind in enumerate(kinds) if kind.family == family)


def _kind_text(kind: ModuleKind, equilibrium: str, short: bool) -> str:
    ports = f"({_ports(kind.inputs)}) -> ({_ports(kind.outputs)})"
    order = f", order {kind.order}" if kind.order else ""
    boxes = kind_parameters(kind, equilibrium)
    if short:
        return f"{kind.name}: {ports}{order}{'; ' + ' '.join(boxes) if boxes else ''}"
    words = "; ".join(_box_text(name, box) for name, box in boxes.items())
    return f"{kind.name}: {ports}{order}; {kind.law}" + (f"; parameters: {words}" if words else "")


def _ports(ports: Mapping[str, Signal]) -> str:
    return ", ".join(f"{name}: {signal}" for name, signal in ports.items())


def _box_text(name: str, box: Range) -> str:
    unit = "" if box.unit == "1" else f" {box.unit}"
    return f"{name} {box.meaning} {box.low:.3g}..{box.high:.3g}{unit}"
