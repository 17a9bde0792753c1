"""The page of stability in a grid: the answer on top, grids, root locus, eigenloci, passivity,
modes.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.analysis.grids.grid import SeriesRL
from ibrid.analysis.grids.stability import GridCase, PointStability, Stability, graded
from ibrid.analysis.models.modes import QUANTILE, Mode
from ibrid.report.facts.modes import pole_plane
from ibrid.report.look.figure import inline_svg
from ibrid.report.look.numbers import interval, number
from ibrid.report.look.style import DANGER, INK, MUTED, PAGE, Axes, series
from ibrid.report.pages.template import page
from ibrid.report.texts.prediction_text import shown_modes
from ibrid.report.texts.stability_text import CASE_HEAD, case_cells, grid_name, passivity_words


def stability_page(study: Stability, source: str = "") -> str:
    """The page as text; `source` : the record's name."""
    above = "Identified inverter model" + (f": {source}" if source else "")
    return page("stability.html", stability_facts(study) | {"above": above, "source": source})


def stability_facts(study: Stability, name: str = "", *, zoom: bool = True) -> dict[str, Any]:
    """What stability.html is filled with.

    `name` : goes before those of the figures; `zoom` : False where no script runs.
    """
    points = study.points
    return {
        "study": study,
        "critical": [
            (
                point.op,
                crossing,
                "-"
                if crossing.interval is None
                else interval(crossing.scr, crossing.interval, None),
            )
            for point in points
            for crossing in point.critical
        ],
        "grid_word": "SCR" if _ratios(points[0]) else "grid",
        "case_head": list(CASE_HEAD),
        "grids": [
            (
                point.op,
                [
                    (grid_name(case), case_cells(case, float(point.frequency[-1])))
                    for case in point.cases
                ],
            )
            for point in points
        ],
        "locus": [
            (point.op, _locus(f"{name}locus-{index}", point))
            for index, point in enumerate(points)
            if any(other.cases[0].modes is not None for other in points)
        ],
        "eigenloci": [
            (point.op, _line_names(point), _eigenloci(f"{name}loci-{index}", point, zoom))
            for index, point in enumerate(points)
        ],
        "passivity": [(point.op, passivity_words(point)) for point in points],
        "passivity_svg": inline_svg(
            lambda axes: draw_passivity(axes, points),
            name=f"{name}passivity",
            label="Smallest eigenvalue of the Hermitian part of -Y over frequency.",
            size=(7.4, 3.6),
            zoom=zoom,
        ),
        "ideal": [(point.op, mode_rows(point.ideal)) for point in points],
        "warnings": list(dict.fromkeys(words for point in points for words in point.warnings)),
    }


def mode_rows(modes: Sequence[Mode]) -> list[tuple[Mode, str]]:
    """The modes of a model that matter, each with the 95 % band of its real part."""
    return [
        (
            mode,
            "-"
            if mode.real_deviation is None
            else f"± {number(QUANTILE * mode.real_deviation, 2)}",
        )
        for mode in shown_modes(modes)
    ]


def _ratios(point: PointStability) -> bool:
    """Whether the grids are named by their short-circuit ratio."""
    return isinstance(point.cases[0].grid, SeriesRL)


def _line_names(point: PointStability) -> list[str]:
    first = "SCR " if _ratios(point) else ""
    return [f"{first}{grid_name(case)}: {graded(case.grade)}" for case in shown_cases(point)]


def _locus(name: str, point: PointStability) -> str:
    label = f"Poles at {point.op} over the short-circuit ratio, real part against frequency."
    return inline_svg(lambda axes: draw_locus(axes, point), name=name, label=label, size=(5.2, 4.2))


def _eigenloci(name: str, point: PointStability, zoom: bool) -> str:
    label = f"Eigenloci of Z (-Y) at {point.op}; the table gives counts and distances from -1."
    return inline_svg(
        lambda axes: draw_eigenloci(axes, point), name=name, label=label, size=(5.2, 5.0), zoom=zoom
    )


#: Circles of the eigenloci's plane that are drawn.
RINGS = (0.1, 0.3, 1.0, 3.0)
#: Size of an eigenvalue beyond which its locus is cut off.
FARTHEST = 5.0
#: Grids whose eigenloci are drawn at most.
SHOWN = 3


def draw_locus(axes: Sequence[Axes], point: PointStability) -> None:
    """Poles in the upper half plane while the short-circuit ratio goes from the weakest to the
    strongest grid.
    """
    (plane,) = axes
    ratios, poles = point.locus
    if not len(ratios):
        ratios, poles = (
            np.array([1.0]),
            np.array([[mode.pole for mode in point.cases[0].modes or point.ideal]]),
        )
    real, hertz = np.real(poles), np.imag(poles) / (2 * np.pi)
    upper = hertz >= 0
    right = max(2.0, 3.0 * float(real.max()))
    reach = 2.0 * max(10.0, float(-real.min()))
    height = 2.0 * max(10.0, float(hertz.max()))
    pole_plane(plane, reach, right, height)
    colour, _, _ = series(0)
    plane.plot(real[upper], hertz[upper], linestyle="none", marker=".", markersize=3, color=colour)
    for row, marker in ((0, "o"), (len(ratios) - 1, "s")):
        ends = upper[row]
        plane.plot(
            real[row][ends],
            hertz[row][ends],
            linestyle="none",
            marker=marker,
            markersize=7,
            markerfacecolor="none",
            markeredgewidth=1.5,
            color=colour,
        )
    highest = max((critical.mode.frequency for critical in point.critical), default=0.0)
    for critical in point.critical:
        plane.plot(
            0.0, critical.mode.frequency, marker="X", markersize=7, color=DANGER, linestyle="none"
        )
        lift = 7 if critical.mode.frequency == highest else -11
        plane.annotate(
            f"SCR {critical.scr:.3g}",
            (0.0, critical.mode.frequency),
            xytext=(-8, lift),
            textcoords="offset points",
            ha="right",
            color=DANGER,
        )
    plane.set_xticks(
        [-(10.0**n) for n in range(8, -1, -2) if 10.0**n <= reach] + [0.0] + [1.0] * (right > 1)
    )
    plane.set_yticks([0.0] + [10.0**n for n in range(9) if 10.0**n <= height])
    plane.minorticks_off()


def shown_cases(point: PointStability) -> list[GridCase]:
    """The weakest grid, the one nearest to a critical ratio or in the middle, and the strongest."""
    cases = list(point.cases)
    if len(cases) <= SHOWN:
        return cases
    middle = len(cases) // 2
    changes = [k for k in range(1, len(cases) - 1) if cases[k].stable != cases[k - 1].stable]
    return [cases[0], cases[changes[0] if changes else middle], cases[-1]]


def draw_eigenloci(axes: Sequence[Axes], point: PointStability) -> None:
    """Both eigenvalues of Z (-Y) over frequency; radii are log2(1 + size), which leaves the unit
    circle as it is.
    """
    (plane,) = axes
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    largest = 1.0
    for index, case in enumerate(shown_cases(point)):
        colour, _, dashes = series(index)
        for locus in case.nyquist.loci.T:
            drawn = _squeezed(_dense(locus))
            largest = max(largest, float(np.abs(drawn).max()))
            x, y = np.real(drawn), np.imag(drawn)
            plane.plot(x, y, color=colour, linestyle=dashes, linewidth=1.5)
            plane.plot(x, -y, color=colour, linestyle=dashes, linewidth=0.8, alpha=0.45)
    for ring in RINGS:
        radius = float(np.log2(1 + ring))
        if ring <= FARTHEST:
            circle = radius * turn
            plane.plot(
                circle.real,
                circle.imag,
                color=MUTED,
                linewidth=1.0 if ring == 1.0 else 0.6,
                linestyle=(0, (4, 3)),
            )
            plane.annotate(
                f"{ring:g}", (0.0, radius), color=MUTED, fontsize=9, ha="center", va="bottom"
            )
    plane.plot(
        -1.0, 0.0, marker="+", markersize=13, markeredgewidth=2.2, color=DANGER, linestyle="none"
    )
    plane.annotate(
        "-1", (-1.0, 0.0), xytext=(-6, 6), textcoords="offset points", color=DANGER, ha="right"
    )
    reach = 1.1 * min(largest, float(np.log2(1 + FARTHEST)))
    plane.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    plane.set(xticks=[-1.0, 0.0, 1.0], yticks=[-1.0, 0.0, 1.0])
    plane.set(xlabel="real part of the eigenvalue  (squeezed)", ylabel="imaginary part  (squeezed)")
    _draw_near(plane.inset_axes((0.66, 0.09, 0.32, 0.32)), shown_cases(point))
    plane.axhline(0, color=MUTED, linewidth=0.6)
    plane.axvline(0, color=MUTED, linewidth=0.6)


def _draw_near(near: Axes, cases: Sequence[GridCase]) -> None:
    """The surroundings of -1, true to scale, an arrow along rising frequency where each grid's
    locus is nearest to it.
    """
    half = 3.0 * max(min(case.nyquist.vector_margin for case in cases), 1e-6)
    near.axhspan(-half, half, facecolor=PAGE, zorder=0)  # what lies behind would seem to be of it
    for index, case in enumerate(cases):
        colour, _, dashes = series(index)
        loci = case.nyquist.loci + 1.0
        for locus in loci.T:
            near.plot(locus.real, locus.imag, color=colour, linestyle=dashes, linewidth=1.4)
            near.plot(
                locus.real, -locus.imag, color=colour, linestyle=dashes, linewidth=0.8, alpha=0.45
            )
        row, column = np.unravel_index(int(np.argmin(np.abs(loci))), loci.shape)
        at, along = loci[row, column], np.diff(loci[max(row - 1, 0) : row + 2, column]).sum()
        along *= 0.3 * half / max(abs(along), 1e-300)
        near.annotate(
            "",
            (at.real + along.real, at.imag + along.imag),
            (at.real, at.imag),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6},
        )
    near.plot(
        0.0, 0.0, marker="+", markersize=13, markeredgewidth=2.2, color=DANGER, linestyle="none"
    )
    near.set(xlim=(-half, half), ylim=(-half, half), xticks=[], yticks=[])
    near.set_xlabel(f"-1 ± {half:.2g}", fontsize=9, labelpad=2)


def draw_passivity(axes: Sequence[Axes], points: Sequence[PointStability]) -> None:
    """Smallest eigenvalue of the Hermitian part of -Y over frequency; below zero the inverter is
    active.
    """
    (plane,) = axes
    plane.set_xscale("log")
    plane.set_yscale("symlog", linthresh=0.01)
    lowest = min(float(one.passivity.smallest.min()) for one in points)
    plane.axhspan(2.0 * min(lowest, -0.02), 0.0, color=DANGER, alpha=0.10, linewidth=0)
    plane.axhline(0, color=INK, linewidth=0.9)
    for index, one in enumerate(points):
        colour, _, dashes = series(index)
        plane.plot(
            one.frequency, one.passivity.smallest, color=colour, linestyle=dashes, linewidth=1.6
        )
    plane.set_xlim(points[0].frequency[0], points[0].frequency[-1])
    plane.set_ylim(bottom=2.0 * min(lowest, -0.02))
    plane.set(xlabel="frequency  (Hz)", ylabel="passivity index  (pu)")


def _dense(locus: np.ndarray) -> np.ndarray:
    """Straight lines between neighbours with points on them, which the squeezed plane bends."""
    parts = np.linspace(0.0, 1.0, 4, endpoint=False)
    between = locus[:-1, None] + parts * np.diff(locus)[:, None]
    return np.append(between.ravel(), locus[-1])


def _squeezed(values: np.ndarray) -> np.ndarray:
    size = np.abs(values)
    return values / np.where(size > 0, size, 1.0) * np.log2(1 + size)
