"""Rows of a sweep that all others contradict, and the likely mistake: a slip of the decimal point,
a sign, exchanged entries.

The other rows predict each row by a rational function with poles common to the four entries, so
that a true resonance, which they see too, is none. Deletion: R. D. Cook, Technometrics 19 (1977)
15, on the equations of vector fitting.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ibrid.border import takes_kinds
from ibrid.measurement.quality.row_mistakes import Mistake, mended
from ibrid.measurement.sweeps.quantities import hertz, percent
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep
from ibrid.measurement.sweeps.vector_fit import (
    best_fit,
    partial_fractions,
    rational_equations,
    starting_poles,
)

#: Fewest rows that predict another, and most of an operating point that are looked at.
FEWEST, MOST = 10, 600
#: Rows that are looked at together, by how many the next ones are further, and how many at an edge
#: inside are left to those.
WINDOW, STRIDE, EDGE = 24, 8, 4
#: Highest order of a rational function, where all rows are looked at together and in a window of
#: them.
HIGHEST, HIGHEST_INSIDE = 14, 8
#: Of the fit that predicts a row: orders that are tried after the last one that paid, and times
#: that its poles are relocated.
BEYOND, ROUNDS = 4, 4
#: Of all measured numbers, the largest part that coefficients may take.
SHARE = 0.6
#: Ratio of variances by which leaving a row out helps from which on it is suspect, and how many
#: suspects are looked at.
SUSPECT, SUSPECTS = 15.0, 4
#: A mistake below this part of |Y| in its row is not looked for.
LEAST = 0.01
#: Mean square of a row's distance from its prediction over the variance of that, from which on a
#: mistake is named, by how much mending must lower it, and, where no mistake explains the row, that
#: and the distance over |Y|.
CONTRADICTED, MENDS, UNEXPLAINED, FAR = 25.0, 50.0, 2500.0, 0.1
#: Of all rows at most this part is named: where more are odd, the others predict nothing.
MOST_WRONG = 0.2
#: Of a row whose entries are all zero.
NO_NUMBERS = "all entries zero, as cells that were not measured"
#: Of a row with a number that stands for what was not measured; how large its entries, all of one
#: size, are at least, and entries of any size, over |Y| in the median.
NOT_MEASURED = "all entries as large as a number that programs write for what was not measured"
ALL_ALIKE, BEYOND_ALL = 100.0, 1e12
#: Part of a row that rounding moves: the least error of a prediction.
ROUNDING = 1e-12


@dataclass(frozen=True)
class WrongRow:
    """`frequency` : Hz.

    `entries` : those that do not follow from the other rows. `likely` : the mistake in words, ""
    where none explains them. `apart` : distance from the prediction over |Y| of that.
    """

    frequency: float
    entries: tuple[str, ...]
    likely: str
    apart: float

    @property
    def words(self) -> str:
        """What is odd and why, behind the frequency."""
        entries = (
            "all entries"
            if len(self.entries) == len(ENTRIES)
            else ", ".join(f"Y{name}" for name in self.entries)
        )
        if self.likely:
            return f"{hertz(self.frequency)}: {self.likely}"
        return f"{hertz(self.frequency)}: {entries} by {percent(self.apart)} of |Y|"


def wrong_rows(point: PointSweep) -> tuple[WrongRow, ...]:
    """The rows that the others contradict, in ascending frequency; of a record that stands for a
    sweep none is looked for.
    """
    if point.excitation is not None or point.predicted:
        return ()
    return _wrong_rows(point.frequency.tobytes(), point.admittance.tobytes())


def contradicted_rows(sweep: Sweep) -> tuple[str, ...]:
    """A sentence that names the rows and the likely mistakes; empty where there is none."""
    listed = [
        f"{point.op.name} at "
        f"{'; at '.join(row.words for row in rows[:6])}{'; ..' * (len(rows) > 6)}"
        for point in sweep.points
        if (rows := wrong_rows(point))
    ]
    if not listed:
        return ()
    return (
        f"rows that all others contradict: {'; '.join(listed)}. Correct them; --robust leaves them "
        "out of a fit.",
    )


@takes_kinds
def without_wrong_rows(sweep: Sweep) -> Sweep:
    """The sweep without the rows that the others contradict."""
    return replace(sweep, points=tuple(_without(point) for point in sweep.points))


def _without(point: PointSweep) -> PointSweep:
    wrong = [row.frequency for row in wrong_rows(point)]
    return point.at(~np.isin(point.frequency, wrong)) if wrong else point


@lru_cache(maxsize=256)
def _wrong_rows(frequency: bytes, admittance: bytes) -> tuple[WrongRow, ...]:
    hertz_of = np.frombuffer(frequency)
    values = np.frombuffer(admittance, dtype=complex).reshape(-1, 4)
    size = np.linalg.norm(values, axis=1)
    # a median, as a row of 1e30 would make nothing of all others
    usual = np.median(size[size > 0]) if size.any() else 0.0
    nothing = size <= ROUNDING * usual
    filled = _filled(values, size, usual)
    kept = np.flatnonzero(~(nothing | filled))
    named = []
    if len(kept):
        for rows, words in ((nothing, NO_NUMBERS), (filled, NOT_MEASURED)):
            apart = np.where(size > 0, size / usual, 1.0)[rows]
            named += [
                WrongRow(float(one), tuple(ENTRIES), words, float(far))
                for one, far in zip(hertz_of[rows], apart, strict=True)
            ]
    most = int(MOST_WRONG * len(kept))
    while FEWEST < len(kept) <= MOST and len(hertz_of) - len(kept) < most:
        odd = _first_contradicted(hertz_of[kept], values[kept])
        if odd is None:
            break
        place, row = odd
        named.append(row)
        kept = np.delete(kept, place)
    return tuple(sorted(named, key=lambda row: row.frequency))


def _filled(values: np.ndarray, size: np.ndarray, usual: float) -> np.ndarray:
    """(K,) whether the entries (K, 4) of a row are a number that stands for none: all of one size
    and far larger than others, or larger than any can be.
    """
    entries = np.abs(values)
    alike = np.ptp(entries, axis=1) <= ROUNDING * entries.max(axis=1)
    return (alike & (size > ALL_ALIKE * usual)) | (size > BEYOND_ALL * usual)


def _first_contradicted(frequency: np.ndarray, values: np.ndarray) -> tuple[int, WrongRow] | None:
    """The first of the suspects, the most suspect one first, that is wrong, and its place; None
    where none is.

    While a wrong row is among the others they predict nothing well, so that no right one is taken
    for wrong.
    """
    helps = _deletion_ratios(frequency, values)
    for place in map(int, np.argsort(-helps)[:SUSPECTS]):
        if helps[place] > SUSPECT and (row := _judged(frequency, values, place)) is not None:
            return place, row
    return None


def _deletion_ratios(frequency: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(K,) F ratio of the residual that leaving each row out takes away, the largest over all
    orders of a rational function.

    Law: of A x = b with poles fixed, the sum of squares without the rows k is S - e_k' (I -
    H_kk)^-1 e_k, H = A (A'A)^-1 A'.
    """
    count = len(frequency)
    ratios = np.zeros(count)
    highest = HIGHEST if count <= WINDOW else HIGHEST_INSIDE
    for first, last in _windows(count):
        judged = np.arange(first + EDGE * (first > 0), last - EDGE * (last < count))
        rows = slice(first, last)
        for order in _orders(last - first - 1, highest):
            helps = _deletion_ratio(frequency[rows], values[rows], order)
            ratios[judged] = np.maximum(ratios[judged], helps[judged - first])
    return ratios


def _deletion_ratio(frequency: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    count = len(frequency)
    s = 1j * frequency / frequency[-1]
    matrix, right = rational_equations(s, values, starting_poles(s.imag, order), _weight(values))
    columns = matrix.reshape(-1, matrix.shape[2])
    basis, _ = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    left = (right.ravel() - basis @ (basis.T @ right.ravel())).reshape(count, 8)
    own = basis.reshape(count, 8, -1)
    remaining, directions = np.linalg.eigh(np.eye(8) - own @ own.transpose(0, 2, 1))
    along = np.einsum("kji,kj->ki", directions, left)
    known = remaining > 1e-9
    taken = (np.where(known, along, 0.0) ** 2 / np.where(known, remaining, 1.0)).sum(axis=1)
    whole = (left**2).sum()
    freedom = 8 * (count - 1) - columns.shape[1]
    without = np.maximum(whole - taken, 0.0) + count * ROUNDING**2
    return (taken / 8) / (without / freedom)


def _judged(frequency: np.ndarray, values: np.ndarray, place: int) -> WrongRow | None:
    """Why a row is wrong; None where the others predict it well enough, or badly."""
    first = max(0, min(place - WINDOW // 2, len(frequency) - WINDOW))
    near = np.arange(first, min(len(frequency), first + WINDOW))
    prediction = _Prediction(frequency, values, near[near != place])
    measured = values[place]
    predicted = prediction.at(frequency[place])
    distance, apart = predicted.distance(measured)
    if distance < CONTRADICTED or apart < LEAST:
        return None
    entries = tuple(predicted.contradicted(measured))
    likely = list(_explanations(measured, predicted, prediction, frequency[place], frequency[near]))
    least, mistake = min(likely, key=lambda one: one[0] * (1.0 + 0.01 * one[1].rank))
    if least * MENDS < distance:
        return WrongRow(float(frequency[place]), mistake.entries, mistake.words, apart)
    if distance > UNEXPLAINED and apart > FAR:
        return WrongRow(float(frequency[place]), entries, "", apart)
    return None


def _explanations(
    measured: np.ndarray,
    predicted: "_Predicted",
    prediction: "_Prediction",
    frequency: float,
    others: np.ndarray,
) -> Iterator[tuple[float, Mistake]]:
    """The distance that is left when each mistake is mended."""
    for mistake, value in mended(measured):
        yield predicted.distance(value)[0], mistake
    lowest, highest = others[0], others[-1]
    slips = [
        frequency * factor for factor in (10.0, 0.1) if lowest <= frequency * factor <= highest
    ]
    rank = 100
    for other in (*others[others != frequency], *slips):
        words = f"like the row at {hertz(other)}, shifted against its frequency"
        yield prediction.at(other).distance(measured)[0], Mistake(tuple(ENTRIES), words, rank)


@dataclass(frozen=True, eq=False)
class _Predicted:
    """`value` : (4,) complex.

    `covariance` : (8, 8) of its real and its imaginary parts over |value|.
    """

    value: np.ndarray
    covariance: np.ndarray

    def distance(self, measured: np.ndarray) -> tuple[float, float]:
        """Mean square of what a row is off, over its variance; and its size over |Y|."""
        off = self._off(measured)
        return float(off @ np.linalg.solve(self.covariance, off)) / len(off), float(
            np.linalg.norm(off)
        )

    def contradicted(self, measured: np.ndarray) -> Iterator[str]:
        """Entries that are off by more than the prediction may be."""
        square = self._off(measured).reshape(2, 4) ** 2 / np.diag(self.covariance).reshape(2, 4)
        for name, (row, column) in ENTRIES.items():
            if square[:, 2 * row + column].max() > CONTRADICTED:
                yield name

    def _off(self, measured: np.ndarray) -> np.ndarray:
        off = (measured - self.value) / np.linalg.norm(self.value)
        return np.concatenate([off.real, off.imag])


class _Prediction:
    """The rational function that some rows determine, and how well at any frequency."""

    def __init__(self, frequency: np.ndarray, values: np.ndarray, rows: np.ndarray) -> None:
        self.highest = frequency[rows[-1]]
        s = 1j * frequency[rows] / self.highest
        fit = best_fit(
            frequency[rows],
            values[rows].reshape(-1, 2, 2),
            highest=HIGHEST,
            beyond=BEYOND,
            rounds=ROUNDS,
        )
        self.poles = fit.poles
        matrix, right = rational_equations(s, values[rows], self.poles, _weight(values[rows]))
        columns = matrix.reshape(-1, matrix.shape[2])
        self.scale = np.linalg.norm(columns, axis=0)
        left, sizes, turned = np.linalg.svd(columns / self.scale, full_matrices=False)
        inverse = 1.0 / np.maximum(sizes, 1e-13 * sizes[0])
        self.root = turned.T * inverse
        self.coefficients = (self.root @ (left.T @ right.ravel())) / self.scale
        self.variance = fit.variance + ROUNDING**2

    def at(self, frequency: float) -> _Predicted:
        s = np.array([1j * frequency / self.highest])
        basis = partial_fractions(s, self.poles)[0]
        scaling, numerators = np.split(self.coefficients, [len(basis)])
        value = numerators.reshape(4, -1) @ np.append(basis, 1.0) / (1.0 + basis @ scaling)
        size = np.linalg.norm(value)
        equations, _ = rational_equations(s, value[None], self.poles, np.array([1.0 / size]))
        slopes = (equations[0] / self.scale) @ self.root
        return _Predicted(value, self.variance * (np.eye(8) + slopes @ slopes.T))


def _weight(values: np.ndarray) -> np.ndarray:
    return 1.0 / np.linalg.norm(values, axis=1)


def _windows(count: int) -> list[tuple[int, int]]:
    if count <= WINDOW:
        return [(0, count)]
    return [
        (first, first + WINDOW) for first in (*range(0, count - WINDOW, STRIDE), count - WINDOW)
    ]


def _orders(rows: int, highest: int) -> Sequence[int]:
    return range(2, min(highest, int((SHARE * 8 * rows - 4) / 5)) + 1)
