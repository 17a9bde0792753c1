"""Ways in which a sweep may be written other than the model means: they look like missing physics and are none.

Each is undone on the data, then the given model is refitted; a verdict needs the fit to be better at every point.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ibrid.measurement.angle_law import usual_mistakes
from ibrid.measurement.conversions import propagate
from ibrid.measurement.sweep import PointSweep, PowerNode, Sweep

FRAME = "frame_misalignment"
_NUMBERS = {"power_scale": "power", "voltage_scale": "voltage", "base_impedance": "factor", FRAME: "angle"}


@dataclass(frozen=True)
class Convention:
    """How the data differ from what the model means; the default: not at all.

    `sign` : -1 when the current counts into the inverter. `q` : -1 when the q axis lags. `factor` : measured admittances are
    so many times too large: another per-unit base. `power`, `voltage` : p and q, and v, are so many times the true ones.
    `node` : where p and q were measured in truth, None as declared. `labels` : pairs of operating points whose labels are
    exchanged.
    `angle` : of the measuring frame, rad: Y' = R(a) Y R(-a), R(a) = [[cos a, sin a], [-sin a, cos a]].
    """

    sign: int = 1
    q: int = 1
    factor: float = 1.0
    labels: tuple[tuple[str, str], ...] = ()
    angle: float = 0.0
    power: float = 1.0
    voltage: float = 1.0
    node: PowerNode | None = None

    @classmethod
    def of(cls, label: str, value: float) -> "Convention":
        """A doubted label of `ibrid.structure.outside.LABELS` at its value."""
        return replace(cls(), **{_NUMBERS[label]: value})

    @classmethod
    def told(cls, labels: Sequence[Mapping[str, Any]], sweep: Sweep) -> "Convention":
        """Of a sweep, what the `labels` of a record made from it say."""
        convention = cls()
        for label in labels:
            if (number := label.get("scale", label.get("angle"))) is not None:
                convention = replace(convention, **{_NUMBERS[label["id"]]: number})
            elif label["id"] == "power_node":
                convention = replace(convention, node=_other_node(sweep))
            else:
                convention = replace(convention, **{"sign" if label["id"] == "current_sign" else "q": -1})
        return convention

    @property
    def ids(self) -> dict[str, dict[str, float]]:
        """Id of each label that is wrong -> its number, where it has one."""
        scales = {label: getattr(self, name) for label, name in _NUMBERS.items() if label != FRAME}
        wrong: dict[str, dict[str, float]] = {
            label: {"scale": value} for label, value in scales.items() if value != 1.0
        }
        wrong |= {"current_sign": {}} if self.sign < 0 else {}
        wrong |= {"q_axis": {}} if self.q < 0 else {}
        wrong |= {"power_node": {}} if self.node else {}
        return wrong | ({FRAME: {"angle": self.angle}} if self.angle else {})

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
        for one, other in self.labels:
            yield f"the labels of {one} and {other} are exchanged", f"Exchange p and q of {one} and {other}."
        if self.factor != 1.0:
            remedy = f"Divide the admittances by {self.factor:.4g}, or correct the base they are referred to."
            yield f"the admittances are {self.factor:.4g} times those on the model's per-unit base", remedy
        if self.power != 1.0:
            words = f"p and q of the file are {self.power:.4g} times the true ones{usual_mistakes(self.power)}"
            yield words, f"Divide the columns p and q by {self.power:.4g}."
        if self.voltage != 1.0:
            words = f"v of the file is {self.voltage:.4g} times the true one{usual_mistakes(self.voltage)}"
            yield words, f"Divide the column v by {self.voltage:.4g} (1 where there is none)."
        if self.node:
            words = f"p and q were measured at the {self.node}, not where the file says"
            yield words, f"Write # power_node: {self.node} at the top of the file."
        if self.angle != 0.0:
            turned = f"{np.degrees(self.angle):.3g} degrees"
            remedy = f"Nothing has to be rewritten: the repaired record keeps the {turned}."
            yield f"the measuring frame is turned by {turned}", remedy

    def undone(self, sweep: Sweep) -> Sweep:
        """The data as the model means them; labels that a sweep lacks stay."""
        by_name = {point.op.name: self._undone(point) for point in sweep.points}
        for label, other in self.labels:
            if label not in by_name or other not in by_name:
                continue
            first, second = by_name[label], by_name[other]
            by_name[label], by_name[other] = replace(second, op=first.op), replace(first, op=second.op)
        node = self.node or sweep.power_node
        return replace(sweep, points=tuple(by_name[name] for name in sweep.names), power_node=node)

    def _undone(self, point: PointSweep) -> PointSweep:
        mirror = np.diag([1.0, float(self.q)])
        turn = rotation(-self.angle)
        response = turn @ point.admittance @ turn.T
        response = self.sign * mirror @ response @ mirror / self.factor
        sigma = None if point.sigma is None else propagate(turn, point.sigma, turn.T) / self.factor
        op = replace(point.op, p=point.op.p / self.power, q=point.op.q / self.power, v=point.op.v / self.voltage)
        return replace(point, op=op, admittance=response, sigma=sigma, repeats=None, larger=())


def rotation(angle: float) -> np.ndarray:
    """R(a), from the grid's frame into one that leads it by `angle` (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def written_otherwise(sweep: Sweep) -> Iterator[Convention]:
    """The conventions without a number to be fitted: signs, the other power node, and pairs of exchanged labels."""
    for sign, q in ((-1, 1), (1, -1), (-1, -1)):
        yield Convention(sign=sign, q=q)
    yield Convention(node=_other_node(sweep))
    for one, other in combinations(sweep.names, 2):
        yield Convention(labels=((one, other),))


def _other_node(sweep: Sweep) -> PowerNode:
    return "pcc" if sweep.power_node == "capacitor" else "capacitor"
