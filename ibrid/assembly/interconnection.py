"""Modules joined into one linear system by substitution, on floats and CasADi symbols alike.

Every signal is a row over the columns [states | delayed signals | v_D v_Q]. Rows are filled in the
order of direct feedthrough; a loop of direct terms is solved as a small linear system of its own.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import networkx as nx
import numpy as np

from ibrid.assembly.direct_loops import inverse_of_loop
from ibrid.assembly.joined import Interconnected, Row
from ibrid.assembly.modules_at import ModuleMatrices
from ibrid.assembly.numbers import is_zero
from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.steady_state import in_order
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, split_port


def interconnect_rows(
    wiring: Wiring, matrices: Mapping[str, Matrices], exact_delays: bool
) -> Interconnected:
    """Join the modules of a wiring whose matrices are given, seen from where it was measured; with
    `exact_delays` delays stay outside the matrices.
    """
    joined = _Joiner(wiring, matrices, exact_delays).join()
    return matrices.seen(joined) if isinstance(matrices, ModuleMatrices) else joined


class _Joiner:
    def __init__(
        self, wiring: Wiring, matrices: Mapping[str, Matrices], exact_delays: bool
    ) -> None:
        self.wiring, self.matrices = wiring, matrices
        self.sources = {  # input channel -> the output channels that add up there
            (port, axis): [(source, axis) for source in found]
            for port, found in wiring.sources.items()
            for axis in (0, 1)
        }
        self.delays = [name for name, kind in wiring.kinds.items() if kind.delay and exact_delays]
        self.states: list[str] = []
        self.first_state: dict[str, int] = {}
        for name, kind in wiring.kinds.items():
            self.first_state[name] = len(self.states)
            self.states += [
                f"{name}.{state}" for state in state_names(kind, len(matrices[name][0]))
            ]
        self.delayed = [(name, axis) for name in self.delays for axis in (0, 1)]
        size = len(self.states) + len(self.delayed)
        self.rows: dict[Channel, Row] = {
            (TERMINAL_VOLTAGE, axis): {size + axis: 1.0} for axis in (0, 1)
        }
        for index, (name, axis) in enumerate(self.delayed):
            (port,) = wiring.kinds[name].outputs
            self.rows[f"{name}.{port}", axis] = {len(self.states) + index: 1.0}
        self.inputs = {name: channels_of(name, kind.inputs) for name, kind in wiring.kinds.items()}
        self.outputs = {
            name: channels_of(name, kind.outputs) for name, kind in wiring.kinds.items()
        }
        self.direct = {
            channel: [
                (gain, source)
                for gain, source in zip(gains, self.inputs[name], strict=True)
                if not is_zero(gain)
            ]
            for name, channels in self.outputs.items()
            for channel, gains in zip(channels, matrices[name][3], strict=True)
        }  # the direct terms of an output channel: (gain, input channel)

    def join(self) -> Interconnected:
        for loop in self._feedthrough_order():
            first = loop[0]
            if len(loop) == 1 and not any(
                first in self.sources[to] for _, to in self.direct[first]
            ):
                self.rows[first] = self._output_row(first)
            else:
                self._solve_loop(loop)
        rows: list[Row] = []
        for name in self.wiring.kinds:
            a, b, _, _ = self.matrices[name]
            driven = [self._input_row(channel) for channel in self.inputs[name]] if a else []
            first = self.first_state[name]
            for a_row, b_row in zip(a, b, strict=True):
                row = {
                    first + index: value for index, value in enumerate(a_row) if not is_zero(value)
                }
                for gain, source in zip(b_row, driven, strict=True):
                    _accumulate(row, gain, source)
                rows.append(row)
        rows += [self._input_row(self.inputs[name][axis]) for name, axis in self.delayed]
        rows += [self._input_row((TERMINAL_CURRENT, axis)) for axis in (0, 1)]
        return Interconnected(tuple(rows), tuple(self.states), tuple(self.delayed))

    def _input_row(self, channel: Channel) -> Row:
        row: Row = {}
        for source in self.sources[channel]:
            _accumulate(row, 1.0, self.rows[source])
        return row

    def _output_row(self, channel: Channel, without: frozenset[Channel] = frozenset()) -> Row:
        name, _ = split_port(channel[0])
        c_row = self.matrices[name][2][self.outputs[name].index(channel)]
        first = self.first_state[name]
        row = {first + index: value for index, value in enumerate(c_row) if not is_zero(value)}
        for gain, target in self.direct[channel]:
            for source in self.sources[target]:
                if source not in without:
                    _accumulate(row, gain, self.rows[source])
        return row

    def _feedthrough_order(self) -> list[list[Channel]]:
        pending = {
            channel: dict.fromkeys(
                one for _, target in self.direct[channel] for one in self.sources[target]
            )
            for channels in self.outputs.values()
            for channel in channels
            if channel not in self.rows
        }
        needs = {channel: sources.keys() for channel, sources in pending.items()}
        order = [
            [channel] for channel in in_order(needs, self.rows.keys(), lambda channel: (channel,))
        ]
        for (channel,) in order:
            del pending[channel]
        if pending:  # loops are rare
            directed = nx.DiGraph()
            directed.add_nodes_from(pending)
            directed.add_edges_from(
                (need, one)
                for one, sources in pending.items()
                for need in sources
                if need in pending
            )
            condensed = nx.condensation(directed)
            order += [
                sorted(condensed.nodes[node]["members"], key=list(pending).index)
                for node in nx.topological_sort(condensed)
            ]
        return order

    def _solve_loop(self, loop: Sequence[Channel]) -> None:
        """y = F y + g on the channels of a loop of direct terms: y = (I - F)^-1 g."""
        inside = frozenset(loop)
        size = len(loop)
        matrix: list[list[Any]] = [
            [1.0 if i == j else 0.0 for j in range(size)] for i in range(size)
        ]
        for i, channel in enumerate(loop):
            for gain, target in self.direct[channel]:
                for source in self.sources[target]:
                    if source in inside:
                        matrix[i][loop.index(source)] = matrix[i][loop.index(source)] - gain
        known = [self._output_row(channel, inside) for channel in loop]
        inverse = self._inverse(loop, matrix)
        for i, channel in enumerate(loop):
            row: Row = {}
            for gain, other in zip(inverse[i], known, strict=True):
                _accumulate(row, gain, other)
            self.rows[channel] = row

    def _inverse(self, loop: Sequence[Channel], matrix: list[list[Any]]) -> list[list[Any]]:
        size = len(loop)
        if any(isinstance(entry, ca.SX) for row in matrix for entry in row):
            symbolic = ca.vertcat(*[ca.horzcat(*row) for row in matrix])
            inverse = ca.solve(ca.sparsify(symbolic), ca.SX.eye(size))
            return [[inverse[i, j] for j in range(size)] for i in range(size)]
        return inverse_of_loop(self.wiring, loop, np.array(matrix, dtype=float)).tolist()


def state_names(kind: ModuleKind, number: int) -> list[str]:
    """Names of a kind's states; those of a Pade form are numbered per axis."""
    if kind.delay is None:
        return list(kind.states)
    return [f"pade{index}_{axis}" for axis in "dq" for index in range(1, number // 2 + 1)]


def _accumulate(row: Row, gain: Any, source: Row) -> None:
    if is_zero(gain):
        return
    unit = not isinstance(gain, ca.SX) and gain == 1
    for column, value in source.items():
        term = value if unit else gain * value
        row[column] = row[column] + term if column in row else term
