"""Frames with a name around the blocks of each loop: where others lie between, in several pieces."""

from collections.abc import Mapping, Sequence
from html import escape

from ibrid.report.block_graph import SUM
from ibrid.report.drawing import Layout
from ibrid.structure.wiring import split_port

#: Between a frame and what is in it; above it more, for the name.
_BESIDE, _ABOVE = 9.0, 19.0
Box = tuple[float, float, float, float]  # left, top, right, bottom


def loop_frames(drawing: Layout, found: Mapping[str, Sequence[str]]) -> tuple[list[str], list[str]]:
    """SVG of the frames, to be drawn below everything else, and of their names, above."""
    boxes = {name: (x, y, x + width, y + height) for name, (x, y, width, height) in drawing.boxes.items()}
    frames: list[str] = []
    names: list[str] = []
    for title, members in found.items():
        inside = [name for name in boxes if name in members or _sum_before(name, members)]
        modules = [boxes[name] for name in inside if name in members]
        others = [box for name, box in boxes.items() if name not in inside]
        pieces = [
            one
            for one in _merged([boxes[name] for name in inside], others)
            if any(_within(box, one) for box in modules)
        ]
        if not pieces:
            continue
        for left, top, right, bottom in pieces:
            size = f'width="{right - left + 2 * _BESIDE:.1f}" height="{bottom - top + _ABOVE + _BESIDE:.1f}"'
            corner = f'x="{left - _BESIDE:.1f}" y="{top - _ABOVE:.1f}"'
            frames.append(f'<g class="loop"><rect {corner} {size} rx="9"/></g>')
        left, top, *_ = max(pieces, key=lambda one: (one[2] - one[0]) * (one[3] - one[1]))
        at = f'x="{left - _BESIDE + 6:.1f}" y="{top - _ABOVE + 12:.1f}"'
        names.append(f'<g class="loop"><text {at}>{escape(title)}</text></g>')
    return frames, names


def _within(box: Box, piece: Box) -> bool:
    return box[0] >= piece[0] and box[1] >= piece[1] and box[2] <= piece[2] and box[3] <= piece[3]


def _sum_before(name: str, members: Sequence[str]) -> bool:
    return name.startswith(SUM) and split_port(name.removeprefix(SUM))[0] in members


def _merged(boxes: Sequence[Box], others: Sequence[Box]) -> list[Box]:
    """Boxes joined pairwise, the closest first, as long as no other box comes into the joint frame."""
    pieces = list(boxes)
    while True:
        pairs = [(_hull(one, other), one, other) for k, one in enumerate(pieces) for other in pieces[k + 1 :]]
        joint = [found for found in pairs if not any(_meet(found[0], box) for box in others)]
        if not joint:
            return pieces
        hull, one, other = min(joint, key=lambda found: (found[0][2] - found[0][0]) + (found[0][3] - found[0][1]))
        pieces = [piece for piece in pieces if piece not in (one, other)] + [hull]


def _hull(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _meet(one: Box, other: Box) -> bool:
    """Whether a box comes into a frame."""
    return (
        one[0] - _BESIDE < other[2]
        and other[0] < one[2] + _BESIDE
        and one[1] - _ABOVE < other[3]
        and other[1] < one[3] + _BESIDE
    )
