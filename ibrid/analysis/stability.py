"""Stability of an identified inverter in a grid: closed-loop poles and the generalised Nyquist criterion beside each other.

The operating point at the PCC (v, p, q) stays that of the record; the source behind the grid's impedance follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.analysis.critical import CriticalRatio
from ibrid.analysis.device_in_grid import DeviceInGrid
from ibrid.analysis.grid import MeasuredGrid, SeriesRL, of_ratio
from ibrid.analysis.grid_case import GridCase
from ibrid.analysis.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.analysis.modes import Mode
from ibrid.analysis.stability_words import case_warnings, sentence, unstable_warning
from ibrid.analysis.validity import bad_fit, beyond_points, measured_frequencies
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.noise import PointNoise
from ibrid.measurement.passivity import Passivity, passivity
from ibrid.measurement.sweep import PointSweep
from ibrid.showing import brief, shown

SCHEMA = "ibrid.stability/1"
#: Frequencies of the passivity index by default.
PASSIVITY_POINTS = 400
#: Short-circuit ratios of the root locus.
LOCUS_POINTS = 120


@dataclass(frozen=True, eq=False)
class PointStability:
    """An inverter at one operating point: alone on an ideal grid, and on each of the grids.

    `ideal` : modes on an ideal grid. `critical` : short-circuit ratios at which stability is lost within the range asked.
    `locus` : ratios (L,) over that range and poles (L, m), rad/s; empty without a range.
    `frequency` (K,) Hz and `passivity` : the index min eig of the Hermitian part of -Y.
    """

    model: LinearModel
    ideal: tuple[Mode, ...]
    cases: tuple[GridCase, ...]
    critical: tuple[CriticalRatio, ...]
    locus: tuple[np.ndarray, np.ndarray]
    frequency: np.ndarray
    passivity: Passivity
    warnings: tuple[str, ...]

    @property
    def op(self) -> str:
        """Name of the operating point."""
        return self.model.op

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        model = self.model
        return {
            "op": model.op,
            "p": model.p,
            "q": model.q,
            "v": model.v,
            "ideal_grid": {
                "stable": all(one.stable for one in self.ideal),
                "modes": [one.plain() for one in self.ideal],
            },
            "grids": [one.plain() for one in self.cases],
            "critical": [one.plain() for one in self.critical],
            "passivity": {
                "frequency_hz": self.frequency.tolist(),
                "index": self.passivity.smallest.tolist(),
                "active_bands_hz": [list(one) for one in self.passivity.bands],
            },
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True, eq=False)
class Stability:
    """Answer of `stability`: one part for each operating point; `xr` is None where no ratio was asked."""

    points: tuple[PointStability, ...]
    xr: float | None
    f0_hz: float
    power_node: str

    @property
    def sentences(self) -> tuple[str, ...]:
        """What it says, one sentence for each operating point."""
        return tuple(sentence(one.op, one.cases, one.critical) for one in self.points)

    def plain(self) -> dict[str, Any]:
        """The JSON, schema "ibrid.stability/1"."""
        return {
            "schema": SCHEMA,
            "sentences": list(self.sentences),
            "xr": self.xr,
            "f0_hz": self.f0_hz,
            "power_node": self.power_node,
            "points": [one.plain() for one in self.points],
        }

    def __repr__(self) -> str:
        grades = "; ".join(
            f"{one.op}: {', '.join(dict.fromkeys(case.grade for case in one.cases))}" for one in self.points
        )
        return brief(f"<Stability at X/R {'-' if self.xr is None else f'{self.xr:g}'}: {grades}", ">")

    def plot(self, ax: Any = None, op: str | None = None) -> Any:
        """A matplotlib figure, or ax with it: the poles while the short-circuit ratio goes from weak to strong."""
        return shown(self, "plotting", "stability_plot", ax, op)

    def _repr_html_(self) -> str:
        """The answer in sentences and the table over the grids, for notebooks."""
        return shown(self, "notebook", "stability_html")


def stability(
    record: Record,
    scr: Sequence[float] | np.ndarray = (),
    *,
    xr: float = 10.0,
    grid: SeriesRL | MeasuredGrid | None = None,
    op: str | Sequence[str] = (),
    frequency: np.ndarray | None = None,
) -> Stability:
    """Stability of a record on grids of given short-circuit ratios, or on one given grid.

    Parameters
    ----------
    scr : ascending short-circuit ratios 1 / |Z| (at 1 per unit of voltage, on the inverter's base), X/R = `xr`; with two or
        more, critical ratios are searched between the first and the last.
    grid : instead of `scr`.
    op : points of the record, or "p=..,q=..[,v=..]" elsewhere; all points of the record by default.
    frequency : (K,) Hz of the passivity index; the measured range by default.

    Raises IbridError, OperatingPointError for what cannot be answered.
    """
    asked = np.atleast_1d(np.asarray(scr, dtype=float))
    if (grid is None) == (len(asked) == 0):
        raise IbridError("stability needs either short-circuit ratios or one grid; give one of them")
    names = (op,) if isinstance(op, str) else tuple(op) or tuple(record.parameters) or (None,)
    with whole_record():
        points = tuple(_at_point(record, name, asked, xr, grid, frequency) for name in names)
        return Stability(
            points,
            xr if grid is None else None,
            float(record.settings["f0_hz"]),
            str(record.settings["power_node"]),
        )


def _at_point(
    record: Record,
    op: str | None,
    scr: np.ndarray,
    xr: float,
    grid: SeriesRL | MeasuredGrid | None,
    frequency: np.ndarray | None,
) -> PointStability:
    whole, name = with_point(record, op)
    device = DeviceInGrid(whole, name, linear_model(whole, name))
    low, high = measured_frequencies(record)
    at = np.geomspace(low, high, PASSIVITY_POINTS) if frequency is None else np.asarray(frequency, dtype=float)
    admittance = PointSweep(device.parametric.op, at, device.parametric.admittance(at))
    cases, critical, locus = [], (), (np.zeros(0), np.zeros((0, 0), dtype=complex))
    if grid is not None:
        cases.append(device.on(grid))
    else:
        cases += [device.on(of_ratio(float(one), xr, device.omega_0)) for one in scr]
        if len(scr) > 1:
            critical = device.critical(float(scr[0]), float(scr[-1]), xr)
            locus = device.locus(np.geomspace(scr[0], scr[-1], LOCUS_POINTS), xr)
    warnings = [*bad_fit(record), *beyond_points(record, device.parametric.op), *case_warnings(cases, high)]
    if device.unstable:
        measured = name in record.settings.get("fitted_points", ())
        warnings.insert(0, unstable_warning(name, device.ideal[0], device.unstable, measured=measured))
    return PointStability(
        device.model,
        device.ideal,
        tuple(cases),
        critical,
        locus,
        at,
        passivity(admittance, PointNoise("unknown", None, None)),
        tuple(warnings),
    )
