"""Several devices behind one PCC: a tree of known passive elements, from the PCC inwards, with a
device at each end.

Per unit of the plant, current out. A branch takes a share of the power that enters at the node
before it, so that the operating point of every device follows in closed form; each is a device of
rating r at p/r, q/r whose admittance r R(a) Y R(-a) is turned by the angle a of its terminals. From
there outwards, with Z = R + (s/omega_0 + J) L and i = Y v,

    shunt Y - Y_s    series (1 - Y Z)^-1 Y    transformer Y / ratio^2, then its series
    node: the sum over its branches.

`laws`: dY = left dY_device right along a whole path, a chain of (1 - Y Z)^-1 and (1 - Z Y)^-1.
"""

import cmath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ibrid.analysis.grids.grid import J
from ibrid.assembly.terminals import inwards, resistance_of
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.structure.network.outside import ELEMENTS, PORT, PortElement

_ONE = np.eye(2)


@dataclass(frozen=True)
class Collector:
    """A branch of a network: elements from the outer side inwards, then a device, or a node with
    further branches; or all of it.

    `rating` : of the device, or of all devices behind it, over the base of power of the plant.
    `share` : of the power that enters at the node before it. `values` : of the device's parameters
    that are known to differ. `bases` : VA, V of the plant.
    """

    name: str
    elements: tuple[PortElement, ...] = ()
    branches: tuple["Collector", ...] = ()
    rating: float = 1.0
    share: float = 1.0
    values: Mapping[str, float] = field(default_factory=dict)
    bases: tuple[float | None, float | None] = (None, None)

    @cached_property
    def devices(self) -> tuple["Collector", ...]:
        """The branches that end at a device, in the order of the file."""
        return tuple(branch for branch in self.all() if not branch.branches)

    def all(self) -> Iterator["Collector"]:
        """It and all behind it."""
        yield self
        for branch in self.branches:
            yield from branch.all()

    @cached_property
    def numbers(self) -> Mapping[str, tuple[float, float]]:
        """Name -> value per unit and its tolerance, of every number of every element; a ratio is
        known.
        """
        by_label = {}
        for branch in self.all():
            for k, element in enumerate(branch.elements, start=1):
                for name in ELEMENTS[element.kind]:
                    value = element.values[name]
                    known = name == "ratio" or not value
                    by_label[branch.label(k, name)] = value, 0.0 if known else element.tolerance
        return by_label

    def at(self, op: OperatingPoint, s: np.ndarray, numbers: Mapping[str, float]) -> "Flow":
        """The network when the plant feeds p, q at v into the grid.

        s : (K,) over omega_0. numbers : name -> value.
        """
        elements = {}
        for branch in self.all():
            for k, element in enumerate(branch.elements, start=1):
                values = {name: numbers[branch.label(k, name)] for name in ELEMENTS[element.kind]}
                elements[branch.name, k] = _Element.of(element.kind, values, s)
        return Flow(
            self,
            elements,
            tuple(_rests(self, complex(op.v), complex(op.p, -op.q) / op.v, elements)),
        )

    def label(self, k: int, number: str) -> str:
        """Name of a number of the k-th element, from 1."""
        return ".".join([*([self.name] if self.name else []), PORT, str(k), number])


class WorkingPoint(NamedTuple):
    """Of a device, per unit of its own rating; `angle` : of its terminals before the PCC, rad."""

    p: float
    q: float
    v: float
    angle: float


#: Admittance (K, 2, 2) seen at a node, and (left, right) of each device behind it, each (K, 2, 2).
Seen = tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]


@dataclass(frozen=True)
class Flow:
    """A network at one operating point of the plant. `rests` : of every device."""

    root: Collector
    elements: Mapping[tuple[str, int], "_Element"]
    rests: tuple[WorkingPoint, ...]

    def seen(self, devices: Sequence[np.ndarray]) -> Seen:
        """At the PCC.

        devices : admittance (K, 2, 2) of each, in the frame of the PCC and per unit of the plant.
        """
        return self._seen(self.root, iter(devices))

    def needed(
        self, measured: np.ndarray, device: int, devices: Sequence[np.ndarray]
    ) -> np.ndarray:
        """(K, 2, 2) what one device has to be for the plant to be as measured, where the others are
        as given.

        A change d of it is seen as left (d^-1 - m)^-1 right; the m of the network is read off d =
        1.
        """
        here, laws = self.seen(devices)
        left, right = (np.linalg.inv(one) for one in laws[device])
        tried = [one + _ONE if k == device else one for k, one in enumerate(devices)]
        m = _ONE - np.linalg.inv(left @ (self.seen(tried)[0] - here) @ right)
        change = left @ (measured - here) @ right
        return devices[device] + np.linalg.inv(_ONE + change @ m) @ change

    def _seen(self, branch: Collector, devices: Iterator[np.ndarray]) -> Seen:
        if branch.branches:
            parts = [self._seen(behind, devices) for behind in branch.branches]
            whole, laws = sum(one[0] for one in parts), [law for one in parts for law in one[1]]
        else:
            whole, laws = next(devices), [(_ONE, _ONE)]
        for k in range(len(branch.elements), 0, -1):
            element = self.elements[branch.name, k]
            whole = whole / element.ratio**2
            left = np.linalg.inv(_ONE - whole @ element.series)
            whole = left @ whole
            right = (_ONE + element.series @ whole) / element.ratio
            left = left / element.ratio
            whole = whole - element.shunt
            laws = [(left @ one, other @ right) for one, other in laws]
        return np.asarray(whole), laws


def _rests(
    branch: Collector, v: complex, i: complex, elements: Mapping[tuple[str, int], "_Element"]
) -> Iterator[WorkingPoint]:
    for k in range(1, len(branch.elements) + 1):
        element = elements[branch.name, k]
        inner = inwards(element.kind, element.values, (v.real, v.imag), (i.real, i.imag))
        v, i = complex(*inner[0]), complex(*inner[1])
    for behind in branch.branches:
        yield from _rests(behind, v, behind.share * i, elements)
    if not branch.branches:
        power = v * i.conjugate() / branch.rating
        yield WorkingPoint(power.real, power.imag, abs(v), cmath.phase(v))


@dataclass(frozen=True)
class _Element:
    """`series` (K, 2, 2) impedance on the outer side of an ideal transformer; `shunt` (K, 2, 2)
    admittance.
    """

    kind: str
    values: Mapping[str, float]
    series: np.ndarray
    shunt: np.ndarray
    ratio: float = 1.0

    @classmethod
    def of(cls, kind: str, values: Mapping[str, float], s: np.ndarray) -> "_Element":
        nothing, turned = np.zeros((len(s), 2, 2)), s[:, None, None] * _ONE + J
        if kind == "shunt":
            impedance = resistance_of(values) * _ONE + np.linalg.inv(values["C"] * turned)
            return cls(kind, values, nothing, np.linalg.inv(impedance))
        return cls(
            kind,
            values,
            values["R"] * _ONE + values["L"] * turned,
            nothing,
            values.get("ratio", 1.0),
        )
