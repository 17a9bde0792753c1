"""Entries of a sweep that stand one row late or early beside the others, as those of a file that
lost its first line.

Law: the four entries of a device are rational functions with common poles. Entries at another
frequency have others, so that a vector fit of the mended numbers leaves far less over than one of
those that stand there (`ibrid.measurement.sweeps.vector_fit`).
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep
from ibrid.measurement.sweeps.vector_fit import FEWEST, SHARE, best_fit, vector_fit

#: Most frequencies at which fits are compared: every second, third .. row of a longer sweep.
MOST = 60
#: A fit of the numbers as they stand that leaves less over than this part of |Y| is right.
FITTED = 1e-4
#: A shift is named where it leaves at most this part of what a fit of the numbers as they stand
#: leaves.
MENDS = 0.2
#: Entries that come from one test or one file, beside the others; a half that is late is one whose
#: other half is early.
_GROUPS = {
    "Ydq and Yqq (the column of vq)": ("dq", "qq"),
    "Yqd and Yqq (the row of iq)": ("qd", "qq"),
    **{f"Y{entry}": (entry,) for entry in ENTRIES},
}


def shifted_entries(sweep: Sweep) -> Iterator[str]:
    """A sentence for each operating point of which some entries are far more likely a row away."""
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
    whole = np.linalg.norm(values, axis=(1, 2)) > 0
    if whole.sum() <= FEWEST:
        return ""
    hertz, values = hertz[whole], values[whole]
    step = -(-len(hertz) // MOST)
    best = best_fit(hertz[::step], values[::step])
    left = _left(hertz[::step], values[::step], best.order)
    if left < FITTED:
        return ""
    return _shifted(hertz, values, step, best.order, left)


def _shifted(hertz: np.ndarray, values: np.ndarray, step: int, order: int, left: float) -> str:
    """The entries that stand one frequency later, or earlier, than the others, in words; "" for
    none.
    """
    least, words = MENDS * left, ""
    for name, entries in _GROUPS.items():
        for rows, side in ((1, "later"), (-1, "earlier")):
            mended = values.copy()
            for entry in entries:
                place = (slice(None), *ENTRIES[entry])
                mended[place] = np.roll(values[place], -rows)
            inside = slice(1, -1)
            left_now = _left(hertz[inside][::step], mended[inside][::step], order)
            if left_now < least:
                least = left_now
                words = (
                    f"{name} probably stand one frequency {side} than the other entries: moved by "
                    "one they fit them; check the rows of the file they come from."
                )
    return words


def _left(hertz: np.ndarray, values: np.ndarray, order: int) -> float:
    """What a vector fit of so many poles leaves over: rms over |Y|, each degree of freedom."""
    weight = 1.0 / np.linalg.norm(values, axis=(1, 2))
    order = min(order, int((SHARE * 8 * len(hertz) - 4) // 5))
    fitted = vector_fit(hertz, values, order, weight)
    residual = weight[:, None, None] * (fitted - values)
    dof = 8 * len(hertz) - 5 * order - 4
    return float(np.sqrt(8 * (np.abs(residual) ** 2).sum() / dof))
