"""What pages add for readers whose browser runs scripts: zoom in plots over frequency, and nothing else.

Pages hold static SVG and are complete without scripts: on paper, in mail, where scripts are off. For zoom they carry a
script of their own (plot_axes.js, zoom.js; 11 kB), because what exists asks for more than it gives. plotly.js brings 1.1
MB in its smallest build and 4.7 MB in the whole one, which the Python package ships; uPlot brings 50 kB and is no Python
package. Both draw by themselves, so that for paper, for readers without scripts and for other colours every figure
would be needed twice. Zoom by CSS alone magnifies letters and axes with the curves. This script moves the curves that
are drawn and gives their axes new ticks. A content security policy admits this one script, by its SHA-256, and nothing
from a network: a name that slipped through `escape` could not run.
"""

import base64
import hashlib
import json
from functools import cache
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from ibrid.report.ticks import unit_of

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

SCRIPTS = ("plot_axes.js", "zoom.js")
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
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"


def zoom_attributes(figure: "Figure") -> str:
    """Attributes of a drawn figure's <svg> that say where its axes lie and what they show; after it was drawn.

    Both ends of logarithmic and linear scales; any other scale stays as it is. Figures over frequency are linked.
    """
    width, height = PER_INCH * figure.get_size_inches()
    unit = next((found for axes in figure.axes if (found := unit_of(axes.xaxis))), "")  # below the lowest axes alone
    found = []
    for axes in figure.axes:
        place = axes.get_position()
        box = [place.x0 * width, (1 - place.y1) * height, place.width * width, place.height * height]
        found.append(
            {
                "box": [round(one, 3) for one in box],
                "x": _side(axes.xaxis, unit),
                "y": _side(axes.yaxis, unit_of(axes.yaxis)),
            }
        )
    linked = "yes" if any(axes.get_xlabel().startswith("frequency") for axes in figure.axes) else "no"
    return f'data-link="{linked}" data-axes="{escape(json.dumps(found, separators=(",", ":")))}"'


def _side(axis: "Axis", unit: str) -> dict[str, Any]:
    scale = axis.get_scale()
    ends = [float(f"{one:.9g}") for one in axis.get_view_interval()]
    return {"scale": scale if scale in ("log", "linear") else "fixed", "ends": ends, "unit": unit}
