"""Instantaneous values that stay exactly the same for many rows while the phase moves on: the
recorder stood still.
"""

from collections.abc import Sequence

import numpy as np

#: First and last place of the samples of each run.
Runs = list[tuple[int, int]]
#: Words by which the remark is known again.
STOOD = "the recorder stood still"
#: What stands must have missed so many usual changes from row to row on its way, and be so many of
#: them away: fewer are those of a coarse resolution or of the steps of a simulation.
_MISSED, _AWAY = 8.0, 2.0
#: Of signals in dq, which may rest exactly: rows that stand, at least, and the part of all other
#: rows that change.
_ROWS, _CHANGE = 10, 0.9


def describe_standing(
    time: np.ndarray, v: np.ndarray, i: np.ndarray, f0_hz: float
) -> tuple[str, ...]:
    """Sentence on where voltage and current, or one of them, stay bit for bit the same; () for
    nowhere.

    time : (n,) s. v, i : (3, n) phases or (2, n) d and q, as recorded.
    Phases turn by 2 pi f0 in a second, so that they cannot stand away from their middle. d and q
    may: a stand of theirs is one where nearly all other rows change, as by noise.
    """
    whole = {"voltage and current": (v, i), "voltage": (v,), "current": (i,)}
    for called, parts in whole.items():
        if stands := _stands(time, parts, f0_hz):
            return (_sentence(called, time, stands),)
    return ()


def _sentence(called: str, time: np.ndarray, stands: Runs) -> str:
    first, last = max(stands, key=lambda one: one[1] - one[0])
    verb = "stay" if " and " in called else "stays"
    more = f", and at {len(stands) - 1} more places" if len(stands) > 1 else ""
    return (
        f"{called} {verb} exactly the same from {time[first]:.6g} to {time[last]:.6g} s "
        f"({last - first + 1} samples){more}: {STOOD}; leave it out or cut the record there"
    )


def _stands(time: np.ndarray, parts: Sequence[np.ndarray], f0_hz: float) -> Runs:
    """First and last row of each stand of all the parts at once."""
    same = np.all([(np.diff(part) == 0).all(axis=0) for part in parts], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    runs = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    if len(parts[0]) == 2:
        return _of_axes(same, runs)
    usual = [_usual_change(part) for part in parts]
    middles = [np.median(part, axis=1) for part in parts]
    stands = []
    for first, last in runs:
        turn = 2 * np.pi * f0_hz * (time[last] - time[first])
        sizes = [
            float(np.abs(part[:, first] - middle).max())
            for part, middle in zip(parts, middles, strict=True)
        ]
        away = 2 * np.sin(min(turn, np.pi) / 2)
        pairs = list(zip(sizes, usual, strict=True))
        if all(
            0 < _MISSED * one < size * turn and _AWAY * one < size * away for size, one in pairs
        ):
            stands.append((first, last))
    return stands


def _of_axes(same: np.ndarray, runs: Runs) -> Runs:
    """The stands within a record of d and q of which nearly all other rows change."""
    long = [
        (first, last)
        for first, last in runs
        if last - first + 1 >= _ROWS and first > 0 and last < len(same)
    ]
    others = np.ones(len(same), dtype=bool)
    for first, last in long:
        others[first:last] = False
    if not long or 2 * others.sum() < len(same) or np.mean(~same[others]) < _CHANGE:
        return []
    return long


def _usual_change(part: np.ndarray) -> float:
    """The median of the changes from row to row, of rows in which something changes."""
    changes = np.abs(np.diff(part)).max(axis=0)
    return float(np.median(changes[changes > 0])) if changes.any() else 0.0
