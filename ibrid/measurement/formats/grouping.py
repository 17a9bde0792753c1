"""Rows that belong together, found in a time that grows with their number alone."""

from collections.abc import Sequence
from itertools import product
from typing import TypeVar

import numpy as np

Label = TypeVar("Label")


def rows_of_each(labels: Sequence[Label]) -> dict[Label, np.ndarray]:
    """Label -> ascending places of its rows, in order of appearance."""
    number: dict[Label, int] = {}
    belongs = np.array([number.setdefault(label, len(number)) for label in labels], dtype=int)
    order = np.argsort(belongs, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(belongs[order])) + 1)
    return dict(zip(number, groups, strict=True)) if number else {}


def first_near(points: np.ndarray, reach: float) -> np.ndarray:
    """(n,) for each point the first one that is at most `reach` away in every coordinate and has
    none before it itself.

    points : (n, d). One that is not a number is near none but itself. Cells as wide as the reach
    hold the first ones, so that only a cell and its neighbours are looked at.
    """
    cells: dict[tuple[float, ...], list[int]] = {}
    around = list(product((-1.0, 0.0, 1.0), repeat=points.shape[1]))
    first = np.arange(len(points))
    for k, (point, corner) in enumerate(
        zip(points.tolist(), np.floor(points / reach).tolist(), strict=True)
    ):
        beside = (cells.get(tuple(map(sum, zip(corner, step, strict=True))), ()) for step in around)
        near = [
            one for cell in beside for one in cell if np.abs(points[one] - point).max() <= reach
        ]
        if near:
            first[k] = min(near)
        else:
            cells.setdefault(tuple(corner), []).append(k)
    return first
