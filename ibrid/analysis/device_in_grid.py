"""An inverter joined with grids: poles of the closed loop, the Nyquist criterion, and ratios at which stability is lost."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.analysis.closed_loop import behind_grid
from ibrid.analysis.critical import FREQUENCY_STEP, CriticalRatio, by_count, crossings, interval
from ibrid.analysis.grid import MeasuredGrid, SeriesRL, of_ratio
from ibrid.analysis.grid_case import GridCase
from ibrid.analysis.linear_model import LinearModel
from ibrid.analysis.modes import STABLE_BELOW, Mode, modes, rightmost
from ibrid.analysis.nyquist import Nyquist, nyquist, start_frequencies
from ibrid.analysis.parametric import Matrices, ParametricModel
from ibrid.analysis.thevenin import terminal_current, thevenin_voltage
from ibrid.analysis.uncertainty import uncertainty
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import OperatingPoint

#: Relative distance from a critical ratio at which the crossing mode is the rightmost one.
BESIDE = 1e-3
#: Poles (rad/s) below this are zero up to rounding; part of the slowest pole that a crossing is resolved to.
ROUNDING, SLOW = 1e-9, 1e-3


@dataclass(frozen=True, eq=False)
class DeviceInGrid:
    """An inverter at one operating point of its record, asked on many grids; what they share is computed once.

    `record` : with `op` among its operating points. `model` : its matrices there.
    """

    record: Record
    op: str
    model: LinearModel

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * np.pi * self.model.f0_hz

    @cached_property
    def parametric(self) -> ParametricModel:
        """Its response with exact delays, and how that depends on the parameters."""
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
        """Modes on an ideal grid, the rightmost first."""
        return modes(self.model.A, self.model.states, self._slopes(lambda matrices: matrices[0]))

    @cached_property
    def poles(self) -> np.ndarray:
        """(n,) on an ideal grid, rad/s."""
        return np.linalg.eigvals(self.model.A)

    @property
    def unstable(self) -> int:
        """Number of unstable poles on an ideal grid."""
        return int((np.real(self.poles) >= STABLE_BELOW).sum())

    @cached_property
    def _current(self) -> np.ndarray | None:
        return terminal_current(self.record, self.op)

    def _joined(self, grid: SeriesRL) -> tuple[np.ndarray, tuple[str, ...]]:
        found, added = behind_grid(self.model.A, self.model.B, self.model.C, self.model.D, grid)
        return found, (*self.model.states, *added)

    def _slopes(self, of: Callable[[Matrices], np.ndarray]) -> list[np.ndarray] | None:
        return None if self.directions is None else self.parametric.matrix_slopes(self.directions, of)

    def criterion(self, grid: SeriesRL | MeasuredGrid) -> Nyquist:
        """The generalised Nyquist criterion, from responses alone but for the number of open-loop unstable poles."""
        at = start_frequencies(self.poles)
        if isinstance(grid, MeasuredGrid):
            at = np.unique(np.concatenate([at, grid.frequency]))
        growth = int(np.linalg.matrix_rank(self.model.D))
        return nyquist(self.parametric.admittance, grid.impedance, at, open_loop_unstable=self.unstable, growth=growth)

    def on(self, grid: SeriesRL | MeasuredGrid) -> GridCase:
        """Everything about one grid."""
        if not isinstance(grid, SeriesRL):
            return GridCase(grid, None, self.criterion(grid), None)
        A, states = self._joined(grid)
        thevenin = None if self._current is None else thevenin_voltage(self.model.v, self._current, grid)
        slopes = self._slopes(lambda matrices: behind_grid(*matrices, grid)[0])
        return GridCase(grid, modes(A, states, slopes), self.criterion(grid), thevenin)

    def locus(self, scr: np.ndarray, xr: float) -> tuple[np.ndarray, np.ndarray]:
        """The ratios (L,) and the closed-loop poles (L, m), rad/s."""
        return scr, np.array(
            [np.linalg.eigvals(self._joined(of_ratio(float(one), xr, self.omega_0))[0]) for one in scr]
        )

    def critical(self, low: float, high: float, xr: float) -> tuple[CriticalRatio, ...]:
        """Every ratio between `low` and `high` at which the poles cross, with the Nyquist answer beside each."""

        def on(scr: float) -> SeriesRL:
            return of_ratio(scr, xr, self.omega_0)

        sizes = np.abs(self.poles)
        slowest = float(sizes[sizes > ROUNDING].min(initial=1.0))
        limit = max(ROUNDING, min(STABLE_BELOW, SLOW * slowest))  # a slow pole crosses slowly

        def stable(scr: float) -> bool:
            return rightmost(self._joined(on(scr))[0]).real < limit

        def counted(scr: float) -> bool:
            return self.criterion(on(scr)).stable

        return tuple(
            CriticalRatio(scr, side, mode, by_count(counted, scr), self._interval(on(scr), mode.frequency))
            for scr, side in crossings(stable, low, high)
            for mode in [self._crossing(on(scr), on(scr * (1 + BESIDE) if side == "above" else scr / (1 + BESIDE)))]
        )

    def _crossing(self, grid: SeriesRL, unstable: SeriesRL) -> Mode:
        """The mode on a critical grid that is the rightmost one on a slightly different, unstable grid."""
        A, states = self._joined(grid)
        crossed = rightmost(self._joined(unstable)[0])
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
