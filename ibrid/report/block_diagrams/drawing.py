"""Where everything of a block diagram lies on the page: boxes, the straight pieces of every net,
branching points.
"""

from collections.abc import Iterator

from ibrid.report.block_diagrams.block_graph import BlockGraph, Pin
from ibrid.report.block_diagrams.layering import Placement, place
from ibrid.report.block_diagrams.routing import TRACK, Crossbar, Routes, route

#: Around the drawing, frames of loops in it; beside the tracks of a channel.
MARGIN, APPROACH = 19.0, 26.0
#: Starting orders that are tried for the drawing with the fewest crossings.
TRIES = 24
Point = tuple[float, float]


class Layout:
    """A finished layout with horizontal positions; all lengths in drawing units, y downwards.

    `boxes` : name -> (left, top, width, height). `lines` : per net, straight pieces ((x, y), (x,
    y)).
    """

    def __init__(self, placement: Placement, routes: Routes) -> None:
        self.placement, self.routes = placement, routes
        self._columns()
        heights = [y for bars in routes.channels for bar in bars for y in (bar.low, bar.high)]
        boxes = [
            (placement.top[name], placement.top[name] + one.height)
            for name, one in placement.shapes.items()
        ]
        self.rise = MARGIN - min([*heights, *(top for top, _ in boxes)])
        self.width = self.right[-1] + self._channel(placement.columns) + MARGIN
        self.height = self.rise + max([*heights, *(bottom for _, bottom in boxes)]) + MARGIN

    def _columns(self) -> None:
        placement = self.placement
        widths = [0.0] * placement.columns
        for name, column in placement.column.items():
            widths[column] = max(widths[column], placement.shapes[name].width)
        self.left, self.right, x = [], [], MARGIN
        for column, width in enumerate(widths):
            x += self._channel(column)
            self.left.append(x)
            x += width
            self.right.append(x)

    def _channel(self, index: int) -> float:
        outer = index in (0, self.placement.columns)
        tracks = self.routes.tracks(index)
        return (0.0 if outer and not tracks else APPROACH) + TRACK * tracks

    def _track(self, channel: int, track: int) -> float:
        start = self.right[channel - 1] if channel else MARGIN
        return start + 10.0 + TRACK * track

    @property
    def boxes(self) -> dict[str, tuple[float, float, float, float]]:
        """Left, top, width and height of every shape."""
        boxes = {}
        for name, shape in self.placement.shapes.items():
            column = self.placement.column[name]
            middle = (self.left[column] + self.right[column]) / 2
            boxes[name] = (
                middle - shape.width / 2,
                self.placement.top[name] + self.rise,
                shape.width,
                shape.height,
            )
        return boxes

    def end(self, pin: Pin, side: str) -> Point:
        """Where a line meets a shape."""
        left, top, width, height = self.boxes[pin[0]]
        if side == "outputs":
            return left + width, top + self.placement.shapes[pin[0]].outputs[pin[1]]
        y = self.routes.pins.get(pin, self.placement.height_of(pin, "inputs")) + self.rise
        if self.placement.graph.node(pin[0]).shape == "sum":
            radius = height / 2
            return left + radius - max(radius**2 - (y - top - radius) ** 2, 0.0) ** 0.5, y
        return left, y

    def pieces(self, net: int) -> list[tuple[Point, Point]]:
        """The straight pieces of a net."""
        source, targets = (
            self.placement.graph.nets[net].source,
            self.placement.graph.nets[net].targets,
        )
        start = self.end(source, "outputs")
        ends = [self.end(pin, "inputs") for pin in targets]
        segments = [(start, (self.right[self.placement.column[source[0]]], start[1]))]
        segments += [
            ((self.left[self.placement.column[pin[0]]], y), (x, y))
            for pin, (x, y) in zip(targets, ends, strict=True)
        ]
        for column, passing in self.routes.passes.items():
            segments += [
                ((self.left[column], y + self.rise), (self.right[column], y + self.rise))
                for y, own in passing
                if own == net
            ]
        for channel, bars in enumerate(self.routes.channels):
            for bar in bars:
                if bar.net == net:
                    segments += self._crossbar(channel, bar)
        return [(a, b) for a, b in segments if a != b]

    def _crossbar(self, channel: int, bar: Crossbar) -> list[tuple[Point, Point]]:
        lift = self.rise
        begin = self.right[channel - 1] if channel else MARGIN
        stop = self.left[channel] if channel < len(self.left) else self.width - MARGIN
        if bar.straight:
            return [((begin, bar.low + lift), (stop, bar.low + lift))]
        x = self._track(channel, bar.track)
        pieces = [((x, bar.low + lift), (x, bar.high + lift))]
        pieces += [((begin, y + lift), (x, y + lift)) for y in bar.left]
        return pieces + [((x, y + lift), (stop, y + lift)) for y in bar.right]

    def branches(self, net: int) -> Iterator[Point]:
        """Points at which a net branches."""
        for channel, bars in enumerate(self.routes.channels):
            for bar in bars:
                if bar.net != net or bar.straight:
                    continue
                for y in bar.left | bar.right:
                    ways = (y in bar.left) + (y in bar.right) + (y > bar.low) + (y < bar.high)
                    if ways > 2:
                        yield self._track(channel, bar.track), y + self.rise


def arrange(graph: BlockGraph) -> Layout:
    """The best of several layouts: few crossings, short lines, little height."""
    placements = (place(graph, seed) for seed in range(TRIES))
    return min(
        (Layout(one, route(one)) for one in placements),
        key=lambda one: one.routes.crossings + one.routes.length / 400 + one.height / 150,
    )
