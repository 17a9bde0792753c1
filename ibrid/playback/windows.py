"""The windows of a record, found from its voltage: pre | first cycle | during | recovery | after."""

from collections.abc import Mapping

import numpy as np

from ibrid.measurement.events import EventRecord

WINDOWS = ("pre", "first cycle", "during", "recovery", "after")
#: Cycles of recovery behind the return of the voltage.
RECOVERY = 6
#: A voltage is away from rest beyond so many deviations at rest and so much, per unit; back within this part of its largest
#: departure.
BEYOND, LEAST, BACK = 8.0, 1e-3, 0.1


def windows_of(record: EventRecord, f0_hz: float) -> Mapping[str, tuple[float, float]]:
    """Window -> (from, to), s; those that the record has. An event without a return of the voltage has no recovery and after.

    `first cycle` begins where the voltage leaves, `during` follows until it is back.
    """
    time, away = record.time, np.hypot(*(record.v - [record.rest.v, 0.0]).T)
    resting = time <= max(record.rest_end, time[0] + 2 / f0_hz)
    threshold = max(LEAST, BEYOND * float(np.sqrt(np.mean(away[resting] ** 2))))
    beyond = away > min(threshold, max(BACK * float(away.max()), LEAST))
    if not beyond.any():
        return {"pre": (float(time[0]), float(time[-1]))}
    begin, end = float(time[int(np.argmax(beyond))]), float(time[-1])
    lasting = np.flatnonzero(away > max(threshold, BACK * float(away.max())))
    back = float(time[lasting[-1]]) if lasting.size else begin
    if lasting.size and lasting[-1] >= len(time) - 2:
        back = end
    first = min(begin + 1 / f0_hz, end)
    edges = {
        "pre": (float(time[0]), begin),
        "first cycle": (begin, first),
        "during": (first, max(back, first)),
        "recovery": (max(back, first), min(max(back, first) + RECOVERY / f0_hz, end)),
        "after": (min(max(back, first) + RECOVERY / f0_hz, end), end),
    }
    return {name: edge for name, edge in edges.items() if edge[1] > edge[0]}
