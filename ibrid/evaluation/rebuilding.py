"""What a record must hold so that its model can be rebuilt and shown: every part of the right form."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, get_args

from ibrid.measurement.sweep import PowerNode
from ibrid.structure.parameters import EQUILIBRIA

#: Settings without which there is no model.
NEEDED = ("equilibrium", "power_node", "f0_hz", "operating_points", "pade_orders")


#: Fields that list sentences or names.
WORDS = ("reasons", "warnings", "at_bound", "identifiability")


def malformed(fields: Mapping[str, Any]) -> str | None:
    """What in the fields of a record, of any outcome, has the wrong form; wording as in `complaint`."""
    for name in WORDS:
        for entry in fields[name]:
            if not isinstance(entry, str):
                return f"has {name} that are not text, found {_shown(entry)}"
    if not _is_number(fields["seconds"]):
        return f"has seconds that are not a number, found {_shown(fields['seconds'])}"
    for op, values in fields["parameters"].items():
        if found := _not_numbers(values):
            return f"has parameters at {op} that are not numbers{found}"
    for count, twin in enumerate(fields["twins"], 1):
        if found := _not_numbers(twin):
            return f"has twins that are not numbers{found} (twin {count})"
    return None


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
        if found := _not_numbers(values):
            return f"has parameters at {op} that are not numbers{found}"
        point = points.get(op) if isinstance(points, Mapping) else None
        if not _are_numbers(point) or not {"p", "q", "v"} <= set(point or ()):
            return f"lacks p, q and v of the operating point {op}"
    return None


def _are_numbers(values: Any) -> bool:
    return not _not_numbers(values)


def _not_numbers(values: Any) -> str:
    """The first of the named values that is no finite number, as a clause; "" when all are."""
    if not isinstance(values, Mapping):
        return f", found {_shown(values)}"
    for name, value in values.items():
        if not _is_number(value):
            return f", found {name} = {_shown(value)}"
    return ""


def _shown(value: Any) -> str:
    return "null" if value is None else repr(value)[:40]


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False
