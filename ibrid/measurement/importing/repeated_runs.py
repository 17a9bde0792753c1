"""Whether two runs over the frequencies can be one operating point measured twice, so that their
mean says something.
"""

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.formats.csv_columns import ENTRIES
from ibrid.measurement.sweeps.quantities import percent

#: Runs that are averaged differ by at most this part of |Y|.
ALIKE = 0.2
#: A real or imaginary part of an entry has the opposite sign throughout where its correlation is
#: below minus this, over so many frequencies at least, and it has the last, a part of |Y|: less may
#: be noise.
_OPPOSED, _FEWEST, _SEEN = 0.9, 4, 0.05


def distance(here: np.ndarray, beside: np.ndarray) -> float:
    """Median over the frequencies of how far entries (m, 4) are from others, as a part; not a
    number where there are none.
    """
    if not len(here):
        return np.nan
    size = np.linalg.norm(here, axis=1)
    return float(np.median(np.linalg.norm(here - beside, axis=1) / np.where(size > 0, size, 1.0)))


def opposed_parts(here: np.ndarray, beside: np.ndarray, frame: str) -> list[str]:
    """Which parts of entries (m, 4) have the opposite sign in others throughout, so that a mean of
    both would be zero.
    """
    if len(here) < _FEWEST:
        return []
    first, second = (np.stack([np.real(one), np.imag(one)]) for one in (here, beside))
    sizes = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    seen = np.minimum(*sizes) > _SEEN * np.linalg.norm(here)
    opposed = (first * second).sum(axis=1) < -_OPPOSED * sizes[0] * sizes[1]
    entries = ENTRIES.get(frame, ENTRIES["dq"])
    return [
        f"the {('real', 'imaginary')[k]} part of {entries[place]}"
        for k, place in np.argwhere(seen & opposed)
    ]


def require_repeats(
    first: np.ndarray, again: np.ndarray, frame: str, places: str, *, said: bool
) -> None:
    """Raise SweepError unless entries (m, 4) may be those of the same point measured again.

    places : where both stand. said : the user says that they are.
    """
    if opposed := opposed_parts(first, again, frame):
        raise SweepError(
            f"{places} must be repeats, as they have one operating point; found {some(opposed)} of "
            "the opposite sign, put right "
            "which is wrong, or import them one by one."
        )
    if not said and (apart := distance(first, again)) > ALIKE:
        raise SweepError(
            f"{places} must be repeats, as they have one operating point; found them "
            f"{percent(apart)} apart in the median, give "
            "one another name, or add --op NAME if all are one point."
        )
