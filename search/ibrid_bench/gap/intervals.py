"""Whether 95 % intervals hold the true values: modules of the repaired program and of the device
are matched by structure.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from ibrid_bench.gap.naming import FRAME

from ibrid.errors import IbridError
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.comparison.compare import compare
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import ParameterTable, parameter_table
from ibrid.structure.reading.wiring import wire


def covered(gap: Mapping[str, Any], truth: Mapping[str, Any]) -> list[int]:
    """Of the parameters of answered effects that are hidden ones: [intervals that hold the true
    value, intervals, parameters that the answer leaves open].
    """
    pairs = list(_pairs(gap, truth))
    inside = [_holds(interval, value) for interval, value in pairs if None not in interval]
    return [sum(inside), len(inside), len(pairs) - len(inside)]


def _pairs(gap: Mapping[str, Any], truth: Mapping[str, Any]) -> Iterator[tuple[list[float], float]]:
    hidden = {one["id"]: one for one in truth["effects"]}
    true_value = _true_values(gap, truth)
    for effect in gap["effects"]:
        if effect["id"] not in hidden:
            continue
        for name, interval in effect["parameters"].items():
            if effect["id"] == FRAME:
                value = hidden[FRAME]["parameters"]["frame_angle"]
            else:
                value = true_value.get(name)
            if value is not None:
                yield interval, value


def _holds(interval: list[float], value: float) -> bool:
    """A gain and the sign behind it may be drawn in one block or in two."""
    _, low, high = interval
    return low <= value <= high or low <= -value <= high


def _true_values(gap: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, float]:
    """Free parameter of the repaired program -> value in the device, where modules there are the
    same.
    """
    if truth["device"] is None:
        return {}
    try:
        found, device = parse_program(gap["program"]), parse_program(truth["device"]["program"])
        matched = compare(found, device).matched
        ours, theirs = _table(found), _table(device)
    except IbridError:
        return {}
    # modules that became one block are joined by "+"
    partners = {module: b.split("+") for a, b in matched for module in a.split("+")}
    answer: dict[str, float] = {}
    for parameter in ours.free:
        places = [
            (partner, key)
            for module, key in parameter.members
            for partner in partners.get(module, ())
        ]
        bound = {theirs.bound[place] for place in places if place in theirs.bound}
        if len(bound) == 1:
            (one,) = bound
            answer[parameter.name] = truth["device"]["values"][one] if isinstance(one, str) else one
    return answer


def _table(diagram: Diagram) -> ParameterTable:
    return parameter_table(wire(diagram, VOCABULARY), "exact")
