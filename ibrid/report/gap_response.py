"""The frequency response before and after a repair, operating point by operating point."""

from collections.abc import Sequence

from ibrid.gap.result import Gap
from ibrid.measurement.sweep import ENTRIES
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.gap_bode import draw_entry
from ibrid.report.gap_curves import PointView, comparable
from ibrid.report.legend import models_legend
from ibrid.report.markup import escape, folded, paragraph

#: Operating points whose figures are open; those of the next unfold, and beyond the last there are none.
OPEN, POINTS = 2, 6


def responses_html(gap: Gap, views: Sequence[PointView]) -> str:
    """Four figures for every operating point; the first are open."""
    shown = [_point(view, place) for place, view in enumerate(views[:POINTS])]
    more = "".join(shown[OPEN:])
    if more:
        more = folded(f"Further operating points: {', '.join(view.name for view in views[OPEN:POINTS])}", more)
    left = [view.name for view in views[POINTS:]]
    note = paragraph(f"Not drawn: {', '.join(left)}.", "note") if left else ""
    return paragraph(_explained(gap, views[0]), "note") + _legend(views) + "".join(shown[:OPEN]) + more + note


def _explained(gap: Gap, view: PointView) -> str:
    words = "Admittance per unit, current out of the inverter. Lowest panel: distance of each model from the measurement; grey: "
    if view.known:
        words += "what noise alone leaves. Bars: two standard deviations."
    else:
        words += f"{gap.noise_level:.2g} of |Y|, below which nothing is claimed, as the noise is not known."
    if not comparable(gap):
        words += " The repaired model answers in the other convention, so it has no line beside these data."
    return words


def _point(view: PointView, place: int) -> str:
    title = f"{view.name}, held out: predicted, never fitted" if view.held_out else view.name
    figures = "".join(_entry(view, place, entry) for entry in ENTRIES)
    return f'<h3>{escape(title)}</h3><div class="four">{figures}</div>'


def _entry(view: PointView, place: int, entry: str) -> str:
    models = ", ".join(line.name for line in view.lines)
    label = (
        f"Y_{entry} at {view.name}: measured, {models}; magnitude, phase, and distance from the measurement over frequency. "
        "The tables give the errors."
    )
    svg = inline_svg(
        lambda axes: draw_entry(axes, entry, view),
        name=f"gap-{place}-{entry}",
        label=label,
        size=(5.2, 5.0),
        rows=3,
        heights=(1.25, 0.95, 0.95),
        zoom=True,
    )
    return figure_html(svg, f"Y<sub>{entry}</sub>")


def _legend(views: Sequence[PointView]) -> str:
    """A circle for the measurement, a line as in the figures for each state of the model."""
    models = list(dict.fromkeys((line.name, line.index) for view in views for line in view.lines))
    return models_legend(models, views[0].lines[-1].index)
