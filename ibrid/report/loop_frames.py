"""Frames with a name around the blocks of each loop, its sums with them: they go round other blocks and other frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from ibrid.report.block_graph import SUM
from ibrid.report.drawing import Layout, Point
from ibrid.structure.wiring import split_port

#: Between a frame and what is in it; above it more, for the name. Two of them fit between the boxes of a column.
_BESIDE, _ABOVE, _ROUND = 6.0, 17.0, 7.0
#: Width of a character of a name, and its height.
_LETTER, _LINE = 6.7, 12.0
Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass(frozen=True)
class Frame:
    """A piece of a loop. `boxes` : rectangles that it is the union of. `name` : where its name begins."""

    title: str
    boxes: tuple[Box, ...]
    name: Point

    @property
    def svg(self) -> tuple[str, str]:
        """The frame, to be drawn below everything else, and its name, above."""
        path = "".join(map(_rounded, _outlines(self.boxes)))
        x, y = self.name
        text = f'<text x="{x:.1f}" y="{y:.1f}">{escape(self.title)}</text>'
        return f'<g class="loop"><path d="{path}"/></g>', f'<g class="loop">{text}</g>'


def loop_frames(drawing: Layout, found: Mapping[str, Sequence[str]]) -> list[Frame]:
    """A frame for each loop, or several where others lie between."""
    boxes = {name: (x, y, x + width, y + height) for name, (x, y, width, height) in drawing.boxes.items()}
    inside = {title: [one for one in boxes if _belongs(one, members)] for title, members in found.items()}
    framed = {name for names in inside.values() for name in names}
    wires = [piece for index in range(len(drawing.placement.graph.nets)) for piece in drawing.pieces(index)]
    frames: list[Frame] = []
    for title, members in found.items():
        others = [_around(boxes[name], name) if name in framed else boxes[name] for name in boxes.keys() - inside[title]]
        others += [box for frame in frames for box in frame.boxes]
        own = {_around(boxes[name], name): name in members for name in inside[title]}
        for piece in _merged(own, others):
            named = [box for box in piece if any(_hull(box, one) == box for one, module in own.items() if module)]
            if named:
                frames.append(Frame(title, tuple(piece), _free_place(named, wires, _LETTER * len(title))))
    return frames


def _belongs(name: str, members: Sequence[str]) -> bool:
    """Whether it is one of them or a sum in front of one."""
    return name in members or (name.startswith(SUM) and split_port(name.removeprefix(SUM))[0] in members)


def _merged(boxes: Mapping[Box, bool], others: Sequence[Box]) -> list[list[Box]]:
    """Boxes joined pairwise, the closest first, as long as nothing else comes between; one rectangle where that is free.
    boxes : True for a module; a sum may also be joined round a corner."""
    pieces = [[box] for box in boxes]
    while True:
        pairs = [
            (joint, one, two)
            for k, one in enumerate(pieces)
            for two in pieces[k + 1 :]
            for a in one
            for b in two
            for joint in _joints(a, b)[: 1 if boxes.get(one[-1], True) and boxes.get(two[-1], True) else 3]
            if not any(_meet(part, box) for part in joint for box in others)
        ]
        if not pairs:
            wholes = [(_hull(*piece), piece) for piece in pieces]
            return [piece if any(_meet(whole, box) for box in others) else [whole] for whole, piece in wholes]
        joint, one, two = min(pairs, key=lambda found: (len(found[0]), _half_way_round(_hull(*found[0]))))
        pieces = [piece for piece in pieces if piece not in (one, two)] + [[*one, *two, *joint]]


def _joints(a: Box, b: Box) -> list[tuple[Box, ...]]:
    """Rectangles that join two: all around them, or one of them led to the side of the other, as far up or down as it needs."""
    found: list[tuple[Box, ...]] = [(_hull(a, b),)]
    for one, two in ((a, b), (b, a)):
        beside = min(one[3], two[3]) - max(one[1], two[1]) > _ROUND
        end = two if beside else (two[0], min(one[1], two[1]), two[2], max(one[3], two[3]))
        found.append(((min(one[0], two[2]), one[1], max(one[2], two[0]), one[3]), end))
    return found


def _half_way_round(box: Box) -> float:
    return box[2] - box[0] + box[3] - box[1]


def _around(box: Box, name: str) -> Box:
    """With room; a sum bears no name."""
    return box[0] - _BESIDE, box[1] - (_BESIDE if name.startswith(SUM) else _ABOVE), box[2] + _BESIDE, box[3] + _BESIDE


def _hull(*boxes: Box) -> Box:
    left, top, right, bottom = zip(*boxes, strict=True)
    return min(left), min(top), max(right), max(bottom)


def _meet(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _free_place(piece: Sequence[Box], wires: Sequence[tuple[Point, Point]], width: float) -> Point:
    """Below an upper edge of a frame, where no wire runs if there is such a place."""
    places = [
        (left + 5.0 + step, top + 12.5)
        for left, top, right, _ in sorted(piece, key=lambda box: (box[1], box[0] - box[2]))
        for step in range(0, max(1, int(right - left - width - 8.0)), 4)
    ]
    lines = [_hull((*a, *a), (*b, *b)) for a, b in wires]
    free = (
        (x, y) for x, y in places if not any(_meet((x - 2, y - _LINE + 2, x + width, y + 3), wire) for wire in lines)
    )
    return next(free, places[0])


def _outlines(boxes: Sequence[Box]) -> list[list[Point]]:
    """Corners of the union of rectangles, clockwise."""
    xs = sorted({x for box in boxes for x in box[::2]})
    ys = sorted({y for box in boxes for y in box[1::2]})
    cells = {
        (i, j)
        for i in range(len(xs) - 1)
        for j in range(len(ys) - 1)
        if any(box[0] <= xs[i] < box[2] and box[1] <= ys[j] < box[3] for box in boxes)
    }
    after: dict[tuple[int, int], tuple[int, int]] = {}
    for i, j in cells:
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        beyond = [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]
        after |= {corners[k]: corners[(k + 1) % 4] for k in range(4) if beyond[k] not in cells}
    found = []
    while after:
        way = [min(after)]
        while (here := after.pop(way[-1], None)) is not None:
            way.append(here)
        turns = [
            b for a, b, c in zip([way[-2], *way], way[:-1], way[1:], strict=False) if (a[0] == b[0]) != (b[0] == c[0])
        ]
        found.append([(xs[i], ys[j]) for i, j in turns])
    return found


def _rounded(corners: Sequence[Point]) -> str:
    """A closed path whose corners are round."""

    def towards(one: Point, other: Point) -> str:
        length = abs(other[0] - one[0]) + abs(other[1] - one[1])  # edges are level or upright
        part = min(0.5, _ROUND / length)
        return f"{one[0] + part * (other[0] - one[0]):.1f} {one[1] + part * (other[1] - one[1]):.1f}"

    around = zip([corners[-1], *corners], corners, [*corners[1:], corners[0]], strict=False)
    bends = [f"{towards(at, before)}Q{at[0]:.1f} {at[1]:.1f} {towards(at, after)}" for before, at, after in around]
    return f"M{'L'.join(bends)}Z"
