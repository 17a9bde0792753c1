"""The first look at a sweep over frequency: a row for each operating point with its range, where it
is active, its resonances, multiples of the nominal frequency, and points that look wrong.
"""

from typing import Any

from ibrid.measurement.quality.inspect import Inspection, PointInspection
from ibrid.report.look.style import DANGER, INK, MUTED, SERIES_STAND_INS

#: What is marked on a row -> marker and colour.
MARKERS = {
    "resonance": ("^", SERIES_STAND_INS[1]),
    "multiple of f0": ("|", MUTED),
    "sticks out": ("x", DANGER),
    "contradicts the others": ("s", DANGER),
}


def draw_inspection(axes: Any, inspection: Inspection) -> None:
    """Rows from above in the order of the sweep; the legend names what is there."""
    points = inspection.points
    for row, point in enumerate(points):
        first = row == 0
        ends = [point.lowest, point.highest]
        axes.plot(ends, [row, row], color=INK, lw=1.5, marker="|", label="measured" * first)
        for begin, end in point.active_bands:
            axes.plot([begin, end], [row, row], color=SERIES_STAND_INS[0], lw=7, alpha=0.4)
    for what, (marker, colour) in MARKERS.items():
        marked = [
            (frequency, row)
            for row, point in enumerate(points)
            for frequency in _marked_at(point)[what]
        ]
        if marked:
            frequencies, rows = zip(*marked, strict=True)
            axes.plot(frequencies, rows, marker, color=colour, ls="", ms=8, label=what)
    if any(point.active_bands for point in points):
        axes.plot([], [], color=SERIES_STAND_INS[0], lw=7, alpha=0.4, label="active (not passive)")
    axes.set_xscale("log")
    axes.set(
        xlabel="frequency (Hz)",
        yticks=range(len(points)),
        yticklabels=[f"{point.op.name}{_noise_words(point)}" for point in points],
        ylim=(len(points) - 0.4, -0.6),
    )
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def _marked_at(point: PointInspection) -> dict[str, list[float]]:
    return {
        "resonance": [one.frequency for one in point.resonances],
        "multiple of f0": [line.frequency for line in point.lines],
        "sticks out": list(point.outliers),
        "contradicts the others": [wrong.frequency for wrong in point.wrong_rows],
    }


def _noise_words(point: PointInspection) -> str:
    return "" if point.noise is None else f"\nnoise {100 * point.noise:.2g} %"
