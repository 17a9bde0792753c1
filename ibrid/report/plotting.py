"""`.plot(ax=)` of sweeps, events, records, predictions and stability studies: a figure, or lines on axes of one's own."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from ibrid.analysis.modes import QUANTILE
from ibrid.analysis.power_jacobian import PowerJacobian
from ibrid.analysis.prediction import Prediction
from ibrid.analysis.stability import Stability
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.events import Events
from ibrid.measurement.sweep import ENTRIES, Sweep
from ibrid.report.bode import Curves, curves, draw_bode
from ibrid.report.gap_figures import on_axes, on_white
from ibrid.report.page import measured_data
from ibrid.report.stability_page import draw_locus
from ibrid.report.style import series


def sweep_plot(sweep: Sweep, ax: Any = None, entry: str = "dd") -> Any:
    """Measured dots of every operating point."""
    points = [Curves(point.op.name, index, point, None, None) for index, point in enumerate(sweep.points)]
    return _bode(points, ax, entry)


def record_plot(record: Record, ax: Any = None, entry: str = "dd") -> Any:
    """Lines of the model and, where the data are where the record says, measured dots."""
    return _bode(curves(record, measured_data(record, None)[0]), ax, entry)


def prediction_plot(point: Prediction, ax: Any = None, entry: str = "dd") -> Any:
    """The line and its 95 % band."""
    half_width = None if point.sigma is None else QUANTILE * point.sigma
    return _bode([Curves(point.op.name, 0, None, point.frequency, point.admittance, half_width)], ax, entry)


def jacobian_plot(found: PowerJacobian, ax: Any = None) -> Any:
    """Magnitudes (dB) of the four entries, magnitude and phase of the NFP; with ax=(magnitude, phase) the NFP alone."""
    with rc_context({"axes.grid": True, "font.size": 9}):
        if ax is not None:
            pair = list(getattr(ax, "flat", ax))
            _nfp(pair, found)
            for one in pair:
                on_white(one)
            return ax
        figure = Figure(figsize=(11, 6), layout="constrained")
        parts: Any = figure.subplots(2, 2, sharex=True)
        _nfp([parts[0, 1], parts[1, 1]], found)
        for column, cause in enumerate(("angle", "voltage")):
            for row, power in enumerate("pq"):
                size = 20 * np.log10(np.abs(found.matrix[:, row, column]))
                parts[column, 0].semilogx(found.frequency, size, label=f"d{power}")
            parts[column, 0].set(title=f"Jacobian: over {cause}", ylabel="dB")
            parts[column, 0].legend()
        on_white(figure)
    return figure


def _nfp(pair: Sequence[Any], found: PowerJacobian) -> None:
    magnitude, phase = pair
    magnitude.semilogx(found.frequency, 20 * np.log10(np.abs(found.nfp)))
    magnitude.set(title="NFP: dp over df", ylabel="dB")
    phase.semilogx(found.frequency, np.degrees(np.unwrap(np.angle(found.nfp))))
    phase.set(ylabel="degrees", xlabel="Hz")


def stability_plot(study: Stability, ax: Any = None, op: str | None = None) -> Any:
    """Poles of one operating point, the first by default, as the short-circuit ratio goes from the weakest to the strongest."""
    names = [one.op for one in study.points]
    if op is not None and op not in names:
        raise IbridError(f"the study has no operating point {op!r}; it has {', '.join(names)}")
    if ax is not None and not hasattr(ax, "plot"):
        raise IbridError(f"ax must be one axes, such as that of plt.subplots(); found {type(ax).__name__}")
    chosen = study.points[names.index(op) if op else 0]
    with rc_context({"axes.grid": True}):
        figure = None if ax is not None else Figure(figsize=(6, 4.5), layout="constrained")
        axes: Any = ax if figure is None else figure.subplots()
        draw_locus([axes], chosen)
        on_white(axes)
    return axes if figure is None else figure


def events_plot(events: Events, ax: Any = None) -> Any:
    """Voltages above currents of every record, d drawn whole and q dashed."""
    if ax is not None and (hasattr(ax, "plot") or np.size(ax) != 2):
        raise IbridError(
            f"ax must be two axes, voltage and current, such as those of plt.subplots(2, sharex=True); found {type(ax).__name__}"
        )
    with rc_context({"axes.grid": True, "font.size": 9}):
        figure = None if ax is not None else Figure(figsize=(8, 5), layout="constrained")
        pair: Any = ax if figure is None else figure.subplots(2, sharex=True)
        for axes, letter in zip(getattr(pair, "flat", pair), "vi", strict=True):
            for index, record in enumerate(events.records):
                for component, dashes in enumerate(("-", "--")):
                    label = f"{record.name} {letter}_{'dq'[component]}"
                    values = getattr(record, letter)[:, component]
                    axes.plot(record.time, values, dashes, color=series(index)[0], label=label, linewidth=1)
            axes.set_ylabel(f"{letter}, per unit")
            axes.legend(fontsize=8)
            on_white(axes)
        axes.set_xlabel("time, s")
    return ax if figure is None else figure


def _bode(shown: Sequence[Curves], ax: Any, entry: str) -> Any:
    """Magnitude above phase of all four entries; or of one on (magnitude, phase) axes that are given."""
    if ax is not None:
        return on_axes(shown, ax, entry)
    with rc_context({"axes.grid": True, "font.size": 9}):
        figure = Figure(figsize=(11, 7), layout="constrained")
        parts = figure.subplots(4, 2, sharex=True, gridspec_kw={"height_ratios": (1.25, 1, 1.25, 1)})
        for number, name in enumerate(ENTRIES):
            row, column = divmod(number, 2)
            pair = [parts[2 * row, column], parts[2 * row + 1, column]]
            draw_bode(pair, name, shown)
            pair[0].set_title(f"Y{name}")
        on_white(figure)
    return figure
