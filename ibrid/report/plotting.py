"""`.plot(ax=)` of sweeps, inspections, diagrams, events, records, gaps, predictions and stability
studies: a figure, or lines on axes of one's own.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.collections import Collection
from matplotlib.colors import is_color_like, to_hex
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from ibrid.analysis.grids.power_jacobian import PowerJacobian
from ibrid.analysis.grids.stability import Stability
from ibrid.analysis.models.modes import QUANTILE
from ibrid.analysis.models.prediction import Prediction, predict
from ibrid.analysis.models.residuals import Residuals
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.results.gap import Gap
from ibrid.measurement.quality.inspect import Inspection
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.block_diagrams.block_diagram import LARGEST
from ibrid.report.block_diagrams.on_axes import arranged, draw_diagram
from ibrid.report.figures.bode import Curves, curves, draw_bode
from ibrid.report.figures.displayed_figure import DisplayedFigure
from ibrid.report.figures.events import draw_events
from ibrid.report.figures.gap_curves import PointView, draw_entry, point_views
from ibrid.report.figures.gap_ports import draw_missing, draw_ports
from ibrid.report.figures.inspection import draw_inspection
from ibrid.report.figures.power_jacobian import draw_nfp
from ibrid.report.figures.residuals import (
    draw_autocorrelation,
    draw_cross_correlation,
    draw_residuals,
)
from ibrid.report.figures.trajectory import Trajectory, draw_trajectory
from ibrid.report.look.style import DANGER, INK, MUTED, SERIES, SERIES_STAND_INS, series
from ibrid.report.pages.page import measured_data
from ibrid.report.pages.stability_page import draw_locus
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program

_SETTINGS: Any = {
    "axes.grid": True,
    "grid.color": "#d7dde4",
    "axes.axisbelow": True,
    "font.size": 9,
    "legend.frameon": False,
}
#: Inches of the widest drawing of a diagram, and units of the drawing in an inch of others.
WIDEST, UNITS_PER_INCH = 15.0, 90.0
#: Ports that are shown, the best ones.
PORTS = 12
#: Colours that figures draw with -> those of a white page.
_COLOURS = {INK: "#16202c", MUTED: "#56636f", DANGER: "#b3261e"} | {
    stand_in: light for stand_in, (light, _) in zip(SERIES_STAND_INS, SERIES, strict=True)
}


def sweep_plot(sweep: Sweep, ax: Any = None, entry: str = "dd") -> Any:
    """Measured dots of every operating point."""
    points = [
        Curves(point.op.name, index, point, None, None) for index, point in enumerate(sweep.points)
    ]
    return _bode(points, ax, entry)


def record_plot(record: Record, ax: Any = None, entry: str = "dd", band: bool = False) -> Any:
    """Lines of the model and, where the data are where the record says, measured dots; band: with
    the 95 % bands of `predict`.
    """
    lines = curves(record, measured_data(record, None)[0])
    return _bode([_with_band(line, record) for line in lines] if band else lines, ax, entry)


def _with_band(line: Curves, record: Record) -> Curves:
    if line.frequency is None:
        return line
    sigma = predict(record, line.name, line.frequency).sigma
    return line if sigma is None else replace(line, half_width=QUANTILE * sigma)


def together_plot(
    things: Sequence[Sweep | Record | Prediction], ax: Any = None, entry: str = "dd"
) -> Any:
    """Several sweeps, records and predictions in one Bode plot, with their names."""
    lines = [line for thing in things for line in _curves_of(thing)]
    lines = [replace(line, index=index) for index, line in enumerate(lines)]
    drawn = _bode(lines, ax, entry)
    handles = []
    for line in lines:
        colour, marker, dashes = series(line.index)
        look: Any = (
            {"linestyle": dashes}
            if line.measured is None
            else {"linestyle": "none", "marker": marker, "markerfacecolor": "none"}
        )
        handles.append(Line2D([], [], color=colour, label=line.name, **look))
    if ax is None:
        legend = drawn.legend(handles=handles, loc="outside upper left", ncols=3)
        on_white(legend)
    else:
        on_white(_two(ax, "magnitude and phase")[0].legend(handles=handles))
    return drawn


def _curves_of(thing: Sweep | Record | Prediction) -> list[Curves]:
    """The lines or dots of one thing, with names that say whose they are."""
    if isinstance(thing, Sweep):
        source = Path(thing.source).stem or "measured"
        return [
            Curves(f"{source}, {point.op.name}", 0, point, None, None) for point in thing.points
        ]
    if isinstance(thing, Prediction):
        half = None if thing.sigma is None else QUANTILE * thing.sigma
        name = f"predicted, {thing.op.name}"
        return [Curves(name, 0, None, thing.frequency, thing.admittance, half)]
    name = parse_program(thing.program).name.removeprefix("build_") or "model"
    return [replace(line, name=f"{name}, {line.name}") for line in curves(thing, None)]


def residuals_plot(residuals: Residuals) -> Any:
    """Residuals over frequency above their correlations."""
    with rc_context(_SETTINGS):
        figure = DisplayedFigure(figsize=(9, 6), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(2, 1))
        over_frequency = figure.add_subplot(grid[0, :])
        draw_residuals(over_frequency, residuals)
        draw_autocorrelation(figure.add_subplot(grid[1, 0]), residuals)
        draw_cross_correlation(figure.add_subplot(grid[1, 1]), residuals)
        handles, names = over_frequency.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=len(names))
        on_white(figure)
    return figure


def trajectory_plot(steps: Sequence[tuple[int, float | None, float | None]]) -> Any:
    """The NRMSE of every candidate of a search, and the best so far."""
    rows = np.array(steps, dtype=float).reshape(-1, 3)  # None becomes nan
    with rc_context(_SETTINGS):
        figure = DisplayedFigure(figsize=(8, 3.4), layout="constrained")
        all_valid = np.ones(len(rows), dtype=bool)
        draw_trajectory(
            [figure.subplots()], Trajectory(rows[:, 0], rows[:, 1], all_valid, rows[:, 2])
        )
        on_white(figure)
    return figure


def prediction_plot(point: Prediction, ax: Any = None, entry: str = "dd") -> Any:
    """The line and its 95 % band."""
    half_width = None if point.sigma is None else QUANTILE * point.sigma
    return _bode(
        [Curves(point.op.name, 0, None, point.frequency, point.admittance, half_width)], ax, entry
    )


def jacobian_plot(jacobian: PowerJacobian, ax: Any = None) -> Any:
    """Magnitudes (dB) of the four entries, magnitude and phase of the NFP; with ax=(magnitude,
    phase) the NFP alone.
    """
    with (
        rc_context({"axes.grid": True, "font.size": 9}),
        np.errstate(divide="ignore"),
    ):  # of zero nothing is drawn
        if ax is not None:
            draw_nfp(pair := _two(ax, "magnitude and phase"), jacobian)
            on_white(*pair)
            return ax
        figure = DisplayedFigure(figsize=(11, 6), layout="constrained")
        parts: Any = figure.subplots(2, 2, sharex=True)
        draw_nfp([parts[0, 1], parts[1, 1]], jacobian)
        for column, cause in enumerate(("angle", "voltage")):
            for row, power in enumerate("pq"):
                size = 20 * np.log10(np.abs(jacobian.matrix[:, row, column]))
                parts[column, 0].semilogx(jacobian.frequency, size, label=f"d{power}")
            parts[column, 0].set(title=f"Jacobian: over {cause}", ylabel="dB")
            parts[column, 0].legend()
        on_white(figure)
    return figure


def stability_plot(study: Stability, ax: Any = None, op: str | None = None) -> Any:
    """Poles of one operating point, the first by default, as the short-circuit ratio goes from the
    weakest to the strongest.
    """
    names = [one.op for one in study.points]
    if op is not None and op not in names:
        raise IbridError(f"the study has no operating point {op!r}; it has {', '.join(names)}")
    _require_axes(ax)
    with rc_context({"axes.grid": True}):
        figure = None if ax is not None else DisplayedFigure(figsize=(6, 4.5), layout="constrained")
        axes: Any = ax if figure is None else figure.subplots()
        draw_locus([axes], study.points[names.index(op) if op else 0])
        on_white(axes)
    return axes if figure is None else figure


def events_plot(events: Events, ax: Any = None) -> Any:
    """Voltages above currents of every record, d drawn whole and q dashed."""
    with rc_context({"axes.grid": True, "font.size": 9}):
        figure = None if ax is not None else DisplayedFigure(figsize=(8, 5), layout="constrained")
        pair: Any = (
            _two(ax, "voltage and current") if figure is None else figure.subplots(2, sharex=True)
        )
        draw_events(pair, events)
        on_white(*pair)
    return ax if figure is None else figure


def inspection_plot(inspection: Inspection, ax: Any = None) -> Any:
    """A row over frequency for each operating point, with what stands out of it."""
    _require_axes(ax)
    with rc_context(_SETTINGS):
        size = (8, 1.8 + 0.5 * len(inspection.points))
        figure = None if ax is not None else DisplayedFigure(figsize=size, layout="constrained")
        axes: Any = ax if figure is None else figure.subplots()
        draw_inspection(axes, inspection)
        on_white(axes)
    return ax if figure is None else figure


def diagram_plot(diagram: Diagram, ax: Any = None) -> Any:
    """Boxes, sums and wires, as on pages; on axes of one's own letters fit those axes."""
    _require_axes(ax)
    if not diagram.instances or len(diagram.instances) > LARGEST:
        raise IbridError(
            f"diagrams of 1 to {LARGEST} modules are drawn; found {len(diagram.instances)}"
        )
    drawing = arranged(diagram, VOCABULARY)
    if ax is not None:
        box = ax.get_window_extent()
        pixels = min(box.width / drawing.width, box.height / drawing.height)
        draw_diagram(ax, drawing, pixels * 72 / ax.figure.dpi)
        return ax
    width = min(WIDEST, drawing.width / UNITS_PER_INCH)
    scale = width / drawing.width
    figure = DisplayedFigure(figsize=(width, scale * drawing.height))
    draw_diagram(figure.add_axes((0, 0, 1, 1)), drawing, 72 * scale)
    return figure


def _require_axes(ax: Any) -> None:
    if ax is not None and not hasattr(ax, "plot"):
        raise IbridError(
            f"ax must be one axes, such as that of plt.subplots(); found {type(ax).__name__}"
        )


def gap_figure(gap: Gap, op: str | None = None, ax: Any = None, entry: str = "dd") -> Any:
    """Admittance before and after at one operating point, beside the port map and the measured
    missing transfer.

    op : operating point; the one with the worst misfit when not given. ax : (magnitude, phase) axes
    for one entry in place of a figure. Raises OperatingPointError for an unknown point, IbridError
    for other axes.
    """
    views = point_views(gap)
    shown = (
        views[0]
        if op is None
        else next(one for one in views if one.name == gap.sweep.point(op).op.name)
    )
    if ax is not None:
        return on_axes(shown.curves, ax, entry)
    with rc_context(_SETTINGS):
        figure = DisplayedFigure(figsize=(15.0 if gap.ports else 10.0, 10.0), layout="constrained")
        grid = figure.add_gridspec(
            1, 2 if gap.ports else 1, width_ratios=(1.5, 1.0) if gap.ports else None
        )
        _draw_entries(figure.add_subfigure(grid[0, 0]), shown)
        if gap.ports:
            _draw_ports(figure.add_subfigure(grid[0, 1]), gap)
        figure.suptitle(
            textwrap.fill(gap.sentence, 130 if gap.ports else 90), fontsize=11, x=0.01, ha="left"
        )
        on_white(figure)
    return figure


def _draw_entries(figure: FigureBase, shown: PointView) -> None:
    grid = figure.add_gridspec(7, 2, height_ratios=(1.2, 0.9, 0.9, 0.02, 1.2, 0.9, 0.9))
    for number, entry in enumerate(ENTRIES):
        first = 4 * (number // 2)
        top = figure.add_subplot(grid[first, number % 2])
        rest = [figure.add_subplot(grid[first + row, number % 2], sharex=top) for row in (1, 2)]
        draw_entry([top, *rest], entry, shown)
        top.set_title(f"$Y_{{{entry}}}$", fontsize=10)
        for plane in (top, rest[0]):
            plane.tick_params(labelbottom=False)
    looks: Any = [series(one.index) for one in shown.lines]
    handles = [
        Line2D([], [], color=looks[-1][0], marker="o", markerfacecolor="none", linestyle="none")
    ]
    handles += [Line2D([], [], color=colour, linestyle=dashes) for colour, _, dashes in looks]
    names = [f"measured at {shown.name}", *(one.name for one in shown.lines)]
    figure.legend(handles, names, loc="outside upper left", ncols=len(names))


def _draw_ports(figure: FigureBase, gap: Gap) -> None:
    transfer = gap.missing_transfer
    grid = figure.add_gridspec(2 if transfer else 1, 1)
    top = figure.add_subfigure(grid[0, 0])
    draw_ports([plane := top.add_subplot()], gap.ports, PORTS)
    plane.set_title("One unknown transfer at each port", fontsize=10)
    if transfer is not None:
        below = figure.add_subfigure(grid[1, 0])
        magnitude = below.add_subplot(2, 1, 1)
        draw_missing([magnitude, below.add_subplot(2, 1, 2, sharex=magnitude)], transfer)
        magnitude.tick_params(labelbottom=False)
        magnitude.set_title(f"Measured at: {transfer.fit.port.words}", fontsize=10)


def _bode(shown: Sequence[Curves], ax: Any, entry: str) -> Any:
    """Magnitude above phase of all four entries; or of one on (magnitude, phase) axes that are
    given.
    """
    _require_entry(entry)
    if ax is not None:
        return on_axes(shown, ax, entry)
    with rc_context({"axes.grid": True, "font.size": 9}):
        figure = DisplayedFigure(figsize=(11, 7), layout="constrained")
        parts = figure.subplots(
            4, 2, sharex=True, gridspec_kw={"height_ratios": (1.25, 1, 1.25, 1)}
        )
        for number, name in enumerate(ENTRIES):
            row, column = divmod(number, 2)
            pair = [parts[2 * row, column], parts[2 * row + 1, column]]
            draw_bode(pair, name, shown)
            pair[0].set_title(f"Y{name}")
        on_white(figure)
    return figure


def on_axes(shown: Sequence[Curves], ax: Any, entry: str) -> Any:
    """Magnitude and phase of one entry, on two axes that are given."""
    pair = _two(ax, "magnitude and phase")
    _require_entry(entry)
    draw_bode(pair, entry, shown)
    on_white(*pair)
    return ax


def _two(ax: Any, what: str) -> list[Any]:
    """Two axes that are given."""
    if hasattr(ax, "plot") or np.size(ax) != 2:
        raise IbridError(
            f"ax must be two axes, {what}, such as plt.subplots(2, sharex=True)[1]; found "
            f"{type(ax).__name__}"
        )
    return list(np.ravel(ax))


def on_white(*drawn: Artist) -> None:
    """Give what was drawn with stand-ins the colours of a white page."""
    painted = (Line2D, Patch, Collection, Text)
    for artist in [
        part for figure in drawn for part in figure.findobj(lambda one: isinstance(one, painted))
    ]:
        for name in ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor"):
            read, write = getattr(artist, f"get_{name}", None), getattr(artist, f"set_{name}", None)
            if read is not None and write is not None:
                paint = read()
                colours = [paint] if is_color_like(paint) else list(paint)
                if any(to_hex(one) in _COLOURS for one in colours):
                    new = [_COLOURS.get(to_hex(one), one) for one in colours]
                    write(new[0] if is_color_like(paint) else new)


def _require_entry(entry: object) -> None:
    """Raise IbridError for what is no entry of the admittance, also where all four are drawn."""
    if not (isinstance(entry, str) and entry in ENTRIES):
        raise IbridError(f"entry must be one of {', '.join(ENTRIES)}; found {entry!r:.60}")
