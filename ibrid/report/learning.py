"""How a proposer learnt in the course of a search: reward, what its answers came to, and how far it has moved."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.report.style import SERIES_STAND_INS, Axes

#: Room for the legend beside the lines, as a share of their length.
LEGEND = 0.17


@dataclass(frozen=True)
class Course:
    """Lines over the updates. `lines` : name -> (N,), nan where there is no number. `name` : of the vertical axis."""

    name: str
    lines: dict[str, np.ndarray]


def draw_courses(axes: Sequence[Axes], courses: Sequence[Course]) -> None:
    """One plane for each course, the updates from 1 along the common axis."""
    from matplotlib.ticker import MaxNLocator

    for plane, course in zip(axes, courses, strict=True):
        for color, (name, values) in zip(SERIES_STAND_INS, course.lines.items(), strict=False):
            number = np.arange(1, len(values) + 1)
            plane.plot(number, values, color=color, linewidth=1.6, marker="o", markersize=3.5, label=name)
        plane.set_ylabel(course.name)
        plane.margins(y=0.12)
        plane.xaxis.set_major_locator(MaxNLocator(integer=True))
        if len(course.lines) > 1:
            plane.legend(loc="center right", fontsize=9)
    last = max(len(values) for course in courses for values in course.lines.values())
    axes[-1].set(xlim=(1 - 0.03 * last, last + LEGEND * last), xlabel="update")


def course(name: str, lines: dict[str, Sequence[float | None]]) -> Course:
    """From numbers with gaps."""
    return Course(name, {key: np.array(values, dtype=float) for key, values in lines.items()})  # None becomes nan
