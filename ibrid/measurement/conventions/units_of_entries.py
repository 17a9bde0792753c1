"""An entry of the diagonal in another unit than the rest."""

import numpy as np

from ibrid.measurement.conventions.frequency_base import REACH
from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep

#: Multiple of one entry that the other of the diagonal is nowhere beyond the reach of control.
FAR_LARGER = 50


def units_of_entries(sweep: Sweep) -> str:
    """A sentence where Ydd or Yqq is far larger than the other at every frequency, beyond the reach
    of control too; "" elsewhere.

    Law: there a filter has Ydd and Yqq alike, and Zdd and Zqq too, whose ratio is the inverse.
    """
    if any(point.frequency[-1] < REACH for point in sweep.points):
        return ""
    size = np.concatenate([np.abs(point.admittance) for point in sweep.points])
    for large, small in (("qq", "dd"), ("dd", "qq")):
        above, below = (size[(slice(None), *ENTRIES[entry])] for entry in (large, small))
        if below.all() and (above > FAR_LARGER * below).all():
            return (
                f"Y{large} is more than {FAR_LARGER} times Y{small} at every frequency (Z{small} "
                f"more than {FAR_LARGER} times Z{large}), where a filter has them alike: one of "
                "them is probably in another unit, such as milliohm for ohm."
            )
    return ""
