"""Nominal values with tolerances: what the engineer believes of the parameters before the data are seen."""

import json
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite, log
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.fit.problem import Coordinates
from ibrid.structure.parameters import Parameter, ParameterTable
from ibrid.structure.wiring import PLANT, Wiring

#: One standard deviation of the logarithm: of plant parameters, and of all others.
PLANT_TOLERANCE, OTHER_TOLERANCE = 0.25, log(2.0)
#: The same for a value that is zero or negative, absolute.
ABSOLUTE_TOLERANCE = 0.25

#: Free parameter -> (centre, standard deviation) in the search coordinate of `Coordinates`.
Prior = Mapping[str, tuple[float, float]]
Nominal = Mapping[str, float | Mapping[str, float]]


def prior_of(values: Nominal, wiring: Wiring, table: ParameterTable) -> dict[str, tuple[float, float]]:
    """The prior that nominal values mean for the free parameters of a diagram.

    values : name -> value, or -> {"value", "tolerance"}; a name is that of a free parameter or of a member that shares it.
    Values of parameters that the program fixes are passed over. Raises IbridError for names and numbers that mean nothing.
    """
    free = {one.name: one for one in table.free}
    owner = {f"{module}.{key}": one.name for one in table.free for module, key in one.members} | {
        name: name for name in free
    }
    every = {f"{name}.{key}" for name, kind in wiring.kinds.items() for key in kind.parameters} | set(owner)
    found: dict[str, tuple[float, float]] = {}
    for name, entry in values.items():
        if name not in every:
            raise IbridError(f"the nominal values name {name!r}, which the program lacks; {near(name, sorted(every))}")
        if name not in owner:
            continue
        value, tolerance = _entry(name, entry)
        parameter = free[owner[name]]
        if tolerance is None:
            kinds = {wiring.kinds[module].family for module, _ in parameter.members}
            tolerance = PLANT_TOLERANCE if kinds == {PLANT} else OTHER_TOLERANCE
            tolerance = tolerance if value > 0 else ABSOLUTE_TOLERANCE
        found[parameter.name] = _in_coordinate(name, parameter, value, tolerance)
    return found


def read_values(path: str | Path) -> dict[str, Any]:
    """Nominal values from a JSON file; IbridError, one sentence, for anything else."""
    path = Path(path)
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise IbridError(f"the nominal values {path} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise IbridError(f"the nominal values {path} are no JSON: {error}") from None
    if not isinstance(values, dict):
        raise IbridError(f'the nominal values {path} must be like {{"plant.L_F": 0.15}}, found {type(values).__name__}')
    return values


def centres(names: Sequence[str], prior: Prior) -> tuple[np.ndarray, np.ndarray]:
    """Centre and one over the standard deviation (P,) for free parameters in order; 0 and 0 for those without a prior."""
    centre = np.array([prior[name][0] if name in prior else 0.0 for name in names])
    weight = np.array([1.0 / prior[name][1] if name in prior else 0.0 for name in names])
    return centre, weight


def _entry(name: str, entry: Any) -> tuple[float, float | None]:
    number = entry.get("value") if isinstance(entry, Mapping) else entry
    tolerance = entry.get("tolerance") if isinstance(entry, Mapping) else None
    value, spread = _number(name, "value", number), None if tolerance is None else _number(name, "tolerance", tolerance)
    if spread is not None and spread <= 0:
        raise IbridError(
            f"the tolerance of {name} must be above zero, found {spread:g}; leave it out for the usual one"
        )
    _require_known(_unknown_keys(entry), name)
    return value, spread


def _number(name: str, what: str, found: Any) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float) or not isfinite(found):
        raise IbridError(f"the nominal {what} of {name} must be a number, found {found!r}")
    return float(found)


def _require_known(unknown: Iterable[str], name: str) -> None:
    """Raise IbridError when a nominal value has keys that mean nothing."""
    if found := sorted(unknown):
        raise IbridError(f"the nominal value of {name} has {', '.join(found)}; known are value and tolerance")


def _unknown_keys(entry: Any) -> set[str]:
    return set(map(str, entry)) - {"value", "tolerance"} if isinstance(entry, Mapping) else set()


def _in_coordinate(name: str, parameter: Parameter, value: float, tolerance: float) -> tuple[float, float]:
    """Centre and standard deviation in the search coordinate, to first order where that is no logarithm."""
    coordinates = Coordinates([parameter])
    if parameter.logarithmic and value <= 0:
        raise IbridError(f"the nominal value of {name} must be above zero, found {value:g}")
    theta = np.array([value])
    slope = float(np.where(coordinates.logarithmic, theta, np.hypot(theta, 0.1) if coordinates.signed[0] else 1.0)[0])
    spread = tolerance * abs(value) if value > 0 else tolerance
    return float(coordinates.to_x(theta)[0]), spread / slope
