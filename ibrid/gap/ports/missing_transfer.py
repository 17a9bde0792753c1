"""The missing transfer as the measurement shows it: at every frequency by itself, the parameters
being known.

The port map leaves the parameters open as well, and trades them for the transfer: a low-pass and
the gain behind it, say. Its dots then carry errors that they share. At given parameters each
frequency tells its own number.

Beside it lies what the repaired diagram does there: the transfer with which the open model answers
as the repaired one does, at all operating points, where there is one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.gap.ports.open_port import OpenedModel, OpenPort
from ibrid.gap.ports.port_fit import PortProblem, eliminate_transfer, iterate_transfer, squared_norm
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.noise import Noise, estimate_noise
from ibrid.gap.refitting.prior import ParameterPrior
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.modules.vocabulary import Vocabulary

#: Frequencies of the named block's curve.
DENSE = 200
#: Standard error, as a part of the shown value, from which on a measured transfer says nothing.
USELESS = 0.5
#: Steps for the measured transfer, and the least that the data say about it (1 / variance).
STEPS, LEAST_SEEN = 30, 1e-12
#: Part of a response by which two answers are alike, the least Delta that is one, and a response
#: (pu) that is none.
ROUNDING, NOTHING = 1e-6, 1e-6


@dataclass(frozen=True, eq=False)
class MissingTransfer:
    """The transfer at a port. `value`, `deviation` : (K,) complex, and the standard error of its
    real and imaginary part, at the parameters of the repaired model, else those of the port's fit;
    shown is Delta, in a signal 1 + Delta.
    `frequency` : (N,) Hz of `line`, what the named block does there, None where the repair is none
    at this port.
    """

    fit: PortFit
    value: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    line: np.ndarray | None

    @property
    def seen(self) -> np.ndarray:
        """(K,) where the measurement says something."""
        return self.deviation < USELESS * np.abs(self.value)


class _Placed(Protocol):
    """What has a place."""

    @property
    def where(self) -> str: ...


class Repaired(Protocol):
    """What an answer says of its repair: `ibrid.gap.results.gap.Gap`."""

    @property
    def verdict(self) -> str: ...
    @property
    def effects(self) -> Sequence[_Placed]: ...
    @property
    def ports(self) -> Sequence[PortFit]: ...
    @property
    def baseline(self) -> Record: ...
    @property
    def repaired(self) -> Record: ...
    @property
    def sweep(self) -> Sweep: ...
    @property
    def held_out(self) -> Sequence[str]: ...
    @property
    def noise_level(self) -> float: ...


def missing_transfer(gap: Repaired) -> MissingTransfer | None:
    """A port at which the repair acts, first of those that its place names, else the best adequate
    one; None where no port tells anything.
    """
    if gap.verdict not in ("named", "located-unnamed"):
        return None
    best, places = None, " ".join(one.where for one in gap.effects)
    for fit in sorted(gap.ports, key=lambda fit: fit.port.name not in places):
        if fit.adequate or gap.repaired is not gap.baseline:
            frequency = np.union1d(
                np.geomspace(fit.frequency[0], fit.frequency[-1], DENSE), fit.frequency
            )
            curve = port_curve(fit, gap.repaired, gap.sweep, frequency)
            if curve is not None:
                return _compare_with_repair(gap, fit, frequency, curve)
            best = (fit, frequency, curve) if best is None and fit.adequate else best
    return None if best is None else _compare_with_repair(gap, *best)


def _compare_with_repair(
    gap: Repaired, fit: PortFit, frequency: np.ndarray, curve: np.ndarray | None
) -> MissingTransfer:
    offset = 1.0 if fit.port.series else 0.0
    line = None if curve is None else offset + curve
    values, start = dict(fit.values), 1.0 + fit.transfer
    if curve is not None:
        values |= next(iter(gap.repaired.parameters.values()))
        start = 1.0 + curve[np.isin(frequency, fit.frequency)]
    noise = estimate_noise(gap.sweep.without(gap.held_out), gap.noise_level)
    delta, deviation = measure_transfer(fit, gap.repaired.vocabulary, noise, values, start)
    return MissingTransfer(fit, offset + delta, deviation, frequency, line)


def port_curve(
    fit: PortFit, repaired: Record, sweep: Sweep, frequency: np.ndarray
) -> np.ndarray | None:
    """Delta (N,) of the repaired diagram at a port, at frequencies in Hz; None where no transfer
    there answers as it does.

    sweep : says the nominal frequency and the power node.
    """
    points = tuple(
        PointSweep(repaired.point(op), frequency, repaired.response(op, frequency), predicted=True)
        for op in repaired.parameters
    )
    values = {**fit.values, **next(iter(repaired.parameters.values()))}
    opened, data = _open_at_values(fit, repaired.vocabulary, replace(sweep, points=points), values)
    if opened is None:
        return None
    target = PortProblem(
        data,
        1.0 / np.maximum(np.linalg.norm(data, axis=(2, 3), keepdims=True), NOTHING),
        ParameterPrior([], {}),
        tail=0.0,
    )
    with np.errstate(all="ignore"):
        g, left = iterate_transfer(
            opened, target, eliminate_transfer(opened, target), STEPS, enough=0.0
        )
    alike = (left <= len(points) * ROUNDING**2).all() and np.abs(g - 1.0).max() > ROUNDING
    return g - 1.0 if alike else None


def measure_transfer(
    fit: PortFit, kinds: Vocabulary, noise: Noise, values: Mapping[str, float], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Delta and its standard error at a port, (K,) each, from the data of a noise, at parameter
    values by name.

    start : 1 + Delta to begin with. Noise that is not known is taken as large as the port's own fit
    leaves it.
    """
    points = tuple(
        point.at(np.isin(point.frequency, fit.frequency)) for point in noise.sweep.points
    )
    opened, data = _open_at_values(fit, kinds, replace(noise.sweep, points=points), values)
    if opened is None:
        return fit.transfer, fit.deviation
    sigma = np.stack([np.asarray(one.sigma) for one in points], axis=1)
    weight = 1.0 / (sigma * (1.0 if noise.known else max(fit.chi2_per_dof, 1.0) ** 0.5))
    target = PortProblem(data, weight, ParameterPrior([], {}), tail=0.0)
    with np.errstate(all="ignore"):
        g, _ = iterate_transfer(opened, target, start, STEPS, enough=0.0)
        return g - 1.0, np.maximum(
            squared_norm(target.transfer_slope(opened, g)), LEAST_SEEN
        ) ** -0.5


def _open_at_values(
    fit: PortFit, kinds: Vocabulary, sweep: Sweep, values: Mapping[str, float]
) -> tuple[OpenedModel | None, np.ndarray]:
    """A port's model at parameter values, opened at the points of a sweep, and their admittances
    (K, M, 2, 2).
    """
    model = OpenPort(fit.port, kinds, sweep)
    theta = np.array([values[one.name] for one in model.symbolic.parameters])
    return model.at(theta), np.stack([one.admittance for one in sweep.points], axis=1)
