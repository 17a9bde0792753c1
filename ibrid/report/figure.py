"""From a function that draws on matplotlib axes to SVG inside a page, in the colours of the page's style sheet."""

import io
import re
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ibrid.report.style import INK, MUTED, RULE, STAND_INS
from ibrid.report.ticks import plain_decades
from ibrid.report.zoom import zoom_attributes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SETTINGS: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "ibrid",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.edgecolor": RULE,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.frameon": False,
}
#: Deviation, in units of 1/72 inch, that a simplified line may have; less where one can look closely.
SIMPLIFIED, SIMPLIFIED_ZOOM = 0.3, 0.02
#: Inches left, right, below and above the axes of a figure; and between stacked axes.
MARGINS, BETWEEN = (0.78, 0.16, 0.5, 0.1), 0.12


def inline_svg(
    draw: Callable[[Sequence["Axes"]], None],
    *,
    name: str,
    label: str,
    size: tuple[float, float],
    rows: int = 1,
    heights: Sequence[float] | None = None,
    zoom: bool = False,
    left: float = MARGINS[0],
) -> Markup:
    """SVG of what `draw` puts on stacked axes with a common x axis.

    size : inches. label : for screen readers. zoom : whether readers may enlarge parts of it, where scripts run.
    left : inches left of the axes, more where their labels are words.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    settings = {**_SETTINGS, "path.simplify_threshold": SIMPLIFIED_ZOOM if zoom else SIMPLIFIED}
    with rc_context(settings):
        figure = Figure(figsize=size)
        axes = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw=_grid(size, rows, heights, left))
        draw(list(axes[:, 0]))
        plain_decades(*(axis for plane in figure.axes for axis in (plane.xaxis, plane.yaxis)))
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    attributes = f'role="img" aria-label="{escape(label)}"' + (f" {zoom_attributes(figure)}" if zoom else "")
    return _for_page(buffer.getvalue(), name, attributes)


def _grid(size: tuple[float, float], rows: int, heights: Sequence[float] | None, left: float) -> dict[str, Any]:
    """Margins that hold the labels of these figures; to measure every label would take as long as to draw it."""
    width, height = size
    _, right, bottom, top = MARGINS
    plot = (height - bottom - top - (rows - 1) * BETWEEN) / rows
    return {
        "left": left / width,
        "right": 1 - right / width,
        "bottom": bottom / height,
        "top": 1 - top / height,
        "hspace": BETWEEN / plot,
        "height_ratios": heights,
    }


def _for_page(text: str, name: str, attributes: str) -> Markup:
    """Only the drawing, with its own identifiers, no name spaces, short numbers, and the style sheet's colours and font."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<style.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'(style="[^"]*?) font-family: [^;"]*;', r"\1", text)
    text = re.sub(r'\b(d|x|y)="[-\s\dA-Z.z]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), text)
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'(id|href)="(#?)([^"]+)"', rf'\1="\2{name}-\3"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    for stand_in, variable in STAND_INS.items():
        text = text.replace(stand_in, variable)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    return Markup(text.replace("<svg", f"<svg {attributes}", 1))
