"""What a frequency grid can show: the loops it covers, the resonances it steps over, the lines it
falls on.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.measurement.sweeps.noise import DENSE, PointNoise, points_per_decade
from ibrid.measurement.sweeps.sweep import PointSweep

LOOPS: tuple[tuple[str, float, float], ...] = (
    ("outer power loops", 0.0, 10.0),
    ("synchronisation (PLL)", 5.0, 100.0),
    ("current loop", 100.0, 1000.0),
    ("filter resonance, delay", 1000.0, np.inf),
)
"""Where the loops of most inverters act, Hz; a rule of thumb, a 400 Hz or a small fast inverter has
them higher.
"""

ENOUGH = 5
"""Points that a loop needs: two or three parameters each, in two to four complex entries."""


@dataclass(frozen=True)
class LoopCoverage:
    """How many points lie where a loop usually acts. low, high : Hz."""

    loop: str
    low: float
    high: float
    points: int

    @property
    def verdict(self) -> str:
        """ "none", "few" or "good"."""
        return "none" if not self.points else "few" if self.points < ENOUGH else "good"


def loop_coverage(frequency: np.ndarray) -> tuple[LoopCoverage, ...]:
    """Points per loop; frequency : (K,) Hz."""
    return tuple(
        LoopCoverage(name, low, high, int(((frequency >= low) & (frequency <= high)).sum()))
        for name, low, high in LOOPS
    )


@dataclass(frozen=True)
class Resonance:
    """A peak of ||Y|| at least twice as high as its surroundings; points : those above 1/sqrt(2) of
    it.
    """

    frequency: float
    points: int


def resonances(point: PointSweep, noise: PointNoise) -> tuple[Resonance, ...]:
    """Peaks that stand twice above the lowest value on each side before the next higher one, and
    above the noise.
    """
    size = np.linalg.norm(point.admittance, axis=(1, 2))
    level = np.zeros(len(size)) if noise.relative is None else noise.relative
    peaks = []
    for k in range(1, len(size) - 1):
        if size[k] <= size[k - 1] or size[k] < size[k + 1]:
            continue
        left = _lowest_before_higher(size[k::-1])
        right = _lowest_before_higher(size[k:])
        if max(left, right) > size[k] / (2 + 10 * level[k]):
            continue
        above = size >= size[k] / np.sqrt(2)
        width = 1 + _run(above[k + 1 :]) + _run(above[k - 1 :: -1])
        peaks.append(Resonance(float(point.frequency[k]), width))
    return tuple(peaks)


def _lowest_before_higher(sizes: np.ndarray) -> float:
    higher = np.flatnonzero(sizes > sizes[0])
    return float(sizes[: higher[0] if len(higher) else None].min())


def _run(flags: np.ndarray) -> int:
    """How many of the first flags hold."""
    gaps = np.flatnonzero(~flags)
    return int(gaps[0]) if len(gaps) else len(flags)


@dataclass(frozen=True)
class HarmonicLine:
    """A point on a multiple of f0, where background harmonics disturb a measurement.

    order : the multiple, in the dq frame.
    outlying : whether it sticks out of its neighbours; None where the grid is too coarse to say.
    """

    frequency: float
    order: int
    outlying: bool | None


def harmonic_lines(
    point: PointSweep, f0_hz: float, tolerance: float = 0.01
) -> tuple[HarmonicLine, ...]:
    """Points within `tolerance` f0 of a multiple of f0, up to the 50th."""
    order = np.round(point.frequency / f0_hz)
    near = (
        (np.abs(point.frequency - order * f0_hz) <= tolerance * f0_hz)
        & (order >= 1)
        & (order <= 50)
    )
    sticking = outliers(point)
    return tuple(
        HarmonicLine(
            float(point.frequency[k]),
            int(order[k]),
            None if sticking is None else bool(sticking[k]),
        )
        for k in np.flatnonzero(near)
    )


def outliers(point: PointSweep, factor: float = 6.0) -> np.ndarray | None:
    """(K,) single points that stick out of their neighbours; None where the grid has fewer than 15
    points a decade.

    What a point should be is the median of the three straight lines between its first, second and
    third neighbours on either side, in log f, so that one bad neighbour is outvoted. It sticks out
    when it misses that by 6 times what is usual around it and each of its two neighbours by less
    than a third of that (else it is a peak).
    """
    count = len(point.frequency)
    if points_per_decade(point.frequency) < DENSE or count < 15:
        return None
    position = np.log(point.frequency)
    values = point.admittance.reshape(count, 4).view(float)
    size = np.linalg.norm(values, axis=1)
    size = np.maximum(size, size.max() * 1e-12)
    inner = np.arange(3, count - 3)
    lines = []
    for step in (1, 2, 3):
        before, after = inner - step, inner + step
        share = (position[inner] - position[before]) / (position[after] - position[before])
        lines.append(values[before] + share[:, None] * (values[after] - values[before]))
    miss = np.zeros(count)
    miss[inner] = np.linalg.norm(values[inner] - np.median(lines, axis=0), axis=1) / size[inner]
    around = np.full(count + 14, np.nan)
    around[inner + 7] = miss[inner]
    usual = np.nanmedian(np.lib.stride_tricks.sliding_window_view(around, 15), axis=1)
    beside = np.maximum(np.roll(miss, 1), np.roll(miss, -1))
    return (miss > factor * np.maximum(usual, 1e-6)) & (miss > 3 * beside)
