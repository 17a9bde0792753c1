"""Lines of a drawing: every net is one right-angled tree. Vertical pieces run between columns, each
on its own track; pieces that pass a column use a height that is free of boxes and of other nets. So
nets cross, but never share a line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np

from ibrid.report.block_diagrams.block_graph import Net, Pin
from ibrid.report.block_diagrams.layering import Placement

CLEARANCE, PIN_CLEARANCE, TRACK = 9.0, 6.0, 10.0


#: Column -> (height, net) that run through it; and heights of inputs.
Passes = dict[int, list[tuple[float, int]]]
Heights = dict[Pin, float]


@dataclass
class Crossbar:
    """What a net does between two columns: heights at which it touches the left and the right
    column.
    """

    net: int
    left: set[float] = field(default_factory=set)
    right: set[float] = field(default_factory=set)
    track: int = -1

    @property
    def low(self) -> float:
        return min(self.left | self.right)

    @property
    def high(self) -> float:
        return max(self.left | self.right)

    @property
    def straight(self) -> bool:
        """One height only, so that no vertical piece is needed."""
        return self.high - self.low < 0.25


@dataclass(frozen=True)
class Routes:
    """`pins` : height of every input after shifting. `passes` : column -> (height, net) that run
    through it.
    `channels` : per channel, left of column c at index c, its crossbars.
    """

    pins: Heights
    passes: Passes
    channels: list[list[Crossbar]]

    def tracks(self, channel: int) -> int:
        """Number of tracks that a channel needs."""
        return max((bar.track for bar in self.channels[channel]), default=-1) + 1

    @property
    def crossings(self) -> int:
        """How often lines of different nets cross."""
        return sum(
            _crossings(a, b)
            for bars in self.channels
            for a in bars
            for b in bars
            if not b.straight and (a.straight or a.track < b.track)
        )

    @property
    def length(self) -> float:
        """Sum of the vertical pieces."""
        return sum(bar.high - bar.low for bars in self.channels for bar in bars)


def route(placement: Placement) -> Routes:
    """Heights and tracks of all nets."""
    nets = placement.graph.nets
    pins = _shifted_inputs(placement, nets)
    passes: Passes = {column: [] for column in range(placement.columns)}
    channels: list[list[Crossbar]] = [[] for _ in range(placement.columns + 1)]
    bars = [_direct(placement, net, index, pins) for index, net in enumerate(nets)]
    trunks = [trunk for index, net in enumerate(nets) for trunk in _trunks(placement, net, index)]
    for index, columns, targets in sorted(trunks, key=lambda one: len(one[1])):
        source = placement.height_of(nets[index].source, "outputs")
        height = _free_height(
            placement, pins, passes, index, columns, source, [pins[pin] for pin in targets]
        )
        for column in columns:
            passes[column].append((height, index))
        _join(bars[index], placement, columns, targets, height, pins)
    for found in bars:
        for channel, bar in found.items():
            channels[channel].append(bar)
    return Routes(pins, passes, [_tracked(one) for one in channels])


def _shifted_inputs(placement: Placement, nets: Sequence[Net]) -> Heights:
    """Heights of the driven inputs, moved a little where another net leaves the column before at
    the same height.
    """
    outputs: Passes = {}
    for index, net in enumerate(nets):
        column = placement.column[net.source[0]]
        outputs.setdefault(column, []).append((placement.height_of(net.source, "outputs"), index))
    pins: Heights = {}
    for index, net in enumerate(nets):
        for pin in net.targets:
            height = placement.height_of(pin, "inputs")
            others = [
                y
                for y, net_there in outputs.get(placement.column[pin[0]] - 1, [])
                if net_there != index
            ]
            others += [y for other, y in pins.items() if other[0] == pin[0]]
            shifts = (0.0, 7.0, -7.0, 4.0, -4.0, 10.0, -10.0)
            pins[pin] = height + next(
                (one for one in shifts if all(abs(height + one - y) >= 4.0 for y in others)), 0.0
            )
    return pins


def _direct(placement: Placement, net: Net, index: int, pins: Heights) -> dict[int, Crossbar]:
    """The crossbar behind the source, with the targets in the next column."""
    column = placement.column[net.source[0]]
    bar = Crossbar(index, left={placement.height_of(net.source, "outputs")})
    bar.right |= {pins[pin] for pin in net.targets if placement.column[pin[0]] == column + 1}
    return {column + 1: bar}


def _trunks(placement: Placement, net: Net, index: int) -> Iterator[tuple[int, range, list[Pin]]]:
    """Columns that a net must pass, forwards and backwards, with the targets that each piece
    serves.
    """
    start = placement.column[net.source[0]]
    ahead = [pin for pin in net.targets if placement.column[pin[0]] > start + 1]
    back = [pin for pin in net.targets if placement.column[pin[0]] <= start]
    if ahead:
        yield index, range(start + 1, max(placement.column[pin[0]] for pin in ahead)), ahead
    if back:
        yield index, range(min(placement.column[pin[0]] for pin in back), start + 1), back


def _free_height(
    placement: Placement,
    pins: Heights,
    passes: Passes,
    net: int,
    columns: range,
    source: float,
    targets: Sequence[float],
) -> float:
    """The height nearest to source and targets that nothing else uses in these columns."""
    nets, blocked = placement.graph.nets, []
    for name, column in placement.column.items():
        if column in columns:
            top = placement.top[name]
            blocked.append((top - CLEARANCE, top + placement.shapes[name].height + CLEARANCE))
    around = range(columns[0] - 1, columns[-1] + 2)
    for column in around:
        blocked += [
            (y - CLEARANCE, y + CLEARANCE) for y, other in passes.get(column, []) if other != net
        ]
    for index, other in enumerate(nets):
        if index == net:
            continue
        ends = (
            [placement.height_of(other.source, "outputs")]
            if placement.column[other.source[0]] in around
            else []
        )
        ends += [pins[pin] for pin in other.targets if placement.column[pin[0]] in around]
        blocked += [(y - PIN_CLEARANCE, y + PIN_CLEARANCE) for y in ends]
    low, high = min(one[0] for one in blocked) - 20, max(one[1] for one in blocked) + 20
    candidates = [source, *targets, *np.arange(low, high, 2.5)]
    free = [y for y in candidates if not any(start < y < end for start, end in blocked)]
    return float(min(free, key=lambda y: abs(y - source) + sum(abs(y - one) for one in targets)))


def _join(
    bars: dict[int, Crossbar],
    placement: Placement,
    columns: range,
    targets: Sequence[Pin],
    height: float,
    pins: Heights,
) -> None:
    """Add a trunk through `columns` to the crossbars of its net."""
    index = next(iter(bars.values())).net
    for column in columns:
        bars.setdefault(column, Crossbar(index)).right.add(height)
        bars.setdefault(column + 1, Crossbar(index)).left.add(height)
    for pin in targets:
        bars[placement.column[pin[0]]].right.add(pins[pin])


def _tracked(bars: list[Crossbar]) -> list[Crossbar]:
    """Order the vertical pieces of a channel for few crossings and give them tracks, shared where
    they do not meet.
    """
    upright = [bar for bar in bars if not bar.straight]
    if len(upright) <= 6:
        ordered = _fewest_crossings(upright)
    else:
        ordered = sorted(upright, key=lambda bar: (bar.high - bar.low, bar.low))
    for index, bar in enumerate(ordered):
        beside = [
            one.track
            for one in ordered[:index]
            if one.low - 4 < bar.high and bar.low - 4 < one.high
        ]
        bar.track = max(beside, default=-1) + 1
    return bars


def _fewest_crossings(bars: Sequence[Crossbar]) -> list[Crossbar]:
    """The best of all orders."""
    between = [[_crossings(first, second) for second in bars] for first in bars]
    orders = permutations(range(len(bars)))
    best = min(
        orders, key=lambda order: sum(between[one][other] for one, other in combinations(order, 2))
    )
    return [bars[index] for index in best]


def _crossings(first: Crossbar, second: Crossbar) -> int:
    """Crossings of two crossbars of a channel when `first` is left of `second`."""
    return sum(first.low < y < first.high for y in second.left) + sum(
        second.low < y < second.high for y in first.right
    )
