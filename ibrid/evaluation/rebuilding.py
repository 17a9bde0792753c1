"""What a record must hold so that its model can be rebuilt: settings and parameters of the right form."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, get_args

from ibrid.measurement.sweep import PowerNode
from ibrid.structure.parameters import EQUILIBRIA

#: Settings without which there is no model.
NEEDED = ("equilibrium", "power_node", "f0_hz", "operating_points", "pade_orders")


def complaint(settings: Mapping[str, Any], parameters: Mapping[str, Any]) -> str | None:
    """What keeps the model from being rebuilt, as the rest of a sentence that begins "the record"; None: nothing."""
    if lacking := [name for name in NEEDED if name not in settings]:
        return f"lacks {', '.join(lacking)}"
    if not parameters:
        return "lacks parameters"
    for name, known in (("equilibrium", EQUILIBRIA), ("power_node", get_args(PowerNode))):
        if settings[name] not in known:
            return f"has an unknown {name}, {str(settings[name])[:40]!r}"
    if not _is_number(settings["f0_hz"]) or settings["f0_hz"] <= 0:
        return "has no positive f0_hz"
    orders = settings["pade_orders"]
    if not isinstance(orders, Mapping) or not all(type(order) is int and 0 < order < 100 for order in orders.values()):
        return "has pade_orders that are not whole numbers"
    points = settings["operating_points"]
    for op, values in parameters.items():
        if not _are_numbers(values):
            return f"has parameters at {op} that are not numbers"
        point = points.get(op) if isinstance(points, Mapping) else None
        if not _are_numbers(point) or not {"p", "q", "v"} <= set(point or ()):
            return f"lacks p, q and v of the operating point {op}"
    return None


def _are_numbers(values: Any) -> bool:
    return isinstance(values, Mapping) and all(_is_number(value) for value in values.values())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
