"""What lies between what was measured and the terminals that a diagram means: labels that may be
wrong, and a port.

From the measurement inwards: scales of p and q, of v and of the admittances and the angle of the
measuring frame, each free when it is doubted; then the port's elements, from the PCC to the filter.
A diagram knows nothing of either.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import exp
from types import MappingProxyType
from typing import Any

from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.modules.kind import Range
from ibrid.writing import PlainData

#: Numbers of each kind of port element, per unit: reactance, susceptance and resistance at the
#: nominal frequency.
ELEMENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"series": ("R", "L"), "shunt": ("R", "C"), "transformer": ("R", "L", "ratio")}
)
#: Factors that a wrong label usually has: right, peak and rms, line and phase, Park's 3/2, Park's
#: 2/3 and sqrt(2/3) in one file, and their inverses.
PEAKS = (1.0, *(power for size in (2**0.5, 3**0.5, 1.5, 1.5**0.5) for power in (size, 1 / size)))
#: Labels that are numbers: the label is so many times the truth (the admittances; p and q; v), or
#: rad of the frame.
LABELS: Mapping[str, Range] = MappingProxyType(
    {
        "power_scale": Range(0.2, 5.0, 1.0, "1", "p and q of the file over the true ones"),
        "voltage_scale": Range(0.4, 2.5, 1.0, "1", "v of the file over the true one"),
        "base_impedance": Range(0.02, 50.0, 1.0, "1", "admittances of the file over the true ones"),
        "frame_misalignment": Range(
            -0.6, 0.6, 0.0, "rad", "angle of the measuring frame before the grid's"
        ),
    }
)
#: The same of each operating point: a frame that stays with the grid's source, or with a fixed
#: reference. The box is wider than the half turn that counts, so that no descent ends at its end.
POINT_LABELS: Mapping[str, Range] = MappingProxyType(
    {
        "frame_rotation": Range(
            -2.0, 2.0, 0.0, "rad", "angle of the measuring frame before the grid's"
        )
    }
)
#: Instance names of the labels and of the port's elements, as in "label.power_scale" and
#: "port.1.R".
LABEL, PORT = "label", "port"


@dataclass(frozen=True)
class PortElement(Frozen):
    """A passive element.

    `kind` : of `ELEMENTS`. `values` : name -> value per unit. `tolerance` : one standard deviation
    of the logarithm of each value but the ratio, 0 where they are known exactly.
    """

    kind: str
    values: Mapping[str, float]
    tolerance: float = 0.0


@dataclass(frozen=True)
class Outside(Frozen):
    """`elements` : from the PCC inwards. `inside` : True when p and q were measured at the device,
    False at the PCC.
    `labels` : the doubted ones, of `LABELS` and `POINT_LABELS`. `known` : label -> number, where it
    was found.
    """

    elements: tuple[PortElement, ...] = ()
    inside: bool = False
    labels: tuple[str, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.elements or self.labels or self.known)

    def numbers(self) -> Iterator[tuple[str, str, float | tuple[Range, float | None]]]:
        """(instance, parameter, value); in place of the value of a free one its box and its
        tolerance.
        """
        for name, box in (*LABELS.items(), *POINT_LABELS.items()):
            if name in self.labels:
                yield LABEL, name, (box, None)
            elif name in self.known:
                yield LABEL, name, float(self.known[name])
        for number, element in enumerate(self.elements, start=1):
            for name in ELEMENTS[element.kind]:
                value, wide = element.values[name], exp(4 * element.tolerance)
                if not element.tolerance or value <= 0 or name == "ratio":
                    yield f"{PORT}.{number}", name, value
                    continue
                box = Range(
                    value / wide,
                    value * wide,
                    value,
                    "pu",
                    f"{name} of element {number} of the port",
                )
                yield f"{PORT}.{number}", name, (box, element.tolerance)

    def to_json(self) -> PlainData:
        """As a record keeps it."""
        elements = [
            {"kind": one.kind, **one.values, "tolerance": one.tolerance} for one in self.elements
        ]
        port = {"power_node": "inside" if self.inside else "outside", "element": elements}
        return {
            "port": port if elements else None,
            "labels": list(self.labels),
            "known": dict(self.known),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Outside":
        """Out of a record; IbridError where it is damaged."""
        try:
            port = data.get("port") or {"element": []}
            elements = tuple(
                PortElement(
                    one["kind"],
                    {name: float(one[name]) for name in ELEMENTS[one["kind"]]},
                    float(one["tolerance"]),
                )
                for one in port["element"]
            )
            labels = tuple(
                name for name in data.get("labels", ()) if name in LABELS or name in POINT_LABELS
            )
            known = {str(name): float(value) for name, value in (data.get("known") or {}).items()}
            return cls(elements, port.get("power_node") == "inside", labels, known)
        except (AttributeError, KeyError, TypeError, ValueError):
            raise IbridError(
                "the record's port is damaged; make it again with ibrid evaluate --port"
            ) from None


NOTHING = Outside()
