"""From a function that draws on matplotlib axes to SVG inside a page, in the colours of the page's
style sheet.
"""

import base64
import hashlib
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ibrid.lazy import MATPLOTLIB, without_settings
from ibrid.report.look.style import (
    INK,
    MUTED,
    RULE,
    STAND_INS,
    draw_minor_grid,
    plain_decades,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

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
#: Deviation, in units of 1/72 inch, that a simplified line may have; less where one can look
#: closely.
SIMPLIFIED, SIMPLIFIED_ZOOM = 0.3, 0.02
#: Inches left, right, below and above the axes of a figure; and between stacked axes.
MARGINS, BETWEEN = (0.78, 0.16, 0.5, 0.1), 0.12


def load_drawing() -> None:
    """Import matplotlib without what a file in the working folder says of figures."""
    with without_settings(MATPLOTLIB):
        import matplotlib  # noqa: F401


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

    size : inches. label : for screen readers. zoom : whether readers may enlarge parts of it, where
    scripts run.
    left : inches left of the axes, more where their labels are words.
    """
    (drawn,) = inline_svgs(
        {name: (label, draw)}, size=size, rows=rows, heights=heights, zoom=zoom, left=left
    )
    return drawn


def inline_svgs(
    drawings: Mapping[str, tuple[str, Callable[[Sequence["Axes"]], None]]],
    *,
    size: tuple[float, float],
    rows: int = 1,
    heights: Sequence[float] | None = None,
    zoom: bool = False,
    left: float = MARGINS[0],
) -> list[Markup]:
    """As `inline_svg`, of several of one kind: name -> (label, draw). The axes are made once, half
    the time of a figure.
    """
    from matplotlib import rc_context, rcdefaults, rcParams
    from matplotlib.figure import Figure

    pictures: list[Markup] = []
    with rc_context():
        rcdefaults()  # a page is the same whatever the reader's own figures look like
        rcParams.update(_SETTINGS)
        rcParams["path.simplify_threshold"] = SIMPLIFIED_ZOOM if zoom else SIMPLIFIED
        figure = Figure(figsize=size)
        axes = figure.subplots(
            rows, 1, sharex=True, squeeze=False, gridspec_kw=_grid(size, rows, heights, left)
        )
        for name, (label, draw) in drawings.items():
            if pictures:
                _empty(figure)
            draw(list(axes[:, 0]))
            plain_decades(*(axis for plane in figure.axes for axis in (plane.xaxis, plane.yaxis)))
            named = [_name_curves(plane, number) for number, plane in enumerate(figure.axes)]
            for plane in figure.axes:
                draw_minor_grid(plane)
            buffer = io.StringIO()
            figure.savefig(
                buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
            )
            attributes = f'role="img" aria-label="{escape(label)}"' + (
                f" {zoom_attributes(figure, named)}" if zoom else ""
            )
            pictures.append(_for_page(buffer.getvalue(), name, attributes))
    return pictures


def _empty(figure: "Figure") -> None:
    for plane in figure.axes:
        for artist in (*plane.lines, *plane.collections, *plane.patches, *plane.texts):
            artist.remove()
        plane.set(xscale="linear", yscale="linear")
        plane.set_prop_cycle(None)
        plane.relim()
        plane.autoscale()


def _grid(
    size: tuple[float, float], rows: int, heights: Sequence[float] | None, left: float
) -> dict[str, Any]:
    """Margins that hold the labels of these figures; to measure every label would take as long as
    to draw it.
    """
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
    """Only the drawing, with its own identifiers, no name spaces, short numbers, and the style
    sheet's colours and font.
    """
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<style.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'(style="[^"]*?) font-family: [^;"]*;', r"\1", text)
    text = re.sub(
        r'\b(d|x|y)="[-\s\dA-Z.z]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), text
    )
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'(id|href)="(#?)([^"]+)"', rf'\1="\2{name}-\3"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    for stand_in, variable in STAND_INS.items():
        text = text.replace(stand_in, variable)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    return Markup(text.replace("<svg", f"<svg {attributes}", 1))


def _name_curves(plane: "Axes", number: int) -> list[tuple[str, str]]:
    """Give each curve with a label an id, by which its values can be read; (end of the id, label).

    number : of the axes in their figure.
    """
    from matplotlib.container import ErrorbarContainer

    shown = [(line, str(line.get_label())) for line in plane.lines]
    with_bars = [one for one in plane.containers if isinstance(one, ErrorbarContainer)]
    shown += [(one.lines[0], str(one.get_label())) for one in with_bars if one.lines[0]]
    labelled = [(line, label) for line, label in shown if label and label[0] != "_"]
    named = []
    for index, (line, label) in enumerate(labelled):
        end = f"curve-{number}-{index}"
        line.set_gid(end)
        named.append((end, label))
    return named


SCRIPTS = ("plot_axes.js", "readout.js", "zoom.js", "units.js", "diagram_zoom.js")
#: Units of an SVG drawing per inch.
PER_INCH = 72.0


@cache
def script() -> str:
    """The text of the script."""
    return "".join((files("ibrid.report") / name).read_text(encoding="utf-8") for name in SCRIPTS)


@cache
def content_policy() -> str:
    """The content security policy of a page: its own styles, the one script, no network."""
    digest = base64.b64encode(hashlib.sha256(script().encode()).digest()).decode()
    return (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src "
        f"'sha256-{digest}'"
    )


def zoom_attributes(figure: "Figure", named: Sequence[Sequence[tuple[str, str]]]) -> str:
    """Attributes of a drawn figure's <svg> that say where its axes lie and what they show; after it
    was drawn.

    Both ends of logarithmic and linear scales; any other scale stays as it is. Figures over
    frequency are linked. named : for each of the axes, (end of the id, name) of its curves.
    """
    width, height = PER_INCH * figure.get_size_inches()
    unit = next(
        filter(None, (unit_of(axes.xaxis) for axes in figure.axes)), ""
    )  # below the lowest axes alone
    views = []
    for axes, curves in zip(figure.axes, named, strict=True):
        place = axes.get_position()
        box = [
            place.x0 * width,
            (1 - place.y1) * height,
            place.width * width,
            place.height * height,
        ]
        views.append(
            {
                "box": [round(one, 3) for one in box],
                "x": _side(axes.xaxis, unit),
                "y": _side(axes.yaxis, unit_of(axes.yaxis)),
                "curves": curves,
            }
        )
    linked = (
        "yes" if any(axes.get_xlabel().startswith("frequency") for axes in figure.axes) else "no"
    )
    return f'data-link="{linked}" data-axes="{escape(json.dumps(views, separators=(",", ":")))}"'


def _side(axis: "Axis", unit: str) -> dict[str, Any]:
    scale = axis.get_scale()
    ends = [float(f"{one:.9g}") for one in axis.get_view_interval()]
    return {"scale": scale if scale in ("log", "linear") else "fixed", "ends": ends, "unit": unit}
