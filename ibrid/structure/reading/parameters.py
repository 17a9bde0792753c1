"""The parameters of a diagram: which numbers are free, fixed, shared by name, and within which
box.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError
from ibrid.frozen import Frozen
from ibrid.modules.kind import PAPER_RANGES, ModuleKind, Range
from ibrid.structure.diagrams.diagram import Instance
from ibrid.structure.network.outside import POINT_LABELS
from ibrid.structure.reading.wiring import Wiring

#: The two ways to treat the operating point: computed from p, q, v and the plant, or fitted freely
#: as in the paper.
EQUILIBRIA = ("exact", "paper")
#: An instance and a parameter of its kind; and the value or free name that each takes.
Place = tuple[str, str]
Bound = dict[Place, str | float]


@dataclass(frozen=True)
class Parameter:
    """One free number.

    `name` : "NAME.parameter", or the shared name. `low`, `high` : the intersection of the boxes of
    all members.
    `members` : (instance, parameter) pairs that take this value. `typical` : a first guess. `unit`,
    `meaning` : words.
    `tolerance` : one standard deviation of its logarithm (of itself where it may be zero) around
    what is known of it, None where nothing is. `local` : True when it belongs to one operating
    point even in a shared fit (E0d, I0d, delta_eq of the paper; the angle of a frame that differs).
    """

    name: str
    low: float
    high: float
    typical: float
    unit: str
    meaning: str
    members: tuple[Place, ...]
    local: bool = False
    tolerance: float | None = None

    @property
    def logarithmic(self) -> bool:
        """True when the box is positive."""
        return self.low > 0


@dataclass(frozen=True)
class ParameterTable(Frozen):
    """Free parameters, and the value or free name that each (instance, parameter) takes."""

    free: tuple[Parameter, ...]
    bound: Bound

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in order."""
        return tuple(parameter.name for parameter in self.free)

    def of(self, instance: str, parameter: str) -> str | float:
        """The free name or the fixed number of a module's parameter."""
        return self.bound[instance, parameter]

    def value(self, instance: str, parameter: str, values: Mapping[str, Any]) -> Any:
        """The value of a module's parameter. values : free name -> value, number or symbol."""
        bound = self.of(instance, parameter)
        return values[bound] if isinstance(bound, str) else bound


def kind_parameters(kind: ModuleKind, equilibrium: str) -> dict[str, Range]:
    """All parameters of a kind under an equilibrium mode, with their ranges."""
    extra = (
        {name: PAPER_RANGES[name] for name in kind.paper_parameters}
        if equilibrium == "paper"
        else {}
    )
    return {**kind.parameters, **extra}


def number_or_name(instance: Instance, parameter: str) -> float | str:
    """The number that a module's parameter is fixed to, else the name of the free one: that which
    it shares, or its own.
    """
    binding = instance.bindings.get(parameter)
    if isinstance(binding, float | str):
        return binding
    return parameter if parameter in PAPER_RANGES else f"{instance.name}.{parameter}"


@takes_kinds
def parameter_table(wiring: Wiring, equilibrium: str) -> ParameterTable:
    """Collect the parameters of a wired diagram.

    Raises DiagramError when two boxes that share a name do not overlap.
    """
    groups: dict[str, list[tuple[Place, Range]]] = {}
    bound: Bound = {}
    for instance in wiring.instances:
        for parameter, box in kind_parameters(wiring.kinds[instance.name], equilibrium).items():
            binding, key = instance.bindings.get(parameter), (instance.name, parameter)
            if isinstance(binding, tuple) or box.usual:
                box = narrow(box, *(binding if isinstance(binding, tuple) else box.unbound))
            bound[key] = name = number_or_name(instance, parameter)
            if isinstance(name, str):
                groups.setdefault(name, []).append((key, box))
    free = [_merge(name, members) for name, members in groups.items()]
    return ParameterTable((*free, *_outside(wiring, bound)), bound)


def _outside(wiring: Wiring, bound: Bound) -> Iterator[Parameter]:
    """Free labels and port values; `bound` takes the fixed ones too."""
    for instance, name, value in wiring.outside.numbers():
        if not isinstance(value, tuple):
            bound[instance, name] = value
            continue
        box, tolerance = value
        own = f"{instance}.{name}"
        bound[instance, name] = own
        words = (box.unit, box.meaning, ((instance, name),))
        yield Parameter(
            own,
            box.low,
            box.high,
            box.typical,
            *words,
            local=name in POINT_LABELS,
            tolerance=tolerance,
        )


def parameters_at(
    wiring: Wiring, table: ParameterTable, values: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """instance -> parameter -> value, for the table of a wired diagram.

    values : free name -> value, number or symbol.
    """
    found: dict[str, dict[str, Any]] = {name: {} for name in wiring.kinds}
    for (name, parameter), bound in table.bound.items():
        found.setdefault(name, {})[parameter] = values[bound] if isinstance(bound, str) else bound
    return found


def narrow(box: Range, low: float, high: float) -> Range:
    """The part of a box between `low` and `high`; DiagramError when there is none."""
    low, high = max(low, box.low), min(high, box.high)
    if not low < high:
        raise DiagramError(
            f"the box ({low:g}, {high:g}) has no part within [{box.low:g}, {box.high:g}]"
        )
    typical = min(max(box.typical, low), high)
    if typical in (low, high):
        typical = (low * high) ** 0.5 if low > 0 else (low + high) / 2
    return Range(low, high, typical, box.unit, box.meaning, box.divides)


def _merge(name: str, members: Sequence[tuple[Place, Range]]) -> Parameter:
    low = max(box.low for _, box in members)
    high = min(box.high for _, box in members)
    if not low < high:
        where = " and ".join(".".join(key) for key, _ in members)
        raise DiagramError(
            f"{where} share the name {name}, but their boxes do not overlap; give them own names"
        )
    first = members[0][1]
    return Parameter(
        name=name,
        low=low,
        high=high,
        typical=min(max(first.typical, low), high),
        unit=first.unit,
        meaning=first.meaning,
        members=tuple(key for key, _ in members),
        local=any(key[1] in PAPER_RANGES for key, _ in members),
    )
