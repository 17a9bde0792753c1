"""How the search went and what it found, drawn: error over the evaluations and against
complexity.
"""

import math
from collections.abc import Iterable
from importlib.util import find_spec
from typing import Any

import numpy as np

from ibrid.report.figures.trajectory import (
    ErrorAgainstCost,
    Trajectory,
    draw_front,
    draw_trajectory,
)
from ibrid.report.look.figure import inline_svg
from ibrid.report.look.numbers import error
from ibrid.report.pages.template import shortened
from ibrid_search.policy_package import UPDATES, policy_part
from ibrid_search.report.run_data import RunData
from ibrid_search.run.trajectory import eligible

#: Characters of a note in the figure.
LABEL = 36


def trajectory_svg(run: RunData) -> str:
    """The error of every candidate and the best so far; "" before the first evaluation."""
    if not run.points:
        return ""
    last = run.points[-1]
    label = (
        f"NRMSE on a logarithmic scale over {last.evaluation} evaluations; the table below gives "
        "the milestones."
    )
    if last.best is not None:
        label += f" The best is {error(last.best)}."
    target = run.settings.get("target")
    shown = Trajectory(
        evaluation=_column(point.evaluation for point in run.points),
        nrmse=_column(point.nrmse for point in run.points),
        stable=np.array([point.stable for point in run.points]),
        best=_column(point.best for point in run.points),
        milestones=tuple(
            (one.evaluation, one.after, f"{shortened(one.note, LABEL)}  {error(one.after)}")
            for one in run.milestones
        ),
        floor=None if run.record is None else run.record.noise_floor,
        target=float(target)
        if isinstance(target, int | float) and not isinstance(target, bool)
        else None,
    )
    return inline_svg(
        lambda axes: draw_trajectory(axes, shown), name="trajectory", label=label, size=(11.5, 4.4)
    )


def front_svg(run: RunData, count: str, name: str) -> str:
    """Error against a count of a step, "free" or "order"."""
    steps = [
        step
        for step in run.steps.values()
        if step.nrmse is not None and getattr(step, count) is not None
    ]
    spots = [
        (float(cost), one.nrmse)
        for one in run.selection.front
        if (cost := getattr(one, count)) is not None
    ]
    place = getattr(run.answer, count, None)
    shown = ErrorAgainstCost(
        cost=_column(getattr(step, count) for step in steps),
        nrmse=_column(step.nrmse for step in steps),
        stable=np.array([eligible(step) for step in steps], dtype=bool),
        front=_undominated([(cost, value) for cost, value in spots if value is not None]),
        answer=None
        if run.answer is None or place is None or run.answer.nrmse is None
        else (float(place), run.answer.nrmse),
        name=name,
    )
    label = (
        f"NRMSE on a logarithmic scale over the number of {name}; the table below gives the front."
    )
    return inline_svg(
        lambda axes: draw_front(axes, shown), name=f"front-{count}", label=label, size=(5.2, 3.4)
    )


def _column(values: Iterable[float | None]) -> np.ndarray:
    return np.array([math.nan if value is None else value for value in values], dtype=float)


def _undominated(spots: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Those of a front of three merits that are also a front of these two."""
    kept: list[tuple[float, float]] = []
    for spot in sorted(set(spots)):
        if not kept or spot[1] < kept[-1][1]:
            kept.append(spot)
    return tuple(kept)


def learning_of(run: RunData) -> dict[str, Any]:
    """The updates of a run (`ibrid_policy.learning.updates`) and their figure; none where nothing
    learns or that is not installed.
    """
    told = run.meta.get(UPDATES, "")
    if not told or find_spec("ibrid_policy") is None:
        return {"updates": (), "svg": ""}
    updates = policy_part("learning.updates").read_updates(told)
    return {"updates": updates, "svg": policy_part("learning.drawing").learning_svg(updates)}
