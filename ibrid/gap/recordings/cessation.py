"""A cessation fitted by the moments of release instead of its hold, and the hold that these amount
to.

The hold begins where the voltage at the filter last passes v_block. That voltage rings, so that a
little change of any number moves the beginning by a period of the ring, and the cost jumps with it.
The moment at which the current sets in again is seen in each record and moves nothing else: it is a
number of its own in each (`UNTIL`). The hold is what lies between the two in the end.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ibrid.gap.recordings.event_misfit import STEP, EventMisfit, event_parameter
from ibrid.gap.refitting.model import Values
from ibrid.measurement.recordings.event_windows import returns_at
from ibrid.measurement.recordings.events import Events
from ibrid.playback.limits import UNTIL, Limit, returned_at

#: Part of the current at rest that is none.
NONE = 0.1
HOLD, MOMENT = "momentary_cessation.t_hold", "momentary_cessation.until"


def with_release_moments(limits: Sequence[Limit]) -> tuple[Limit, ...]:
    """The same with a cessation that ends at a moment."""
    return tuple(UNTIL if one.id == UNTIL.id else one for one in limits)


def moments_from_hold(start: Mapping[str, float], events: Events) -> list[dict[str, float]]:
    """Values of a cessation with its hold behind the return of each record's voltage; and with the
    moments at which the current sets in for good, where a record has none before: a voltage that
    falls again while the current returns begins a hold anew.
    """
    values = {name: value for name, value in start.items() if name != HOLD}
    box, behind, seen = UNTIL.parameters["until"], {}, {}
    for record in events.records:
        name, moment = (
            event_parameter(MOMENT, record.name),
            returns_at(record, events.f0_hz) + start[HOLD],
        )
        none = (record.time > record.rest_end) & (
            np.hypot(*record.i.T) < NONE * np.hypot(*record.i_rest)
        )
        sets_in = float(record.time[none][-1]) if none.any() else moment
        behind[name], seen[name] = np.clip(
            np.array([moment, sets_in]) - record.rest_end, box.low, box.high
        ).tolist()
    return [values | behind] if behind == seen else [values | behind, values | seen]


def holds_from_moments(misfit: EventMisfit, x: np.ndarray) -> list[Values]:
    """Values with the hold that each record shows, and with their mean; none where no record was
    blocked.
    """
    values, holds = misfit.values(x), []
    for record in misfit.noise.events.records:
        own = misfit.values_for_event(record, x)
        (played,) = misfit.player.play(record, [own], step=STEP)
        hold = own[MOMENT] - returned_at(misfit.player.limits, played.memory)
        if np.isfinite(hold) and hold < UNTIL.parameters["until"].high:
            holds.append(max(hold, 1e-4))
    rest = {name: value for name, value in values.items() if not name.startswith(MOMENT)}
    return [
        {**rest, HOLD: hold} for hold in sorted({*holds, float(np.mean(holds))} if holds else ())
    ]
