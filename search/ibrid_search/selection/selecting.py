"""Choosing the answer: the front of error against order and free numbers, what fits as well, and
what held-out data say.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import mean_or_none, nrmse
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.measurement.sweeps.amplitudes import can_be_thinned, thinned
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.requirements import passivity_index
from ibrid_search.run.selection import plain_selection
from ibrid_search.run.trajectory import eligible
from ibrid_search.screening.plausibility import find_impossible_values
from ibrid_search.screening.selection_criterion import NoiseFloor
from ibrid_search.step import Step

#: Structures of the front that are looked at closely, the least errors first.
MOST = 10


@dataclass(frozen=True)
class Finalist:
    """A structure of the front. `frequencies` : error at frequencies that a refit did not see.
    `holdout` : at operating points that no fit saw. `passivity` : least eigenvalue of -(Y+Y')/2
    over the measured band, per unit.
    `damping` : least damping ratio of all poles, negative when one is unstable.
    """

    step: int
    nrmse: float
    order: int
    free_parameters: int
    stable: bool
    holdout: float | None
    frequencies: float | None
    passivity: float | None
    damping: float | None
    note: str


def select(
    steps: Sequence[Step],
    best: Step,
    record_of: Callable[[int], Record],
    assessor: Assessor,
    floor: NoiseFloor,
    error: Callable[[int], float],
    way: str,
) -> dict[str, Any]:
    """The content of selection.json, and beside it the `seconds` of the refits.

    error : of a step, as the run measures it. floor : what noise leaves of it. way : "error": the
    best by the criterion of the run; "frequencies", "op": of the front, the smallest structure with
    the least error at held-out frequencies or operating points; "plausible": by held-out operating
    points where there are any, else by the criterion. The answer is always stable, and has an
    impossible value only where every finalist has one.
    """
    numbers = sorted({one.step for one in plain_selection(steps).front[:MOST]} | {best.number})
    by_number = {step.number: step for step in steps}
    records = {number: record_of(number) for number in numbers}
    refits: dict[
        int, Record
    ] = {}  # without every fourth frequency, from the found values; none where too few are left
    unseen: tuple[PointSweep, ...] = ()
    study = assessor.study
    if can_be_thinned(study.fitted):
        unseen = thinned(study.fitted, hold=True).points
        fewer = replace(
            assessor, study=replace(study, sweep=thinned(study.fitted, hold=False), holdout_op=())
        )
        refits = {
            number: fewer.record_of(record.program, assessor.quick, record.parameters)
            for number, record in records.items()
        }
    finalists = [
        _candidate(by_number[number], record, study.held, _error_at(unseen, refits.get(number)))
        for number, record in records.items()
    ]
    possible = [one for one in finalists if not find_impossible_values(records[one.step])]
    answer, why = _chosen(possible or finalists, best, way, floor)
    limit = EQUALLY_GOOD.error_ratio * max(
        error(best.number), floor.largest_error
    )  # with known noise what that leaves, two deviations allowed
    return {
        "schema": "ibrid.selection/1",
        "front": [vars(one) for one in sorted(finalists, key=lambda one: one.nrmse)],
        "equally_good": [
            step.number for step in steps if eligible(step) and error(step.number) <= limit
        ],
        "answer": answer,
        "why": why,
        "residual_modules": residual_modules(record_of(answer)),
        "seconds": sum(one.seconds for one in refits.values()),
    }


def given_answer(number: int, why: str, steps: Sequence[Step], record: Record) -> dict[str, Any]:
    """The content of selection.json where whoever evaluated the steps names the answer and says
    why.
    """
    front = [
        {
            "step": one.step,
            "nrmse": one.nrmse,
            "order": one.order,
            "free_parameters": one.free,
            "stable": one.stable,
        }
        for one in plain_selection(steps).front[:MOST]
    ]
    return {
        "schema": "ibrid.selection/1",
        "front": front,
        "equally_good": [number],
        "answer": number,
        "why": why,
        "residual_modules": residual_modules(record),
    }


def residual_modules(record: Record) -> list[str]:
    """Modules of a record that stand for no physics."""
    kinds = {kind.name: kind for kind in record.vocabulary}
    return [one.name for one in record.diagram.instances if kinds[one.kind].residual]


def _chosen(
    finalists: Sequence[Finalist], best: Step, way: str, floor: NoiseFloor
) -> tuple[int, str]:
    """The answer and why.

    Held-out errors within the noise, or alike, are equal: the smaller structure is the answer.
    """
    for ways, what, error in _HELD_OUT:
        errors = {candidate.step: error(candidate) for candidate in finalists if candidate.stable}
        known = {step: value for step, value in errors.items() if value is not None}
        if way in ways and known:
            least = max(
                EQUALLY_GOOD.error_ratio * min(known.values()),
                floor.largest_error if floor.known else 0.0,
            )
            able = [candidate for candidate in finalists if known.get(candidate.step, inf) <= least]
            answer = min(
                able,
                key=lambda candidate: (
                    candidate.free_parameters,
                    candidate.order,
                    known[candidate.step],
                ),
            )
            return (
                answer.step,
                f"of the front it predicts the held-out {what} best, error "
                f"{known[answer.step]:.3g}",
            )
    return (
        best.number,
        "it is the simplest of those with the least error, and stable at every operating point",
    )


#: Ways of choosing by data that no fit saw, what those are, and the error there.
_HELD_OUT: tuple[tuple[tuple[str, ...], str, Callable[[Finalist], float | None]], ...] = (
    (("op", "plausible"), "operating points", lambda candidate: candidate.holdout),
    (("frequencies",), "frequencies", lambda candidate: candidate.frequencies),
)


def _candidate(
    step: Step, record: Record, held: Sequence[str], frequencies: float | None
) -> Finalist:
    """held : names of the held-out operating points.

    frequencies : error at held-out frequencies.
    """
    low, high = record.settings["frequency_hz"]
    poles = [complex(*one) for found in record.poles.values() for one in found]
    return Finalist(
        step=step.number,
        nrmse=float(record.nrmse or 0.0),
        order=int(step.order or 0),
        free_parameters=int(step.free or 0),
        stable=bool(step.stable),
        holdout=mean_or_none(record.holdout.get(name) for name in held),
        frequencies=frequencies,
        passivity=min(passivity_index(record, name, low, high) for name in record.stable),
        damping=min((-one.real / abs(one) for one in poles if abs(one) > 0), default=None),
        note=step.note,
    )


def _error_at(points: Sequence[PointSweep], refit: Record | None) -> float | None:
    """Error of a refit at the frequencies that it did not see."""
    if refit is None or refit.nrmse is None:
        return None
    return float(
        np.mean([nrmse(refit.response(point.op.name, point.frequency), point) for point in points])
    )
