"""The look that all pages share: colours for light, dark and paper, and the style sheet."""

import math
import re
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ibrid.report.look.numbers import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.typing import LineStyleType
else:  # matplotlib is imported when something is drawn
    Axes = Axis = LineStyleType = Any

#: Light and dark colour per operating point; markers and dashes tell them apart on paper and for
#: colour-blind readers.
SERIES = (
    ("#0064b4", "#6db3f2"),
    ("#c2490c", "#f5935a"),
    ("#0a7d5a", "#4fc79c"),
    ("#8a3ea8", "#cf94ea"),
    ("#8a6500", "#d9b445"),
    ("#b5265e", "#f27fa8"),
)
MARKERS = ("o", "s", "^", "D", "v", "P")
#: The markers in a legend, 34 by 14.
SHAPES = {
    "o": '<circle cx="17" cy="7" r="4"/>',
    "s": '<rect x="13" y="3" width="8" height="8"/>',
    "^": '<path d="M17 2.5l4.6 8h-9.2z"/>',
    "D": '<path d="M17 2l5 5-5 5-5-5z"/>',
    "v": '<path d="M17 11.5l-4.6-8h9.2z"/>',
    "P": '<path d="M15.5 2.5h3v3h3v3h-3v3h-3v-3h-3v-3h3z"/>',
}
DASHES: tuple[LineStyleType, ...] = (
    "-",
    (0, (6, 2)),
    (0, (2, 1.4)),
    (0, (7, 2, 1.5, 2)),
    (0, (4, 1.5)),
    (0, (1, 1)),
)

#: Stand-ins that figures draw with; `figure.inline_svg` replaces them by the variables of the style
#: sheet.
INK, MUTED, RULE, DANGER = "#010203", "#020304", "#030405", "#040506"
STAND_INS = {INK: "var(--ink)", MUTED: "var(--muted)", RULE: "var(--rule)", DANGER: "var(--danger)"}
#: Of the page behind a figure, where a part of it covers another; notebooks have their own.
PAGE = "#040607"
STAND_INS |= {PAGE: "var(--page,canvas)"}
SERIES_STAND_INS = tuple(f"#0506{index:02x}" for index in range(len(SERIES)))
STAND_INS |= {stand_in: f"var(--series-{index})" for index, stand_in in enumerate(SERIES_STAND_INS)}


def series(index: int) -> tuple[str, str, LineStyleType]:
    """Colour stand-in, marker and dash pattern of the operating point number `index`."""
    turn = index % len(SERIES)
    return SERIES_STAND_INS[turn], MARKERS[turn], DASHES[turn]


class SeriesLine(NamedTuple):
    """How a legend draws a line: number of its colour, marker, and dash pattern of an SVG path, ""
    for a whole line.
    """

    colour: int
    marker: str
    dashes: str


def series_line(index: int) -> SeriesLine:
    """The look of operating point or model number `index` in a legend."""
    turn = index % len(SERIES)
    dashes = DASHES[turn]
    pattern = (
        "" if isinstance(dashes, str) else " ".join(f"{1.5 * length:g}" for length in dashes[1])
    )
    return SeriesLine(turn, MARKERS[turn], pattern)


def heat(error: float | None) -> str:
    """Background for a relative error: none up to 1e-4, full at 1, in between on a logarithmic
    scale.
    """
    if error is None or error <= 1e-4:
        return ""
    depth = min(1.0, math.log10(error / 1e-4) / 4)
    return f"background:rgba(214,84,32,{0.06 + 0.54 * depth**1.5:.2f})"


def _variables(which: int, rest: str) -> str:
    return rest + "".join(f"--series-{index}:{pair[which]};" for index, pair in enumerate(SERIES))


_LIGHT = _variables(
    0,
    "color-scheme:light;--page:#ffffff;--panel:#f5f7fa;--ink:#16202c;--muted:#56636f;--rule:#cfd6de;--danger:#b3261e;"
    "--good:#0a7d5a;--link:#0058a8;--plant:#fbe3cf;--control:#dbe8f8;--sync:#eadcf5;--frame:#d9efe4;--static:#eceff2;"
    "--branch:#f6eebb;--residual:#f8dada;--unknown:#fff3c4;--edge:#3e4c5a;--shade:rgba(22,32,44,.28);",
)
_DARK = _variables(
    1,
    "color-scheme:dark;--page:#12171d;--panel:#1b222a;--ink:#e6ebf0;--muted:#a3afba;--rule:#3b4651;--danger:#ff8a80;"
    "--good:#4fc79c;--link:#7cbcf5;--plant:#5a3a1e;--control:#22405f;--sync:#46305c;--frame:#1f4a3a;--static:#2d353e;"
    "--branch:#4d4a1c;--residual:#5e2c2c;--unknown:#5a4d17;--edge:#b9c4ce;--shade:rgba(230,235,240,.3);",
)


def style_sheet() -> str:
    """The whole style sheet: colours, then page.css."""
    colours = (
        f":root{{{_LIGHT}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{_DARK}}}}}\n"
    )
    return colours + _rules()


#: Where notebooks say that their page is dark.
DARK_NOTEBOOKS = ('[data-jp-theme-light="false"]', '[data-vscode-theme-kind="vscode-dark"]')
_NOTEBOOK = (
    "background:var(--page);color:var(--ink);padding:.2rem .9rem .6rem;border-radius:.4rem;"
    "font:15px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;"
    "h1{font-size:1.25rem}header{padding:0}thead "
    "th{vertical-align:bottom}table{table-layout:auto;margin-left:0}"
)


def notebook_style_sheet() -> str:
    """The same for an output of a notebook: for what lies in `.ibrid` alone, dark where the
    notebook is.
    """
    screen = _rules().partition("@media print")[0]
    dark = ",".join(f"{where} .ibrid" for where in DARK_NOTEBOOKS)
    return f".ibrid{{{_LIGHT}}}\n{dark}{{{_DARK}}}\n.ibrid.ibrid{{{screen}{_NOTEBOOK}}}"


def _rules() -> str:
    return (files("ibrid.report") / "page.css").read_text(encoding="utf-8")


#: Ratio of the ends up to which a scale gets numbers between its decades: at 2 and 5, and at all of
#: them.
SOME, ALL = 30.0, 3.0


def plain_decades(*drawn: Axis) -> None:
    """Write the ticks of logarithmic axes as numbers, not powers of ten, which are slow to set and
    hard to read.

    Between decades there are ticks only where fewer than two decades are shown: without a number
    they say little, and they take a third of the time of a figure.
    """
    from matplotlib.ticker import FuncFormatter, NullLocator

    for axis in drawn:
        if axis.get_scale() in ("log", "symlog"):
            axis.set_major_formatter(FuncFormatter(lambda value, _: _written(value)))
            low, high = axis.get_view_interval()
            if axis.get_scale() == "log" and low > 0 and high < SOME * low:
                leading = "123456789" if high < ALL * low else "25"
                axis.set_minor_formatter(
                    FuncFormatter(
                        lambda value, _, kept=leading: (
                            _written(value) if f"{value:e}"[0] in kept else ""
                        )
                    )
                )
            else:
                axis.set_minor_locator(NullLocator())


#: Units of 1/72 inch that a decade needs for lines at 2 to 9, and at 2 and 5 alone.
ROOM, LITTLE_ROOM = 45.0, 18.0


def draw_minor_grid(plane: Axes) -> None:
    """Draw faint lines between the decades of logarithmic axes, as on logarithmic paper.

    One path for each axis; it keeps the limits, and is drawn after everything else is.
    """
    from matplotlib.lines import Line2D

    place, figure = plane.get_position(), plane.get_figure(root=True)
    if figure is None:
        return
    width, height = (72.0 * length for length in figure.get_size_inches())
    sides = (
        (plane.xaxis, width * place.width, plane.get_xaxis_transform()),
        (plane.yaxis, height * place.height, plane.get_yaxis_transform()),
    )
    for axis, length, across in sides:
        places = _between_decades(axis, length)
        if not places:
            continue
        along, ends = np.repeat(places, 3), np.tile([0.0, 1.0, np.nan], len(places))
        line = along, ends
        x, y = line if axis is plane.xaxis else line[::-1]
        look = {"color": RULE, "linewidth": 0.5, "alpha": 0.55, "zorder": 0.4}
        plane.add_artist(Line2D(x, y, transform=across, **look))


def _between_decades(axis: Axis, length: float) -> list[float]:
    """Where lines between the decades go; none where they would be too close."""
    low, high = axis.get_view_interval()
    if axis.get_scale() != "log" or not 0 < low < high:
        return []
    room = length / math.log10(high / low)
    leading = range(2, 10) if room >= ROOM else (2, 5) if room >= LITTLE_ROOM else ()
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)))
    places = [digit * 10.0**decade for decade in decades for digit in leading]
    return [place for place in places if low < place < high]


def unit_of(axis: Axis) -> str:
    """What stands in brackets at the end of an axis's label, "" where nothing does."""
    found = re.search(r"\(([^()]*)\)$", axis.get_label_text())
    return found[1] if found else ""


def _written(value: float) -> str:
    return number(value).replace("-", "−", 1) if value < 0 else number(value)
