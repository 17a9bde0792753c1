"""Entries of a sweep that stand one row late or early beside the others, as those of a file that
lost its first line, and rows that run against their frequencies.

Law: the four entries of a device are rational functions with common stable poles. Entries at
another frequency have others: at frequencies in steps of one ratio an entry that is a row late has
each pole divided by that ratio. So the numbers as they stand need more poles than the mended ones
for the same error, or leave far more over with as many
(`ibrid.measurement.sweeps.vector_fit`).
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep
from ibrid.measurement.sweeps.vector_fit import FEWEST, SHARE, best_fit, vector_fit

#: Most frequencies at which fits are compared: every second, third .. row of a longer sweep.
MOST = 60
#: A shift is named where it leaves at most this part of what a fit of the numbers as they stand
#: leaves with as many poles, and at most so many times what their best fit leaves.
MENDS, FLOOR = 0.2, 1.5
#: Condition number from which on Z tells nothing.
INVERTIBLE = 1e10
#: What the rounding of numbers leaves over, whatever a fit leaves.
ROUNDED = 1e-10
#: Part of |Y| that so many stable poles leave of numbers that are those of no stable device.
_SOME_POLES, UNSTABLE = 12, 0.3
#: Entries that come from one test or one file, beside the others; a half that is late is one whose
#: other half is early.
_GROUPS = {
    "{matrix}dq and {matrix}qq (the column of {cause}q) probably stand": ("dq", "qq"),
    "{matrix}qd and {matrix}qq (the row of {effect}q) probably stand": ("qd", "qq"),
    **{f"{{matrix}}{entry} probably stands": (entry,) for entry in ENTRIES},
}
_BACKWARDS = (
    "the numbers are those of no stable device, but are once the rows run against their "
    "frequencies, or once the sign of all imaginary parts is turned: one column is probably "
    "sorted the other way, or angles are counted the other way; correct the file."
)


def shifted_entries(sweep: Sweep) -> Iterator[str]:
    """A sentence for each operating point of which some entries are far more likely a row away, or
    all rows the other way round.
    """
    for point in sweep.points:
        if point.excitation is None and not point.predicted:
            words = _shift_in_words(point.frequency.tobytes(), point.admittance.tobytes())
            if words:
                yield f"{point.op.name}: {words}"


@lru_cache(maxsize=256)
def _shift_in_words(frequency: bytes, admittance: bytes) -> str:
    """The likely shift in words; "" where all entries stand in their rows."""
    hertz = np.frombuffer(frequency)
    values = np.frombuffer(admittance, dtype=complex).reshape(-1, 2, 2)
    whole = np.linalg.cond(values) < INVERTIBLE
    if whole.sum() <= FEWEST:
        return ""
    hertz, values = hertz[whole], values[whole]
    step = -(-len(hertz) // MOST)
    rows = slice(1, -1, step)
    if _runs_backwards(hertz[rows], values[rows]):
        return _BACKWARDS
    order = best_fit(hertz[rows], values[rows]).order
    floor = max(_left(hertz[rows], values[rows], order), ROUNDED)
    fewer = _fewer_than_needed(hertz[rows], values[rows], floor / MENDS, order)
    for poles in dict.fromkeys((fewer, order)):
        words, least = "", min(MENDS * _left(hertz[rows], values[rows], poles), FLOOR * floor)
        for named, mended in _mended(values):
            left = _left(hertz[rows], mended[rows], poles)
            if left < least:
                words, least = named, left
        if words:
            return words
    return ""


def _runs_backwards(hertz: np.ndarray, values: np.ndarray) -> bool:
    """Whether the rows fit stable poles the other way round alone.

    Reversal of rows in steps of one ratio maps f to c / f, and so a stable pole to an unstable one.
    """
    standing = _left(hertz, values, _SOME_POLES)
    return standing > UNSTABLE and _left(hertz, values[::-1], _SOME_POLES) < MENDS * standing


def _fewer_than_needed(hertz: np.ndarray, values: np.ndarray, enough: float, order: int) -> int:
    """The most poles, 2 at least, before a fit leaves no more over than is enough."""
    for poles in range(2, order):
        if _left(hertz, values, poles + 1) <= enough:
            return poles
    return order


def _mended(values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Each likely mistake in words, and the admittances without it (K, 2, 2)."""
    for matrix, cause, effect in (("Y", "v", "i"), ("Z", "i", "v")):
        matrices = values if matrix == "Y" else np.linalg.inv(values)
        for name, entries in _GROUPS.items():
            for rows, side in ((1, "later"), (-1, "earlier")):
                mended = matrices.copy()
                for entry in entries:
                    place = (slice(None), *ENTRIES[entry])
                    mended[place] = np.roll(matrices[place], -rows)
                if (np.linalg.cond(mended) > INVERTIBLE).any():
                    continue
                named = name.format(matrix=matrix, cause=cause, effect=effect)
                words = (
                    f"{named} one frequency {side} than the other entries: moved by one row all "
                    "fit together; check the rows of the file."
                )
                yield words, mended if matrix == "Y" else np.linalg.inv(mended)


def _left(hertz: np.ndarray, values: np.ndarray, order: int) -> float:
    """What a vector fit of so many poles leaves over: rms over |Y|, each degree of freedom."""
    weight = 1.0 / np.linalg.norm(values, axis=(1, 2))
    order = min(order, int((SHARE * 8 * len(hertz) - 4) // 5))
    fitted = vector_fit(hertz, values, order, weight)
    residual = weight[:, None, None] * (fitted - values)
    dof = 8 * len(hertz) - 5 * order - 4
    return float(np.sqrt(8 * (np.abs(residual) ** 2).sum() / dof))
