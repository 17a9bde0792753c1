"""An inverter joined with grids: poles of the closed loop, the Nyquist criterion, and ratios at
which stability is lost.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ibrid.analysis.grids.critical import (
    FREQUENCY_STEP,
    CriticalRatio,
    by_count,
    crossings,
    interval,
)
from ibrid.analysis.grids.grid import J, MeasuredGrid, SeriesRL, of_ratio
from ibrid.analysis.grids.grid_case import GridCase
from ibrid.analysis.grids.nyquist import Nyquist, nyquist, start_frequencies
from ibrid.analysis.models.linear_model import LinearModel
from ibrid.analysis.models.modes import STABLE_BELOW, Mode, modes, rightmost
from ibrid.analysis.models.parametric import Matrices, ParametricModel, uncertainty
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.terminals import behind_terminals
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.branch import BRANCH
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import split_port

#: Smallest singular value of a direct term over the largest that counts as its rank.
RANK = 1e-12
#: Condition number from which on v_PCC does not follow from the states.
SINGULAR = 1e12


def behind_grid(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, grid: SeriesRL
) -> tuple[np.ndarray, tuple[str, ...]]:
    """State matrix of dx/dt = A x + B v, i = C x + D v joined with v = (r + x s/omega_0 + x J) i.

    The grid's inductor is in series with what the inverter has at its terminals. With D = 0 its
    current is C x, which the inverter's states hold already, so no state is added and v follows
    from di/dt = C (A x + B v). Where D passes some combination of v on (a resistive branch at the
    PCC), the same combination of the current is a state of its own.

    Returns the matrix (m, m), m = n + rank D, and the names of the added states.
    Raises IbridError where v does not follow.
    """
    left, sizes, right = np.linalg.svd(D)
    rank = int((sizes > RANK * max(1.0, float(sizes[0]))).sum())
    own, shared = (
        left[:, :rank],
        left[:, rank:],
    )  # combinations of the current: states of the grid, of the inverter
    direct, rest = (
        right[:rank].T,
        right[rank:].T,
    )  # voltage combinations that D passes on, and the others
    l = grid.x / grid.omega_0
    drop = grid.r * np.eye(2) + grid.x * J
    n = len(A)
    # i = own j + shared shared' C x, v = direct u + rest w, u = (j - own' C x) / sizes, over z =
    # (x, j)
    i = np.hstack([shared @ shared.T @ C, own])
    u = np.hstack([-own.T @ C, np.eye(rank)]) / sizes[:rank, None]
    known = direct @ u
    # shared' (l di/dt) = shared' (v - drop i) with shared' di/dt = shared' C (A x + B v)
    through = l * shared.T @ C @ B - shared.T
    forced = (
        np.hstack([l * shared.T @ C @ A, np.zeros((2 - rank, rank))])
        + shared.T @ drop @ i
        + through @ known
    )
    if rank < 2:
        square = through @ rest
        if np.linalg.cond(square) > SINGULAR:
            raise IbridError(
                "the PCC voltage does not follow from the model and the grid: its inductances "
                "cancel; check the parameters"
            )
        v = known - rest @ np.linalg.solve(square, forced)
    else:
        v = known
    top = np.hstack([A, np.zeros((n, rank))]) + B @ v
    # own' l di/dt = own' (v - drop i), i = own j + what the inverter's states hold
    bottom = own.T @ (v - drop @ i) / l
    return np.vstack([top, bottom]), tuple(f"grid.i_{k + 1}" for k in range(rank))


def terminal_current(record: Record, op: str) -> np.ndarray | None:
    """(2,) [i_D, i_Q] that leaves the PCC at an operating point of the record, shunt branches
    included; per unit.

    None for a plant whose equilibrium is not known in closed form.
    """
    settings, values = record.settings, record.parameters[op]
    wiring = record.wiring
    plant = wiring.kinds[wiring.plant]
    if plant.branches is None:
        return None
    at = record.point(op).pqv
    table = parameter_table(wiring, settings["equilibrium"])
    every = parameters_at(wiring, table, values)
    inner = behind_terminals(wiring.outside, wiring.plant, every, at, settings["power_node"])
    if inner.current is not None:
        return np.array(inner.current, dtype=float)
    numbers = every[wiring.plant]
    current = np.array(
        plant_equilibrium(plant, numbers, *inner.point, inner.power_node)["i_g"], dtype=float
    )
    shunts = [
        split_port(source)[0]
        for source in wiring.sources[TERMINAL_CURRENT]
        if source != TERMINAL_VOLTAGE and wiring.kinds[split_port(source)[0]].family == BRANCH
    ]
    if shunts:
        matrices = module_matrices(wiring, every, at, pade_orders={}, **record.physics)
        for name in shunts:  # linear and in the grid frame: its DC gain acts on the voltage itself
            a, b, c, d = (np.array(part, dtype=float) for part in matrices[name])
            current = current + (d - c @ np.linalg.solve(a, b)) @ [at[2], 0.0]
    return current if np.isfinite(current).all() else None


def thevenin_voltage(v: float, current: np.ndarray, grid: SeriesRL) -> float:
    """|v_Th|, per unit, of v_Th = [v, 0] - (r + x J) i."""
    return float(np.linalg.norm(np.array([v, 0.0]) - (grid.r * np.eye(2) + grid.x * J) @ current))


#: Relative distance from a critical ratio at which the crossing mode is the rightmost one.
BESIDE = 1e-3
#: Poles (rad/s) below this are zero up to rounding; part of the slowest pole that a crossing is
#: resolved to.
ROUNDING, SLOW = 1e-9, 1e-3


@dataclass(frozen=True, eq=False)
class DeviceInGrid:
    """An inverter at one operating point of its record, asked on many grids; what they share is
    computed once.

    `record` : with `op` among its operating points. `model` : its matrices there.
    """

    record: Record
    op: str
    model: LinearModel

    @cached_property
    def parametric(self) -> ParametricModel:
        """Its response with exact delays, and how that depends on the parameters."""
        return ParametricModel(
            self.record, OperatingPoint(self.op, self.model.p, self.model.q, self.model.v)
        )

    @cached_property
    def directions(self) -> np.ndarray | None:
        """(P, R) standard deviations of the parameters; None without a covariance of all of
        them.
        """
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
        return (
            None if self.directions is None else self.parametric.matrix_slopes(self.directions, of)
        )

    def criterion(self, grid: SeriesRL | MeasuredGrid) -> Nyquist:
        """The generalised Nyquist criterion, from responses alone but for the number of open-loop
        unstable poles.
        """
        at = start_frequencies(self.poles)
        if isinstance(grid, MeasuredGrid):
            at = np.unique(np.concatenate([at, grid.frequency]))
        growth = int(np.linalg.matrix_rank(self.model.D))
        return nyquist(
            self.parametric.admittance,
            grid.impedance,
            at,
            open_loop_unstable=self.unstable,
            growth=growth,
        )

    def on(self, grid: SeriesRL | MeasuredGrid) -> GridCase:
        """Everything about one grid."""
        if not isinstance(grid, SeriesRL):
            grid = grid.on_base(self.model.s_base_va, self.model.v_base_v)
            return GridCase(grid, None, self.criterion(grid), None)
        A, states = self._joined(grid)
        thevenin = (
            None if self._current is None else thevenin_voltage(self.model.v, self._current, grid)
        )
        slopes = self._slopes(lambda matrices: behind_grid(*matrices, grid)[0])
        return GridCase(grid, modes(A, states, slopes), self.criterion(grid), thevenin)

    def locus(self, scr: np.ndarray, xr: float) -> tuple[np.ndarray, np.ndarray]:
        """The ratios (L,) and the closed-loop poles (L, m), rad/s."""
        return scr, np.array(
            [
                np.linalg.eigvals(self._joined(of_ratio(float(one), xr, self.model.omega_0))[0])
                for one in scr
            ]
        )

    def critical(self, low: float, high: float, xr: float) -> tuple[CriticalRatio, ...]:
        """Every ratio between `low` and `high` at which the poles cross, with the Nyquist answer
        beside each.
        """
        on = partial(of_ratio, xr=xr, omega_0=self.model.omega_0)
        sizes = np.abs(self.poles)
        slowest = float(sizes[sizes > ROUNDING].min(initial=1.0))
        limit = max(ROUNDING, min(STABLE_BELOW, SLOW * slowest))  # a slow pole crosses slowly

        def stable(scr: float) -> bool:
            return rightmost(self._joined(on(scr))[0]).real < limit

        count = partial(by_count, lambda ratio: self.criterion(on(ratio)).stable)
        return tuple(
            CriticalRatio(scr, side, mode, count(scr), self._interval(on(scr), mode.frequency))
            for scr, side in crossings(stable, low, high)
            for mode in [
                self._crossing(
                    on(scr), on(scr * (1 + BESIDE) if side == "above" else scr / (1 + BESIDE))
                )
            ]
        )

    def _crossing(self, grid: SeriesRL, unstable: SeriesRL) -> Mode:
        """The mode on a critical grid that is the rightmost one on a slightly different, unstable
        grid.
        """
        A, states = self._joined(grid)
        crossed = rightmost(self._joined(unstable)[0])
        return min(modes(A, states), key=lambda one: abs(one.pole - crossed))

    def _interval(self, grid: SeriesRL, frequency: float) -> tuple[float, float] | None:
        if (directions := self.directions) is None:
            return None
        at = frequency * np.array([1 - FREQUENCY_STEP, 1.0, 1 + FREQUENCY_STEP])
        return interval(
            grid.scr,
            frequency,
            self.parametric.admittance,
            lambda frequency: self.parametric.slopes(frequency) @ directions,
            grid.impedance(at),
        )
