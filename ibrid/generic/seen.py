"""A recording as a generic model sees it: the voltage between the frames, the set points, and the
window through which the current is compared.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.generic.simulate import TOLD
from ibrid.measurement.estimators.correlation import Correlated, correlated, noise_of_frames
from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs
from ibrid.measurement.recordings.event_rest import noise_at_rest
from ibrid.measurement.recordings.events import NO_WINDOW, EventRecord, Events

#: Least noise of a current, per unit; most steps between two samples of a waveform, s.
LEAST, COARSE = 2e-4, 1e-3

Play = Callable[[np.ndarray, np.ndarray, np.ndarray, tuple[float, float, float]], np.ndarray]


@dataclass(frozen=True, eq=False)
class SeenRecord(Frozen):
    """`time` (M,) s, `v` (M,) complex and `told` (M, 3) go into the model; `show` takes its current
    to the samples (N,). `sigma` : of each component of a sample.
    """

    record: EventRecord
    time: np.ndarray
    v: np.ndarray
    told: np.ndarray
    shared: Correlated
    sigma: float

    @property
    def rest(self) -> tuple[float, float, float]:
        """p, q, v."""
        return self.record.rest.p, self.record.rest.q, self.record.rest.v

    def current(self, play: Play) -> np.ndarray:
        """The model's current (N,), complex, at the samples of the recording."""
        answer = play(self.time, self.v, self.told, self.rest)
        if self.record.window is None:
            return np.interp(self.record.time, self.time, answer)
        return np.asarray(self.record.rebuilt.matrix @ answer)

    def residual(self, current: np.ndarray) -> np.ndarray:
        """Independent errors, in standard deviations, of the samples that tell something."""
        away = current - to_complex(self.record.i)
        error = to_pairs(away)[None]
        white = self.shared.whitened(error)[0][self.shared.kept]
        return (white / self.sigma).ravel()


def seen(record: EventRecord, f0_hz: float) -> SeenRecord:
    """A record, ready to be played. IbridError where it is too slow."""
    window = record.window or NO_WINDOW
    kept = ~record.masked
    if record.window is not None:
        before = record.before_estimator
        sigma = noise_of_frames(record.time, record.i, record.rest_end, window)[0]
        interval = float(np.median(np.diff(record.time)))
        if interval > 0.25:
            raise IbridError(
                f"record {record.name} has a frame every {interval:g} s, which shows no loop of "
                "REGC_A and REEC_A; take 10 frames per s or more"
            )
    else:
        before = record
        sigma = noise_at_rest(record, f0_hz)[0]
    if record.sigma is not None:
        sigma = float(np.median(record.sigma))
    apart = max(int(COARSE / float(np.median(np.diff(before.time)))), 1)
    places = np.unique(np.append(np.arange(0, len(before.time), apart), len(before.time) - 1))
    places = places if record.window is None else np.arange(len(before.time))
    held = np.clip(
        np.searchsorted(record.time, before.time + 1e-9, side="right") - 1, 0, len(record.time) - 1
    )  # a set point is held from the sample that first shows it
    moved = {name: value[held] for name, value in record.steps_told.items()}
    zero = np.zeros(len(before.time))
    told = np.stack([moved.get(name, zero) for name in TOLD], axis=1)
    return SeenRecord(
        record=record,
        time=before.time[places],
        v=to_complex(before.v)[places],
        told=told[places],
        shared=correlated(record.time, window, kept),
        sigma=max(sigma, LEAST),
    )


def seen_events(events: Events) -> tuple[SeenRecord, ...]:
    """All records in which something happens."""
    moving = [record for record in events.records if not record.still]
    if not moving:
        raise IbridError("nothing happens in any record; a generic model is fitted to events")
    return tuple(seen(record, events.f0_hz) for record in moving)
