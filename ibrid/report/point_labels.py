"""Labels beside points of a figure, placed so that they cover neither each other nor the curve."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ibrid.report.style import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Size of the letters in points; a character and a line are generous because the reader's font is not known.
SIZE = 9.0
CHARACTER, LINE = 4.9, 12.0
#: Characters of a label at most.
LONGEST = 48
#: Places that are tried: points to the right, or with a minus to the left, and lines up.
RIGHT = (10, 24, 45, 80, 130, 190, -10, -24, -45, -80)
UP = (0, 1, 2, 3, -1, 4, 5, -2, 6, 8, 10, 12, -3)

#: Points of detour that a place on the left, under a falling curve, is worth: what is not the best lies on the right.
AWAY = 40

Box = tuple[float, float, float, float]
Line = tuple[float, float, float, float]


def label_points(plane: "Axes", points: Sequence[tuple[float, float, str]], curve: Sequence[Line]) -> None:
    """Put a label beside each of `points` (x, y, words in data coordinates), in their order, with a line that leads to it.

    `curve` : straight pieces in data coordinates that no label may cover, best of a line that falls to the right. A point
    that finds no place gets no label.
    """
    from matplotlib.figure import Figure

    figure = plane.figure
    if not points or not isinstance(figure, Figure):
        return
    figure.draw_without_rendering()  # settles the layout, so that places are known
    scale = 72.0 / figure.dpi
    width, height = (scale * one for one in plane.get_window_extent().size)

    def place(x: float, y: float) -> tuple[float, float]:
        across, down = plane.transAxes.inverted().transform(plane.transData.transform((x, y)))
        return float(across) * width, float(down) * height

    lines: list[Line] = [(*place(a, b), *place(c, d)) for a, b, c, d in curve]
    boxes: list[Box] = []
    for x, y, words in points:
        at, text = place(x, y), _shortened(words)
        found = _free_place(at, text, boxes, lines, (width, height))
        if found is None:
            continue
        box, lead = found
        boxes.append(box)
        lines.append(lead)
        side = 0 if lead[2] > at[0] else 2  # the end of the label that looks at its point
        plane.annotate(text, (x, y), (box[side] - at[0], (box[1] + box[3]) / 2 - at[1]), textcoords="offset points",
                       ha=("left", "", "right")[side], fontsize=SIZE, color=INK, va="center", annotation_clip=False,
                       arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 2,
                                   "relpos": (side / 2, 0.5)}, parse_math=False).set_in_layout(False)  # fmt: skip


def _shortened(words: str) -> str:
    """At most `LONGEST` characters, of those that the font of the layout knows."""
    words = "".join(one if one.isprintable() and (ord(one) < 0x250 or one in "–…→") else "?" for one in words)
    return words if len(words) <= LONGEST else words[: LONGEST - 1].rstrip() + "…"


def _free_place(
    at: tuple[float, float], text: str, boxes: Sequence[Box], lines: Sequence[Line], size: tuple[float, float]
) -> tuple[Box, Line] | None:
    """The nearest place beside a point for a label, and the line that leads to it."""
    long = CHARACTER * len(text) + 4
    offsets = [(dx, LINE * dy) for dx in RIGHT for dy in UP if dx < 0 or dy]  # level to the right is the curve
    for dx, dy in sorted(offsets, key=lambda one: math.hypot(one[0], 1.6 * one[1]) + (AWAY if one[0] > 0 else 0)):
        x, y = at[0] + dx, at[1] + dy
        left = x if dx > 0 else x - long
        box = (left, y - LINE / 2, left + long, y + LINE / 2)
        lead = (at[0] + math.copysign(3, dx), at[1] + math.copysign(min(3.0, abs(dy)), dy), x - math.copysign(1, dx), y)
        if box[0] < 0 or box[2] > size[0] or box[1] < 0 or box[3] > size[1]:
            continue
        if any(_overlap(box, other) or _meets(lead, other) for other in boxes):
            continue
        if any(_meets(line, box) for line in lines) or any(_cross(lead, line) for line in lines):
            continue
        return box, lead
    return None


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _meets(line: Line, box: Box) -> bool:
    """Whether a line has a point in a box: it begins or ends there, or crosses a side."""
    left, low, right, high = box
    if any(left <= x <= right and low <= y <= high for x, y in (line[:2], line[2:])):
        return True
    sides = ((left, low, right, low), (left, high, right, high), (left, low, left, high), (right, low, right, high))
    return any(_cross(line, side) for side in sides)


def _cross(one: Line, other: Line) -> bool:
    """Whether two pieces of straight line have a point in common, other than by touching."""

    def side(line: Line, x: float, y: float) -> float:
        return (line[2] - line[0]) * (y - line[1]) - (line[3] - line[1]) * (x - line[0])

    return side(one, *other[:2]) * side(one, *other[2:]) < 0 and side(other, *one[:2]) * side(other, *one[2:]) < 0
