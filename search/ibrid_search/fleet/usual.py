"""Of sets of values that explain the data alike, the one that the prior finds most probable.

A power PI before a current PI has a twin with their zeros exchanged, whose filter resistance may be a hundred times the usual;
noise decides which of them a fit ends at. Beside where the fit ended this descends from its twins (`ibrid.fit.twins`) and from
the usual values, those of the family where it has any and the textbook's for the rest, and takes the least of

    chi2 + sum over parameters of (ln(value / usual) / spread)^2.
"""

from collections.abc import Iterator, Mapping
from math import inf, log

import numpy as np

from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.fit.corner_swap import corner_swaps
from ibrid.fit.twins import find_swaps
from ibrid.structure.library import published_names, published_values
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import wire
from ibrid.study import Study
from ibrid_search.diagnosis import Edited, Looker
from ibrid_search.first_look import problems_of
from ibrid_search.fleet.prior import ANYTHING, DeviceFamily

#: Rounds of the descent from the usual values, and the relative gain below which it has ended.
ROUNDS, END = 6, 1e-4
#: Deviations that a value of the other sign counts as.
OTHER_SIGN = 3.0


def more_usual(record: Record, looker: Looker, label: str, family: DeviceFamily | None) -> Record:
    """The record, or one of the same structure and grade at more usual values. label : of the shipped diagram that it is of."""
    study = looker.study
    usual = {**_usual(record, study, label), **({} if family is None else family.typical)}
    starts = [{name: value for name, (value, _) in usual.items()}, *_twins(record, study)]
    others = [values for start in starts if (values := _descended(record, looker, start)) is not None]
    records = [record_at(record.diagram, study, values) for values in others]
    alike = [record, *(one for one in records if one.grade == record.grade)]
    return min(alike, key=lambda one: _surprise(one, usual))


def _twins(record: Record, study: Study) -> Iterator[dict[str, float]]:
    """Values of twins, exact ones or nearly."""
    wiring, problems = problems_of(record.diagram, study, study.groups)
    problem = problems[0]
    (values, *_) = record.parameters.values()
    theta = np.array([values[one.name] for one in problem.numbers])
    for swap in (*find_swaps(problem, wiring), *corner_swaps(problem, wiring, study.sweep.omega_0)):
        if np.isfinite(twin := swap.apply(theta)).all():
            inside = np.clip(twin, problem.coordinates.low, problem.coordinates.high)
            yield dict(zip((one.name for one in problem.numbers), map(float, inside), strict=True))


def _descended(record: Record, looker: Looker, start: Mapping[str, float]) -> Mapping[str, float] | None:
    """Where a descent from these values ends; None where they have no response."""
    edit = Edited(record.diagram, "", "", {})
    values, error = [start] * len(looker.study.fitted.names), inf
    for _ in range(ROUNDS):
        look = looker.look(edit, values, glance=True)
        if not look.values:
            return None
        values, before, error = look.values, error, look.error
        if before - error <= END * error:
            break
    return values[0]


def _usual(record: Record, study: Study, label: str) -> dict[str, tuple[float, float]]:
    """The textbook's values, each with the spread of a parameter of which nothing is known."""
    table = parameter_table(wire(record.diagram, study.kinds), study.equilibrium)
    typical = {one.name: one.typical for one in table.free}
    typical |= published_values(label) if label in published_names() else {}
    return {name: (value, ANYTHING) for name, value in typical.items()}


def _surprise(record: Record, usual: Mapping[str, tuple[float, float]]) -> float:
    (values, *_) = record.parameters.values()
    misfit = record.misfit or {}
    found = float(misfit.get("chi2_per_dof") or 0.0) * float(misfit.get("dof") or 0.0)
    for name, (value, spread) in usual.items():
        ratio = values.get(name, value) / value if value else 1.0
        found += (log(ratio) / spread if ratio > 0 else OTHER_SIGN) ** 2
    return found
