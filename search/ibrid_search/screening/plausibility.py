"""Plausibility of a candidate: structures that are refused before a fit, and fitted values that an
engineer would doubt however small the error is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from types import MappingProxyType

from ibrid.evaluation.record import Record
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.view import views_of
from ibrid.structure.diagrams.diagram import Diagram, Instance
from ibrid.structure.grammar_rules.violation import Violation
from ibrid.structure.reading.wiring import PLANT
from ibrid_search.screening.settings import SCREENING

Interval = tuple[float, float]
NO_INTERVALS: Mapping[str, Interval] = MappingProxyType({})

#: Warnings of the grammar that a search treats as errors; a fit would only hide the mistake.
REFUSED_WARNINGS = ("one_rotation", "voltage_unused", "idle_module", "coupling_unit")


@dataclass(frozen=True)
class PlausibilityIssues:
    """Count what is implausible about a fitted diagram.

    `missing` : control layers that are absent (synchronisation, inner loop, outer loops); of two
    devices, those of the more complete one. `at_bound` : parameters at a bound, such as those of a
    block without effect. `absurd` : plant parameters far from typical values, such as a resistance
    of 1 pu, which stand in for a missing part of the controller; with known noise only those whose
    confidence interval excludes plausible values. `residual` : modules that fit any residual and
    have no physical meaning. `impossible` : values that no device has (`find_impossible_values`);
    such a fit is never the result.
    """

    missing: int = 0
    at_bound: int = 0
    absurd: int = 0
    residual: int = 0
    impossible: int = 0

    @property
    def total(self) -> int:
        """Return the number of issues that count against a candidate.

        Residual modules call for a further search but do not make the rest doubtful; impossible
        values exclude the candidate as a result but not as a parent.
        """
        return self.missing + self.at_bound + self.absurd


NO_ISSUES = PlausibilityIssues()


def count_issues(diagram: Diagram, record: Record, kinds: Vocabulary) -> PlausibilityIssues:
    """Count the plausibility issues of a fitted diagram.

    `absurd` is the largest count over the operating points.
    """
    missing_layers = [view.roles.missing_layers for view in views_of(diagram, kinds)]
    absurd_values = [
        _count_absurd_fitted_values(diagram, record, op, kinds) for op in record.parameters
    ]
    return PlausibilityIssues(
        missing=min(missing_layers, default=0),
        at_bound=len(record.at_bound),
        absurd=max(absurd_values, default=0),
        residual=record.residual_modules,
        impossible=len(find_impossible_values(record)),
    )


def find_impossible_values(record: Record) -> tuple[str, ...]:
    """Return the names of fitted parameters at a bound that is a physical limit.

    A power share at either bound: one of two devices delivers nothing. A plant parameter at its
    upper bound, if the data identify it; at its lower bound the component is just absent. The
    bounds of controller parameters are limits of the search, not of physics, and do not count.
    """
    if not record.at_bound:
        return ()
    kinds = {kind.name: kind for kind in record.vocabulary}
    parameters_at_bound = {label.split(" at ")[0] for label in record.at_bound}
    impossible = dict[str, None]()
    for instance in record.diagram.instances:
        kind = kinds[instance.kind]
        plant_parameters = kind.parameters if kind.family == PLANT else ()
        for name in (*kind.shares, *plant_parameters):
            label = _parameter_label(instance, name)
            if label not in parameters_at_bound:
                continue
            if name in kind.shares or _is_at_upper_bound(label, record):
                impossible[label] = None
    return tuple(impossible)


def _parameter_label(instance: Instance, name: str) -> str:
    """Return "instance.parameter", or the name that several instances share by a binding."""
    bound = instance.bindings.get(name)
    return bound if isinstance(bound, str) else f"{instance.name}.{name}"


def _is_at_upper_bound(label: str, record: Record) -> bool:
    """Return True if an identified value is nearer to its upper bound, on a logarithmic scale."""
    bounds = record.boxes[label]
    geometric_mean = sqrt(max(bounds["low"], 0.0) * bounds["high"])
    for op, values in record.parameters.items():
        identified = record.intervals.get(op, {}).get(label) is not None
        if identified and values[label] > geometric_mean:
            return True
    return False


def _count_absurd_fitted_values(
    diagram: Diagram, record: Record, op: str, kinds: Vocabulary
) -> int:
    """Count the absurd plant parameters of a fit at an operating point, given their intervals."""
    values = record.parameters[op]
    if record.over_noise is None:  # without a known noise an interval says little
        return count_absurd_values(diagram, values, kinds)
    intervals = {
        name: _double_log_interval(values[name], interval)
        for name, interval in record.intervals.get(op, {}).items()
    }
    return count_absurd_values(diagram, values, kinds, intervals)


def _double_log_interval(value: float, interval: Sequence[float] | None) -> Interval:
    """Double the width of a confidence interval in ln(value), from 95 % to about 4 sigma.

    A parameter that is not identifiable, or whose interval reaches zero, may have any value.
    """
    if interval is None or value <= 0 or min(interval) <= 0:
        return 0.0, inf
    return interval[0] ** 2 / value, interval[1] ** 2 / value


def count_absurd_values(
    diagram: Diagram,
    values: Mapping[str, float],
    kinds: Vocabulary,
    intervals: Mapping[str, Interval] = NO_INTERVALS,
) -> int:
    """Count the plant parameters that are far from their typical values.

    A value is absurd beyond `ScreeningSettings.absurd_factor` of the typical value in either
    direction; a resistance only above, since a small one is not visible in the data.

    Parameters
    ----------
    values : Mapping[str, float]
        "instance.parameter" of one operating point, per unit; the typical value where it lacks.
    intervals : Mapping[str, tuple[float, float]]
        Confidence intervals; a parameter is absurd only if its whole interval is.
    """
    kind_of = {kind.name: kind for kind in kinds}
    count = 0
    for instance in diagram.instances:
        kind = kind_of[instance.kind]
        if kind.family != PLANT:
            continue
        for name in kind.parameters:
            label = _parameter_label(instance, name)
            low, high = _plausible_range(kind, name)
            value = values.get(label, kind.parameters[name].typical)
            interval_low, interval_high = intervals.get(label, (value, value))
            if not (low <= interval_high and interval_low <= high):
                count += 1
    return count


def _plausible_range(kind: ModuleKind, name: str) -> Interval:
    """Return the range of plausible values of a plant parameter, per unit."""
    typical = kind.parameters[name].typical
    low = 0.0 if name.startswith("R_") else typical / SCREENING.absurd_factor
    return low, typical * SCREENING.absurd_factor


def refusal_reason(warnings: tuple[Violation, ...]) -> str:
    """Return why a valid diagram is not worth a fit, as sentences; "" if it is.

    Refused are a rotation into a frame without the one back, a terminal voltage that nothing uses,
    a module without a path to the terminal current, and a decoupling gain that is an inductance in
    pu where seconds are needed (wrong by a factor of omega_0).
    """
    refused = [warning for warning in warnings if warning.reason in REFUSED_WARNINGS]
    return "; ".join(map(str, refused))
