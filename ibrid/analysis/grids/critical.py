"""Critical short-circuit ratios: where a pole pair crosses the imaginary axis, where the Nyquist
count changes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.analysis.grids.nyquist import Response
from ibrid.analysis.models.modes import QUANTILE, Mode
from ibrid.writing import PlainData

#: Short-circuit ratios at which the poles are asked whether they are stable; a window narrower than
#: one step is not seen.
STEPS = 240
#: Relative width to which a crossing is bisected.
WIDTH = 1e-6
#: The Nyquist count is asked at these factors on both sides of a crossing of the poles, until it
#: differs.
AROUND = (1.005, 1.02, 1.1, 1.5)
#: Relative step of the frequency in a derivative, and the widest interval of ln scr that is still
#: given.
FREQUENCY_STEP, WIDEST = 1e-6, 3.0
#: Relative width to which the change of the Nyquist count is bisected.
NYQUIST_WIDTH = 1e-5


@dataclass(frozen=True)
class CriticalRatio:
    """A short-circuit ratio at which stability is lost.

    `scr` : from the poles. `unstable` : "below" or "above" it. `mode` : the one that crosses.
    `scr_nyquist` : where the Nyquist count changes; None where it does not change nearby.
    `interval` : 95 %, None without a covariance.
    """

    scr: float
    unstable: str
    mode: Mode
    scr_nyquist: float | None
    interval: tuple[float, float] | None

    def plain(self) -> PlainData:
        """For JSON."""
        return {
            "scr": self.scr,
            "scr_nyquist": self.scr_nyquist,
            "interval": None if self.interval is None else list(self.interval),
            "unstable": self.unstable,
            "mode": self.mode.plain(),
        }


def crossings(stable: Callable[[float], bool], low: float, high: float) -> list[tuple[float, str]]:
    """(ratio, "below" or "above") wherever `stable` changes between `low` and `high`, to 1e-6."""
    grid = np.geomspace(low, high, STEPS)
    fine = [stable(float(one)) for one in grid]
    return [
        (
            bisected(stable, float(grid[k]), float(grid[k + 1]), WIDTH),
            "above" if fine[k] else "below",
        )
        for k in range(len(grid) - 1)
        if fine[k] != fine[k + 1]
    ]


def bisected(stable: Callable[[float], bool], low: float, high: float, width: float) -> float:
    """The ratio between `low` and `high` at which `stable`, different at both, changes."""
    at_low = stable(low)
    while high > low * (1 + width):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) == at_low else (low, middle)
    return float(np.sqrt(low * high))


def by_count(stable: Callable[[float], bool], near: float) -> float | None:
    """Where the Nyquist verdict changes around `near`; None when it does not within a factor of
    1.5.
    """
    for factor in AROUND:
        low, high = near / factor, near * factor
        if stable(low) != stable(high):
            return bisected(stable, low, high, NYQUIST_WIDTH)
    return None


def interval(
    scr: float, frequency: float, admittance: Response, slopes: Response, impedance: np.ndarray
) -> tuple[float, float] | None:
    """95 % interval of a critical ratio by the delta method, as a factor each way; None where it
    cannot be told.

    At the crossing det(I + L) = 0 with L = -Z Y, Z proportional to 1/scr. Its real and imaginary
    parts give the changes of ln scr and of the frequency for a change of the parameters; at zero
    frequency the real part alone gives that of ln scr.

    Parameters
    ----------
    frequency : of the crossing, Hz. admittance : of the inverter. slopes : its derivatives (K, 2,
    2, R) along independent standard normal directions of the parameters. impedance : (K, 2, 2) of
    the grid just below, at and just above.
    """
    step = FREQUENCY_STEP * frequency
    at = np.array([frequency - step, frequency, frequency + step])
    loop = -impedance @ admittance(at)
    determinant = np.linalg.det(np.eye(2) + loop)
    (a, b), (c, d) = np.eye(2) + loop[1]
    cofactors = np.array([[d, -b], [-c, a]])
    by_ratio = -np.trace(cofactors @ loop[1])
    by_parameters = np.einsum("ij,jk,kir->r", cofactors, -impedance[1], slopes(at[1:2])[0])
    if frequency == 0:
        moved = by_parameters.real / by_ratio.real
    else:
        by_frequency = (determinant[2] - determinant[0]) / (2 * FREQUENCY_STEP)
        columns = np.array([[by_ratio.real, by_frequency.real], [by_ratio.imag, by_frequency.imag]])
        moved = np.linalg.solve(columns, np.stack([by_parameters.real, by_parameters.imag]))[0]
    spread = QUANTILE * float(np.linalg.norm(moved))
    return (float(scr * np.exp(-spread)), float(scr * np.exp(spread))) if spread < WIDEST else None
