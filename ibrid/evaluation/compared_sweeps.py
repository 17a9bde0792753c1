"""How far two sweeps agree, such as a simulation's or a state space's and a measured one."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.evaluation.errors_by_part import error_parts
from ibrid.measurement.sweeps.interpolating import common_points, interpolated
from ibrid.measurement.sweeps.quantities import counted, hertz, percent, span
from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep
from ibrid.writing import PlainData, aligned

SCHEMA = "ibrid.compare-sweeps/1"
#: Two sweeps that differ by less are the same but for rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ComparedPoint:
    """An operating point of both sweeps.

    `first`, `second` : its names. `frequencies`, `low_hz`, `high_hz` : those of the second sweep
    within the first. `nrmse` : norm of the difference over that of the second. `worst_entry`,
    `worst_hz`, `worst` : where |Y - Y'| is largest, relative to the norm of the matrix there.
    """

    first: str
    second: str
    frequencies: int
    low_hz: float
    high_hz: float
    nrmse: float
    worst_entry: str
    worst_hz: float
    worst: float


@dataclass(frozen=True)
class ComparedSweeps:
    """`by_entry`, `by_band` : NRMSE of the part, the mean over the points; None of an empty band.

    `only_first`, `only_second` : operating points that the other one lacks.
    """

    points: tuple[ComparedPoint, ...]
    by_entry: Mapping[str, float | None]
    by_band: Mapping[str, float | None]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether nothing but rounding is between them."""
        return all(point.nrmse < _ROUNDING for point in self.points)

    def to_json(self) -> PlainData:
        """The content of `ibrid compare --json` for two sweeps."""
        return {
            "schema": SCHEMA,
            "same": self.same,
            "points": [vars(point) for point in self.points],
            "by_entry": dict(self.by_entry),
            "by_band": dict(self.by_band),
            "only_first": list(self.only_first),
            "only_second": list(self.only_second),
        }


@takes_kinds
def compare_sweeps(first: Sweep, second: Sweep) -> ComparedSweeps:
    """Compare two sweeps point by point, at the frequencies of the second one.

    Points are those of one name, else those of one p, q and v. Where the first sweep has other
    frequencies it is interpolated, linearly in log f.

    Raises SweepError for another nominal frequency, and where no operating point or no frequency is
    in both.
    """
    if first.f0_hz != second.f0_hz:
        raise SweepError(
            f"two sweeps that are compared must have one nominal frequency; found {first.f0_hz:g} "
            f"and {second.f0_hz:g} Hz, correct f0_hz of one."
        )
    pairs = common_points(first, second)
    if not pairs:
        raise SweepError(
            "two sweeps that are compared must have an operating point in common, by name or by p, "
            f"q and v; found {', '.join(first.names)} and {', '.join(second.names)}."
        )
    held = []
    for name, other in pairs:
        point, beside = first.point(name), second.point(other)
        response = interpolated(point.frequency, point.admittance, beside.frequency)
        inside = np.isfinite(response).all(axis=(1, 2))
        if inside.any():
            kept = replace(
                beside,
                frequency=beside.frequency[inside],
                admittance=beside.admittance[inside],
                sigma=None,
            )
            held.append((name, kept, response[inside]))
    if not held:
        raise SweepError(
            "two sweeps that are compared must have frequencies in common; the bands of their "
            "common operating points lie apart."
        )
    parts = error_parts([response for _, _, response in held], tuple(one for _, one, _ in held))
    points = []
    for name, point, response in held:
        size = np.linalg.norm(point.admittance, axis=(1, 2))
        away = np.abs(response - point.admittance) / np.maximum(size, 1e-300)[:, None, None]
        k, row, column = np.unravel_index(int(np.argmax(away)), away.shape)
        entry = next(one for one, place in ENTRIES.items() if place == (row, column))
        grid = point.frequency
        points.append(
            ComparedPoint(
                name,
                point.op.name,
                len(grid),
                float(grid[0]),
                float(grid[-1]),
                parts.by_op[point.op.name],
                entry,
                float(grid[k]),
                float(away[k, row, column]),
            )
        )
    taken = ({one.first for one in points}, {one.second for one in points})
    return ComparedSweeps(
        tuple(points),
        parts.by_entry,
        parts.by_band,
        tuple(name for name in first.names if name not in taken[0]),
        tuple(name for name in second.names if name not in taken[1]),
    )


def format_compared_sweeps(compared: ComparedSweeps) -> str:
    """The comparison as lines for a terminal."""
    rows = [("operating point", "NRMSE", "frequencies", "largest difference")]
    for point in compared.points:
        both = point.second if point.first == point.second else f"{point.first} and {point.second}"
        grid = f"{point.frequencies}, {span(point.low_hz, point.high_hz)}"
        worst = f"{percent(point.worst)} of |Y| in {point.worst_entry} at {hertz(point.worst_hz)}"
        rows.append((both, f"{point.nrmse:.3g}", grid, worst))
    lines = [aligned(rows)]
    for what, parts in (("entry", compared.by_entry), ("band in Hz", compared.by_band)):
        shown = [f"{name} {value:.3g}" for name, value in parts.items() if value is not None]
        lines.append(f"NRMSE by {what}: {', '.join(shown)}")
    for which, names in (("first", compared.only_first), ("second", compared.only_second)):
        if names:
            lines.append(f"only in the {which}: {', '.join(names)}")
    count = counted(len(compared.points), "operating point")
    lines.append(f"the same response at {count}" if compared.same else "different responses")
    return "\n".join(lines)
