"""A device scanned together with the impedance of the grid in series with it: the device alone."""

from dataclasses import replace

import numpy as np

from ibrid.analysis.grids.grid import MeasuredGrid, SeriesRL
from ibrid.errors import SweepError
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep


def without_series_grid(sweep: Sweep, grid: SeriesRL | MeasuredGrid) -> Sweep:
    """Take the impedance of a grid off a sweep of both in series.

    Law: v_PCC = v_source + Z_g i with the current i out of the device, so that i = Y v_PCC answers
    the source as Y_s = (Y^-1 - Z_g)^-1, and Y = (Y_s^-1 + Z_g)^-1.

    Parameters
    ----------
    sweep : of the series, in the frame of the voltage at the PCC; p, q and v are those of the PCC.
    grid : per unit on the base of the sweep.

    Raises
    ------
    SweepError
        The sweep is singular somewhere, or the grid is all of it, so that nothing is left.
    """
    if isinstance(grid, MeasuredGrid):
        grid = grid.on_base(sweep.s_base_va, sweep.v_base_v)
    return replace(sweep, points=tuple(_point(point, grid) for point in sweep.points))


def _point(point: PointSweep, grid: SeriesRL | MeasuredGrid) -> PointSweep:
    series = grid.impedance(point.frequency)
    admittance = _device(point.admittance, series, point.op.name)
    repeats = point.repeats
    if repeats is not None:
        repeats = np.stack([_device(one, series, point.op.name) for one in repeats])
    sigma = None if point.sigma is None else _deviation(point, admittance)
    larger = tuple(_point(one, grid) for one in point.larger)
    return replace(point, admittance=admittance, repeats=repeats, sigma=sigma, larger=larger)


def _device(admittance: np.ndarray, series: np.ndarray, name: str) -> np.ndarray:
    """(K, 2, 2) the admittance of the device alone."""
    try:
        return np.linalg.inv(np.linalg.inv(admittance) + series)
    except np.linalg.LinAlgError:
        raise SweepError(
            f"operating point {name}: the impedance of the grid must be a part of what was "
            "measured; nothing is left at some frequency, check the values of the grid."
        ) from None


def _deviation(point: PointSweep, device: np.ndarray) -> np.ndarray:
    """(K, 2, 2) standard deviations of the device's parts: dY = M dY_s N with M = Y Y_s^-1 and
    N = Y_s^-1 Y, parts of entries taken as independent.
    """
    whole = np.linalg.inv(point.admittance)
    left, right = np.abs(device @ whole) ** 2, np.abs(whole @ device) ** 2
    return np.sqrt(left @ np.asarray(point.sigma) ** 2 @ right)
