"""Momentary cessation fitted by its moments of release, and the hold time that these mean.

The hold time counts from when the voltage at the filter last passes v_block. That voltage rings, so
that a small change of any parameter shifts this moment by a period of the ringing, and the cost has
a jump there. The moment at which the current sets in again is visible in each record and changes
nothing else: it is fitted instead, one parameter for each record (`UNTIL`). The hold time is the
difference of the two moments at the end of the fit.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ibrid.gap.recordings.event_misfit import STEP, EventMisfit, event_parameter
from ibrid.gap.refitting.model import Values
from ibrid.measurement.recordings.event_windows import returns_at
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.playback.limits import UNTIL, Limit, returned_at

#: Part of the steady-state current below which the inverter is blocked.
BLOCKED_CURRENT = 0.1
#: Shortest hold time, s.
SHORTEST_HOLD = 1e-4
#: Names of the parameters in the two forms.
HOLD_TIME = "momentary_cessation.t_hold"
RELEASE_TIME = "momentary_cessation.until"


def with_release_times(limits: Sequence[Limit]) -> tuple[Limit, ...]:
    """Return the limits with a momentary cessation that ends at a given moment."""
    return tuple(UNTIL if limit.id == UNTIL.id else limit for limit in limits)


def release_times_from_hold(start: Mapping[str, float], events: Events) -> list[dict[str, float]]:
    """Return initial values with the release times that a hold time means in each record.

    The first counts the hold time from the return of the voltage. The second, where it differs,
    takes the moments at which the current sets in for good: a voltage that falls again while the
    current returns begins another hold.
    """
    values = {name: value for name, value in start.items() if name != HOLD_TIME}
    bounds = UNTIL.parameters["until"]
    expected: dict[str, float] = {}
    observed: dict[str, float] = {}
    for record in events.records:
        name = event_parameter(RELEASE_TIME, record.name)
        release = returns_at(record, events.f0_hz) + start[HOLD_TIME]
        times = np.array([release, _last_blocked(record, release)]) - record.rest_end
        expected[name], observed[name] = np.clip(times, bounds.low, bounds.high).tolist()
    if expected == observed:
        return [values | expected]
    return [values | expected, values | observed]


def _last_blocked(record: EventRecord, default: float) -> float:
    """Return the last time, s, at which the current is blocked; the default where it never is."""
    is_blocked = (record.time > record.rest_end) & (
        np.hypot(*record.i.T) < BLOCKED_CURRENT * np.hypot(*record.i_rest)
    )
    return float(record.time[is_blocked][-1]) if is_blocked.any() else default


def holds_from_release_times(misfit: EventMisfit, x: np.ndarray) -> list[Values]:
    """Return values with the hold time that each record shows at x (P,), and with their mean.

    Empty where no record was blocked.
    """
    values = misfit.values(x)
    holds: list[float] = []
    for record in misfit.noise.events.records:
        own_values = misfit.values_for_event(record, x)
        (response,) = misfit.player.play(record, [own_values], step=STEP)
        hold = own_values[RELEASE_TIME] - returned_at(misfit.player.limits, response.memory)
        if np.isfinite(hold) and hold < UNTIL.parameters["until"].high:
            holds.append(max(hold, SHORTEST_HOLD))
    if not holds:
        return []
    others = {name: value for name, value in values.items() if not name.startswith(RELEASE_TIME)}
    return [{**others, HOLD_TIME: hold} for hold in sorted({*holds, float(np.mean(holds))})]
