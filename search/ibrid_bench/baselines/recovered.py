"""How many of the true parameters a fitted diagram has, whatever its modules are called."""

from collections.abc import Mapping

from ibrid.evaluation.record import Record
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.comparison.compare import compare
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

#: Relative distance from the true value that still counts.
WITHIN = 0.05


def close(value: float, true: float) -> bool:
    """Within 5 % of the true value."""
    return abs(value - true) <= WITHIN * abs(true)


def recovered(record: Record, truth: Diagram, values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the true parameters that are right in a record with one parameter set for all
    operating points.

    A parameter counts when modules of its kind are matched (`ibrid compare`) and every one that is
    has its value. Modules that `compare` leaves without a partner give nothing, so that this is a
    lower bound for a structure that is not the true one.
    values : the true ones, by their names in `truth`.
    """
    found = _values(record.diagram, next(iter(record.parameters.values())))
    true_wiring = wire(truth, VOCABULARY)
    true_table = parameter_table(true_wiring, "exact")
    partners = [
        (mine, true)
        for first, second in compare(record.diagram, truth).matched
        for mine in first.split("+")
        for true in second.split("+")
    ]
    right: dict[str, list[bool]] = {}
    for mine, true in partners:
        for (instance, parameter), name in true_table.bound.items():
            kind = true_wiring.kinds[instance].name
            if instance == true and isinstance(name, str) and (mine, kind, parameter) in found:
                right.setdefault(name, []).append(close(found[mine, kind, parameter], values[name]))
    return tuple(name for name in values if name in right and all(right[name]))


def _values(diagram: Diagram, parameters: Mapping[str, float]) -> dict[tuple[str, str, str], float]:
    """(instance, kind, parameter) -> fitted or fixed number."""
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    return {
        (instance, wiring.kinds[instance].name, parameter): float(
            table.value(instance, parameter, parameters)
        )
        for instance, parameter in table.bound
    }
