"""The missing transfer function as the measurement shows it, at every frequency by itself.

The port map leaves the parameters open and trades them for the transfer function: a low-pass and
the gain behind it, say; its values then have common errors. At given parameters each frequency
determines its own value.

The transfer function of the repaired diagram at the port is computed with it, where the model with
one there responds as the repaired one does at all operating points.
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

#: Frequencies of the repaired diagram's curve.
CURVE_POINTS = 200
#: Standard error, as a part of the value, above which a measured transfer is not shown.
LARGEST_DEVIATION = 0.5
#: Rounds for the measured transfer, and the least information (1/variance) on it.
MOST_ROUNDS = 30
LEAST_INFORMATION = 1e-12
#: Part of a response by which two may differ and count as equal, and the least Delta.
ROUNDING = 1e-6
#: Response (pu) that stands for zero.
TINY_RESPONSE = 1e-6


@dataclass(frozen=True, eq=False)
class MissingTransfer:
    """The transfer function at a port: Delta, or 1 + Delta where the port is in series.

    Parameters
    ----------
    fit : PortFit
        Of the port.
    value, deviation : ndarray
        (K,) complex, and the standard error of its real and imaginary part, at the parameters of
        the repaired model, else at those of the port's fit.
    frequency : ndarray
        (N,) Hz of `line`.
    line : ndarray or None
        (N,) transfer function of the repaired diagram; None where the repair does not act at this
        port.
    """

    fit: PortFit
    value: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    line: np.ndarray | None

    @property
    def seen(self) -> np.ndarray:
        """(K,) whether the measurement determines the value."""
        return self.deviation < LARGEST_DEVIATION * np.abs(self.value)


class LocatedEffect(Protocol):
    """An effect with its location in the program."""

    @property
    def where(self) -> str: ...


class Repaired(Protocol):
    """What is needed of a repair: `ibrid.gap.results.gap.Gap`."""

    @property
    def verdict(self) -> str: ...
    @property
    def effects(self) -> Sequence[LocatedEffect]: ...
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
    """Return the missing transfer function at the port at which the repair acts.

    The ports that the effects name come first; else the best adequate port. None where there is
    none.
    """
    if gap.verdict not in ("named", "located-unnamed"):
        return None
    locations = " ".join(effect.where for effect in gap.effects)
    best_adequate = None
    for fit in sorted(gap.ports, key=lambda fit: fit.port.name not in locations):
        if not (fit.adequate or gap.repaired is not gap.baseline):
            continue
        grid = np.geomspace(fit.frequency[0], fit.frequency[-1], CURVE_POINTS)
        frequency = np.union1d(grid, fit.frequency)
        curve = port_curve(fit, gap.repaired, gap.sweep, frequency)
        if curve is not None:
            return _compare_with_repair(gap, fit, frequency, curve)
        if best_adequate is None and fit.adequate:
            best_adequate = (fit, frequency, curve)
    return None if best_adequate is None else _compare_with_repair(gap, *best_adequate)


def _compare_with_repair(
    gap: Repaired, fit: PortFit, frequency: np.ndarray, curve: np.ndarray | None
) -> MissingTransfer:
    """Measure the transfer function at a port, beside that of the repaired diagram.

    curve : (N,) Delta of the repaired diagram at `frequency` (N,); None where there is none.
    """
    offset = 1.0 if fit.port.series else 0.0
    values = dict(fit.values)
    start = 1.0 + fit.transfer
    line = None
    if curve is not None:
        line = offset + curve
        values |= next(iter(gap.repaired.parameters.values()))
        start = 1.0 + curve[np.isin(frequency, fit.frequency)]
    noise = estimate_noise(gap.sweep.without(gap.held_out), gap.noise_level)
    delta, deviation = measure_transfer(fit, gap.repaired.vocabulary, noise, values, start)
    return MissingTransfer(fit, offset + delta, deviation, frequency, line)


def port_curve(
    fit: PortFit, repaired: Record, sweep: Sweep, frequency: np.ndarray
) -> np.ndarray | None:
    """Compute Delta (N,) of the repaired diagram at a port, at frequencies (N,) in Hz.

    None where no transfer function there responds as the repaired diagram does.

    sweep : has the nominal frequency and the power node.
    """
    points = tuple(
        PointSweep(repaired.point(op), frequency, repaired.response(op, frequency), predicted=True)
        for op in repaired.parameters
    )
    values = {**fit.values, **next(iter(repaired.parameters.values()))}
    predicted = replace(sweep, points=points)
    opened, data = _open_at_values(fit, repaired.vocabulary, predicted, values)
    if opened is None:
        return None
    magnitude = np.linalg.norm(data, axis=(2, 3), keepdims=True)
    weight = 1.0 / np.maximum(magnitude, TINY_RESPONSE)
    problem = PortProblem(data, weight, ParameterPrior([], {}), tail=0.0)
    with np.errstate(all="ignore"):
        start = eliminate_transfer(opened, problem)
        g, cost = iterate_transfer(opened, problem, start, MOST_ROUNDS, enough=0.0)
    is_equal = (cost <= len(points) * ROUNDING**2).all()
    is_nonzero = np.abs(g - 1.0).max() > ROUNDING
    return g - 1.0 if is_equal and is_nonzero else None


def measure_transfer(
    fit: PortFit, kinds: Vocabulary, noise: Noise, values: Mapping[str, float], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Measure Delta at a port at given parameter values, each frequency by itself.

    Parameters
    ----------
    noise : Noise
        Of the data; an unknown one is taken as large as the port's own fit leaves it.
    values : mapping
        Parameter values by name.
    start : ndarray
        (K,) 1 + Delta to begin with.

    Returns
    -------
    tuple of ndarray
        Delta (K,), and its standard error.
    """
    points = tuple(
        point.at(np.isin(point.frequency, fit.frequency)) for point in noise.sweep.points
    )
    opened, data = _open_at_values(fit, kinds, replace(noise.sweep, points=points), values)
    if opened is None:
        return fit.transfer, fit.deviation
    scale = 1.0 if noise.known else max(fit.chi2_per_dof, 1.0) ** 0.5
    sigma = np.stack([np.asarray(point.sigma) for point in points], axis=1)
    problem = PortProblem(data, 1.0 / (sigma * scale), ParameterPrior([], {}), tail=0.0)
    with np.errstate(all="ignore"):
        g, _ = iterate_transfer(opened, problem, start, MOST_ROUNDS, enough=0.0)
        information = squared_norm(problem.transfer_slope(opened, g))
        return g - 1.0, np.maximum(information, LEAST_INFORMATION) ** -0.5


def _open_at_values(
    fit: PortFit, kinds: Vocabulary, sweep: Sweep, values: Mapping[str, float]
) -> tuple[OpenedModel | None, np.ndarray]:
    """Open a port's model at parameter values and the points of a sweep.

    Returns
    -------
    tuple of OpenedModel and ndarray
        None without a response; and the admittances (K, M, 2, 2) of the sweep.
    """
    model = OpenPort(fit.port, kinds, sweep)
    theta = np.array([values[parameter.name] for parameter in model.symbolic.parameters])
    data = np.stack([point.admittance for point in sweep.points], axis=1)
    return model.at(theta), data
