"""How a proposer learnt in the course of a search, drawn: reward, what its answers came to, and how
far it has moved.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.report.look.figure import inline_svg
from ibrid.report.look.style import SERIES_STAND_INS, Axes

#: Room for the legend beside the lines, as a share of their length.
LEGEND = 0.17


@dataclass(frozen=True)
class Course:
    """Lines over the updates.

    `lines` : name -> (N,), nan where there is no number. `name` : of the vertical axis.
    """

    name: str
    lines: dict[str, np.ndarray]


def draw_courses(axes: Sequence[Axes], courses: Sequence[Course]) -> None:
    """One plane for each course, the updates from 1 along the common axis."""
    from matplotlib.ticker import MaxNLocator

    for plane, course in zip(axes, courses, strict=True):
        for color, (name, values) in zip(SERIES_STAND_INS, course.lines.items(), strict=False):
            number = np.arange(1, len(values) + 1)
            plane.plot(
                number, values, color=color, linewidth=1.6, marker="o", markersize=3.5, label=name
            )
        plane.set_ylabel(course.name)
        plane.margins(y=0.12)
        plane.xaxis.set_major_locator(MaxNLocator(integer=True))
        if len(course.lines) > 1:
            plane.legend(loc="center right", fontsize=9)
    last = max(len(values) for course in courses for values in course.lines.values())
    axes[-1].set(xlim=(1 - 0.03 * last, last + LEGEND * last), xlabel="update")


def course(name: str, lines: dict[str, Sequence[float | None]]) -> Course:
    """From numbers with gaps."""
    return Course(
        name, {key: np.array(values, dtype=float) for key, values in lines.items()}
    )  # None becomes nan


def learning_svg(updates: Sequence[Any]) -> str:
    """Reward, shares of answers, entropy and divergence; "" where there are no two updates."""
    if len(updates) < 2:
        return ""
    rewards: dict[str, Sequence[float | None]] = {
        "mean": [one.reward for one in updates],
        "best": [one.best_reward for one in updates],
    }
    if any(one.gain is not None for one in updates):
        rewards["gain, mean"] = [one.gain for one in updates]
    courses = (
        course("reward", rewards),
        course(
            "share",
            {
                name.replace("duplicates", "known before"): [getattr(one, name) for one in updates]
                for name in ("valid", "duplicates", "siblings", "refused")
            },
        ),
        course(
            "nats per token",
            {
                "entropy": [one.entropy for one in updates],
                "divergence": [one.divergence for one in updates],
            },
        ),
    )
    label = (
        f"Reward, shares of answers, entropy and divergence over {len(updates)} updates; the "
        "tables give the numbers."
    )
    return inline_svg(
        lambda axes: draw_courses(axes, courses),
        name="learning",
        label=label,
        size=(11.5, 6.0),
        rows=len(courses),
    )
