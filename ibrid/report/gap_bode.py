"""One entry of the admittance before and after a repair: magnitude, phase, and the distance of each model from the data."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ibrid.measurement.sweep import ENTRIES
from ibrid.report.bode import draw_bode
from ibrid.report.gap_curves import PointView
from ibrid.report.style import MUTED, series
from ibrid.report.ticks import plain_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: The distance axis reaches at most this part below the least noise; what is smaller is drawn at its end.
DEEPEST = 0.03


def draw_entry(axes: Sequence["Axes"], entry: str, shown: PointView) -> None:
    """Three axes: magnitude (per unit), phase (degrees), distance |Y model - Y measured| (per unit) over the noise."""
    *bode, distance = axes
    draw_bode(bode, entry, shown.curves)
    bode[-1].set_xlabel("")
    place = (slice(None), *ENTRIES[entry])
    frequency, floor = shown.point.frequency, shown.noise[place]
    away = [np.abs(line.at_data[place] - shown.point.admittance[place]) for line in shown.lines]
    low = max(min(float(one.min()) for one in [*away, floor]), DEEPEST * float(floor.min())) / 1.5
    high = 2.0 * max(float(one.max()) for one in [*away, floor])
    distance.fill_between(frequency, floor, low, color=MUTED, alpha=0.22, linewidth=0, gid=f"noise-{entry}")
    for line, size in zip(shown.lines, away, strict=True):
        colour, marker, dashes = series(line.index)
        look: dict[str, Any] = {"color": colour, "linestyle": dashes, "marker": marker, "markersize": 3.0}
        distance.plot(frequency, np.maximum(size, low), linewidth=1.1, **look)
    distance.set_yscale("log")
    distance.set_ylim(low, high)
    distance.set_ylabel("distance  (pu)")
    distance.set_xlabel("frequency  (Hz)")
    plain_decades(bode[0].yaxis, distance.yaxis, distance.xaxis)
