"""The language of programs in words: what may be written, which kinds there are, and when a diagram
is legal.

Kinds, ports, boxes and limits are read from their declarations, so the words follow any vocabulary.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import groupby
from typing import TYPE_CHECKING, Any

from ibrid.measurement.sweeps.quantities import counted
from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.diagrams.program import program_text
from ibrid.structure.grammar_rules.grammar import HIGHEST_ORDER
from ibrid.structure.reading.parameters import kind_parameters
from ibrid.structure.reading.wiring import PLANT
from ibrid_search.language_models.quoting import digits, fenced, quoted

if TYPE_CHECKING:
    from jinja2 import Environment


def words(template: str, **facts: Any) -> str:
    """A text of the folder `prompts`, filled with facts."""
    text = (
        _templates()
        .get_template(template)
        .render(facts, voltage=TERMINAL_VOLTAGE, current=TERMINAL_CURRENT)
    )
    return text.rstrip("\n")


@cache
def _templates() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # only who asks a model needs it

    loader = PackageLoader("ibrid_search", "prompts")
    templates = Environment(
        loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    filters = {
        "counted": counted,
        "digits": digits,
        "fenced": fenced,
        "program_text": program_text,
        "quoted": quoted,
    }
    templates.filters.update(filters)
    return templates


def api_text() -> str:
    """How a program is written."""
    return words("programs.md")


def rules_text(kinds: Vocabulary, equilibrium: str) -> str:
    """When a diagram is legal, as a list."""
    inwards, outwards = (
        [kind.name for kind in kinds if kind.element is element] for element in ROTATIONS
    )
    return words(
        "rules.md",
        equilibrium=equilibrium,
        listed=_listed,
        highest_order=HIGHEST_ORDER,
        signs=[kind.name for kind in kinds if kind.element is Element.SIGN],
        zero=[kind.name for kind in kinds if not kind.inputs],
        plants=[kind.name for kind in kinds if kind.family == PLANT],
        dividing=[kind.name for kind in kinds if kind.shares],
        inwards=inwards,
        outwards=outwards,
        ports=[
            f"{kind.name}.{port}"
            for kind in kinds
            if kind.family != PLANT
            for port in kind.equilibrium_ports
        ],
        fitted=list(dict.fromkeys(name for kind in kinds for name in kind.paper_parameters)),
        residual=[kind.name for kind in kinds if kind.residual],
    )


def kinds_text(kinds: Vocabulary, equilibrium: str, *, short: bool = False) -> str:
    """The vocabulary by family: ports with their signals, law, order, parameters; `short` has names
    alone.
    """
    order = [kind.family for kind in kinds]
    families = groupby(
        sorted(kinds, key=lambda kind: order.index(kind.family)), key=lambda kind: kind.family
    )
    return "\n".join(
        line
        for family, members in families
        for line in (
            f"{family}:",
            *(f"  {_kind_text(kind, equilibrium, short)}" for kind in members),
        )
    )


def _listed(names: Sequence[str], word: str = "and") -> str:
    return (
        ", ".join(names[:-1]) + (f" {word} " if len(names) > 1 else "") + names[-1]
        if names
        else "none"
    )


def _kind_text(kind: ModuleKind, equilibrium: str, short: bool) -> str:
    boxes = kind_parameters(kind, equilibrium)
    if short:
        named = f"{kind.name}: {_by_signal(kind.inputs)} -> {_by_signal(kind.outputs)}"
        return f"{named}; {' '.join(boxes)}" if boxes else named
    ports = f"({_ports(kind.inputs)}) -> ({_ports(kind.outputs)})"
    order = f", order {kind.order}" if kind.order else ""
    words = "; ".join(_box_text(name, box) for name, box in boxes.items())
    return f"{kind.name}: {ports}{order}; {kind.law}" + (f"; parameters: {words}" if words else "")


def _ports(ports: Mapping[str, Signal]) -> str:
    return ", ".join(f"{name}: {signal}" for name, signal in ports.items())


def _by_signal(ports: Mapping[str, Signal]) -> str:
    signals = dict.fromkeys(ports.values())
    named = ((signal, [name for name, one in ports.items() if one is signal]) for signal in signals)
    return " ".join(f"{signal}({', '.join(names)})" for signal, names in named) or "nothing"


def _box_text(name: str, box: Range) -> str:
    unit = "" if box.unit == "1" else f" {box.unit}"
    return f"{name} {box.meaning} {box.low:.3g}..{box.high:.3g}{unit}"
