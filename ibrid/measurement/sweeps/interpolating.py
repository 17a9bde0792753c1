"""A response at other frequencies than its own, and operating points that two sweeps have in
common.
"""

import numpy as np

from ibrid.measurement.sweeps.sweep import Sweep

#: p, q and v that differ by less are one operating point, per unit.
_SAME = 0.02


def interpolated(frequency: np.ndarray, response: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(M, 2, 2) linear in log f, entry by entry; not a number outside the band.

    frequency : (K,) Hz, ascending. response : (K, 2, 2). wanted : (M,) Hz.
    """
    at, to = np.log(frequency), np.log(wanted)
    flat = response.reshape(len(frequency), 4)
    columns = []
    for one in flat.T:
        real, imaginary = (
            np.interp(to, at, part, np.nan, np.nan) for part in (np.real(one), np.imag(one))
        )
        columns.append(real + 1j * imaginary)
    return np.stack(columns, axis=1).reshape(len(wanted), 2, 2)


def common_points(first: Sweep, second: Sweep) -> tuple[tuple[str, str], ...]:
    """Names in the first and in the second sweep of the operating points that both have: called
    alike, else with p, q and v alike.
    """
    pairs = [(name, name) for name in second.names if name in first.names]
    if pairs:
        return tuple(pairs)
    for point in second.points:
        away = [
            max(abs(one.op.p - point.op.p), abs(one.op.q - point.op.q), abs(one.op.v - point.op.v))
            for one in first.points
        ]
        nearest = int(np.argmin(away))
        if away[nearest] < _SAME:
            pairs.append((first.names[nearest], point.op.name))
    return tuple(pairs)
