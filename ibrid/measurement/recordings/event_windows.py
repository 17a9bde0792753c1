"""The windows of a record, found from its voltage: pre | first cycle | during | recovery |
after.
"""

from collections.abc import Mapping

import numpy as np

from ibrid.measurement.recordings.events import EventRecord

WINDOWS = ("pre", "first cycle", "during", "recovery", "after")
#: Cycles of recovery behind the return of the voltage.
RECOVERY = 5
#: A magnitude that departs by less, per unit, does not make the event: its angle does.
LEAST = 0.02


def windows_of(record: EventRecord, f0_hz: float) -> Mapping[str, tuple[float, float]]:
    """Window -> (from, to), s, of those that the record has.

    pre ends with the rest; `during` ends where the voltage last comes back half of its way, in
    magnitude or, where that hardly moves, in angle. An event whose voltage does not come back has
    no recovery and no after.
    """
    begin, end, back = record.rest_end, float(record.time[-1]), returns_at(record, f0_hz)
    first = min(begin + 1 / f0_hz, back)
    settled = min(back + RECOVERY / f0_hz, end)
    edges = (float(record.time[0]), begin, first, back, settled, end)
    return {
        name: (low, high)
        for name, low, high in zip(WINDOWS, edges[:-1], edges[1:], strict=True)
        if high > low
    }


def returns_at(record: EventRecord, f0_hz: float) -> float:
    """The time, s, at which the voltage comes back; the end of the record where it does not."""
    end, later = float(record.time[-1]), record.time > record.rest_end
    if not later.any():
        return end
    away = departure(record)
    largest = float(np.abs(away[later]).max())
    last = np.abs(away[record.time >= end - 0.25 / f0_hz]).mean()
    if last >= largest / 2:
        return end
    return float(record.time[np.flatnonzero(np.abs(away) > largest / 2)[-1]])


def departure(record: EventRecord) -> np.ndarray:
    """(n,) by how much the magnitude is away from rest, per unit; the angle, rad, where the
    magnitude stays.
    """
    magnitude = np.hypot(*record.v.T) - record.rest.v
    if np.abs(magnitude).max() >= LEAST:
        return magnitude
    return np.unwrap(np.arctan2(record.v[:, 1], record.v[:, 0]))
