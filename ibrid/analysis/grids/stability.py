"""Stability of an identified inverter in a grid: closed-loop poles and the generalised Nyquist
criterion beside each other.

The operating point at the PCC (v, p, q) stays that of the record; the source behind the grid's
impedance follows.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.analysis.grids.critical import CriticalRatio
from ibrid.analysis.grids.device_in_grid import DeviceInGrid
from ibrid.analysis.grids.grid import MeasuredGrid, SeriesRL, of_ratio
from ibrid.analysis.grids.grid_case import GridCase
from ibrid.analysis.models.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.analysis.models.modes import Mode
from ibrid.analysis.models.validity import bad_fit, beyond_points, measured_frequencies
from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.quality.passivity import Passivity, passivity
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.noise import PointNoise
from ibrid.measurement.sweeps.quantities import hertz, span
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.showing import brief, made_above, shown
from ibrid.writing import PlainData, write_json

SCHEMA = "ibrid.stability/1"
#: Short-circuit ratios where nobody says any: very weak to strong.
USUAL_RATIOS = (1.5, 2.0, 3.0, 5.0, 10.0)
#: Frequencies of the passivity index by default.
PASSIVITY_POINTS = 400
#: Short-circuit ratios of the root locus.
LOCUS_POINTS = 120


@dataclass(frozen=True, eq=False)
class PointStability(Frozen):
    """An inverter at one operating point: alone on an ideal grid, and on each of the grids.

    `ideal` : modes on an ideal grid. `critical` : short-circuit ratios at which stability is lost
    within the range asked.
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

    def plain(self) -> PlainData:
        """For JSON."""
        model = self.model
        return {
            **{name: getattr(model, name) for name in ("op", "p", "q", "v")},
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


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Stability:
    """Answer of `stability`: one part for each operating point; `xr` is None where no ratio was
    asked.
    """

    points: tuple[PointStability, ...]
    xr: float | None
    f0_hz: float
    power_node: str

    @property
    def sentences(self) -> tuple[str, ...]:
        """What it says, one sentence for each operating point."""
        return tuple(sentence(one.op, one.cases, one.critical) for one in self.points)

    def plain(self) -> PlainData:
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
            f"{one.op}: {', '.join(dict.fromkeys(case.grade for case in one.cases))}"
            for one in self.points
        )
        return brief(
            f"<Stability at X/R {'-' if self.xr is None else f'{self.xr:g}'}: {grades}", ">"
        )

    def plot(self, ax: Any = None, op: str | None = None) -> Any:
        """A matplotlib figure, or ax with it: the poles while the short-circuit ratio goes from
        weak to strong.
        """
        return shown(self, "plotting", "stability_plot", ax, op)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the JSON of `ibrid stability --json`, replacing the file atomically."""
        write_json(Path(path), self.plain())

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each operating point and grid: short-circuit ratio,
        grade, stable, vector margin and its frequency in Hz.
        """
        rows = [
            {
                "op": point.op,
                "scr": getattr(case.grid, "scr", None),
                "grade": case.grade,
                "stable": case.stable,
                "vector_margin": case.nyquist.vector_margin,
                "vector_margin_hz": case.nyquist.vector_margin_hz,
            }
            for point in self.points
            for case in point.cases
        ]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def _repr_html_(self) -> str:
        """The answer in sentences and the table over the grids, for notebooks."""
        return shown(self, "pages.notebook", "stability_html")


@takes_kinds
@hearing_interrupts()
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
    scr : ascending short-circuit ratios 1 / |Z| (at 1 per unit of voltage, on the inverter's base),
    X/R = `xr`; `USUAL_RATIOS` when neither these nor a grid are given; with two or more, critical
    ratios are searched between the first and the last.
    grid : instead of `scr`.
    op : points of the record, or "p=..,q=..[,v=..]" elsewhere; all points of the record by default.
    frequency : (K,) Hz of the passivity index; the measured range by default.

    Raises IbridError, OperatingPointError for what cannot be answered.
    """
    asked = np.atleast_1d(np.asarray(scr, dtype=float))
    if grid is not None and len(asked):
        raise IbridError(
            "stability needs either short-circuit ratios or one grid; give one of them"
        )
    if grid is None and not len(asked):
        asked = np.array(USUAL_RATIOS)
    at = None if frequency is None else frequencies_of(frequency)
    names = (op,) if isinstance(op, str) else tuple(op) or tuple(record.parameters) or (None,)
    with whole_record():
        points = tuple(_at_point(record, name, asked, xr, grid, at) for name in names)
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
    at = np.geomspace(low, high, PASSIVITY_POINTS) if frequency is None else frequency
    admittance = PointSweep(
        device.parametric.op, at, device.parametric.admittance(at), predicted=True
    )
    cases, critical, locus = [], (), (np.zeros(0), np.zeros((0, 0), dtype=complex))
    if grid is not None:
        cases.append(device.on(grid))
    else:
        cases += [device.on(of_ratio(float(one), xr, device.model.omega_0)) for one in scr]
        if len(scr) > 1:
            critical = device.critical(float(scr[0]), float(scr[-1]), xr)
            locus = device.locus(np.geomspace(scr[0], scr[-1], LOCUS_POINTS), xr)
    warnings = [
        *bad_fit(record),
        *beyond_points(record, device.parametric.op),
        *case_warnings(cases, high),
    ]
    if device.unstable:
        measured = name in record.settings.get("fitted_points", ())
        warnings.insert(
            0, unstable_warning(name, device.ideal[0], device.unstable, measured=measured)
        )
    index = passivity(admittance, PointNoise("unknown", None, None))
    return PointStability(
        device.model, device.ideal, tuple(cases), critical, locus, at, index, tuple(warnings)
    )


#: Relative width up to which a 95 % interval is not worth a word.
TIGHT = 1e-3


def sentence(op: str, cases: Sequence[GridCase], critical: Sequence[CriticalRatio]) -> str:
    """What stability at an operating point comes to."""
    stable = [case.stable for case in cases]
    first, last = cases[0].grid, cases[-1].grid
    if isinstance(first, MeasuredGrid) or isinstance(last, MeasuredGrid) or len(cases) == 1:
        at = hertz(cases[0].nyquist.vector_margin_hz)
        where = f"on {first.name}" if isinstance(first, MeasuredGrid) else f"at SCR {first.scr:.4g}"
        by = ", by the Nyquist count alone" if isinstance(first, MeasuredGrid) else ""
        slim = (
            f", {' and '.join(cases[0].slim)} at {at}" if cases[0].grade == "barely stable" else ""
        )
        return f"{op}: {graded(cases[0].grade)} {where}{by}{slim}"
    if not critical:
        word = "stable" if all(stable) else "UNSTABLE"
        return (
            f"{op}: {word} on every grid from SCR {first.scr:.4g} to {last.scr:.4g}{_barely(cases)}"
        )
    parts = []
    for ratio in critical:
        band = ""
        if ratio.interval is not None and ratio.interval[1] > ratio.interval[0] * (1 + TIGHT):
            band = f" (95 % {ratio.interval[0]:.4g} to {ratio.interval[1]:.4g})"
        kind = (
            "without oscillation"
            if ratio.mode.frequency == 0
            else f"at {hertz(ratio.mode.frequency)}"
        )
        names = " and ".join(name for name, _ in ratio.mode.states[:2])
        parts.append(f"unstable {ratio.unstable} SCR {ratio.scr:.4g}{band}, {kind} ({names})")
    return f"{op}: {'; '.join(parts)}{_barely(cases)}"


def graded(grade: str) -> str:
    """The word for a grade that a reader cannot pass over."""
    return "UNSTABLE" if grade == "unstable" else grade


def _barely(cases: Sequence[GridCase]) -> str:
    """Where it is barely stable, and the worst of it."""
    barely = [case for case in cases if case.grade == "barely stable"]
    if not barely:
        return ""
    worst = min(barely, key=lambda case: case.nyquist.vector_margin)
    at = hertz(worst.nyquist.vector_margin_hz)
    listed = ", ".join(
        f"{case.grid.scr:.4g}" for case in barely[:4] if not isinstance(case.grid, MeasuredGrid)
    )
    more = f" and {len(barely) - 4} more" if len(barely) > 4 else ""
    return f"; barely stable at SCR {listed}{more}, at worst {' and '.join(worst.slim)} at {at}"


def unstable_warning(op: str, worst: Mode, number: int, *, measured: bool) -> str:
    """What it means that the identified model is unstable by itself; `measured` : the data are from
    this point.
    """
    doubt = (
        "; a device that was measured on a stiff grid at this point was stable, so that this model "
        "cannot be right"
        if measured
        else ""
    )
    return (
        f"the identified model is unstable by itself at {op}, on an ideal grid: {number} "
        f"{'pole' if number == 1 else 'poles'}, "
        f"up to {worst.pole.real:+.3g} rad/s at {hertz(worst.frequency)}; the Nyquist count takes "
        "them in, and "
        f"a grid on which it is stable must hold it{doubt}"
    )


def case_warnings(cases: Sequence[GridCase], highest: float) -> Iterator[str]:
    """Where the answers on grids are less sure than they look; `highest` measured frequency in
    Hz.
    """
    first = [one.modes[0] for one in cases if one.modes]
    beyond = [one for one in first if not one.stable and one.frequency > highest]
    if beyond:
        yield (
            f"an unstable mode at {hertz(beyond[0].frequency)} lies above the highest measured "
            f"frequency, {hertz(highest)}: "
            "the model is an extrapolation there"
        )
    differing = [one for one in cases if one.modes is not None and one.stable != one.nyquist.stable]
    if differing:
        yield (
            f"poles and Nyquist disagree on {len(differing)} of {len(cases)} grids: near a "
            "critical ratio, or because the poles "
            "take delays as Pade forms"
        )
    for case in cases:
        if isinstance(case.grid, MeasuredGrid):
            yield from case.grid.warnings
            low, high = case.grid.frequency[0], case.grid.frequency[-1]
            yield (
                f"the grid is known at {len(case.grid.frequency)} frequencies from "
                f"{span(low, high)}: a resonance between "
                "two of them is not seen, and beyond them the grid is taken to go on as a series R "
                "and L"
            )
        if not case.nyquist.certain:
            yield (
                "a Nyquist locus does not end on the real axis, so that its count is a guess: is a "
                "pole of the model at zero?"
            )
