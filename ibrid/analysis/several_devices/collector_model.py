"""A plant as a function of its numbers: one record's model at every device of a collector network,
seen at the PCC.

x = (values of every device, what each device differs by, logarithms of the uncertain numbers of the
network), in the search coordinates of the record; parameters are named all.pll.kP_pll,
inverter_1.pll.kP_pll and inverter_1.port.1.L.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ibrid.analysis.models.parametric import ParametricModel
from ibrid.analysis.several_devices.collector import Collector, Flow, WorkingPoint
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.problem import Problem
from ibrid.measurement.conventions.rotation import propagate, rotation
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep

#: Step of a logarithm in a difference, and standard deviations of a number's tolerance to the ends
#: of its box.
STEP, WIDE = 1e-6, 4.0


class CollectorCoordinates:
    """theta <-> x of a plant; a device's parameter stands for its whole value.

    `whole` : of one device.
    """

    def __init__(
        self, model: ParametricModel, beside: np.ndarray, logs: np.ndarray, spread: np.ndarray
    ) -> None:
        own = model.coordinates
        self.whole, self._beside, size = own, beside, beside.size
        self._parts = [beside.shape[1], beside.shape[1] + size]
        width = own.x_high - own.x_low
        ends = np.tile(width, len(beside)), WIDE * spread
        self.x_low = np.concatenate([own.x_low, -ends[0], logs - ends[1]])
        self.x_high = np.concatenate([own.x_high, ends[0], logs + ends[1]])

    def devices(self, x: np.ndarray) -> np.ndarray:
        """(N, P) coordinates of each device, inside the boxes."""
        every, differs, _ = np.split(x, self._parts)
        return np.clip(
            every + self._beside + differs.reshape(self._beside.shape),
            self.whole.x_low,
            self.whole.x_high,
        )

    def to_theta(self, x: np.ndarray) -> np.ndarray:
        """Values, those of the devices whole."""
        every, _, logs = np.split(x, self._parts)
        return np.concatenate(
            [self.whole.to_theta(every), self.whole.to_theta(self.devices(x)).ravel(), np.exp(logs)]
        )


class CollectorModel:
    """The admittance of a plant at measured points, and its slopes; asked as a `Problem`.

    `names` (X,) of x, whose first `parameters` are those of every device. `x` (X,) : as the record
    and the file have it. `spread` (E,) : tolerances of the network's uncertain numbers, the last of
    x.
    """

    def __init__(
        self,
        record: Record,
        model: ParametricModel,
        collector: Collector,
        points: Sequence[PointSweep],
    ) -> None:
        outside = record.diagram.outside
        if outside.labels or outside.known or (outside.elements and outside.inside):
            raise IbridError(
                "the record has doubted labels, or p and q measured behind its port, which the "
                "devices of a plant do not "
                "have; fit it with --labels exact and a port whose power_node is outside"
            )
        self._model, self.collector, self.points = model, collector, tuple(points)
        self.parameters = len(model.x)
        self._s = [1j * one.frequency / float(record.settings["f0_hz"]) for one in points]
        uncertain = {name: one for name, one in collector.numbers.items() if one[1]}
        self._uncertain = tuple(uncertain)
        self.spread = np.array([tolerance for _, tolerance in uncertain.values()])
        logs = np.log([value for value, _ in uncertain.values()])
        self.coordinates = CollectorCoordinates(model, self._known_to_differ(), logs, self.spread)
        self.x = np.concatenate([model.x, np.zeros(len(collector.devices) * len(model.x)), logs])
        devices = [f"{device.name}.{name}" for device in collector.devices for name in model.names]
        self.names = (*(f"all.{name}" for name in model.names), *devices, *self._uncertain)
        self._placed = lru_cache(maxsize=2)(self._place)

    def responses(self, x: np.ndarray) -> list[np.ndarray]:
        """(K, 2, 2) at the PCC, point by point, at x (X,)."""
        flows = self._placed(self._logs(x))[0]
        return [flow.seen(self._turned(x, m))[0] for m, flow in enumerate(flows)]

    def jacobians(self, x: np.ndarray) -> list[np.ndarray]:
        """(K, 2, 2, X) of them."""
        flows, problems = self._placed(self._logs(x))
        own = [
            one.jacobians(values)
            for one, values in zip(problems, self.coordinates.devices(x), strict=True)
        ]
        jacobians = []
        for m, flow in enumerate(flows):
            parts = []
            for device, rest, (left, right), slopes in zip(
                self.collector.devices,
                flow.rests,
                flow.seen(self._turned(x, m))[1],
                own,
                strict=True,
            ):
                turn = rotation(rest.angle).T
                # one of each for all frequencies where nothing lies between device and PCC
                left, right = (
                    np.broadcast_to(one, slopes[m].shape[:3])
                    for one in (device.rating * left @ turn, turn.T @ right)
                )
                parts.append(
                    np.moveaxis(
                        left[:, None] @ np.moveaxis(slopes[m], -1, 1) @ right[:, None], 1, -1
                    )
                )
            jacobians.append(np.concatenate([sum(parts), *parts], axis=-1))
        here = self.responses(x)
        for j in range(len(self.x) - len(self.spread), len(self.x)):
            there = self.responses(x + STEP * (np.arange(len(x)) == j))
            further = [
                ((moved - one) / STEP)[..., None] for moved, one in zip(there, here, strict=True)
            ]
            jacobians = [
                np.concatenate(both, axis=-1) for both in zip(jacobians, further, strict=True)
            ]
        return jacobians

    def behind(self, device: int, point: PointSweep, m: int) -> PointSweep:
        """What one device has to be for the plant to be as measured at the m-th point, the others
        being as in the record: its own point, admittance and, to first order, sigma, per unit of
        its rating.
        """
        flow, answers = self._placed(self._logs(self.x))[0][m], self._turned(self.x, m)
        rest, (left, right) = flow.rests[device], flow.seen(answers)[1][device]
        turn, rating = rotation(rest.angle).T, self.collector.devices[device].rating
        before, after = turn.T @ np.linalg.inv(left), np.linalg.inv(right) @ turn
        sigma = None if point.sigma is None else propagate(before, point.sigma, after) / rating
        op = OperatingPoint(point.op.name, rest.p, rest.q, rest.v)
        needed = turn.T @ flow.needed(point.admittance, device, answers) @ turn / rating
        return PointSweep(op, point.frequency, needed, sigma=sigma)

    def rests(self, device: int) -> dict[str, WorkingPoint]:
        """Where a device works at each point."""
        flows = self._placed(self._logs(self.x))[0]
        return {
            one.op.name: flow.rests[device] for one, flow in zip(self.points, flows, strict=True)
        }

    def _turned(self, x: np.ndarray, m: int) -> list[np.ndarray]:
        """Of each device at a point, in the frame of the PCC and per unit of the plant."""
        flows, problems = self._placed(self._logs(x))
        turns = [rotation(rest.angle).T for rest in flows[m].rests]
        whole = zip(
            self.collector.devices, turns, problems, self.coordinates.devices(x), strict=True
        )
        return [
            device.rating * turn @ problem.response(own, m, problem.points[m].omega) @ turn.T
            for device, turn, problem, own in whole
        ]

    def _logs(self, x: np.ndarray) -> tuple[float, ...]:
        return tuple(x[len(x) - len(self.spread) :])

    def _place(self, logs: tuple[float, ...]) -> tuple[list[Flow], list[Problem]]:
        """The network at every point, and the model at each device's own points, which the network
        decides.
        """
        known = {name: value for name, (value, _) in self.collector.numbers.items()}
        numbers = known | dict(zip(self._uncertain, np.exp(logs), strict=True))
        flows = [
            self.collector.at(one.op, s, numbers)
            for one, s in zip(self.points, self._s, strict=True)
        ]
        problems = []
        for rests in zip(*(flow.rests for flow in flows), strict=True):
            ops = [
                OperatingPoint(one.op.name, at.p, at.q, at.v)
                for one, at in zip(self.points, rests, strict=True)
            ]
            points = [
                replace(one, op=op, sigma=None) for one, op in zip(self.points, ops, strict=True)
            ]
            problems.append(self._model.problem(points))
        return flows, problems

    def _known_to_differ(self) -> np.ndarray:
        """(N, P) by how much a device's coordinates differ from the record's."""
        model, offsets = self._model, []
        for device in self.collector.devices:
            if strange := set(device.values) - set(model.names):
                names = ", ".join(sorted(strange))
                raise IbridError(
                    f"{device.name} has values of {names}, which the record's model does not have"
                )
            boxes = zip(model.names, model.coordinates.low, model.coordinates.high, strict=True)
            for name, low, high in (
                (name, low, high) for name, low, high in boxes if name in device.values
            ):
                if not low <= device.values[name] <= high:
                    raise IbridError(
                        f"{name} of {device.name} must lie in the box of the parameter, {low:g} to "
                        f"{high:g}; found "
                        f"{device.values[name]:g}"
                    )
            theta = model.coordinates.to_theta(model.x)
            own = [
                device.values.get(name, value)
                for name, value in zip(model.names, theta, strict=True)
            ]
            offsets.append(model.coordinates.to_x(np.array(own)) - model.x)
        return np.array(offsets)
