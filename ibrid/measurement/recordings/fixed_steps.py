"""Records and sweeps that a program of fixed steps made by the trapezoidal rule, as programs of
electromagnetic transients do.

Law: the rule takes (2/h) (z - 1)/(z + 1), z = exp(s h), for s, so that a program answers a wave of
f as the device itself answers tan(pi f h)/(pi h): at 2 kHz and steps of 50 us 2.07 kHz (Tustin;
Dommel, IEEE Trans. Power App. Syst. PAS-88, 1969).
"""

from dataclasses import replace

import numpy as np

from ibrid.measurement.recordings.event_rest import noise_at_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.resampling import sampling_rate
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Longest step that a program of averaged inverters takes, s; noise at rest, per unit, above which
#: no program wrote the samples.
LONGEST_STEP, QUIET = 2.5e-4, 2e-6
#: Largest difference of the steps of two records, relative.
SAME = 1e-3


def step_of(events: Events) -> float | None:
    """The step, s, of records that say that they are the steps of a program, or may be: without
    noise, and equally far apart in all of them; else None.
    """
    if any(sampling_rate(record.time) is None for record in events.records):
        return None
    steps = [
        float(record.time[-1] - record.time[0]) / (len(record.time) - 1)
        for record in events.records
    ]
    if max(steps) > (1.0 + SAME) * min(steps):
        return None
    possible = max(steps) < LONGEST_STEP and all(
        _quiet(record, events.f0_hz) for record in events.records
    )
    return steps[0] if possible or events.solver else None


def _quiet(record: EventRecord, f0_hz: float) -> bool:
    """Whether a record shows no noise at rest."""
    return (
        record.sigma is None and max(noise_at_rest(record, f0_hz)[0], record.voltage_noise) < QUIET
    )


def in_fixed_steps(events: Events) -> Events:
    """The same records as the steps of a program."""
    return replace(
        events, records=tuple(replace(record, stepped=True) for record in events.records)
    )


def as_of_the_device(sweep: Sweep, step: float) -> Sweep:
    """A sweep of a program at the frequencies at which the device itself answers so; those beyond
    half of the rate left out.

    step : s.
    """
    return replace(sweep, points=tuple(_of_the_device(point, step) for point in sweep.points))


def _of_the_device(point: PointSweep, step: float) -> PointSweep:
    point = point.at(point.frequency * step < 0.5)
    return replace(point, frequency=np.tan(np.pi * point.frequency * step) / (np.pi * step))
