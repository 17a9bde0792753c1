"""Records of events as operating points of a sweep: where a fit to records alone begins.

Away from rest a small departure obeys I(s) = Y(s) V(s), with the Laplace transforms of what voltage and current do, whatever that is.
Along s = damping + j omega a transform forgets what comes after the record's end, so that no window is needed and nothing leaks.
One record shows Y in one direction at each s: its `PointSweep` has that as the first of two columns, and zeros.
"""

import numpy as np

from ibrid.measurement.event_rest import noise_at_rest
from ibrid.measurement.events import EventRecord, Events
from ibrid.measurement.sweep import PointSweep, Sweep

#: Damping times the length of what happens: at its end e^-7 is left. Frequencies, from 1 / length to a part of the sampling rate.
FORGOTTEN, NUMBER, HIGHEST = 7.0, 20, 0.2
#: Part of the greatest departure of the voltage at which something begins to happen.
BEGUN = 0.1
#: Standard deviation of an answer that is not small, as a part of it.
NOT_SMALL = 0.03


def transformed(events: Events) -> Sweep:
    """The records as a sweep, p, q and v at the PCC; each number weighs by its noise and by how little is linear of it."""
    points = tuple(_point(record, events.f0_hz) for record in events.records)
    return Sweep(points, f0_hz=events.f0_hz, power_node="pcc", source=events.source)


def _point(record: EventRecord, f0_hz: float) -> PointSweep:
    moved = np.linalg.norm(record.v - [record.rest.v, 0.0], axis=1)
    begin = max(int(np.argmax(moved > BEGUN * moved.max())) - 1, 0)
    begin = min(begin, len(moved) - 4)
    time = record.time[begin:] - record.time[begin]
    lasts, interval = float(time[-1]), float(np.median(np.diff(time)))
    frequency = np.geomspace(1.0 / lasts, max(HIGHEST / interval, 2.0 / lasts), NUMBER)
    damping = FORGOTTEN / lasts
    weight = np.gradient(time) * np.exp(-damping * time)
    kernel = weight * np.exp(-2j * np.pi * np.outer(frequency, time))
    answer, excitation = np.zeros((NUMBER, 2, 2), dtype=complex), np.zeros((NUMBER, 2, 2), dtype=complex)
    answer[:, :, 0] = kernel @ (record.i - record.i_rest)[begin:]
    excitation[:, :, 0] = kernel @ (record.v - [record.rest.v, 0.0])[begin:]
    noise = record.sigma[begin:] if record.sigma is not None else noise_at_rest(record, f0_hz)[0]
    size = np.linalg.norm(answer, axis=(1, 2))
    sigma = np.hypot(np.linalg.norm(weight * noise), NOT_SMALL * size)
    return PointSweep(
        record.rest,
        frequency,
        answer,
        np.broadcast_to(np.maximum(sigma, np.finfo(float).tiny)[:, None, None], answer.shape),
        excitation=excitation,
        damping=damping,
    )
