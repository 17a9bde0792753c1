"""What a repaired diagram does at a port: the transfer that the port map measures there, from the blocks themselves.

Two diagrams have modules in common; whatever lies between these is a matrix from their outputs to their inputs, B + Delta P
with an open port. Where the repair changes B by a multiple of P alone, that multiple is the Delta of the named block.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.signals_at_rest import Channel, channels_of, sources_of
from ibrid.evaluation.record import Record
from ibrid.gap.port_kinds import PORT_KINDS
from ibrid.gap.port_map import PortFit
from ibrid.structure.derived_outputs import derived_outputs
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import Wiring, wire

#: Part of a change that may differ from a multiple of P.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class PortCurve:
    """`series` : True where the port lies in a signal, whose whole transfer is 1 + Delta; False for a path of its own,
    Delta. `named` : (N,) complex Delta of the repaired diagram; None where its repair is none at this port."""

    series: bool
    named: np.ndarray | None


def port_curve(fit: PortFit, repaired: Record, frequency: np.ndarray) -> PortCurve:
    """Compare a port's diagram with the repaired one, at frequencies (N,) in Hz and all operating points."""
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    opened = wire(fit.port.diagram, (*repaired.vocabulary, *PORT_KINDS))
    after = wire(repaired.diagram, repaired.vocabulary)
    series, found = True, []
    for op, values in repaired.parameters.items():
        blocks = _Blocks(opened, fit.values, repaired, op, s), _Blocks(after, values, repaired, op, s)
        shut, doubled = (blocks[0].between(after, fit.port.block, gain) for gain in (1.0, 2.0))
        pattern, change = doubled - shut, blocks[1].between(opened) - shut
        series = series and bool(np.allclose(_multiple(pattern, shut), 1.0))
        delta = _multiple(pattern, change)
        left, size = np.linalg.norm(change - delta[:, None, None] * pattern), np.linalg.norm(change)
        found.append(delta if left <= ROUNDING * size and size > ROUNDING * np.linalg.norm(shut) else None)
    alike = all(one is not None and np.allclose(one, found[0]) for one in found)
    return PortCurve(series, found[0] if alike else None)


def _multiple(pattern: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """The number (N,) whose product with `pattern` (N, i, j) comes nearest to `matrix`."""
    return (pattern.conj() * matrix).sum(axis=(1, 2)) / (np.abs(pattern) ** 2).sum(axis=(1, 2))


class _Blocks:
    """The modules of a wiring as transfers at s = j omega (N,), at the parameters `values` and an operating point."""

    def __init__(self, wiring: Wiring, values: Mapping[str, float], record: Record, op: str, s: np.ndarray) -> None:
        self.wiring, self.s = wiring, s
        table = parameter_table(wiring, record.settings["equilibrium"])
        self.matrices = module_matrices(wiring, table, values, record.point(op).pqv, **record.physics)
        delayed = {name: kind.delay for name, kind in wiring.kinds.items() if kind.delay is not None}
        self.delays = {name: table.value(name, delay, values) for name, delay in delayed.items()}

    def between(self, other: Wiring, unknown: str = "", gain: float = 1.0) -> np.ndarray:
        """From the outputs of the modules in common with another wiring to their inputs, (N, inputs, outputs).

        unknown, gain : the module that is an unknown transfer, and what it is taken for.
        """
        ours, theirs = ({one.name: one for one in wiring.instances} for wiring in (self.wiring, other))
        common = sorted(name for name, one in ours.items() if theirs.get(name) == one)
        own = [name for name in ours if name not in common]
        inputs = [*self._channels(common, "inputs"), *_both(TERMINAL_CURRENT)]
        outputs = [*self._channels(common, "outputs"), *_both(TERMINAL_VOLTAGE)]
        entering, leaving = self._channels(own, "inputs"), self._channels(own, "outputs")
        g = np.zeros((len(self.s), len(leaving), len(entering)), dtype=complex)
        for name in own:
            rows = [leaving.index(one) for one in channels_of(name, self.wiring.kinds[name].outputs)]
            columns = [entering.index(one) for one in channels_of(name, self.wiring.kinds[name].inputs)]
            g[:, np.array(rows)[:, None], columns] = self._transfer(name, gain if name == unknown else None)
        closed = np.linalg.solve(np.eye(len(leaving)) - g @ self._wires(entering, leaving), g)
        whole = self._wires(inputs, outputs) + self._wires(inputs, leaving) @ closed @ self._wires(entering, outputs)
        return self._without_derived(whole, outputs, common)

    def _transfer(self, name: str, gain: float | None) -> np.ndarray:
        a, b, c, d = self.matrices[name]
        width = len(d)
        if gain is not None:
            return np.broadcast_to(gain * np.eye(width), (len(self.s), width, width))
        through = np.array(d, dtype=float)
        if a:
            lag = self.s[:, None, None] * np.eye(len(a)) - np.array(a, dtype=float)
            through = through + np.array(c, dtype=float) @ np.linalg.solve(lag, np.array(b, dtype=float) + 0j)
        return through * np.exp(-self.s * self.delays.get(name, 0.0))[:, None, None]

    def _channels(self, names: Sequence[str], side: str) -> list[Channel]:
        return [one for name in names for one in channels_of(name, getattr(self.wiring.kinds[name], side))]

    def _wires(self, targets: Sequence[Channel], sources: Sequence[Channel]) -> np.ndarray:
        """1 where a source drives a target."""
        place = {channel: index for index, channel in enumerate(sources)}
        found = np.zeros((len(targets), len(sources)))
        for row, target in enumerate(targets):
            for source in sources_of(self.wiring, target):
                if source in place:
                    found[row, place[source]] += 1.0
        return found

    def _without_derived(self, matrix: np.ndarray, outputs: Sequence[Channel], common: Sequence[str]) -> np.ndarray:
        """Columns of outputs that others determine, such as i_C = i_ti - i_g, moved to those."""
        matrix = matrix.copy()
        place = {channel: index for index, channel in enumerate(outputs)}
        for name in common:
            for port, origins in derived_outputs(self.wiring.kinds[name]).items():
                if any(side == "input" for side, _ in origins):
                    continue
                width = self.wiring.kinds[name].outputs[port].width
                columns = [place[f"{name}.{port}", axis] for axis in range(width)]
                for (_, origin), weights in origins.items():
                    onto = [place[f"{name}.{origin}", axis] for axis in range(weights.shape[1])]
                    matrix[:, :, onto] += matrix[:, :, columns] @ weights
                matrix[:, :, columns] = 0.0
        return matrix


def _both(terminal: str) -> list[Channel]:
    return [(terminal, 0), (terminal, 1)]
