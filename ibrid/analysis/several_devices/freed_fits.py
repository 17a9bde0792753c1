"""A record's model fitted to new data with some parameters free and the others as the record knows
them: x = x_0 + B z + E d.

The data are a sweep or records of events; both are whitened residuals and their slopes. The values
of limits that stand beside the program are known as well as the record's own fit to records of
events knew them.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from scipy.linalg import block_diag

from ibrid.analysis.models.parametric import ParametricModel, uncertainty
from ibrid.analysis.several_devices.collector import Collector
from ibrid.analysis.several_devices.collector_model import CollectorCoordinates, CollectorModel
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import is_adequate, p_value
from ibrid.fit.least_squares import Descent, Ending, Points
from ibrid.fit.problem import Coordinates, Problem
from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.event_noise import FITTED_PULSE_ERROR, EventNoise, estimate_event_noise
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.playback.compare import model_of_record

#: Steps of a fit, and how it goes: until a step promises nothing that counts. What the record knows
#: sets the scale of w.
STEPS, DESCENT = 50, Descent(marquardt=True, damping=1e-3, largest=np.inf, enough=1e-6, small=1e-6)
#: What a descent from an end at a kink, where a limit begins to act, must gain in T to be followed
#: by one more.
KINK = 1e-2
#: The linear gain in T below which no parameter is tried; T of a number from which on nothing is
#: linear.
LEAST, FAR = 4.0, 10.0
#: Points of a finer scan, and logarithms of factors at which a parameter is scanned.
FINER = 9
SCAN = np.log(
    np.concatenate([1.0 / np.geomspace(1.02, 2.0, 12)[::-1], [1.0], np.geomspace(1.02, 2.0, 12)])
)


@dataclass(frozen=True)
class FreedFit:
    """`x` (P,), `w` the coordinates (z, d), `cost` T, `curvature` J'J + prior of w."""

    w: np.ndarray
    x: np.ndarray
    cost: float
    curvature: np.ndarray


class FreedFits(ABC):
    """Fits of a record's model to new data.

    `names`, `size` : of the parameters. `x0` : (P,) the record's. `root` : (P, R) one standard
    deviation each, as the record knows them. `numbers` : measured. `source` : of the noise. `most`
    : fits that are tried.
    """

    most: int = 10
    names: Sequence[str]
    coordinates: Coordinates | CollectorCoordinates
    x0: np.ndarray
    root: np.ndarray
    numbers: float
    source: str

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @abstractmethod
    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(S, R) whitened, model minus measured, at x (S, P); not finite where the model has no
        answer.
        """

    @abstractmethod
    def slopes(self, x: np.ndarray) -> np.ndarray:
        """(R, P) of it."""

    told_by = inf

    def p_value(self, cost: float) -> float:
        """Of so large a T by noise alone."""
        return p_value(cost, self.numbers, self.told_by)

    def adequate(self, cost: float) -> bool:
        """True where so large a T is noise, or too little beside it to matter."""
        return is_adequate(cost, self.numbers, self.told_by)

    def starts(self, free: Sequence[int], near: FreedFit | None) -> np.ndarray:
        """The best of a scan of the last parameter about each middle: the lower of them may lie in
        the higher valley.
        """
        middles = self._middles(len(free), near)
        if not free:
            return middles
        return np.array([self._scanned(free, middle)[1] for middle in middles])

    def likely(self, free: Sequence[int], last: FreedFit) -> list[int]:
        """Near the noise those with the largest linear gain, far from it those with the best
        scan.
        """
        others = [j for j in range(self.size) if j not in free]
        if last.cost > FAR * self.numbers:
            middles = self._middles(len(free) + 1, last)
            costs = {
                j: min(self._scanned((*free, j), middle)[0] for middle in middles) for j in others
            }
            return sorted(sorted(costs, key=costs.__getitem__)[: self.most])
        gain = self.gains(free, last, others)
        return sorted(j for j in list(gain)[: self.most] if gain[j] > LEAST)

    def _middles(self, free: int, near: FreedFit | None) -> np.ndarray:
        """Where scans are about: the record's values, and another fit with fewer parameters
        free.
        """
        size = self.root.shape[1] + free
        other = (
            [] if near is None or len(near.w) >= size else [np.pad(near.w, (0, size - len(near.w)))]
        )
        return np.array([np.zeros(size), *other])

    def _scanned(self, free: Sequence[int], middle: np.ndarray) -> tuple[float, np.ndarray]:
        """T, and the coordinates, of the best of a scan of the last parameter, then of a finer one
        about that.
        """
        around, best, w, cost = SCAN, 0, middle[None], np.full(1, np.inf)
        for _ in range(2):
            w = np.repeat(middle[None], len(around), axis=0)
            w[:, -1] += around
            cost = Freed(self, free).at(w).cost
            best = int(np.argmin(cost))
            around = np.linspace(
                around[max(best - 1, 0)], around[min(best + 1, len(around) - 1)], FINER
            )
        return float(cost[best]), w[best]

    def move(self, j: int, d: float) -> float:
        """How large a change of a parameter by d is, where others explain the data as well."""
        return abs(d)

    def gains(self, free: Sequence[int], last: FreedFit, others: Sequence[int]) -> dict[int, float]:
        """By how much T would fall if each of the others were free beside, linearly; the largest
        first.
        """
        slopes, model = self.slopes(last.x), Freed(self, free)
        seen = slopes @ model.directions
        inverse = np.linalg.pinv(seen.T @ seen + np.diag(model.pulled))
        residual = self.residuals(last.x[None])[0]
        gain = {}
        for j in others:
            beside = slopes[:, j] - seen @ (inverse @ (seen.T @ slopes[:, j]))
            size = float(slopes[:, j] @ beside)
            gain[j] = float(beside @ residual) ** 2 / size if size > 1e-9 else 0.0
        return {j: gain[j] for j in sorted(gain, key=lambda j: -gain[j])}

    def fit(self, free: Sequence[int], near: FreedFit | None = None) -> FreedFit:
        """The least T with these parameters free, by damped least squares from some starts; again
        from an end at a kink.
        """
        model, before = Freed(self, free), np.inf
        least = DESCENT.go(model, DESCENT.begin(model, self.starts(free, near)), STEPS).best(1)
        while least.ended[0] in (Ending.STALLED, Ending.DAMPED) and least.cost[0] < before - KINK:
            before, least = least.cost[0], DESCENT.go(model, DESCENT.begin(model, least.x), STEPS)
        if not np.isfinite(least.cost[0]):
            raise IbridError(
                "the record's model has no finite answer at the operating points of the data"
            )
        values, normal = model.parameters(least.x)[0], model.normal(least.points)[1][0]
        return FreedFit(least.x[0], values, float(least.cost[0]), normal)


class Freed:
    """T over w = (z, d), as a `SumOfSquares`: how w moves the parameters, `directions`, and which
    of w the record pulls back.
    """

    def __init__(self, fits: FreedFits, free: Sequence[int]) -> None:
        self.fits = fits
        self.directions = np.hstack([fits.root, np.eye(fits.size)[:, list(free)]])
        self.pulled = np.repeat([1.0, 0.0], [fits.root.shape[1], len(free)])
        self.box = np.full(len(self.pulled), -np.inf), np.full(len(self.pulled), np.inf)
        self._known: dict[bytes, np.ndarray] = {}

    def parameters(self, w: np.ndarray) -> np.ndarray:
        """x (S, P) at w."""
        coordinates = self.fits.coordinates
        return np.clip(self.fits.x0 + w @ self.directions.T, coordinates.x_low, coordinates.x_high)

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        """T and the residuals."""
        residual = self.fits.residuals(self.parameters(x))
        cost = (residual**2).sum(axis=1) + x**2 @ self.pulled
        return Points(x, np.where(np.isfinite(cost), cost, np.inf), (residual,))

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Of the residuals and of what is pulled."""
        slopes = np.array([self._slopes(x) for x in self.parameters(points.x)]) @ self.directions
        gradient = np.einsum("srw,sr->sw", slopes, points.carried[0]) + points.x * self.pulled
        return gradient, slopes.mT @ slopes + np.diag(self.pulled)

    def _slopes(self, x: np.ndarray) -> np.ndarray:
        """Once for each x: a step that was not taken asks for them again."""
        if (key := x.tobytes()) not in self._known:
            self._known[key] = self.fits.slopes(x)
        return self._known[key]


class SweepFits(FreedFits):
    """Of a sweep."""

    def __init__(self, record: Record, sweep: Sweep) -> None:
        noise = estimate_noise(sweep)
        self.source = noise.source
        self._set(self._of(record, sweep), noise.sweep.points)
        if not noise.known:  # its level is that of what the freest model leaves
            everything = self.fit(tuple(range(self.size)))
            scale = np.sqrt(everything.cost / max(self.numbers - self.size, 1))
            self._set(self._problem, noise.scaled(float(scale)).sweep.points)

    def _of(self, record: Record, sweep: Sweep) -> Problem | CollectorModel:
        """What answers at the points of the sweep; the names, the coordinates and what the record
        knows.
        """
        model = _parametric(record, power_node=sweep.power_node)
        self.names, self.x0, self.coordinates = model.names, model.x, model.coordinates
        self.root = _known(record)[1]
        return model.problem(sweep.points)

    def _set(self, problem: Problem | CollectorModel, points: Sequence[PointSweep]) -> None:
        self._problem, self._points = problem, tuple(points)
        self._measured = np.concatenate([_flat(one.admittance[..., None])[:, 0] for one in points])
        self._sigma = np.concatenate([np.tile(np.asarray(one.sigma).ravel(), 2) for one in points])
        self.numbers = len(self._measured)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Of the admittances."""
        answers = [
            np.concatenate([_flat(one[..., None])[:, 0] for one in self._problem.responses(one)])
            for one in x
        ]
        return (np.array(answers) - self._measured) / self._sigma

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Of the same."""
        return (
            np.concatenate([_flat(one) for one in self._problem.jacobians(x)])
            / self._sigma[:, None]
        )


class PlantFits(SweepFits):
    """Of a sweep at the PCC of a plant, whose devices are those of the record or differ from it."""

    def __init__(self, record: Record, sweep: Sweep, collector: Collector) -> None:
        self._collector, self._sweep = collector, sweep
        super().__init__(record, sweep)

    def _of(self, record: Record, sweep: Sweep) -> CollectorModel:
        found = plant_model(record, self._collector, sweep.points)
        self.names, self.x0, self.coordinates = found.names, found.x, found.coordinates
        self.plant, self.root = found, known_of_plant(record, found)
        return found

    def move(self, j: int, d: float) -> float:
        """A change of one device is likelier than the same of all, which looks alike where their
        places do.
        """
        return abs(d) * (2 * len(self._collector.devices) if j < self.plant.parameters else 1)

    def behind(self, device: int) -> Sweep:
        """What one device has to be where the others are as the record has them."""
        points = [self.plant.behind(device, one, m) for m, one in enumerate(self._points)]
        return replace(self._sweep, points=tuple(points), power_node="pcc")


def plant_model(
    record: Record, collector: Collector, points: Sequence[PointSweep]
) -> CollectorModel:
    """The plant of a record's devices at points of its PCC, where p, q and v are."""
    return CollectorModel(record, _parametric(record, power_node="pcc"), collector, points)


def known_of_plant(record: Record, plant: CollectorModel) -> np.ndarray:
    """(X, R) one standard deviation each of a plant's numbers: what the record knows of every
    device alike, and tolerances.
    """
    known = _known(record)[1]
    between = np.zeros((len(plant.x) - len(known) - len(plant.spread), 0))
    return np.asarray(block_diag(known, between, np.diag(plant.spread)))


class EventFits(FreedFits):
    """Of records of events."""

    most = 3

    def likely(self, free: Sequence[int], last: FreedFit) -> list[int]:
        """The values of limits always: there are few, and where one acts is narrower than a
        scan.
        """
        limits = {j for j, name in enumerate(self.names) if name in self._limits and j not in free}
        return sorted({*super().likely(free, last), *limits})

    def __init__(self, record: Record, events: Events, noise: EventNoise | None = None) -> None:
        """noise : by which the events are weighed; None: theirs, with what the record makes of the
        voltage between samples.
        """
        model = model_of_record(record)
        fitter = EventFitter(
            noise or estimate_event_noise(events, events.rests), model.kinds, {}, None
        )
        if noise is None:
            fitter = fitter.with_noise(
                fitter.noise_for_model(
                    model.diagram, model.limits, model.values, FITTED_PULSE_ERROR
                )
            )
        self._misfit, self.noise = fitter.misfit(model.diagram, model.limits), fitter.noise
        self.told_by, self.source = self.noise.noise_dof, self.noise.source
        self.names, self.coordinates = self._misfit.parameter_prior.names, self._misfit.coordinates
        self.x0 = self._misfit.parameter_prior.start(model.values)
        self.numbers = self._misfit.count
        known, root = _known(record)
        self._limits = {
            f"{one['id']}.{name}": float(one.get("deviations", {}).get(name, 0.0))
            for one in record.settings.get("large_signal", ())
            for name in one["parameters"]
        }
        spread = np.diag([self._limits.get(name, 0.0) for name in self.names])
        self.root = np.hstack([np.zeros((self.size, root.shape[1])), spread[:, spread.any(axis=0)]])
        for name, row in zip(known, root, strict=True):
            self.root[self.names.index(name), : root.shape[1]] = row

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Of the currents."""
        return self._misfit.whitened_residuals(x)

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Of the same."""
        return self._misfit.event_jacobian(x)


def fits_of(record: Record, data: Sweep | Events, collector: Collector | None = None) -> FreedFits:
    """The fits to a sweep, that of a plant too, or to records of events.

    Raises IbridError for a record without a covariance.
    """
    if collector is None:
        return SweepFits(record, data) if isinstance(data, Sweep) else EventFits(record, data)
    if not isinstance(data, Sweep):
        raise IbridError(
            "a plant of several devices is compared with a sweep, found records of events; give a "
            "sweep"
        )
    return PlantFits(record, data, collector)


def _known(record: Record) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the record's parameters and one standard deviation each, (P, R)."""
    sure = uncertainty(record, _parametric(record))
    if sure is None:
        raise IbridError("the record holds no covariance; fit again with --parameters shared")
    return sure.names, sure.directions


def _flat(values: np.ndarray) -> np.ndarray:
    """(K, 2, 2, P) complex as (8 K, P): real parts, then imaginary ones."""
    rows = values.reshape(-1, values.shape[-1])
    return np.concatenate([np.real(rows), np.imag(rows)])


def _parametric(record: Record, **settings: str) -> ParametricModel:
    """The record's model at any of its points, with some settings changed."""
    name = next(iter(record.parameters), None)
    if name is None:
        raise IbridError("the record has no fitted values; make it with ibrid evaluate")
    return ParametricModel(
        replace(record, settings={**record.settings, **settings}), record.point(name)
    )
