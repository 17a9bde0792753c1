"""Frames with a name around the blocks of each loop, its sums with them: they go round other blocks
and other frames.
"""

from collections.abc import Mapping, Sequence
from html import escape
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from ibrid.report.block_diagrams.block_graph import SUM
from ibrid.report.block_diagrams.drawing import Layout, Point
from ibrid.report.block_diagrams.references import REFERENCE
from ibrid.structure.reading.wiring import split_port

#: Between a frame and what is in it; above it more, for the name. Two of them fit between the boxes
#: of a column.
_BESIDE, _ABOVE = 6.0, 17.0
#: Width of a character of a name.
_LETTER = 6.7
Box = tuple[float, float, float, float]  # left, top, right, bottom


class Frame(NamedTuple):
    """A piece of a loop.

    `boxes` : rectangles that it is the union of. `name` : where its name begins.
    """

    title: str
    boxes: tuple[Box, ...]
    name: Point

    @property
    def svg(self) -> tuple[str, str]:
        """The frame, to be drawn below everything else, and its name, above: what fills it hides
        the lines inside of it.
        """
        rects = "".join(
            f'<rect class="{style}" x="{x:.1f}" y="{y:.1f}" width="{right - x:.1f}" '
            f'height="{low - y:.1f}" rx="3"/>'
            for style, (x, y, right, low) in product(("edge", "inside"), self.boxes)
        )
        text = f'<text x="{self.name[0]:.1f}" y="{self.name[1]:.1f}">{escape(self.title)}</text>'
        return f'<g class="loop">{rects}</g>', f'<g class="loop">{text}</g>'


def loop_frames(drawing: Layout, loops: Mapping[str, Sequence[str]]) -> list[Frame]:
    """A frame for each loop, or several where others lie between."""
    boxes = {
        name: (x, y, x + width, y + height) for name, (x, y, width, height) in drawing.boxes.items()
    }
    inside = {
        title: [one for one in boxes if _belongs(one, members)] for title, members in loops.items()
    }
    framed = {name for names in inside.values() for name in names}
    room = {
        name: _around(box, _BESIDE if name.startswith(SUM) else _ABOVE)
        for name, box in boxes.items()
    }
    nets = range(len(drawing.placement.graph.nets))
    wires = [_hull((*a, *a), (*b, *b)) for net in nets for a, b in drawing.pieces(net)]
    pieces: list[tuple[str, list[Box], list[Box]]] = []  # name, rectangles, those it may stand in
    for title, members in loops.items():
        others = [
            room[name] if name in framed else boxes[name] for name in boxes.keys() - inside[title]
        ]
        others += [box for _, shown, _ in pieces for box in shown]
        own = {room[name]: name in members for name in inside[title]}
        for piece in _merged(own, others):
            named = [
                box
                for box in piece
                if any(_hull(box, one) == box for one, module in own.items() if module)
            ]
            if named:
                shown = [
                    box for box in piece if not any(_hull(box, one) == one != box for one in piece)
                ]
                pieces.append((title, list(dict.fromkeys(shown)), named))
    frames: list[Frame] = []
    for title, shown, named in pieces:
        width = _LETTER * len(title)
        outside = [*boxes.values(), *wires, *(box for _, other, _ in pieces for box in other)]
        name = _free_place(named, [*boxes.values(), *wires], outside, width)
        frames.append(Frame(title, tuple(shown), name))
    return frames


def _belongs(name: str, members: Sequence[str]) -> bool:
    """Whether it is one of them, or a sum or a reference in front of one."""
    end = name.removeprefix(SUM).removeprefix(REFERENCE)
    return name in members or (end != name and (split_port(end)[0] or end) in members)


def _merged(boxes: Mapping[Box, bool], others: Sequence[Box]) -> list[list[Box]]:
    """Boxes joined pairwise, the closest first, as long as nothing else comes between; one
    rectangle where that is free.
    boxes : True for a module; a sum may also be joined round a corner.
    """
    pieces = [[box] for box in boxes]
    while True:
        pairs = [
            (len(joint), sum(_hull(*joint)[2:]) - sum(_hull(*joint)[:2]), joint, one, two)
            for one, two in combinations(pieces, 2)
            for a, b in product(one, two)
            for joint in _joints(a, b)[
                : 1 if boxes.get(one[-1], True) and boxes.get(two[-1], True) else 3
            ]
            if not any(_meet(part, box) for part in joint for box in others)
        ]
        if not pairs:
            return [
                piece if any(_meet(_hull(*piece), box) for box in others) else [_hull(*piece)]
                for piece in pieces
            ]
        *_, joint, one, two = min(pairs)
        pieces = [piece for piece in pieces if piece not in (one, two)] + [[*one, *two, *joint]]


def _joints(a: Box, b: Box) -> list[tuple[Box, ...]]:
    """Rectangles that join two: all around them, or one of them led to the side of the other, as
    far up or down as it needs.
    """
    joints: list[tuple[Box, ...]] = [(_hull(a, b),)]
    for one, two in ((a, b), (b, a)):
        beside = min(one[3], two[3]) - max(one[1], two[1]) > _BESIDE
        end = two if beside else (two[0], min(one[1], two[1]), two[2], max(one[3], two[3]))
        joints.append(((min(one[0], two[2]), one[1], max(one[2], two[0]), one[3]), end))
    return joints


def _around(box: Box, above: float) -> Box:
    return box[0] - _BESIDE, box[1] - above, box[2] + _BESIDE, box[3] + _BESIDE


def _hull(*boxes: Box) -> Box:
    left, top, right, bottom = zip(*boxes, strict=True)
    return min(left), min(top), max(right), max(bottom)


def _meet(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _free_place(
    piece: Sequence[Box], inside: Sequence[Box], outside: Sequence[Box], width: float
) -> Point:
    """Below an upper edge of a frame, where no wire runs; else above a lower edge, and else beside
    the frame.

    inside, outside : what the name may not meet there.
    """
    ways = ((1, 12.5, inside), (3, -4.0, inside), (1, -4.0, outside), (3, 12.5, outside))
    upper = sorted(piece, key=lambda box: (box[1], box[0] - box[2]))
    places = (
        (x, box[edge] + below, taken)
        for edge, below, taken in ways
        for box in upper
        for x in np.arange(box[0] + 5.0, max(box[2] - width - 3.0, box[0] + 6.0), 4.0)
    )
    for x, y, taken in places:
        words = (x - 2.0, y - 10.0, x + width, y + 3.0)
        if not any(_meet(words, box) for box in taken):
            return x, y
    return upper[0][0] + 5.0, upper[0][1] + 12.5
