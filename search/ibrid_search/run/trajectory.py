"""The course of a search, computed from its steps: the best so far, and the milestones on the way.

An evaluation is a step with a fit of its own (`ibrid_search.step.EVALUATED`), counted in the order
of the steps from 1, the start. Only stable candidates that meet what was required count as best.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import BETTER
from ibrid.foreign_text import csv_text
from ibrid_search.step import EVALUATED, Status, Step

#: Errors up to this are rounding, and tie: the model is the measurement.
ROUNDING = 1e-7

RecordOf = Callable[[int], Record | None]


@dataclass(frozen=True)
class Point:
    """A row of trajectory.csv: an evaluation, and the best NRMSE once it was known. `better` : it
    is a new best.
    """

    evaluation: int
    step: int
    nrmse: float | None
    best: float | None
    note: str
    stable: bool
    better: bool


@dataclass(frozen=True)
class Milestone:
    """An improvement that was accepted.

    `before`, `after` : NRMSE of the edited parent and of this, None before a start. `band` : the
    band (Hz) whose part of the squared error fell most from the record of the edited parent to this
    one's, with the relative error in that band in both; "" where that is unknown.
    """

    evaluation: int
    step: int
    note: str
    before: float | None
    after: float
    band: str = ""
    band_before: float | None = None
    band_after: float | None = None


def eligible(step: Step) -> bool:
    """Whether a step may be the best: fitted, stable at every operating point, and as required."""
    return (
        step.status is Status.OK
        and step.stable is True
        and step.nrmse is not None
        and bool(math.isfinite(step.nrmse))
    )


def improves(before: float | None, after: float) -> bool:
    """Whether an error is a new best and no tie."""
    return before is None or (before > ROUNDING and after < (1 - BETTER.tie) * before)


def best_step(steps: Iterable[Step]) -> Step | None:
    """The lowest error; among ties the fewest free parameters, then the lowest order, then the
    first.
    """
    fit = [step for step in steps if eligible(step)]
    if not fit:
        return None
    limit = max(ROUNDING, (1 + BETTER.tie) * min(_error(step) for step in fit))
    tied = [step for step in fit if _error(step) <= limit]
    return min(tied, key=lambda step: (step.free or 0, step.order or 0, step.number))


def trajectory(steps: Iterable[Step]) -> tuple[Point, ...]:
    """Best so far over the evaluations, in the order of the steps."""
    points: list[Point] = []
    best, mark = None, None  # the lowest error, and the last that was no tie
    for step in sorted(steps, key=lambda one: one.number):
        if step.status not in EVALUATED:
            continue
        better = False
        if eligible(step):
            better = improves(mark, _error(step))
            mark = _error(step) if better else mark
            best = _error(step) if best is None else min(best, _error(step))
        points.append(
            Point(len(points) + 1, step.number, step.nrmse, best, step.note, eligible(step), better)
        )
    return tuple(points)


def trajectory_csv(points: Iterable[Point]) -> str:
    """trajectory.csv; an empty cell where there is no number."""
    rows: list[list[object]] = [["evaluation", "step", "nrmse", "best", "what changed"]]
    for one in points:
        cells = ["" if value is None else repr(value) for value in (one.nrmse, one.best)]
        rows.append([one.evaluation, one.step, *cells, " ".join(one.note.split())])
    return csv_text(rows)


def milestones(
    points: Iterable[Point], steps: Mapping[int, Step], record_of: RecordOf
) -> tuple[Milestone, ...]:
    """The improvements in their order; `record_of` gives the record of a step, None where there is
    none.
    """
    improvements: list[Milestone] = []
    for point in points:
        if point.better:
            step = steps[point.step]
            parent = None if step.edited is None else record_of(step.edited)
            improvements.append(milestone(point.evaluation, step, record_of(step.number), parent))
    return tuple(improvements)


def milestone(
    evaluation: int, step: Step, record: Record | None = None, parent_record: Record | None = None
) -> Milestone:
    """One improvement, described by the records before and after the edit; of a start, which edits
    nothing, by its own alone.
    """
    band = band_that_got_better(parent_record, record)
    return Milestone(
        evaluation=evaluation,
        step=step.number,
        note=" ".join(step.note.split()) or ("the start" if step.parent is None else ""),
        before=None if parent_record is None else parent_record.nrmse,
        after=_error(step),
        band=band,
        band_before=parent_record.nrmse_by_band.get(band)
        if parent_record is not None and band
        else None,
        band_after=record.nrmse_by_band.get(band) if record is not None and band else None,
    )


def band_that_got_better(before: Record | None, after: Record | None) -> str:
    """The band whose part of the squared error, share times NRMSE^2, fell most; "" where none did
    or nothing is known.
    """
    if before is None or after is None or before.nrmse is None or after.nrmse is None:
        return ""
    gains = {
        band: share * before.nrmse**2 - (after.share_by_band.get(band) or 0.0) * after.nrmse**2
        for band, share in before.share_by_band.items()
        if share is not None
    }
    band = max(gains, key=lambda name: gains[name], default="")
    return band if band and gains[band] > 0 else ""


def _error(step: Step) -> float:
    return math.inf if step.nrmse is None else step.nrmse
