"""The missing transfer as the measurement shows it: at every frequency by itself, the parameters being known.

The port map leaves the parameters open as well, and trades them for the transfer: a low-pass and the gain behind it, say.
Its dots then carry errors that they share. At given parameters each frequency tells its own number.

Beside it lies what the repaired diagram does there. Two diagrams have modules in common; whatever lies between these is a matrix
from their outputs to their inputs, B + Delta P with an open port. Where the repair changes B by a multiple of P alone, that
multiple is the Delta of the named block.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.signals_at_rest import Channel, channels_of, sources_of
from ibrid.evaluation.record import Record
from ibrid.gap.noise import Noise, noise_of
from ibrid.gap.open_port import OpenPort
from ibrid.gap.port_fit import Target, power, settled
from ibrid.gap.port_kinds import PORT_KINDS
from ibrid.gap.port_map import PortFit
from ibrid.gap.prior import Beliefs
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.derived_outputs import derived_outputs
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import Wiring, wire

if TYPE_CHECKING:
    from ibrid.gap.result import Gap

#: Frequencies of the named block's curve.
DENSE = 200
#: Standard error, as a part of the shown value, from which on a measured transfer says nothing.
USELESS = 0.5
#: Steps for the measured transfer, and the least that the data say about it (1 / variance).
STEPS, LEAST_SEEN = 30, 1e-12
#: Part of a change that may differ from a multiple of P.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class MissingTransfer:
    """The transfer at a port. `value`, `deviation` : (K,) complex, and the standard error of its real and imaginary part, at
    the parameters of the repaired model, else those of the port's fit; shown is Delta, in a signal 1 + Delta.
    `frequency` : (N,) Hz of `line`, what the named block does there, None where the repair is none at this port."""

    fit: PortFit
    series: bool
    value: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    line: np.ndarray | None

    @property
    def seen(self) -> np.ndarray:
        """(K,) where the measurement says something."""
        return self.deviation < USELESS * np.abs(self.value)


def missing_transfer(gap: "Gap") -> MissingTransfer | None:
    """The port at which the repair acts, else the best adequate one; None where no port tells anything."""
    if gap.verdict not in ("named", "located-unnamed"):
        return None
    best = None
    for fit in gap.ports:
        if fit.adequate or gap.repaired is not gap.baseline:
            frequency = np.union1d(np.geomspace(fit.frequency[0], fit.frequency[-1], DENSE), fit.frequency)
            curve = port_curve(fit, gap.repaired, frequency)
            if curve.named is not None:
                return _missing(gap, fit, frequency, curve)
            best = (fit, frequency, curve) if best is None and fit.adequate else best
    return None if best is None else _missing(gap, *best)


def _missing(gap: "Gap", fit: PortFit, frequency: np.ndarray, curve: "PortCurve") -> MissingTransfer:
    offset = 1.0 if curve.series else 0.0
    line = None if curve.named is None else offset + curve.named
    values, start = dict(fit.values), 1.0 + fit.transfer
    if curve.named is not None:
        values |= next(iter(gap.repaired.parameters.values()))
        start = 1.0 + curve.named[np.isin(frequency, fit.frequency)]
    noise = noise_of(gap.sweep.without(gap.held_out), gap.noise_level)
    delta, deviation = measured(fit, gap.repaired.vocabulary, noise, values, start)
    return MissingTransfer(fit, curve.series, offset + delta, deviation, frequency, line)


def measured(
    fit: PortFit, kinds: Vocabulary, noise: Noise, values: Mapping[str, float], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Delta and its standard error at a port, (K,) each, from the data of a noise, at parameter values by name.

    start : 1 + Delta to begin with. Noise that is not known is taken as large as the port's own fit leaves it.
    """
    points = tuple(point.at(np.isin(point.frequency, fit.frequency)) for point in noise.sweep.points)
    model = OpenPort(fit.port, kinds, replace(noise.sweep, points=points))
    opened = model.at(np.array([values[one.name] for one in model.symbolic.parameters]))
    if opened is None:
        return fit.transfer, fit.deviation
    data, sigma = (np.stack([getattr(one, name) for one in points], 1) for name in ("admittance", "sigma"))
    weight = 1.0 / (sigma * (1.0 if noise.known else max(fit.chi2_per_dof, 1.0) ** 0.5))
    target = Target(data, weight, Beliefs([], {}), tail=0.0)
    with np.errstate(all="ignore"):
        g, _ = settled(opened, target, start, STEPS, enough=0.0)
        return g - 1.0, np.maximum(power(target.by_transfer(opened, g)), LEAST_SEEN) ** -0.5


# --- what the repaired diagram does there ----------------------------------------------------------------------------


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
    series, deltas = True, []
    for op, values in repaired.parameters.items():
        blocks = _Blocks(opened, fit.values, repaired, op, s), _Blocks(after, values, repaired, op, s)
        shut, doubled = (blocks[0].between(after, fit.port.block, gain) for gain in (1.0, 2.0))
        pattern, change = doubled - shut, blocks[1].between(opened) - shut
        series = series and bool(np.allclose(_multiple(pattern, shut), 1.0))
        delta = _multiple(pattern, change)
        left, size = np.linalg.norm(change - delta[:, None, None] * pattern), np.linalg.norm(change)
        deltas.append(delta if left <= ROUNDING * size and size > ROUNDING * np.linalg.norm(shut) else None)
    alike = all(one is not None and np.allclose(one, deltas[0]) for one in deltas)
    return PortCurve(series, deltas[0] if alike else None)


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
        incidence = np.zeros((len(targets), len(sources)))
        for row, target in enumerate(targets):
            for source in sources_of(self.wiring, target):
                if source in place:
                    incidence[row, place[source]] += 1.0
        return incidence

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
