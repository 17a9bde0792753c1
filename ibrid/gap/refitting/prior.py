"""Nominal values with tolerances as a Gaussian prior of the parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.fit.anchor import DECADE
from ibrid.fit.problem import Coordinates
from ibrid.foreign_data import json_in, text_in
from ibrid.modules.kind import Range
from ibrid.ranges import finite_number
from ibrid.schemas import json_word
from ibrid.structure.reading.parameters import Parameter, ParameterTable
from ibrid.structure.reading.wiring import PLANT, Wiring

#: One standard deviation of the logarithm: of plant parameters, and of all others.
PLANT_TOLERANCE = 0.25
OTHER_TOLERANCE = log(2.0)
#: The same for a value that is zero or negative, absolute, at least: of a large one, such as a
#: droop of -16 rad/s, it is the tolerance above times its size.
ABSOLUTE_TOLERANCE = 0.25
#: Standard deviations of its tolerance beyond which a parameter is said to have moved.
FAR = 3.0
#: Part of its nominal value at which the scale of a parameter that may change its sign passes from
#: logarithmic to linear.
RATIO_LIMIT = 0.05
#: Factor beyond its bounds up to which a nominal value is set to the bound; more is a wrong unit.
UNIT_ERROR_FACTOR = 10.0


@dataclass(frozen=True)
class NominalValue:
    """A nominal value and its tolerance, one standard deviation.

    Of the logarithm where the value is positive, else absolute.
    """

    nominal: float
    tolerance: float


#: Free parameter -> its nominal value.
Prior = Mapping[str, NominalValue]
Nominal = Mapping[str, float | Mapping[str, float]]


class ParameterPrior:
    """Gaussian prior of P free parameters, on a logarithmic scale where that exists.

    Law: with nominal value n and tolerance t a value theta is (asinh(theta / kn) - asinh(1 / k)) /
    t standard deviations away, k = `RATIO_LIMIT`: the logarithm of the ratio over t down to kn, and
    finite at zero and below. Within positive bounds it is ln(theta / n) / t, with n <= 0 it is
    (theta - n) / t, and 0 without a nominal value.

    Attributes
    ----------
    known : ndarray
        (P,) True where there is a nominal value.
    nominal : ndarray
        (P,) nominal values, else the typical value of the parameter.
    weight : ndarray
        (P,) 1/t, 0 without a nominal value.
    coordinates : Coordinates
        Of the search: theta <-> x.
    """

    def __init__(self, parameters: Sequence[Parameter], prior: Prior) -> None:
        self.names = [parameter.name for parameter in parameters]
        self.coordinates = Coordinates(parameters)
        known = np.zeros(len(parameters), dtype=bool)
        nominal = np.array([parameter.typical for parameter in parameters], dtype=float)
        weight = np.zeros(len(parameters))
        for k, parameter in enumerate(parameters):
            entry = prior.get(parameter.name)
            if entry is not None:
                known[k] = True
                nominal[k] = entry.nominal
                weight[k] = 1.0 / entry.tolerance
        self.known = known
        self.nominal = nominal
        self.weight = weight
        self._ratio = np.array([parameter.logarithmic for parameter in parameters], dtype=bool)
        self._bent = ~self._ratio & (self.nominal > 0)
        self._knee = np.where(self._bent, RATIO_LIMIT * self.nominal, 1.0)
        self._over = np.where(self._ratio, self.nominal, 1.0)

    def deviations(self, theta: np.ndarray) -> np.ndarray:
        """Return the standard deviations (..., P) between theta (..., P) and the nominal values."""
        safe = np.where(self._ratio, theta, 1.0)
        away = np.where(self._ratio, np.log(safe / self._over), theta - self.nominal)
        bent = np.arcsinh(theta / self._knee) - np.arcsinh(1.0 / RATIO_LIMIT)
        return np.where(self.known, np.where(self._bent, bent, away) * self.weight, 0.0)

    def moved(self, x: np.ndarray) -> dict[str, float]:
        """Return the deviation of x (P,) by name, in tolerances, where there is a nominal value."""
        rows = zip(
            self.names, self.deviations(self.coordinates.to_theta(x)), self.known, strict=True
        )
        return {name: float(away) for name, away, known in rows if known}

    def reset_implausible(self, x: np.ndarray) -> np.ndarray:
        """Return x (P,) with implausible values, beyond `FAR` tolerances, reset to nominal."""
        return np.where(
            np.abs(self.deviations(self.coordinates.to_theta(x))) > FAR, self.start({}), x
        )

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """Return d deviation / d theta at theta (..., P)."""
        away = np.where(self._ratio, 1.0 / np.where(self._ratio, theta, 1.0), 1.0)
        return np.where(self._bent, 1.0 / np.hypot(theta, self._knee), away) * self.weight

    def start(self, values: Mapping[str, float]) -> np.ndarray:
        """Return x (P,) at values by name; what they lack is the nominal value."""
        theta = np.array(
            [values.get(name, own) for name, own in zip(self.names, self.nominal, strict=True)],
            dtype=float,
        )
        return self.coordinates.to_x(np.clip(theta, self.coordinates.low, self.coordinates.high))

    def deviation_slope_in_x(self, x: np.ndarray) -> np.ndarray:
        """Return d deviation / dx at x (..., P)."""
        return self._deviation_slope_in_x(self.coordinates.to_theta(x))

    def _deviation_slope_in_x(self, theta: np.ndarray) -> np.ndarray:
        """Return d deviation / dx (..., P) at theta (..., P)."""
        return self.slope(theta) * self.coordinates.slope(theta)

    def penalty_terms(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the prior penalty, half its gradient and half its curvature at x (..., P).

        The penalty (...) is the sum of the squared deviations; the others are (..., P).
        """
        theta = self.coordinates.to_theta(x)
        deviations = self.deviations(theta)
        slope = self._deviation_slope_in_x(theta)
        return (deviations**2).sum(axis=-1), deviations * slope, slope**2

    def width(self, x: np.ndarray, unknown: float = DECADE) -> np.ndarray:
        """Return one standard deviation in x (P,) at x (P,); `unknown` without a nominal value."""
        slope = self.deviation_slope_in_x(x)
        return np.where(slope > 0, 1.0 / np.where(slope > 0, slope, 1.0), unknown)


def build_prior(values: Nominal, wiring: Wiring, table: ParameterTable) -> dict[str, NominalValue]:
    """Return the prior of a diagram's free parameters that nominal values mean.

    Parameters
    ----------
    values : mapping
        Name -> value, or -> {"value", "tolerance"}. A name is that of a free parameter or of a
        member that shares it; those of parameters that the program fixes are ignored.

    Raises
    ------
    IbridError
        Unknown names, numbers that are none, values outside the bounds of their parameter, and
        different values of members that share a parameter.
    """
    free = {parameter.name: parameter for parameter in table.free}
    owner = _owner_by_name(table)
    known_names = {
        f"{name}.{key}" for name, kind in wiring.kinds.items() for key in kind.parameters
    } | set(owner)
    prior: dict[str, NominalValue] = {}
    entries: dict[str, _PriorEntry] = {}
    for name, given in values.items():
        if name not in known_names:
            raise IbridError(
                f"the nominal values name {name!r}, which the program lacks; "
                f"{near(name, sorted(known_names))}"
            )
        if name not in owner:
            continue
        parameter = free[owner[name]]
        entry = _PriorEntry(name, *read_nominal_value(name, given, parameter))
        if parameter.name in entries:
            entry = _join_entries(entries[parameter.name], entry, parameter.name)
        entries[parameter.name] = entry
        tolerance = entry.tolerance
        if tolerance is None:
            tolerance = _usual_tolerance(parameter, entry.value, wiring)
        prior[parameter.name] = NominalValue(entry.value, tolerance)
    return prior


@dataclass(frozen=True)
class _PriorEntry:
    """A nominal value as given: name, value, and tolerance if any."""

    name: str
    value: float
    tolerance: float | None


def _owner_by_name(table: ParameterTable) -> dict[str, str]:
    """Return the free parameter that each name means: its own, or of a member that shares it."""
    owner: dict[str, str] = {}
    for parameter in table.free:
        owner |= {f"{module}.{key}": parameter.name for module, key in parameter.members}
    return owner | {parameter.name: parameter.name for parameter in table.free}


def _join_entries(first: _PriorEntry, second: _PriorEntry, parameter: str) -> _PriorEntry:
    """Join two entries of one parameter; IbridError where they differ."""
    tolerances = {first.tolerance, second.tolerance} - {None}
    if first.value != second.value or len(tolerances) > 1:
        raise IbridError(
            f"{first.name} and {second.name} are one parameter of the program, {parameter}, but "
            "their nominal values are "
            f"{_format_entry(first)} and {_format_entry(second)}; give one of them, or "
            "the same for both"
        )
    tolerance = first.tolerance if second.tolerance is None else second.tolerance
    return _PriorEntry(second.name, second.value, tolerance)


def _usual_tolerance(parameter: Parameter, value: float, wiring: Wiring) -> float:
    """Return the tolerance of a nominal value that comes without one."""
    families = {wiring.kinds[module].family for module, _ in parameter.members}
    tolerance = PLANT_TOLERANCE if families == {PLANT} else OTHER_TOLERANCE
    return tolerance if value > 0 else max(ABSOLUTE_TOLERANCE, -tolerance * value)


def read_nominal_value(name: str, entry: Any, box: Parameter | Range) -> tuple[float, float | None]:
    """Read a nominal value within the bounds of its parameter, and its tolerance if given.

    Raises IbridError for anything else.
    """
    fields = entry if isinstance(entry, Mapping) else {"value": entry}
    value = _require_number(name, "value", fields.get("value"))
    tolerance = None
    if fields.get("tolerance") is not None:
        tolerance = _require_number(name, "tolerance", fields["tolerance"])
    if tolerance is not None and tolerance <= 0:
        raise IbridError(
            f"the tolerance of {name} must be above zero, found {tolerance:g}; leave it out for a "
            "usual one"
        )
    unknown = sorted(set(map(str, fields)) - {"value", "tolerance"})
    if unknown:
        raise IbridError(
            f"the nominal value of {name} has {', '.join(unknown)}; known are value and tolerance"
        )
    if box.logarithmic and value <= 0:
        raise IbridError(f"the nominal value of {name} must be above zero, found {value:g}")
    _require_inside(name, value, box)
    return value, tolerance


def fitted_values(record: Record) -> dict[str, float]:
    """Return the fitted values of a record, as nominal values.

    Raises IbridError where they differ between operating points.
    """
    if (record.settings.get("parameters"), record.settings.get("equilibrium")) != (
        "shared",
        "exact",
    ):
        raise IbridError(
            "a gap begins with one set of values: fit the record again with --parameters shared "
            "--equilibrium exact"
        )
    if not record.parameters:
        raise IbridError(
            "the record has no fitted values; give its program, with nominal values where you know "
            "them"
        )
    return dict(next(iter(record.parameters.values())))


def read_values(path: str | Path) -> dict[str, Any]:
    """Read nominal values from a JSON file; IbridError, one sentence, for anything else."""
    path = Path(path)
    try:
        values = json_in(text_in(path))
    except OSError as error:
        raise IbridError(
            f"the nominal values {path} cannot be read: {error.strerror or error}"
        ) from None
    except ValueError as error:
        raise IbridError(f"the nominal values {path} are no JSON: {error}") from None
    if not isinstance(values, dict):
        raise IbridError(
            f'the nominal values {path} must be like {{"plant.L_F": 0.15}}, found '
            f"{json_word(values)}"
        )
    if "schema" in values and "program" in values:
        raise IbridError(
            f"{path} is a record, not nominal values; give it in place of the program, without "
            "--values"
        )
    return values


def _require_number(name: str, what: str, value: Any) -> float:
    """Return a finite number; IbridError for anything else."""
    number = finite_number(value)
    if number is None:
        raise IbridError(f"the nominal {what} of {name} must be a number, found {value!r:.40}")
    return number


def _require_inside(name: str, value: float, box: Parameter | Range) -> None:
    """Raise IbridError for a nominal value far outside the bounds of its parameter."""
    low = box.low
    high = box.high
    lowest = low / UNIT_ERROR_FACTOR if low > 0 else UNIT_ERROR_FACTOR * low
    highest = high * UNIT_ERROR_FACTOR if high > 0 else high / UNIT_ERROR_FACTOR
    if not lowest <= value <= highest:
        unit = "" if box.unit in ("", "1") else f" {box.unit}"
        raise IbridError(
            f"the nominal value of {name} must lie in the box of the parameter, {low:g} to "
            f"{high:g}{unit}, found {value:g}; "
            "see that it is per unit, or in s and rad/s, or leave it out"
        )


def _format_entry(entry: _PriorEntry) -> str:
    """Format a value and its tolerance for a message."""
    if entry.tolerance is None:
        return f"{entry.value:g}"
    return f"{entry.value:g} with a tolerance of {entry.tolerance:g}"
