"""The generalised Nyquist criterion on the eigenloci of Z_grid (-Y): no poles of the closed loop
are needed.

L = Z (-Y), the grid's impedance times the load admittance of the inverter. With P unstable poles of
Y, the closed loop has P - W of them, W counter-clockwise turns of det(I + L) round zero while omega
goes from minus to plus infinity; these are the turns of both eigenloci round -1 together.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.frozen import Frozen

Response = Callable[[np.ndarray], np.ndarray]  # frequencies (K,) Hz -> (K, 2, 2) complex

#: Largest turn of det(I + L) between neighbouring frequencies, rad, before one is put between them.
TURN = 0.3
#: Rounds of halving at most; then neighbours are as near as rounding allows.
ROUNDS = 48
#: Frequencies at most: where the numbers are too large for their rounding, every turn is wide and
#: halving would not end.
MOST = 100_000
#: Distance of both ends of the locus from the real axis, rad, up to which the count is certain.
REAL = 0.15


@dataclass(frozen=True, eq=False)
class Nyquist(Frozen):
    """Answer of `nyquist`.

    `frequency` (K,) Hz, positive; those below zero are the mirror image. `loci` (K, 2) complex
    eigenvalues of L, each column continuous. `turns` : W. `open_loop_unstable` : P. `certain` :
    det(I + L) turns in small steps and ends near the real axis at both ends of the frequencies, so
    that the count is a whole number by itself. `vector_margin` : smallest distance of a locus from
    -1, reached at `vector_margin_hz`. `gain_margin` : factor on the impedance that makes a locus
    pass -1, the nearest above 1; None when no larger one does. `phase_margin` : smallest angle in
    degrees between a locus of size 1 and -1; None without.
    """

    frequency: np.ndarray
    loci: np.ndarray
    turns: int
    open_loop_unstable: int
    certain: bool
    vector_margin: float
    vector_margin_hz: float
    gain_margin: float | None
    phase_margin: float | None

    @property
    def unstable_poles(self) -> int:
        """Of the closed loop, P - W; none: stable."""
        return self.open_loop_unstable - self.turns

    @property
    def stable(self) -> bool:
        """The closed loop has no unstable pole."""
        return self.unstable_poles == 0


def nyquist(
    admittance: Response,
    impedance: Response,
    frequency: np.ndarray,
    *,
    open_loop_unstable: int = 0,
    growth: int = 0,
) -> Nyquist:
    """Count and margins over given frequencies and as many between them as the locus needs.

    Parameters
    ----------
    admittance : of the inverter, current out. impedance : of the grid. frequency : (K,) Hz,
    positive, ascending.
    open_loop_unstable : unstable poles of the admittance. growth : power of s with which det(I + L)
    grows at high
        frequency: the rank of the inverter's direct term on an inductive grid.
    """
    frequency, loop, smooth = _refined(admittance, impedance, frequency, growth)
    loci = _continuous(np.linalg.eigvals(loop))
    phase = np.unwrap(np.angle(_determinant(loop, frequency, growth)))
    ends = np.round(phase[[0, -1]] / np.pi)
    turns = round(float(ends[1] - ends[0]))
    distance = np.abs(1.0 + loci).min(axis=1)
    nearest = int(np.argmin(distance))
    return Nyquist(
        frequency=frequency,
        loci=loci,
        turns=turns,
        open_loop_unstable=open_loop_unstable,
        certain=smooth and bool(np.abs(phase[[0, -1]] - np.pi * ends).max() < REAL),
        vector_margin=float(distance[nearest]),
        vector_margin_hz=float(frequency[nearest]),
        gain_margin=_gain_margin(loci),
        phase_margin=_phase_margin(loci),
    )


def start_frequencies(poles: np.ndarray) -> np.ndarray:
    """(K,) Hz, from far below the slowest to far above the fastest of the open-loop poles (rad/s),
    dense around each.
    """
    sizes = np.abs(poles[np.abs(poles) > 1e-9])
    slow, fast = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
    decades = np.log10(1e9 * fast / slow)
    around = [
        pole.imag + np.linspace(-6.0, 6.0, 25) * abs(pole.real)
        for pole in poles[np.imag(poles) > 0]
    ]
    found = np.unique(
        np.concatenate([np.geomspace(1e-6 * slow, 1e3 * fast, int(30 * decades)), *around])
    )
    return found[found > 0] / (2 * np.pi)


def _refined(
    admittance: Response, impedance: Response, frequency: np.ndarray, growth: int
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Frequencies at which det(I + L) turns in small steps, L there, and whether it does: not with
    more than `MOST`.
    """

    def loop(at: np.ndarray) -> np.ndarray:
        return -impedance(at) @ admittance(at)

    values, wide = loop(frequency), np.zeros(0, dtype=int)
    for _ in range(ROUNDS):
        turn = np.diff(np.angle(_determinant(values, frequency, growth)))
        wide = np.flatnonzero(np.abs(np.angle(np.exp(1j * turn))) > TURN)
        wide = wide[frequency[wide + 1] > frequency[wide] * (1 + 1e-12)]
        if not len(wide) or len(frequency) + len(wide) > MOST:
            break
        between = np.sqrt(frequency[wide] * frequency[wide + 1])
        frequency = np.insert(frequency, wide + 1, between)
        values = np.insert(values, wide + 1, loop(between), axis=0)
    return frequency, values, not len(wide)


def _determinant(loop: np.ndarray, frequency: np.ndarray, growth: int) -> np.ndarray:
    """det(I + L), divided by (1 + s)^growth so that it stays finite; s counts in units of a middle
    frequency.
    """
    middle = np.sqrt(frequency[0] * frequency[-1])
    return np.linalg.det(np.eye(2) + loop) / (1.0 + 1j * frequency / middle) ** growth


def _continuous(loci: np.ndarray) -> np.ndarray:
    """The same eigenvalues (K, 2), ordered so that each column moves little from row to row."""
    stay = np.abs(np.diff(loci, axis=0)).sum(axis=1)
    swap = np.abs(loci[1:] - loci[:-1, ::-1]).sum(axis=1)
    crossed = np.concatenate([[False], np.cumsum(swap < stay) % 2 == 1])
    return np.where(crossed[:, None], loci[:, ::-1], loci)


def _gain_margin(loci: np.ndarray) -> float | None:
    """Smallest factor above 1 that brings a crossing of the negative real axis to -1."""
    factors = []
    for locus in loci.T:
        real = _where_zero(np.imag(locus), np.real(locus))
        if abs(locus[0].imag) <= 1e-3 * abs(locus[0]):
            real = np.append(
                real, locus[0].real
            )  # at zero frequency both loci end on the real axis, or are a pair
        factors += [-1.0 / one for one in real if -1.0 < one < 0.0]
    return min(factors) if factors else None


def _phase_margin(loci: np.ndarray) -> float | None:
    """Smallest angle (degrees) from -1 where a locus crosses the unit circle."""
    crossings = np.concatenate([_where_zero(np.abs(locus) - 1.0, locus) for locus in loci.T])
    return float(np.degrees(np.abs(np.angle(-crossings))).min()) if len(crossings) else None


def _where_zero(size: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The values, straight between neighbours, at which a size changes its sign."""
    k = np.flatnonzero(size[1:] * size[:-1] < 0)
    part = size[k] / (size[k] - size[k + 1])
    return values[k] + part * (values[k + 1] - values[k])
