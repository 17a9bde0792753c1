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

from ibrid.measurement.conventions.frequency_base import REACH
from ibrid.measurement.conventions.tail import signs_of_tail
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep

#: What may be turned, in words.
_TURNED = {f"Y{name}": (place,) for name, place in ENTRIES.items()} | {
    "Ydd and Yqd (the column of vd)": ((0, 0), (1, 0)),
    "Ydq and Yqq (the column of vq)": ((0, 1), (1, 1)),
    "Ydd and Ydq (the row of id)": ((0, 0), (0, 1)),
    "Yqd and Yqq (the row of iq)": ((1, 0), (1, 1)),
}
#: Part of what stands there that may be left of what must vanish.
_LEFT = 0.1


def turned_signs(sweep: Sweep) -> Iterator[str]:
    """A sentence where the highest frequencies of every operating point are those of a filter only
    once the signs of some entries are turned.
    """
    if any(signs_of_tail(point, sweep.f0_hz)[1] for point in sweep.points):
        return
    for words, places in _TURNED.items():
        factors = np.ones((2, 2))
        factors[tuple(zip(*places, strict=True))] = -1
        if all(_is_filter(point, factors, sweep.f0_hz) for point in sweep.points):
            yield (
                "at the highest frequencies d and q answer as those of no filter, but do once the "
                f"sign of {words} is turned: it is probably wrong in the file; correct it there "
                "(import takes a minus before the names of real and imaginary parts)."
            )
            return


def _is_filter(point: PointSweep, factors: np.ndarray, f0_hz: float) -> bool:
    """Whether the inductance of a filter is seen at the end of an operating point, with the current
    out and q leading as declared, once its entries are multiplied by factors.
    """
    if point.frequency[-1] < REACH:
        return False
    mended = PointSweep(point.op, point.frequency, point.admittance * factors)
    if signs_of_tail(mended, f0_hz) != (1, 1):
        return False
    z = np.linalg.inv(mended.admittance[-3:])
    along, across = z[:, 0, 0] + z[:, 1, 1], z[:, 1, 0] - z[:, 0, 1]
    apart, alike = z[:, 0, 0] - z[:, 1, 1], z[:, 1, 0] + z[:, 0, 1]
    return bool(
        (np.abs(apart) < _LEFT * np.abs(along)).all()
        and (np.abs(alike) < _LEFT * np.abs(across)).all()
    )
