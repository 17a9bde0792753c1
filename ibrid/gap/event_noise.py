"""What records of events are judged by: the noise of the current, and what nobody measured of the voltage between the samples."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ibrid.gap.noise import LEAST_UNKNOWN, Noise
from ibrid.measurement.between_samples import error_between, noise_left
from ibrid.measurement.event_rest import noise_at_rest
from ibrid.measurement.events import EventRecord, Events
from ibrid.measurement.sweep import Sweep
from ibrid.playback.between_samples import Matrices, uncertain_current

#: Degrees of freedom of the estimate of what sampling leaves open: of drawn edges it is right to a factor of two, rms.
SURE = 10.0
#: Part of the floor from which on that is said, and how.
SAID, SAMPLING = 0.3, ", and what sampling leaves open of the voltage"


@dataclass(frozen=True, eq=False)
class EventNoise(Noise):
    """`sigma` : record -> (N, 2) deviation by which residuals of i_d and i_q are weighed; of errors that vary together it is so
    much larger that they count as often as they are independent. `expected` : the deviation itself, of which the floor is.
    `of_current` : (N,) that of each measured component of the current. `told_by` : degrees of freedom of
    the estimate of all of it (Welch and Satterthwaite); `noise_told_by` : of that of the noise, infinite where it is stated, or so
    small that the least that any model deserves counts."""

    events: Events = field(kw_only=True)
    sigma: dict[str, np.ndarray] = field(kw_only=True)
    expected: dict[str, np.ndarray] = field(kw_only=True)
    of_current: dict[str, np.ndarray] = field(kw_only=True)
    told_by: float = field(kw_only=True)
    noise_told_by: float = field(kw_only=True)

    def times(self, factor: float) -> "EventNoise":
        """The same: a record tells its noise."""
        return self

    def of(self, events: Events) -> "EventNoise":
        """Of some of the same records, or of their beginnings."""
        cut: dict[str, Any] = {
            field: {one.name: getattr(self, field)[one.name][: len(one.time)] for one in events.records}
            for field in ("sigma", "expected", "of_current")
        }
        return replace(self, events=events, **cut)

    def until(self, seconds: float) -> "EventNoise":
        """Of the same records, which end so long after their events begin."""
        records = tuple(one.until(one.rest_end + seconds) for one in self.events.records)
        return self.of(replace(self.events, records=records))

    def independent(self, record: str) -> np.ndarray:
        """(N, 2) how many independent numbers each of a record's counts for: what noise and sampling add to chi2."""
        return (self.expected[record] / self.sigma[record]) ** 2

    @property
    def count(self) -> float:
        """Independent numbers in all records."""
        return float(sum(self.independent(name).sum() for name in self.events.names))

    def seen_by(self, matrices: Callable[[EventRecord], Matrices]) -> "EventNoise":
        """The same with what a model makes of the voltage that is open. matrices : A, B, C, D of it at a record's rest.

        Raises IbridError where it has no rest.
        """
        sigma, expected, share, by_noise, by_sampling = {}, {}, 0.0, 0.0, 0.0
        for record in self.events.records:
            own = self.of_current[record.name]
            open_voltage = error_between(record), noise_left(record)
            answer = uncertain_current(matrices(record), record.time, *open_voltage, own)
            sigma[record.name] = np.sqrt(own[:, None] ** 2 + answer.count * answer.variance)
            expected[record.name] = np.sqrt(own[:, None] ** 2 + answer.variance)
            share = max(share, float(answer.variance.sum() / (expected[record.name] ** 2).sum()))
            by_noise += float(((own[:, None] / sigma[record.name]) ** 2).sum())
            by_sampling += float((answer.variance / sigma[record.name] ** 2).sum())
        source = self.source.removesuffix(SAMPLING) + SAMPLING * (share > SAID)
        told_by = (by_noise + by_sampling) ** 2 / (by_noise**2 / self.noise_told_by + by_sampling**2 / SURE)
        return replace(self, sigma=sigma, expected=expected, source=source, told_by=told_by)

    @property
    def logarithm(self) -> float:
        """Twice the sum of the logarithms of sigma over that of the measured current: what a model pays for its own weights."""
        pairs = ((self.sigma[name], own[:, None]) for name, own in self.of_current.items())
        return float(sum(2.0 * np.log(sigma / own).sum() for sigma, own in pairs))


def event_noise(events: Events, sweep: Sweep) -> EventNoise:
    """Sigma as given, else the rms of the current at rest about a constant, a slope and ripple of the frequency; to both
    is added `LEAST_UNKNOWN` of the rms of what happens, and the rounding of the file's numbers."""
    of_current, freedom, stated = {}, np.inf, True
    for record in events.records:
        floor = LEAST_UNKNOWN * float(np.sqrt(np.mean((record.i - record.i_rest) ** 2)))
        floor = float(np.hypot(floor, record.current_step / np.sqrt(12.0)))
        own = record.sigma
        if own is None:
            level, count = noise_at_rest(record, events.f0_hz)
            own, stated = np.full(len(record.time), level), False
            if level > floor:
                freedom = min(freedom, count)
        of_current[record.name] = np.hypot(own, max(floor, 1e-9))
    source = "the sigma of the records" if stated else "the current at rest before each event"
    sigma = {name: np.repeat(own[:, None], 2, axis=1) for name, own in of_current.items()}
    return EventNoise(
        sweep,
        True,
        source,
        events=events,
        sigma=sigma,
        expected=sigma,
        of_current=of_current,
        told_by=freedom,
        noise_told_by=freedom,
    )


def noise_floors(noise: EventNoise) -> Mapping[str, float]:
    """Record -> NRMSE that noise and sampling alone would leave."""
    return {
        record.name: float(np.sqrt((noise.expected[record.name] ** 2).sum()) / np.linalg.norm(record.i - record.i_rest))
        for record in noise.events.records
    }
