"""Complex numbers of which a cell holds magnitude and angle, as 0.5∠-45°; degrees by convention."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.errors import SweepError

_POLAR = re.compile(r"([-+.\deE]+)[∠<]([-+.\deE]+)(°|deg|rad)?")
#: As LTspice exports a sweep: (-1.2e+01dB,9.0e+01°), or real and imaginary part with a comma.
_IN_DECIBELS = re.compile(r"\(([-+.\deE]+)dB,([-+.\deE]+)°?\)")
_IN_PARTS = re.compile(r"([-+]?\d+\.\d+(?:[eE][-+]\d+)),([-+]?\d+\.\d+(?:[eE][-+]\d+))")
#: Characters of which one is in every polar cell.
SIGNS = "∠<"
#: Angles up to this may be degrees or radians.
TURN = 2 * np.pi
#: Ten turns, rad: an angle in radians that was not wrapped stays below.
_MOST_RADIANS = 20 * np.pi
#: What is asked where no angle is above a turn in radians, and the answers.
QUESTION = (
    "whether the angles of its polar cells are in degrees or radians (none is above 2 pi)",
    "--polar deg",
    "--polar rad",
)


@dataclass(frozen=True)
class Polar:
    """Magnitude and angle of a cell as they are written; `unit` : "deg", "rad", or "" for none."""

    magnitude: float
    angle: float
    unit: str

    def value(self, *, radians: bool) -> complex:
        """The complex number; radians : whether an angle without a unit is in rad."""
        in_radians = self.unit == "rad" or (radians and not self.unit)
        angle = self.angle if in_radians else np.deg2rad(self.angle)
        return complex(self.magnitude * np.exp(1j * angle))


def polar_of(text: str) -> Polar | None:
    """The parts of a cell with decimal points and without blanks; None where it is not polar."""
    match = _POLAR.fullmatch(text)
    if match is None:
        return None
    unit = "deg" if match[3] == "°" else match[3] or ""
    try:
        return Polar(float(match[1]), float(match[2]), unit)
    except ValueError:
        return None


def spice_number(text: str) -> complex | None:
    """The complex number of a cell that LTspice wrote; None for another."""
    if match := _IN_DECIBELS.fullmatch(text):
        size = 10 ** (float(match[1]) / 20)
        return complex(size * np.exp(1j * np.deg2rad(float(match[2]))))
    if match := _IN_PARTS.fullmatch(text):
        return complex(float(match[1]), float(match[2]))
    return None


def largest_angle(
    columns: Mapping[str, Sequence[Polar | None]], place: Callable[[int, str], str], said: str
) -> float:
    """The largest size of an angle without a unit where none is said, as it is written; else 0.

    place : where a cell stands, for sentences. said : "deg", "rad" or "".

    Raises SweepError for a negative magnitude, and for degrees that are said to be radians.
    """
    largest = 0.0
    for name, cells in columns.items():
        for row, cell in enumerate(cells):
            if cell is None:
                continue
            if cell.magnitude < 0:
                raise SweepError(
                    f"{place(row, name)} must have a magnitude of zero or more; found "
                    f"{cell.magnitude:g} at an angle of {cell.angle:g}, write decibels and angles "
                    "into columns of their own, or turn the angle by half a turn."
                )
            size = abs(cell.angle)
            if size > _MOST_RADIANS and "rad" in (cell.unit, said * (not cell.unit)):
                raise SweepError(
                    f"{place(row, name)} must have its angle in rad, as is said; found "
                    f"{cell.angle:g}, which is in degrees: --polar deg."
                )
            largest = max(largest, size * (not cell.unit and not said))
    return largest
