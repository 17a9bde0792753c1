"""Records of events as operating points of a sweep: where a fit to records alone begins.

Small departures from rest obey I(s) = Y(s) V(s), with their Laplace transforms, whatever voltage
and current do. Along s = damping + j omega a transform forgets what comes after the record's end,
so that no window is needed and nothing leaks. A record shows Y in one direction at each s: its
`PointSweep` has that as the first of two columns, and zeros.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.measurement.recordings.between_samples import error_between
from ibrid.measurement.recordings.event_rest import noise_at_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Damping times the length of what happens: at its end e^-7 is left. Frequencies, from 1 / length
#: to a part of the sampling rate.
FORGOTTEN, NUMBER, HIGHEST = 7.0, 20, 0.2
#: Points between two samples at which their splines are summed, so that a transform is right up to
#: the highest frequency.
FINER = 4
#: Part of the greatest departure of the voltage at which something surely happens; and below which
#: it has not begun, which is no less than some times the median departure at rest.
HAPPENS, BEGUN, AT_REST = 0.1, 1e-3, 2.0
#: Standard deviation of an answer that is not small, as a part of it.
NOT_SMALL = 0.03
#: Current, per unit, that is none: a record in which nothing happens says nothing.
NOTHING = 1e-9


def transformed(events: Events) -> Sweep:
    """The records as a sweep, p, q and v at the PCC.

    Each number weighs by its noise, by what is open of the voltage between samples, and by how
    little is linear of it.
    """
    points = tuple(_point(record, events.f0_hz) for record in events.records)
    return Sweep(points, f0_hz=events.f0_hz, power_node="pcc", source=events.source)


def _point(record: EventRecord, f0_hz: float) -> PointSweep:
    begin = _beginning(record)
    samples = record.time[begin:]
    lasts, interval = float(samples[-1] - samples[0]), float(np.median(np.diff(samples)))
    fine = np.interp(
        np.arange(FINER * (len(samples) - 1) + 1) / FINER, np.arange(len(samples)), samples
    )
    frequency = np.geomspace(1.0 / lasts, max(HIGHEST / interval, 2.0 / lasts), NUMBER)
    damping = FORGOTTEN / lasts
    answer, excitation = (
        np.zeros((NUMBER, 2, 2), dtype=complex),
        np.zeros((NUMBER, 2, 2), dtype=complex),
    )
    i, v = (
        CubicSpline(record.time, record.i)(fine) - record.i_rest,
        record.voltage(fine) - [record.rest.v, 0.0],
    )
    for k, s in enumerate(damping + 2j * np.pi * frequency):
        wave = np.gradient(fine) * np.exp(-s * (fine - fine[0]))
        answer[k, :, 0] = wave @ i + 1e-3 * NOTHING * lasts  # zero is no answer
        excitation[k, :, 0] = wave @ v
    noise = record.sigma[begin:] if record.sigma is not None else noise_at_rest(record, f0_hz)[0]
    forgetting = np.exp(-damping * (samples - samples[0]))
    heard = np.linalg.norm(noise * np.gradient(samples) * forgetting)
    between = np.linalg.norm(error_between(record)[begin:].T * np.diff(samples) * forgetting[:-1])
    size, caused = (np.linalg.norm(one, axis=(1, 2)) for one in (answer, excitation))
    unknown = between * size / np.maximum(caused, between + 1e-300)
    sigma = np.sqrt((heard + NOTHING * lasts) ** 2 + unknown**2 + (NOT_SMALL * size) ** 2)
    spread = np.broadcast_to(sigma[:, None, None], answer.shape)
    return PointSweep(
        record.rest, frequency, answer, spread, excitation=excitation, damping=damping
    )


def _beginning(record: EventRecord) -> int:
    """The last sample before anything happens, with three behind it at least."""
    departure = np.linalg.norm(record.v - [record.rest.v, 0.0], axis=1)
    happens = int(np.argmax(departure > HAPPENS * departure.max()))
    still = AT_REST * float(np.median(departure[record.time <= record.rest_end]))
    quiet = np.flatnonzero(departure[:happens] <= max(BEGUN * departure.max(), still))
    return min(int(quiet[-1]) if len(quiet) else 0, len(departure) - 4)
