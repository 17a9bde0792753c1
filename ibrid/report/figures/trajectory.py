"""The course of a search and what it found: error against evaluation, and error against
complexity.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ibrid.report.look.style import DANGER, INK, MUTED, SERIES_STAND_INS, Axes

#: Errors below this are drawn at it; so are those above the ceiling, which leaves room over the
#: first best.
LOWEST = 1e-8
CEILING = 2.0
#: Candidates are thinned to one in each cell of a grid of this many by this many cells.
CELLS = (200, 80)
#: Milestones with a label at most.
LABELS = 14
Line = tuple[float, float, float, float]


@dataclass(frozen=True)
class Trajectory:
    """`evaluation`, `nrmse`, `stable`, `best` : (N,) in the order of evaluation, nan where there is
    no number.

    `milestones` : (evaluation, NRMSE, label). `floor` : NRMSE that noise alone would leave.
    `target` : where the search ends.
    """

    evaluation: np.ndarray
    nrmse: np.ndarray
    stable: np.ndarray
    best: np.ndarray
    milestones: tuple[tuple[float, float, str], ...] = ()
    floor: float | None = None
    target: float | None = None


@dataclass(frozen=True)
class ErrorAgainstCost:
    """Error against complexity.

    `cost`, `nrmse`, `stable` : (N,) of all candidates. `front` : (cost, NRMSE) of the best of each.
    `answer` : (cost, NRMSE) of the chosen one, or None. `name` : what the cost counts.
    """

    cost: np.ndarray
    nrmse: np.ndarray
    stable: np.ndarray
    front: tuple[tuple[float, float], ...]
    answer: tuple[float, float] | None
    name: str
    floor: float | None = None


def draw_trajectory(axes: Sequence[Axes], shown: Trajectory) -> None:
    """Logarithm of the error over the evaluations: candidates as dots, best so far as a line,
    labelled milestones.
    """
    (plane,) = axes
    low, high = _limits(shown.best, shown.nrmse, shown.floor, shown.target)
    last = max(1.0, float(shown.evaluation.max(initial=1.0)))
    _prepare(plane, low, high)
    plane.set(xlim=(-0.015 * last, 1.03 * last), xlabel="evaluation")
    _dots(plane, shown.evaluation, shown.nrmse, shown.stable, low, high)
    x, y = _corners(shown.evaluation, np.clip(shown.best, low, high), last)
    plane.plot(x, y, drawstyle="steps-post", color=SERIES_STAND_INS[0], linewidth=1.8)
    levels = [one for one in (shown.floor, shown.target) if one]
    _level(plane, shown.floor, "noise floor", low, right=False)
    _level(plane, shown.target, "target", low, right=True)
    spots = [(x, float(np.clip(y, low, high)), words) for x, y, words in shown.milestones]
    plane.plot(
        [x for x, _, _ in spots],
        [y for _, y, _ in spots],
        linestyle="none",
        marker="o",
        markersize=4.5,
        color=SERIES_STAND_INS[0],
        gid="milestones",
    )
    _label(plane, _worth_a_label(spots), _stairs(x, y) + [(0.0, one, last, one) for one in levels])


def draw_front(axes: Sequence[Axes], shown: ErrorAgainstCost) -> None:
    """Logarithm of the error over a count: candidates as dots, the front as a line, the answer as a
    ring.
    """
    (plane,) = axes
    low, high = _limits(
        np.array([error for _, error in shown.front]), shown.nrmse, shown.floor, None
    )
    _prepare(plane, low, high)
    most = float(shown.cost[np.isfinite(shown.cost)].max(initial=1.0))
    plane.set(xlim=(-0.5, most + 1), xlabel=shown.name)
    _dots(plane, shown.cost, shown.nrmse, shown.stable, low, high)
    if shown.front:
        x, y = zip(*sorted(shown.front), strict=True)
        plane.plot(
            x,
            np.clip(y, low, high),
            color=SERIES_STAND_INS[0],
            linewidth=1.5,
            drawstyle="steps-post",
            marker="o",
            markersize=5,
        )
    _level(plane, shown.floor, "noise floor", low, right=False)
    if shown.answer is not None:
        plane.plot(
            shown.answer[0],
            float(np.clip(shown.answer[1], low, high)),
            linestyle="none",
            marker="o",
            markersize=11,
            markerfacecolor="none",
            markeredgewidth=1.8,
            color=SERIES_STAND_INS[1],
        )


def _limits(best: np.ndarray, nrmse: np.ndarray, *levels: float | None) -> tuple[float, float]:
    """Ends of the error axis: from below the best and every level that is near to above the first
    best.
    """
    found = best[np.isfinite(best)]
    everything = found if found.size else nrmse[np.isfinite(nrmse)]
    top = CEILING * float(np.clip(everything.max(initial=1.0), 0.5, 10.0))
    bottom = min([float(everything.min(initial=top / 20)), *(one for one in levels if one)])
    return max(LOWEST, min(bottom / 2, top / 20)), top


def _prepare(plane: Axes, low: float, high: float) -> None:
    from matplotlib.ticker import MaxNLocator

    plane.set(yscale="log", ylim=(low * 0.8, high * 1.25), ylabel="NRMSE")
    plane.minorticks_off()
    plane.xaxis.set_major_locator(MaxNLocator(integer=True))


def _dots(
    plane: Axes, x: np.ndarray, nrmse: np.ndarray, stable: np.ndarray, low: float, high: float
) -> None:
    """Every candidate, thinned; unstable ones as crosses."""
    known = np.isfinite(nrmse) & np.isfinite(x)
    y = np.clip(np.where(known, nrmse, high), low, high)
    look: dict[str, Any] = {"linestyle": "none", "markeredgewidth": 0.0, "alpha": 0.45}
    for chosen, style in (
        (known & stable, look | {"marker": "o", "markersize": 3.4, "color": MUTED}),
        (
            known & ~stable,
            look | {"marker": "x", "markersize": 3.6, "color": DANGER, "markeredgewidth": 0.9},
        ),
    ):
        kept = _thinned(x[chosen], y[chosen], low, high)
        if kept.size:
            plane.plot(x[chosen][kept], y[chosen][kept], **style)


def _thinned(x: np.ndarray, y: np.ndarray, low: float, high: float) -> np.ndarray:
    """Numbers of the dots that stand alone in their cell of the grid, or first in it."""
    if not x.size:
        return np.array([], dtype=int)
    across = np.round(CELLS[0] * (x - x.min()) / max(1e-12, float(np.ptp(x))))
    down = np.round(CELLS[1] * np.log(y / low) / math.log(high / low))
    return np.sort(np.unique(np.stack([across, down]), axis=1, return_index=True)[1])


def _level(plane: Axes, value: float | None, words: str, low: float, *, right: bool) -> None:
    """A line across, named above its right end or below its left one, so that two of them do not
    meet.
    """
    if value and value >= low:
        plane.axhline(value, color=MUTED, linewidth=1.0, linestyle=(0, (5, 3)))
        plane.annotate(
            words,
            (float(right), value),
            (-4, 3) if right else (4, -3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=SIZE,
            color=MUTED,
            ha="right" if right else "left",
            va="bottom" if right else "top",
        )


def _worth_a_label(spots: Sequence[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """The start and the largest falls of the error, in their order."""
    falls = [math.inf, *(math.log(a[1] / b[1]) for a, b in pairwise(spots))]
    chosen = sorted(range(len(spots)), key=lambda index: -falls[index])[:LABELS]
    return [spots[index] for index in sorted(chosen)]


def _corners(
    evaluation: np.ndarray, best: np.ndarray, last: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where the best falls, and the end of its line; empty before there is a best."""
    known = np.isfinite(best)
    if not known.any():
        return np.array([]), np.array([])
    falls = np.flatnonzero(known & (best != np.append(np.nan, best[:-1])))
    return np.append(evaluation[falls], last), np.append(best[falls], best[falls][-1])


def _stairs(x: np.ndarray, y: np.ndarray) -> list[Line]:
    """Level and upright pieces of a step line, in data coordinates."""
    stairs = [
        (float(a), float(b), float(c), float(b))
        for a, b, c in zip(x[:-1], y[:-1], x[1:], strict=True)
    ]
    return stairs + [
        (float(a), float(b), float(a), float(c))
        for a, b, c in zip(x[1:], y[:-1], y[1:], strict=True)
    ]


#: Size of the letters in points, and characters of a label at most.
SIZE, LONGEST = 9.0, 48


def _label(plane: Axes, points: Sequence[tuple[float, float, str]], curve: Sequence[Line]) -> None:
    """Put a label beside each of `points` (x, y, words), with a line that leads to it; one that
    finds no place gets none.

    `curve` : straight pieces that no label may cover. All in data coordinates.
    """
    if not points:
        return
    import textalloc  # as matplotlib: only who draws needs it

    x, y = np.array([one[:2] for one in points]).T
    lines = np.array(curve).reshape(-1, 2, 2)  # pieces, ends, (x, y)
    textalloc.allocate(
        plane,
        x,
        y,
        [_shortened(words) for _, _, words in points],
        x_scatter=x,
        y_scatter=y,
        x_lines=list(lines[..., 0]),
        y_lines=list(lines[..., 1]),
        textsize=SIZE,
        textcolor=INK,
        linecolor=MUTED,
        linewidth=0.7,
        margin=0.004,
        min_distance=0.01,
        max_distance=0.25,
        nbr_candidates=600,
        draw_all=False,
        avoid_label_lines_overlap=True,
        avoid_crossing_label_lines=True,
        parse_math=False,
    )


def _shortened(words: str) -> str:
    """At most `LONGEST` characters, of those that the font of the layout knows."""
    words = "".join(
        one if one.isprintable() and (ord(one) < 0x250 or one in "–…→") else "?" for one in words
    )
    return words if len(words) <= LONGEST else words[: LONGEST - 1].rstrip() + "…"
