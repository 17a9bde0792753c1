"""Ways in which a sweep may be written other than the model means: they look like missing physics
and are none.

Each is undone on the data, then the given model is refitted; a verdict needs the fit to be better
at every point.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np

from ibrid.measurement.conventions.angle_law import usual_mistakes
from ibrid.measurement.conventions.conversions import QUARTER_TURN
from ibrid.measurement.conventions.frequency_base import frequency_readings, possible_frequencies
from ibrid.measurement.conventions.resting_axis import resting_axis
from ibrid.measurement.conventions.rotation import propagate, rotation
from ibrid.measurement.sweeps.noise import estimate
from ibrid.measurement.sweeps.sweep import PointSweep, PowerNode, Sweep

FRAME = "frame_misalignment"
FREQUENCY, AXES, ROTATION = "frequency_base", "axes_exchanged", "frame_rotation"
#: Largest angle (rad) of a frame that is called misaligned; beyond it, and where it differs by
#: operating point, it is rotated.
MISALIGNED = 0.6
#: Angles of a frame (rad) about which a misalignment is looked for beyond the usual one.
SECTORS = (np.pi / 3, -np.pi / 3)
_NUMBERS = {
    "power_scale": "power",
    "voltage_scale": "voltage",
    "base_impedance": "factor",
    FRAME: "angle",
}
#: Key of a label's number in records and answers.
_KEYS = ("scale", "angle", "f0_hz")


@dataclass(frozen=True)
class Convention:
    """How the data differ from what the model means; the default: not at all.

    `sign` : -1 when the current counts into the inverter. `q` : -1 when the q axis lags. `factor` :
    measured admittances are so many times too large: another per-unit base. `power`, `voltage` : p
    and q, and v, are so many times the true ones.
    `node` : where p and q were measured in truth, None as declared. `labels` : pairs of operating
    points whose labels are exchanged.
    `angle` : of the measuring frame, rad: Y' = R(a) Y R(-a), R(a) = [[cos a, sin a], [-sin a, cos
    a]]. `angles` : the same at operating points by name, where it differs; it comes on top.
    `axes` : -1 when the voltage at rest lies on q: a frame at 90 degrees; with a q axis that lags,
    d and q are exchanged.
    `frequency` : the nominal one in truth, Hz; None as declared.
    """

    sign: int = 1
    q: int = 1
    factor: float = 1.0
    labels: tuple[tuple[str, str], ...] = ()
    angle: float = 0.0
    power: float = 1.0
    voltage: float = 1.0
    node: PowerNode | None = None
    axes: int = 1
    frequency: float | None = None
    angles: tuple[tuple[str, float], ...] = ()

    @classmethod
    def of(cls, label: str, value: float) -> "Convention":
        """A doubted label of `ibrid.structure.network.outside.LABELS` at its value."""
        return replace(cls(), **{_NUMBERS[label]: value})

    @classmethod
    def told(cls, labels: Sequence[Mapping[str, Any]], sweep: Sweep) -> "Convention":
        """Of a sweep, what the `labels` of a record made from it say."""
        fields = {
            **_NUMBERS,
            ROTATION: "angle",
            FREQUENCY: "frequency",
            "current_sign": "sign",
            "q_axis": "q",
            AXES: "axes",
        }
        convention = cls()
        for label in labels:
            if label["id"] == "power_node":
                convention = replace(convention, node=_other_node(sweep))
                continue
            if label.get("angles"):
                convention = replace(convention, angles=tuple(label["angles"].items()))
                continue
            number = next((label[key] for key in _KEYS if label.get(key) is not None), -1)
            convention = replace(convention, **{fields[label["id"]]: number})
        return convention

    @property
    def ids(self) -> dict[str, dict[str, Any]]:
        """Id of each label that is wrong -> its number, where it has one; of a frame that differs
        its numbers by operating point.
        """
        scales = {label: getattr(self, name) for label, name in _NUMBERS.items() if label != FRAME}
        wrong: dict[str, dict[str, Any]] = {
            label: {"scale": value} for label, value in scales.items() if value != 1.0
        }
        wrong |= {"current_sign": {}} if self.sign < 0 else {}
        wrong |= {"q_axis": {}} if self.q < 0 else {}
        wrong |= {AXES: {}} if self.axes < 0 else {}
        wrong |= {"power_node": {}} if self.node else {}
        wrong |= {FREQUENCY: {"f0_hz": self.frequency}} if self.frequency else {}
        wrong |= {ROTATION: {"angles": dict(self.angles)}} if self.angles else {}
        frame = FRAME if abs(self.angle) <= MISALIGNED else ROTATION
        return wrong | ({frame: {"angle": self.angle}} if self.angle else {})

    @property
    def turned(self) -> bool:
        """True where the measuring frame is turned."""
        return bool(self.angle or self.angles)

    def angle_at(self, name: str) -> float:
        """Of the measuring frame at an operating point, rad."""
        return self.angle + dict(self.angles).get(name, 0.0)

    @property
    def equivalents(self) -> dict[str, tuple[str, ...]]:
        """Id of a label that is wrong -> ids of what does the same to data: another name of a
        quarter turn, and decoupling without delay, which takes as much from what couples the axes
        as a lower frequency does.
        """
        turned = {AXES: (ROTATION,)} if self.axes < 0 and self.q > 0 else {}
        return turned | ({FREQUENCY: ("decoupling",)} if self.frequency else {})

    @property
    def words(self) -> str:
        """What is different, in words."""
        return " and ".join(different for different, _ in self._told) or "as declared"

    @property
    def remedy(self) -> str:
        """What to write into the file of the data, as sentences."""
        return " ".join(remedy for _, remedy in self._told)

    @property
    def _told(self) -> Iterator[tuple[str, str]]:
        """What is different, and what to do about it."""
        if self.sign < 0:
            remedy = "Write # current: in at the top of the file, or out where it says in."
            yield "the current counts into the inverter", remedy
        if self.q < 0:
            yield (
                "the q axis lags the d axis",
                "Write # q_axis: lags at the top of the file, or leads where it says lags.",
            )
        if self.axes < 0:
            other = (
                "with that, d and q are exchanged"
                if self.q < 0
                else "or the frame is turned by +-90 degrees"
            )
            yield (
                f"the voltage at rest lies on the q axis ({other})",
                "Write # voltage_axis: q at the top of the file, or d where it says q.",
            )
        if self.frequency:
            remedy = f"Write # f0_hz: {self.frequency:g} at the top of the file."
            yield f"the nominal frequency is {self.frequency:g} Hz, not what the file says", remedy
        for one, other in self.labels:
            yield (
                f"the labels of {one} and {other} are exchanged",
                f"Exchange p and q of {one} and {other}.",
            )
        if self.factor != 1.0:
            remedy = (
                f"Divide the admittances by {self.factor:.4g}, or correct the base they are "
                "referred to."
            )
            yield (
                f"the admittances are {self.factor:.4g} times those on the model's per-unit base",
                remedy,
            )
        if self.power != 1.0:
            words = (
                f"p and q of the file are {self.power:.4g} times the true "
                f"ones{usual_mistakes(self.power)}"
            )
            yield words, f"Divide the columns p and q by {self.power:.4g}."
        if self.voltage != 1.0:
            words = (
                f"v of the file is {self.voltage:.4g} times the true "
                f"one{usual_mistakes(self.voltage)}"
            )
            yield words, f"Divide the column v by {self.voltage:.4g} (1 where there is none)."
        if self.node:
            words = f"p and q were measured at the {self.node}, not where the file says"
            yield words, f"Write # power_node: {self.node} at the top of the file."
        if self.angle != 0.0:
            turned = f"{np.degrees(self.angle):.3g} degrees"
            remedy = f"Nothing has to be rewritten: the repaired record keeps the {turned}."
            if abs(self.angle) > MISALIGNED:
                remedy += (
                    f" Or write # frame_deg: {np.degrees(self.angle):.3g} at the top of the file."
                )
            yield f"the measuring frame is turned by {turned}", remedy
        if self.angles:
            degrees = [f"{np.degrees(angle):.3g}" for _, angle in self.angles]
            points = zip(degrees, self.angles, strict=True)
            turned = ", ".join(f"{number} degrees at {name}" for number, (name, _) in points)
            remedy = (
                f"Write # frame_deg: {', '.join(degrees)} at the top of the file; the repaired "
                "record keeps them."
            )
            yield f"the measuring frame is turned by {turned}", remedy

    def undone(self, sweep: Sweep) -> Sweep:
        """The data as the model means them; labels that a sweep lacks stay."""
        by_name = {point.op.name: self._undone(point) for point in sweep.points}
        for label, other in self.labels:
            if label not in by_name or other not in by_name:
                continue
            first, second = by_name[label], by_name[other]
            by_name[label], by_name[other] = (
                replace(second, op=first.op),
                replace(first, op=second.op),
            )
        node = self.node or sweep.power_node
        f0_hz = self.frequency or sweep.f0_hz
        return replace(
            sweep, points=tuple(by_name[name] for name in sweep.names), power_node=node, f0_hz=f0_hz
        )

    def written(self, response: np.ndarray, name: str = "") -> np.ndarray:
        """Admittances (K, 2, 2) as the model means them, as the data are written.

        name : of the operating point.
        """
        turn = self._turn(name)
        return self.sign * self.factor * turn @ response @ turn.T

    def _turn(self, name: str) -> np.ndarray:
        """A vector as the model means it, in the frame of the data: its own axes, then the side of
        q, then the angle.
        """
        mirror = np.diag([1.0, float(self.q)])
        axes = QUARTER_TURN if self.axes < 0 else np.eye(2)
        return rotation(self.angle_at(name)) @ mirror @ axes

    def _undone(self, point: PointSweep) -> PointSweep:
        turn = self._turn(point.op.name).T
        response = self.sign * (turn @ point.admittance @ turn.T) / self.factor
        sigma = None if point.sigma is None else propagate(turn, point.sigma, turn.T) / self.factor
        op = replace(
            point.op,
            p=point.op.p / self.power,
            q=point.op.q / self.power,
            v=point.op.v / self.voltage,
        )
        return replace(point, op=op, admittance=response, sigma=sigma, repeats=None, larger=())


def written_otherwise(sweep: Sweep) -> Iterator[Convention]:
    """The conventions without a number to be fitted: signs, axes, the other power node, pairs of
    exchanged labels, and nominal frequencies; of axes and frequencies those that the data leave
    open before anything is fitted.
    """
    noise = estimate(sweep)
    seen = resting_axis(sweep, noise)
    possible = {None: (1, -1), "d": (1,), "q": (-1,)}[seen and seen.axis]
    for axes, q, sign in product(possible, (1, -1), (1, -1)):
        if (axes, q, sign) != (1, 1, 1):
            yield Convention(sign=sign, q=q, axes=axes)
    yield Convention(node=_other_node(sweep))
    for frequency in possible_frequencies(frequency_readings(sweep, noise), sweep.f0_hz):
        yield Convention(frequency=frequency)
    for one, other in combinations(sweep.names, 2):
        yield Convention(labels=((one, other),))


def _other_node(sweep: Sweep) -> PowerNode:
    return "pcc" if sweep.power_node == "capacitor" else "capacitor"
