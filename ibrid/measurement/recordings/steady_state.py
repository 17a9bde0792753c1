"""From when on a recording is in steady state, where it begins with the start-up of a
simulation.
"""

from math import ceil

import numpy as np

#: How far means over a cycle may be apart in two cycles at rest, per unit, of voltage and current:
#: strictly, then as usual.
WANDERS = ((0.002, 0.005), (0.01, 0.03))
#: Half cycles that must agree; least voltage at rest, per unit, and beside what came before; by how
#: much an event moves v or i.
_HALVES, _LEAST, _AS_BEFORE, _MOVES = 4, 0.5, 0.9, 0.05


def rests_from(time: np.ndarray, v: np.ndarray, i: np.ndarray, f0_hz: float) -> float | None:
    """s from which two cycles are at rest, the first time; None where the record begins so, never
    is, or nothing follows.

    Nor is it rest where the voltage was higher before: then the record begins with the event.

    v, i : (n,) complex, d + j q per unit, in a frame that turns at about 2 pi f0_hz: the size of v
    and i beside v stand still.
    """
    half = 0.5 / f0_hz
    if time[-1] - time[0] > len(time) * half:  # a half cycle has no sample
        return None
    starts = np.arange(time[0], time[-1] - half, half)
    if len(starts) <= _HALVES:
        return None
    edges = np.searchsorted(time, np.append(starts, starts[-1] + half) - 1e-9)
    if (np.diff(edges) < 1).any():
        return None
    beside = i * np.exp(-1j * np.angle(v))
    halves = [np.add.reduceat(one, edges[:-1]) / np.diff(edges) for one in (abs(v), beside)]
    sizes, currents = (
        0.5 * (one[1:] + one[:-1]) for one in halves
    )  # over whole cycles, each half a cycle later
    for wanders in WANDERS:
        still = [k for k in range(len(sizes) - _HALVES + 2) if _stands(sizes, currents, k, wanders)]
        if not still or still[0] == 0:
            continue
        first, last = still[0], still[0] + _HALVES
        moves = max(abs(one[last:] - one[first]).max(initial=0.0) for one in (sizes, currents))
        if sizes[first] > _AS_BEFORE * sizes[:last].max() and moves > _MOVES:
            return (
                ceil((starts[first] + half) * 1e4) / 1e4
            )  # what a mean hides has died away half a cycle later
    return None


def _stands(
    sizes: np.ndarray, currents: np.ndarray, first: int, wanders: tuple[float, float]
) -> bool:
    """Whether two cycles from a place on keep the size of the voltage and the current."""
    here = slice(first, first + _HALVES - 1)
    moved = np.ptp(sizes[here]), abs(currents[here] - currents[first]).max()
    return bool(sizes[first] > _LEAST and moved[0] < wanders[0] and moved[1] < wanders[1])
