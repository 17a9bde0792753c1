"""Loops of direct terms: legal while I - F can be inverted, F being the direct terms round the
loop.

Singular means singular at every one of a few fixed draws of the parameters near their typical
values: a loop that is singular at special values only stays legal, and the fit keeps away from
those.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import networkx as nx
import numpy as np

from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.parameters import ParameterTable
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, split_port

Gains = dict[tuple[Channel, Channel], float]  # (from, to) -> gain between output channels

#: Modules that direct terms may join round a loop, and connections among them: solving it in
#: symbols costs with their cube.
LARGEST_LOOP, TIGHTEST_LOOP = 20, 60

OMEGA_0 = 2 * np.pi * 60.0
DRAWS = 3
#: Reciprocal condition number of I - F, rows and columns scaled, below which a loop counts as
#: singular.
SINGULAR = 1e-9


@dataclass(frozen=True)
class AlgebraicLoop:
    """Channels that depend on each other without delay, and the modules on a singular cycle, in
    order, if it is one.
    """

    channels: tuple[Channel, ...]
    singular: tuple[str, ...]


class DirectTerms:
    """The direct terms of a wired diagram at random draws of its parameters and of the operating
    point, and their loops.

    table : of the wired diagram under the exact equilibrium, whatever `equilibrium` is.
    """

    def __init__(self, wiring: Wiring, table: ParameterTable, equilibrium: str) -> None:
        self.wiring, self.table, self.equilibrium = wiring, table, equilibrium
        self._exact = _Draws(wiring, table, 0.5)

    @cached_property
    def largest_loop(self) -> tuple[tuple[str, ...], int]:
        """The modules that direct terms join round the tightest loop, and the pairs of them; delays
        count as direct.

        Under the exact equilibrium, whatever that of the diagram is: there no term vanishes for
        lying on an axis.
        """
        kinds = self.wiring.kinds
        terms = self._exact.gains(0)
        graph = nx.DiGraph(
            (split_port(start)[0], split_port(end)[0]) for (start, _), (end, _) in terms
        )
        for name, kind in kinds.items():
            if kind.delay is not None:  # a Pade form has a direct term
                ports = (f"{name}.{port}" for port in kind.inputs)
                sources = (
                    split_port(source)[0] for port in ports for source in self.wiring.sources[port]
                )
                graph.add_edges_from((source, name) for source in sources if source)
        loops = (
            graph.subgraph(group)
            for group in nx.strongly_connected_components(graph)
            if len(group) > 1
        )
        largest = max(loops, key=lambda loop: loop.number_of_edges(), default=nx.DiGraph())
        return tuple(name for name in kinds if name in largest), largest.number_of_edges()

    @cached_property
    def loops(self) -> tuple[AlgebraicLoop, ...]:
        """All loops of direct terms; a transport delay breaks a loop.

        Under `equilibrium="paper"` every equilibrium lies on the d axis, which can make a loop
        singular.
        """
        drawn = self._exact if self.equilibrium == "exact" else _Draws(self.wiring, self.table, 0.0)
        loops = [sorted(group) for group in round_trips(nx.DiGraph(list(drawn.gains(0))))]
        if not loops:
            return ()
        draws = [drawn.gains(number) for number in range(DRAWS)]
        places = {name: index for index, name in enumerate(self.wiring.kinds)}
        return tuple(
            AlgebraicLoop(tuple(loop), _from_first(_singular_cycle(loop, draws), places))
            for loop in sorted(loops)
        )


class _Draws:
    """Each draw is made when it is first asked for, since most diagrams need the first alone.

    largest_q : of the operating points that are drawn, per unit.
    """

    def __init__(self, wiring: Wiring, table: ParameterTable, largest_q: float) -> None:
        self.wiring, self.table, self._largest_q = wiring, table, largest_q
        self._rng = np.random.default_rng(20)
        self._drawn: list[Gains] = []

    def gains(self, number: int) -> Gains:
        """Gains between output channels, (from, to) -> gain, at a draw; draws are numbered from
        0.
        """
        while len(self._drawn) <= number:
            self._drawn.append(_direct_terms(self.wiring, self.table, self._rng, self._largest_q))
        return self._drawn[number]


def round_trips(graph: nx.DiGraph) -> list[set[Any]]:
    """The parts of a graph from whose nodes a way leads back to them."""
    parts = nx.strongly_connected_components(graph)
    return [
        part for part in parts if len(part) > 1 or any(graph.has_edge(one, one) for one in part)
    ]


def _from_first(cycle: tuple[str, ...], places: Mapping[str, int]) -> tuple[str, ...]:
    """The same cycle, beginning with the module that was added first."""
    start = min(range(len(cycle)), key=lambda index: places[cycle[index]], default=0)
    return cycle[start:] + cycle[:start]


def _direct_terms(
    wiring: Wiring, table: ParameterTable, rng: np.random.Generator, largest_q: float
) -> Gains:
    """Gains at a random draw."""
    values = _draw(table, rng)
    angle = rng.uniform(-0.5, 0.5)
    frame = (float(np.cos(angle)), float(np.sin(angle)))
    sources = {
        port: [source for source in found if source != TERMINAL_VOLTAGE]
        for port, found in wiring.sources.items()
    }
    terms: Gains = {}
    for name, kind in wiring.kinds.items():
        if kind.delay is not None:
            continue
        inputs, outputs = channels_of(name, kind.inputs), channels_of(name, kind.outputs)
        bound = {parameter: table.bound[name, parameter] for parameter in kind.parameters}
        numbers = {
            parameter: values[one] if isinstance(one, str) else one
            for parameter, one in bound.items()
        }
        points = {
            port: (rng.uniform(0.5, 1.5), rng.uniform(-largest_q, largest_q))
            for port in kind.equilibrium_ports
        }
        d = kind.matrices(**numbers, **kind.context(OMEGA_0, frame, points))[3]
        for output, row in zip(outputs, d, strict=True):
            for (port, axis), gain in zip(inputs, row, strict=True):
                if gain:
                    for source in sources[port]:
                        edge = ((source, axis), output)
                        terms[edge] = terms.get(edge, 0.0) + float(gain)
    return {edge: gain for edge, gain in terms.items() if gain}


def _draw(table: ParameterTable, rng: np.random.Generator) -> dict[str, float]:
    values = {}
    for parameter in table.free:
        if parameter.logarithmic:
            value = parameter.typical * 10 ** rng.uniform(-0.5, 0.5)
        else:
            value = parameter.typical + 0.05 * (parameter.high - parameter.low) * rng.uniform(-1, 1)
        values[parameter.name] = float(np.clip(value, parameter.low, parameter.high))
    return values


def _singular_cycle(loop: list[Channel], draws: list[Gains]) -> tuple[str, ...]:
    """Modules on the cycle that makes I - F singular at every draw; empty when one draw can be
    inverted.
    """
    place = {channel: index for index, channel in enumerate(loop)}
    involved: set[Channel] = set()
    for terms in draws:
        matrix = np.eye(len(loop))
        for (start, end), gain in terms.items():
            if start in place and end in place:
                matrix[place[end], place[start]] -= gain
        rows = np.abs(matrix).max(axis=1)
        scaled = matrix / np.where(rows > 0, rows, 1.0)[:, None]
        columns = np.abs(scaled).max(axis=0)
        _, spread, directions = np.linalg.svd(scaled / np.where(columns > 0, columns, 1.0))
        if spread[-1] > SINGULAR * spread[0]:
            return ()
        involved = {
            channel
            for channel, weight in zip(loop, directions[-1], strict=True)
            if abs(weight) > 1e-6
        }
    kept = nx.DiGraph([edge for edge in draws[0] if edge[0] in involved and edge[1] in involved])
    try:
        cycle = [start for start, _ in nx.find_cycle(kept)]
    except nx.NetworkXNoCycle:
        cycle = loop
    return tuple(dict.fromkeys(split_port(port)[0] for port, _ in cycle))
