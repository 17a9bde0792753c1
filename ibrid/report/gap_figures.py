"""A gap as one matplotlib figure for notebooks: before and after, and where the missing transfer acts."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.collections import Collection
from matplotlib.colors import is_color_like, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from ibrid.errors import IbridError
from ibrid.gap.result import Gap
from ibrid.measurement.sweep import ENTRIES
from ibrid.report.bode import Curves, draw_bode
from ibrid.report.gap_curves import PointView, draw_entry, point_views
from ibrid.report.gap_ports import draw_missing, draw_ports
from ibrid.report.style import DANGER, INK, MUTED, SERIES, SERIES_STAND_INS, series

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

_SETTINGS: Any = {
    "axes.grid": True,
    "grid.color": "#d7dde4",
    "axes.axisbelow": True,
    "font.size": 9,
    "legend.frameon": False,
}
#: Ports that are shown, the best ones.
PORTS = 12
#: Colours that figures draw with -> those of a white page.
_COLOURS = {INK: "#16202c", MUTED: "#56636f", DANGER: "#b3261e"} | {
    stand_in: light for stand_in, (light, _) in zip(SERIES_STAND_INS, SERIES, strict=True)
}


def gap_figure(gap: Gap, op: str | None = None, ax: Any = None, entry: str = "dd") -> Any:
    """Admittance before and after at one operating point, beside the port map and the measured missing transfer.

    op : operating point; the one with the worst misfit when not given. ax : (magnitude, phase) axes for one entry in place of a
    figure. Raises OperatingPointError for an unknown point, IbridError for other axes.
    """
    views = point_views(gap)
    shown = views[0] if op is None else next(one for one in views if one.name == gap.sweep.point(op).op.name)
    if ax is not None:
        return on_axes(shown.curves, ax, entry)
    with rc_context(_SETTINGS):
        figure = Figure(figsize=(15.0 if gap.ports else 10.0, 10.0), layout="constrained")
        grid = figure.add_gridspec(1, 2 if gap.ports else 1, width_ratios=(1.5, 1.0) if gap.ports else None)
        _draw_entries(figure.add_subfigure(grid[0, 0]), shown)
        if gap.ports:
            _draw_ports(figure.add_subfigure(grid[0, 1]), gap)
        figure.suptitle(textwrap.fill(gap.sentence, 130 if gap.ports else 90), fontsize=11, x=0.01, ha="left")
        on_white(figure)
    return figure


def on_axes(shown: Sequence[Curves], ax: Any, entry: str) -> Any:
    """Magnitude and phase of one entry, on two axes that are given."""
    pair = list(getattr(ax, "flat", ax)) if not hasattr(ax, "plot") else []
    if len(pair) != 2 or entry not in ENTRIES:
        raise IbridError(
            "ax must be two axes, magnitude and phase, such as those of plt.subplots(2, sharex=True), and entry one of "
            f"{', '.join(ENTRIES)}; found {type(ax).__name__} and {entry!r}"
        )
    draw_bode(pair, entry, shown)
    for one in pair:
        on_white(one)
    return ax


def _draw_entries(figure: "FigureBase", shown: PointView) -> None:
    grid = figure.add_gridspec(7, 2, height_ratios=(1.2, 0.9, 0.9, 0.02, 1.2, 0.9, 0.9))
    for number, entry in enumerate(ENTRIES):
        first = 4 * (number // 2)
        top = figure.add_subplot(grid[first, number % 2])
        rest = [figure.add_subplot(grid[first + row, number % 2], sharex=top) for row in (1, 2)]
        draw_entry([top, *rest], entry, shown)
        top.set_title(f"$Y_{{{entry}}}$", fontsize=10)
        for plane in (top, rest[0]):
            plane.tick_params(labelbottom=False)
    dots = Line2D([], [], color=series(shown.lines[-1].index)[0], marker="o", markerfacecolor="none", linestyle="none")
    handles = [dots]
    for one in shown.lines:
        colour, _, dashes = series(one.index)
        handles.append(Line2D([], [], color=colour))
        handles[-1].set_linestyle(dashes)
    names = [f"measured at {shown.name}", *(one.name for one in shown.lines)]
    figure.legend(handles, names, loc="outside upper left", ncols=len(names))


def _draw_ports(figure: "FigureBase", gap: Gap) -> None:
    found = gap.missing_transfer
    grid = figure.add_gridspec(2 if found else 1, 1)
    top = figure.add_subfigure(grid[0, 0])
    draw_ports([plane := top.add_subplot()], gap.ports, PORTS)
    plane.set_title("One unknown transfer at each port", fontsize=10)
    if found is not None:
        below = figure.add_subfigure(grid[1, 0])
        magnitude = below.add_subplot(2, 1, 1)
        draw_missing([magnitude, below.add_subplot(2, 1, 2, sharex=magnitude)], found)
        magnitude.tick_params(labelbottom=False)
        magnitude.set_title(f"Measured at: {found.fit.port.words}", fontsize=10)


def on_white(figure: Artist) -> None:
    """Give what was drawn with stand-ins the colours of a white page."""
    for artist in figure.findobj(lambda one: isinstance(one, Line2D | Patch | Collection | Text)):
        for name in ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor"):
            read, write = getattr(artist, f"get_{name}", None), getattr(artist, f"set_{name}", None)
            if read is not None and write is not None:
                found = read()
                colours = [found] if is_color_like(found) else list(found)
                if any(to_hex(one) in _COLOURS for one in colours):
                    new = [_COLOURS.get(to_hex(one), one) for one in colours]
                    write(new[0] if is_color_like(found) else new)
