"""Figures of stability in a grid: root locus over the short-circuit ratio, eigenloci, passivity index."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ibrid.analysis.stability import GridCase, PointStability
from ibrid.report.modes import pole_plane
from ibrid.report.style import DANGER, INK, MUTED, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Circles of the eigenloci's plane that are drawn.
RINGS = (0.1, 0.3, 1.0, 3.0)
#: Size of an eigenvalue beyond which its locus is cut off.
FARTHEST = 5.0
#: Grids whose eigenloci are drawn at most.
SHOWN = 3


def draw_locus(axes: Sequence["Axes"], one: PointStability) -> None:
    """Poles in the upper half plane while the short-circuit ratio goes from the weakest to the strongest grid."""
    (plane,) = axes
    ratios, poles = one.locus
    if not len(ratios):
        ratios, poles = np.array([1.0]), np.array([[mode.pole for mode in one.cases[0].modes or one.ideal]])
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
        plane.plot(real[row][ends], hertz[row][ends], linestyle="none", marker=marker, markersize=7,
                   markerfacecolor="none", markeredgewidth=1.5, color=colour)  # fmt: skip
    highest = max((found.mode.frequency for found in one.critical), default=0.0)
    for found in one.critical:
        plane.plot(0.0, found.mode.frequency, marker="X", markersize=7, color=DANGER, linestyle="none")
        lift = 7 if found.mode.frequency == highest else -11
        plane.annotate(f"SCR {found.scr:.3g}", (0.0, found.mode.frequency), xytext=(-8, lift),
                       textcoords="offset points", ha="right", color=DANGER)  # fmt: skip
    plane.set_xticks([-(10.0**n) for n in range(8, -1, -2) if 10.0**n <= reach] + [0.0] + [1.0] * (right > 1))
    plane.set_yticks([0.0] + [10.0**n for n in range(9) if 10.0**n <= height])
    plane.minorticks_off()


def shown_cases(one: PointStability) -> list[GridCase]:
    """The weakest grid, the one nearest to a critical ratio or in the middle, and the strongest."""
    cases = list(one.cases)
    if len(cases) <= SHOWN:
        return cases
    middle = len(cases) // 2
    changes = [k for k in range(1, len(cases) - 1) if cases[k].stable != cases[k - 1].stable]
    return [cases[0], cases[changes[0] if changes else middle], cases[-1]]


def draw_eigenloci(axes: Sequence["Axes"], one: PointStability) -> None:
    """Both eigenvalues of Z (-Y) over frequency; radii are log2(1 + size), which leaves the unit circle as it is."""
    (plane,) = axes
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    largest = 1.0
    for index, case in enumerate(shown_cases(one)):
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
                circle.real, circle.imag, color=MUTED, linewidth=1.0 if ring == 1.0 else 0.6, linestyle=(0, (4, 3))
            )
            plane.annotate(f"{ring:g}", (0.0, radius), color=MUTED, fontsize=9, ha="center", va="bottom")
    plane.plot(-1.0, 0.0, marker="+", markersize=13, markeredgewidth=2.2, color=DANGER, linestyle="none")
    plane.annotate("-1", (-1.0, 0.0), xytext=(-6, 6), textcoords="offset points", color=DANGER, ha="right")
    reach = 1.1 * min(largest, float(np.log2(1 + FARTHEST)))
    plane.set_xlim(-reach, reach)
    plane.set_ylim(-reach, reach)
    plane.set_aspect("equal")
    plane.set_xticks([-1.0, 0.0, 1.0])
    plane.set_yticks([-1.0, 0.0, 1.0])
    plane.set_xlabel("real part of the eigenvalue  (squeezed)")
    plane.set_ylabel("imaginary part  (squeezed)")
    _draw_near(plane.inset_axes((0.66, 0.09, 0.32, 0.32)), shown_cases(one))
    plane.axhline(0, color=MUTED, linewidth=0.6)
    plane.axvline(0, color=MUTED, linewidth=0.6)


def _draw_near(near: "Axes", cases: Sequence[GridCase]) -> None:
    """The surroundings of -1, true to scale, an arrow along rising frequency where each grid's locus is nearest to it."""
    half = 3.0 * max(min(case.nyquist.vector_margin for case in cases), 1e-6)
    for index, case in enumerate(cases):
        colour, _, dashes = series(index)
        loci = case.nyquist.loci + 1.0
        for locus in loci.T:
            near.plot(locus.real, locus.imag, color=colour, linestyle=dashes, linewidth=1.4)
            near.plot(locus.real, -locus.imag, color=colour, linestyle=dashes, linewidth=0.8, alpha=0.45)
        row, column = np.unravel_index(int(np.argmin(np.abs(loci))), loci.shape)
        at, along = loci[row, column], np.diff(loci[max(row - 1, 0) : row + 2, column]).sum()
        along *= 0.3 * half / max(abs(along), 1e-300)
        near.annotate("", (at.real + along.real, at.imag + along.imag), (at.real, at.imag),
                      arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6})  # fmt: skip
    near.plot(0.0, 0.0, marker="+", markersize=13, markeredgewidth=2.2, color=DANGER, linestyle="none")
    near.set_xlim(-half, half)
    near.set_ylim(-half, half)
    near.set_xticks([])
    near.set_yticks([])
    near.set_xlabel(f"-1 ± {half:.2g}", fontsize=9, labelpad=2)


def draw_passivity(axes: Sequence["Axes"], points: Sequence[PointStability]) -> None:
    """Smallest eigenvalue of the Hermitian part of -Y over frequency; below zero the inverter is active."""
    (plane,) = axes
    plane.set_xscale("log")
    plane.set_yscale("symlog", linthresh=0.01)
    lowest = min(float(one.passivity.smallest.min()) for one in points)
    plane.axhspan(2.0 * min(lowest, -0.02), 0.0, color=DANGER, alpha=0.10, linewidth=0)
    plane.axhline(0, color=INK, linewidth=0.9)
    for index, one in enumerate(points):
        colour, _, dashes = series(index)
        plane.plot(one.frequency, one.passivity.smallest, color=colour, linestyle=dashes, linewidth=1.6)
    plane.set_xlim(points[0].frequency[0], points[0].frequency[-1])
    plane.set_ylim(bottom=2.0 * min(lowest, -0.02))
    plane.set_xlabel("frequency  (Hz)")
    plane.set_ylabel("passivity index  (pu)")


def _dense(locus: np.ndarray) -> np.ndarray:
    """Straight lines between neighbours with points on them, which the squeezed plane bends."""
    parts = np.linspace(0.0, 1.0, 4, endpoint=False)
    between = locus[:-1, None] + parts * np.diff(locus)[:, None]
    return np.append(between.ravel(), locus[-1])


def _squeezed(values: np.ndarray) -> np.ndarray:
    size = np.abs(values)
    return values / np.where(size > 0, size, 1.0) * np.log2(1 + size)
