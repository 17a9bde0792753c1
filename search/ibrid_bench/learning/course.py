"""The course of a search as a staircase of its best error, and what is measured on it."""

from collections.abc import Mapping, Sequence
from math import inf, log10
from typing import Any

import numpy as np

#: (evaluation, NRMSE) wherever the best so far got better; evaluations count from 1, the start.
Course = Sequence[Sequence[float]]
#: Errors below it count as it: what is left then is rounding.
LEAST_ERROR = 1e-6
#: The error of no model at all, before there is a best.
NO_MODEL = 1.0


def course_of(trajectory: Sequence[tuple[int, float | None, float | None]]) -> list[list[float]]:
    """The staircase of a run's trajectory, errors to six digits."""
    steps: list[list[float]] = []
    for evaluation, _, best in trajectory:
        if best is not None and (not steps or float(f"{best:.6g}") < steps[-1][1]):
            steps.append([evaluation, float(f"{best:.6g}")])
    return steps


def best_at(course: Course, evaluations: np.ndarray) -> np.ndarray:
    """The best error after so many evaluations, `NO_MODEL` before the first; same shape."""
    at = np.array([step[0] for step in course])
    errors = np.array([NO_MODEL, *(step[1] for step in course)])
    return errors[np.searchsorted(at, evaluations, side="right")]


def evaluations_to(course: Course, limit: float, budget: int) -> float:
    """Evaluations until the best error is at most `limit`; infinite where the budget does not reach
    it.
    """
    return next((float(step[0]) for step in course if step[1] <= limit and step[0] <= budget), inf)


def area(course: Course, budget: int) -> float:
    """Mean over the evaluations 1 .. budget of log10 of the best error, `LEAST_ERROR` at least.

    A search that ended early keeps its best. Half a unit is a factor of three in the error, on the
    geometric mean.
    """
    errors = best_at(course, np.arange(1, budget + 1))
    return float(np.mean(np.log10(np.maximum(errors, LEAST_ERROR))))


def final_error(row: Mapping[str, Any]) -> float:
    """log10 of the best error of a row at its end, `LEAST_ERROR` at least."""
    last = row["curve"][-1][1] if row["curve"] else NO_MODEL
    return log10(max(last, LEAST_ERROR))
