"""What structures answer to an event that nobody recorded yet, and along which directions their
parameters move it.

A record has thousands of samples, but structures differ in it along few directions: in an
orthonormal basis of these, white noise stays white and nothing is lost.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ibrid.analysis.models.linear_model import LinearModel
from ibrid.analysis.models.parametric import ParametricModel, Uncertainty
from ibrid.analysis.several_devices.freed_fits import EventFits
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.recordings.event_noise import EventNoise, estimate_event_noise
from ibrid.measurement.recordings.dq_pairs import to_pairs
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.recording import AFTER, LENGTH, RATE, Event, event_of
from ibrid.ranges import require_in_range

#: A structure at an operating point: its record, matrices, response, and what is known of its
#: parameters.
Structure = tuple[Record, LinearModel, ParametricModel, Uncertainty]


def event_to_rank(text: str) -> tuple[Event, float]:
    """An event, and the length of its record in s. IbridError for another form or a length beyond
    what can be ranked.
    """
    event = event_of(text)
    length = max(LENGTH, event.over + AFTER)
    require_in_range("ranked", length, f"the record of the event {text!r:.60}", IbridError)
    return event, length


def event_answers(
    structures: Sequence[Structure], text: str, noise: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each structure the whitened answer (M,), and its slopes (M, R) along directions of
    standard deviation one.

    text : the event, "dip:0.6", or a step of a set point, "p_ref:0.5". noise : of each sample,
    relative to the rms of the first one's departure from rest; what sampling leaves open joins it.
    Limits that stand beside a program act.
    Raises IbridError where one has no answer.
    """
    (event, length), linear = event_to_rank(text), structures[0][1]
    time = np.arange(round(length * RATE) + 1) / RATE
    shape = event.voltage(time, linear.v0[0])
    v, i = to_pairs(shape), np.tile(linear.i0, (len(time), 1))
    rest = OperatingPoint(text, linear.p_pcc, linear.q_pcc, linear.v0[0])
    told = event.told(time, rest)
    asked = EventRecord(
        rest, time, v, i, event.at - 1.0 / RATE, sigma=np.ones(len(time)), told=told
    )
    events = Events((asked,), f0_hz=linear.f0_hz)
    departure, _ = _played(structures[0], events, estimate_event_noise(events, events.rests))
    deviation = max(noise * float(np.sqrt(np.mean(departure**2))), 1e-9)
    events = replace(events, records=(replace(asked, sigma=np.full(len(time), deviation)),))
    weights = EventFits(structures[0][0], events).noise
    played = [_played(one, events, weights) for one in structures]
    differences = [(departure - played[0][0])[:, None] for departure, _ in played]
    basis, _ = np.linalg.qr(np.hstack([*differences, *(slopes for _, slopes in played)]))
    return [
        (basis.T @ difference[:, 0], basis.T @ slopes)
        for difference, (_, slopes) in zip(differences, played, strict=True)
    ]


def _played(
    structure: Structure, asked: Events, noise: EventNoise
) -> tuple[np.ndarray, np.ndarray]:
    """The whitened departure from rest (2 N,), and its slopes (2 N, R)."""
    record, _, _, sure = structure
    fits = EventFits(record, asked, noise)
    departure = fits.residuals(fits.x0[None])[0]
    if not np.isfinite(departure).all():
        raise IbridError(f"the model does not hold out in {asked.names[0]}")
    return departure, fits.slopes(fits.x0)[
        :, [fits.names.index(name) for name in sure.names]
    ] @ sure.directions
