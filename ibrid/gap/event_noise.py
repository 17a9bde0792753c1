"""What noise records of events are judged by: the stated one, or that of the current at rest before the event."""

from dataclasses import dataclass, field, replace

import numpy as np

from ibrid.gap.noise import LEAST_UNKNOWN, Noise
from ibrid.measurement.event_rest import noise_at_rest
from ibrid.measurement.events import Events
from ibrid.measurement.sweep import Sweep


@dataclass(frozen=True, eq=False)
class EventNoise(Noise):
    """`sigma` : record -> (N,) standard deviation of each of i_d and i_q. `told_by` : degrees of freedom of the estimate
    it comes from; infinite where it is stated, or so small that the least that any model deserves counts."""

    events: Events = field(kw_only=True)
    sigma: dict[str, np.ndarray] = field(kw_only=True)
    told_by: float = field(kw_only=True)

    def times(self, factor: float) -> "EventNoise":
        """The same: a record tells its noise."""
        return self

    def until(self, seconds: float) -> "EventNoise":
        """Of the same records, which end so long after their events begin."""
        records = tuple(one.until(one.rest_end + seconds) for one in self.events.records)
        sigma = {one.name: self.sigma[one.name][: len(one.time)] for one in records}
        return replace(self, events=replace(self.events, records=records), sigma=sigma)


def event_noise(events: Events, sweep: Sweep) -> EventNoise:
    """Sigma as given, else the rms of the current at rest about a constant, a slope and ripple of the frequency; to both
    is added `LEAST_UNKNOWN` of the rms of what happens."""
    sigma, freedom, stated = {}, np.inf, True
    for record in events.records:
        floor = LEAST_UNKNOWN * float(np.sqrt(np.mean((record.i - record.i_rest) ** 2)))
        own = record.sigma
        if own is None:
            level, count = noise_at_rest(record, events.f0_hz)
            own, stated = np.full(len(record.time), level), False
            if level > floor:
                freedom = min(freedom, count)
        sigma[record.name] = np.hypot(own, max(floor, 1e-9))
    source = "the sigma of the records" if stated else "the current at rest before each event"
    return EventNoise(sweep, True, source, events=events, sigma=sigma, told_by=freedom)
