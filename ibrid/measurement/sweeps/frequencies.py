"""Frequencies that somebody asks for."""

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.masked import require_unmasked
from ibrid.ranges import LIMITS


def frequencies_of(value: object) -> np.ndarray:
    """(K,) Hz of one frequency or a list of them, each of 0 to the largest.

    IbridError for anything else, such as dates.
    """
    require_unmasked("frequencies", value)
    at = np.atleast_1d(np.asarray(value))
    if (
        at.ndim != 1
        or at.dtype.kind not in "iuf"
        or not ((at >= 0) & (at <= LIMITS["freq_hz"].upper)).all()
    ):
        raise IbridError(
            f"frequencies are numbers in Hz from 0 to {LIMITS['freq_hz'].upper:g}, one or a list "
            f"of them; found {str(value)[:60]}"
        )
    return at.astype(float)
