"""Stability of an identified inverter in a grid: closed-loop poles and the generalised Nyquist criterion beside each other.

The operating point at the PCC (v, p, q) stays that of the record; the source behind the grid's impedance follows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ibrid.analysis.closed_loop import behind_grid
from ibrid.analysis.critical import FREQUENCY_STEP, CriticalRatio, by_count, crossings, interval
from ibrid.analysis.grid import MeasuredGrid, SeriesRL, of_ratio
from ibrid.analysis.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.analysis.measured_range import beyond_points, measured_frequencies
from ibrid.analysis.modes import STABLE_BELOW, Mode, modes, rightmost
from ibrid.analysis.nyquist import Nyquist, nyquist, start_frequencies
from ibrid.analysis.parametric import Matrices, ParametricModel
from ibrid.analysis.thevenin import terminal_current, thevenin_voltage
from ibrid.analysis.uncertainty import uncertainty
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.noise_estimate import PointNoise
from ibrid.measurement.passivity import Passivity, passivity
from ibrid.measurement.sweep import OperatingPoint, PointSweep

SCHEMA = "ibrid.stability/1"
#: Frequencies of the passivity index by default.
PASSIVITY_POINTS = 400
#: Relative distance from a critical ratio at which the crossing mode is the rightmost one.
BESIDE = 1e-3
#: Poles (rad/s) below this are zero up to rounding; part of the slowest pole that a crossing is resolved to.
ROUNDING, SLOW = 1e-9, 1e-3
#: Short-circuit ratios of the root locus.
LOCUS_POINTS = 120
#: Frequencies between the ends of a measured grid at which the criterion begins.
MEASURED_POINTS = 400


@dataclass(frozen=True, eq=False)
class GridCase:
    """The inverter on one grid.

    `modes` : of the closed loop, the rightmost first; None for a measured impedance, which has no poles. `thevenin` : |v_Th|
    that keeps the operating point, per unit; None where it is not known.
    """

    grid: SeriesRL | MeasuredGrid
    modes: tuple[Mode, ...] | None
    nyquist: Nyquist
    thevenin: float | None

    @property
    def stable(self) -> bool:
        """By the poles; for a measured impedance by the Nyquist count."""
        return self.nyquist.stable if self.modes is None else all(one.stable for one in self.modes)

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        rl = self.grid if isinstance(self.grid, SeriesRL) else None
        return {
            "scr": None if rl is None else rl.scr,
            "r": None if rl is None else rl.r,
            "x": None if rl is None else rl.x,
            "file": None if isinstance(self.grid, SeriesRL) else self.grid.name,
            "thevenin_voltage": self.thevenin,
            "stable": self.stable,
            "modes": None if self.modes is None else [one.plain() for one in self.modes],
            "nyquist": {
                "stable": self.nyquist.stable,
                "certain": self.nyquist.certain,
                "unstable_poles": self.nyquist.unstable_poles,
                "open_loop_unstable": self.nyquist.open_loop_unstable,
                "turns": self.nyquist.turns,
                "vector_margin": self.nyquist.vector_margin,
                "vector_margin_hz": self.nyquist.vector_margin_hz,
                "gain_margin": self.nyquist.gain_margin,
                "phase_margin_deg": self.nyquist.phase_margin,
            },
        }


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
        return tuple(_sentence(one) for one in self.points)

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
    device = _Device(whole, name, linear_model(whole, name))
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
    warnings = [*device.warnings(), *beyond_points(record, device.parametric.op)]
    warnings += _case_warnings(cases, high)
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


@dataclass(frozen=True, eq=False)
class _Device:
    """The inverter at one operating point, what is computed once."""

    record: Record
    op: str
    model: LinearModel

    @property
    def omega_0(self) -> float:
        return 2 * np.pi * self.model.f0_hz

    @cached_property
    def parametric(self) -> ParametricModel:
        return ParametricModel(self.record, OperatingPoint(self.op, self.model.p, self.model.q, self.model.v))

    @cached_property
    def directions(self) -> np.ndarray | None:
        """(P, R) standard deviations of the parameters; None without a covariance of all of them."""
        settings = self.record.settings
        if (settings["parameters"], settings["equilibrium"]) != ("shared", "exact"):
            return None
        found = uncertainty(self.record, self.parametric)
        return None if found is None else found.directions

    @cached_property
    def ideal(self) -> tuple[Mode, ...]:
        return modes(self.model.A, self.model.states, self._slopes(lambda matrices: matrices[0]))

    @cached_property
    def poles(self) -> np.ndarray:
        return np.linalg.eigvals(self.model.A)

    @property
    def unstable(self) -> int:
        return int((self.poles.real >= STABLE_BELOW).sum())

    @cached_property
    def growth(self) -> int:
        return int(np.linalg.matrix_rank(self.model.D))

    @cached_property
    def current(self) -> np.ndarray | None:
        return terminal_current(self.record, self.op)

    def joined(self, grid: SeriesRL) -> tuple[np.ndarray, tuple[str, ...]]:
        found, added = behind_grid(self.model.A, self.model.B, self.model.C, self.model.D, grid)
        return found, (*self.model.states, *added)

    def _slopes(self, of: Callable[[Matrices], np.ndarray]) -> list[np.ndarray] | None:
        return None if self.directions is None else self.parametric.matrix_slopes(self.directions, of)

    def criterion(self, grid: SeriesRL | MeasuredGrid) -> Nyquist:
        if isinstance(grid, SeriesRL):
            at, growth = start_frequencies(self.poles), self.growth
        else:
            at, growth = _within(grid, self.poles), 0
        return nyquist(
            self.parametric.admittance, grid.impedance, at, open_loop_unstable=self.unstable, growth=growth
        )

    def on(self, grid: SeriesRL | MeasuredGrid) -> GridCase:
        if not isinstance(grid, SeriesRL):
            return GridCase(grid, None, self.criterion(grid), None)
        A, states = self.joined(grid)
        thevenin = None if self.current is None else thevenin_voltage(self.model.v, self.current, grid)
        slopes = self._slopes(lambda matrices: behind_grid(*matrices, grid)[0])
        return GridCase(grid, modes(A, states, slopes), self.criterion(grid), thevenin)

    def locus(self, scr: np.ndarray, xr: float) -> tuple[np.ndarray, np.ndarray]:
        return scr, np.array(
            [np.linalg.eigvals(self.joined(of_ratio(float(one), xr, self.omega_0))[0]) for one in scr]
        )

    def critical(self, low: float, high: float, xr: float) -> tuple[CriticalRatio, ...]:
        def on(scr: float) -> SeriesRL:
            return of_ratio(scr, xr, self.omega_0)

        sizes = np.abs(self.poles)
        slowest = float(sizes[sizes > ROUNDING].min(initial=1.0))
        limit = max(ROUNDING, min(STABLE_BELOW, SLOW * slowest))  # a slow pole crosses slowly

        def stable(scr: float) -> bool:
            return rightmost(self.joined(on(scr))[0]).real < limit

        def counted(scr: float) -> bool:
            return self.criterion(on(scr)).stable

        return tuple(
            CriticalRatio(scr, side, mode, by_count(counted, scr), self._interval(on(scr), mode.frequency))
            for scr, side in crossings(stable, low, high)
            for mode in [self._crossing(on(scr), on(scr * (1 + BESIDE) if side == "above" else scr / (1 + BESIDE)))]
        )

    def _crossing(self, grid: SeriesRL, unstable: SeriesRL) -> Mode:
        """The mode on a critical grid that is the rightmost one on a slightly different, unstable grid."""
        A, states = self.joined(grid)
        crossed = rightmost(self.joined(unstable)[0])
        return min(modes(A, states), key=lambda one: abs(one.pole - crossed))

    def _interval(self, grid: SeriesRL, frequency: float) -> tuple[float, float] | None:
        if self.directions is None:
            return None
        directions = self.directions
        at = frequency * np.array([1 - FREQUENCY_STEP, 1.0, 1 + FREQUENCY_STEP])
        return interval(
            grid.scr,
            frequency,
            self.parametric.admittance,
            lambda frequency: self.parametric.slopes(frequency) @ directions,
            grid.impedance(at),
        )

    def warnings(self) -> list[str]:
        if not self.unstable:
            return []
        worst = self.ideal[0].pole
        measured = self.op in self.record.settings.get("fitted_points", ())
        return [
            f"the identified model is unstable by itself at {self.op}, on an ideal grid: {self.unstable} "
            f"{'pole' if self.unstable == 1 else 'poles'}, up to {worst.real:+.3g} rad/s at {abs(worst.imag) / (2 * np.pi):.3g} Hz; "
            "the Nyquist count takes them in, and a grid on which it is stable must hold it"
            + (
                ", but a device that was measured on a stiff grid at this point was stable: then do not trust this model"
                if measured
                else ""
            )
        ]


def _within(grid: MeasuredGrid, poles: np.ndarray) -> np.ndarray:
    """Frequencies of a measured grid's range at which the criterion begins, its own and those around the poles among them."""
    low, high = grid.frequency[0], grid.frequency[-1]
    around = start_frequencies(poles)
    inside = around[(around > low) & (around < high)]
    return np.unique(np.concatenate([grid.frequency, inside, np.geomspace(low, high, MEASURED_POINTS)[1:-1]]))


def _case_warnings(cases: Sequence[GridCase], highest: float) -> list[str]:
    found = []
    beyond = [
        one for one in cases if one.modes and not one.modes[0].stable and one.modes[0].frequency > highest
    ]
    if beyond:
        found.append(
            f"an unstable mode at {beyond[0].modes[0].frequency:.3g} Hz lies above the highest measured frequency, {highest:g} Hz: "  # type: ignore[index]
            "the model is an extrapolation there"
        )
    differing = [one for one in cases if one.modes is not None and one.stable != one.nyquist.stable]
    if differing:
        found.append(
            f"poles and Nyquist disagree on {len(differing)} of {len(cases)} grids: near a critical ratio, or because the poles "
            "take delays as Pade forms"
        )
    for one in cases:
        if isinstance(one.grid, MeasuredGrid):
            found += one.grid.warnings
            low, high = one.grid.frequency[0], one.grid.frequency[-1]
            found.append(
                f"the grid is known from {low:g} to {high:g} Hz, {len(one.grid.frequency)} frequencies, interpolated between "
                "them: a resonance between two of them, and what happens outside, is not judged"
            )
            if not one.nyquist.certain:
                found.append(
                    "the locus does not end near the real axis at the ends of that range, so that the count is a guess; "
                    "measure the grid to lower and higher frequencies"
                )
    return found


def _sentence(one: PointStability) -> str:
    stable = [case.stable for case in one.cases]
    first, last = one.cases[0].grid, one.cases[-1].grid
    if len(one.cases) == 1:
        where = f"{first.name}" if isinstance(first, MeasuredGrid) else f"SCR {first.scr:.4g}"
        by = ", by the Nyquist count alone" if isinstance(first, MeasuredGrid) else ""
        return f"{one.op}: {'stable' if stable[0] else 'UNSTABLE'} on {where}{by}"
    if not one.critical:
        word = "stable" if all(stable) else "UNSTABLE"
        return f"{one.op}: {word} on every grid from SCR {first.scr:.4g} to {last.scr:.4g}"
    parts = []
    for found in one.critical:
        band = "" if found.interval is None else f" (95 % {found.interval[0]:.4g} to {found.interval[1]:.4g})"
        kind = "without oscillation" if found.mode.frequency == 0 else f"at {found.mode.frequency:.3g} Hz"
        names = " and ".join(name for name, _ in found.mode.states[:2])
        parts.append(f"unstable {found.unstable} SCR {found.scr:.4g}{band}, {kind} ({names})")
    return f"{one.op}: {'; '.join(parts)}"
