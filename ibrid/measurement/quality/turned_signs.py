"""Signs of an entry, a row or a column of a matrix that are turned, as the highest frequencies show
them.

Law: a filter sees no direction, so beyond the reach of control Zdd = Zqq and Zqd = -Zdq, and an
inductance has (Zqd - Zdq) / (Zdd + Zqq) = f0 / (j f)
(`ibrid.measurement.conventions.frequency_base`).
A turned sign exchanges the sums and the differences: what must vanish stands at f0 / (j f), and
what must stand there vanishes. Ydd and Yqq of opposite signs alone are no evidence: what nearly
ideal voltage feedforward leaves over may have them.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.conventions.frequency_base import REACH
from ibrid.measurement.conventions.tail import signs_of_tail
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Entries that may be turned together: one, a column, a row.
_TURNED = ("dd", "dq", "qd", "qq", "dd qd", "dq qq", "dd dq", "qd qq")
_ROWS = ("dd", "dq"), ("qd", "qq")
#: Part of the difference of the sequences that their coupling may be.
_LEFT = 0.1


def turned_signs(sweep: Sweep) -> Iterator[str]:
    """A sentence where the highest frequencies of every operating point are those of a filter only
    once the signs of some entries are turned.
    """
    for entries in _TURNED:
        factors = np.array([[-1 if one in entries else 1 for one in row] for row in _ROWS])
        if all(_is_filter(point, factors, sweep.f0_hz) for point in sweep.points):
            named = entries.replace(" ", " and Y")
            yield (
                "at the highest frequencies d and q answer as those of no filter, but do once the "
                f"sign of Y{named} is turned: it is probably wrong in the file; correct it there "
                "(import takes a minus before the names of real and imaginary parts)."
            )


def _is_filter(point: PointSweep, factors: np.ndarray, f0_hz: float) -> bool:
    """Whether the inductance of a filter is seen at the end of an operating point, with the current
    out and q leading as declared, and no coupling of sequences, once its entries are multiplied by
    factors.
    """
    mended = PointSweep(point.op, point.frequency, point.admittance * factors)
    if point.frequency[-1] < REACH or signs_of_tail(mended, f0_hz) != (1, 1):
        return False
    z = TO_SEQUENCE @ np.linalg.inv(mended.admittance[-3:]) @ np.conj(TO_SEQUENCE.T)
    apart = np.diff(np.diagonal(z, axis1=1, axis2=2))
    return bool((np.abs(z[:, [0, 1], [1, 0]]) < _LEFT * np.abs(apart)).all())
