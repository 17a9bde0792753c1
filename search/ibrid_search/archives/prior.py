"""What is known of a device before it is looked at: the structures of its fleet, and their typical
values.

Of each parameter the geometric mean's robust form: the median of ln(value) over devices whose own
data determine it, and its spread s, shrunk towards what is believed of any parameter (a factor of
two, as by so many devices as `BELIEVED`). Device n learns from the first `learned_from(n)` alone,
so its answer does not depend on who was faster.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import copysign, exp, log, sqrt
from sys import intern

import numpy as np

from ibrid.analysis.models.parametric import ParametricModel, uncertainty
from ibrid.evaluation.record import Record

#: Devices whose answers all begin without a prior.
FIRST = 8
#: Spread of ln(value) of a parameter of which nothing is known, and the number of devices that it
#: counts for.
ANYTHING, BELIEVED = log(2.0), 3
#: Ends of an interval within this factor: the device's data determine the parameter.
DETERMINED = 4.0
#: From the interquartile range of a normal distribution to its deviation.
QUARTILES = 1.349
#: Grades of a device that others learn from.
TRUSTED = ("explains", "close")


@dataclass(frozen=True)
class DeviceFamily:
    """Devices of one structure.

    `label` : what it is called. `program` : of its first device. `typical` : parameter -> value and
    spread of its logarithm, where at least one device determines it.
    """

    structure: str
    label: str
    program: str
    devices: int
    typical: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The typical values alone."""
        return {name: value for name, (value, _) in self.typical.items()}


@dataclass(frozen=True)
class Prior:
    """What `devices` of a fleet say about the next: its families, the commonest first."""

    devices: int = 0
    families: tuple[DeviceFamily, ...] = ()

    def of(self, structure: str) -> DeviceFamily | None:
        """The family of that structure, if there is one."""
        return next((one for one in self.families if one.structure == structure), None)


@dataclass(frozen=True)
class DeviceAnswer:
    """What a fleet keeps in memory of a device's record: its structure, and the values that its
    data determine.

    Texts are those of other devices where they are equal: of a hundred thousand some kilobytes each
    must fit.
    """

    structure: str
    label: str
    program: str
    grade: str
    values: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, record: Record) -> "DeviceAnswer":
        """values : parameter -> value and deviation of its logarithm, from the 95 % interval."""
        told = record.settings["fleet"]
        point = next(iter(record.parameters), "")
        ends = record.intervals.get(point, {})
        values = {}
        for name, value in record.parameters.get(point, {}).items():
            low, high = ends.get(name) or (0.0, 0.0)
            if low * high > 0 and 1 / DETERMINED < low / high < DETERMINED and value:
                values[intern(name)] = value, abs(log(high / low)) / (2 * 1.96)
        texts = told["structure"], told["diagram"], record.program, record.grade or "fails"
        structure, label, program, grade = map(intern, texts)
        return cls(structure, label, program, grade, values)


def learned_from(number: int) -> int:
    """How many devices, from the first on, device `number` learns from: half of those before it, at
    powers of two.
    """
    return 0 if number < 2 * FIRST else 1 << ((number // 2).bit_length() - 1)


def learned(answers: Iterable[DeviceAnswer], devices: int) -> Prior:
    """The prior that answers give of so many devices, those without an answer included."""
    by_structure: dict[str, list[DeviceAnswer]] = {}
    for answer in answers:
        if answer.grade in TRUSTED:
            by_structure.setdefault(answer.structure, []).append(answer)
    families = [
        DeviceFamily(
            structure, members[0].label, members[0].program, len(members), _typical(members)
        )
        for structure, members in by_structure.items()
    ]
    return Prior(devices, tuple(sorted(families, key=lambda one: (-one.devices, one.structure))))


def _typical(members: list[DeviceAnswer]) -> dict[str, tuple[float, float]]:
    typical = {}
    for name in set().union(*(one.values for one in members)):
        signed = [one.values[name][0] for one in members if name in one.values]
        logarithms = np.log(np.abs(signed))
        if len({copysign(1.0, value) for value in signed}) > 1:
            continue  # a ratio to the typical value means nothing
        low, middle, high = np.percentile(logarithms, (25, 50, 75))
        number = len(signed)
        spread = sqrt(
            (number * ((high - low) / QUARTILES) ** 2 + BELIEVED * ANYTHING**2)
            / (number + BELIEVED)
        )
        typical[name] = copysign(exp(middle), signed[0]), spread
    return dict(sorted(typical.items()))


def joined(record: Record, family: DeviceFamily) -> dict[str, list[float]]:
    """Parameter -> value and 95 % ends where data and prior are taken together, to first order.

    Law: x = x_hat + A w with w standard normal by the data and the boxes, m_j = x_j + s_j e by the
    prior; so w has the covariance C = (I + A' S^-2 A)^-1 and the mean C A' S^-2 (m - x_hat). The
    record itself stays what the data alone say, and the fleet learns from that.
    """
    name = next(iter(record.parameters))
    model = ParametricModel(record, record.point(name))
    sure = uncertainty(record, model)
    if sure is None or not sure.names:
        return {}
    known = [k for k, parameter in enumerate(sure.names) if parameter in family.typical]
    theta = model.coordinates.to_theta(model.x)

    def coordinate(factor: float) -> np.ndarray:
        there = theta.copy()
        there[known] = [
            family.typical[sure.names[k]][0] * exp(factor * family.typical[sure.names[k]][1])
            for k in known
        ]
        return model.coordinates.to_x(np.clip(there, model.coordinates.low, model.coordinates.high))

    mean, spread = coordinate(0.0), np.maximum(np.abs(coordinate(0.5) - coordinate(-0.5)), 1e-6)
    directions = sure.directions
    weighted = directions[known] / spread[known, None] ** 2
    covariance = np.linalg.inv(np.eye(directions.shape[1]) + directions[known].T @ weighted)
    x = model.x + directions @ covariance @ weighted.T @ (mean - model.x)[known]
    deviation = np.sqrt(np.einsum("ij,jk,ik->i", directions, covariance, directions))
    ends = [model.coordinates.to_theta(x + side * 1.96 * deviation) for side in (0.0, -1.0, 1.0)]
    return {name: [float(end[k]) for end in ends] for k, name in enumerate(sure.names)}
