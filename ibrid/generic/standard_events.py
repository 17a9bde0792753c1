"""What an identified model answers to standard events, as phasors of one cycle: the recordings to
which a generic model is fitted where nothing was recorded.

Events: dips and a swell of 150 ms, steps of the voltage and of both set points, and, where they
judge the generic model alone, a jump of the angle and a ramp of the frequency. The terminal voltage
is given, as behind a stiff grid.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.recordings.dq_pairs import to_pairs
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.compare import EventModel, play
from ibrid.playback.recording import Event, named_records

#: To which the generic model is fitted, and by which it is judged; set points are changes of p and
#: q, per unit.
FITTED = (
    ("dip", 0.8),
    ("dip", 0.5),
    ("swell", 1.1),
    ("step", -0.05),
    ("p_ref", -0.2),
    ("q_ref", 0.1),
)
HELD_OUT = (
    ("dip", 0.65),
    ("step", 0.05),
    ("p_ref", -0.1),
    ("q_ref", -0.1),
    ("phase", 10.0),
    ("frequency", 0.5),
)
#: Of each kind that ends, how long it lasts, s.
_LASTS = {"dip": 0.15, "swell": 0.15}
#: When an event begins, how long a record is, s; samples and frames per s.
_AT, _LENGTH, _RATE, _FRAMES = 0.3, 1.2, 2000.0, 200.0
#: The estimator: a Fourier window of one cycle.
_WINDOW = "dft:1"


@dataclass(frozen=True)
class Answers:
    """`fitted`, `held_out` : the model's answers; None where it answers no held-out event.
    `left_out` : a sentence for each event that the model has no answer to.
    """

    fitted: Events
    held_out: Events | None
    left_out: tuple[str, ...]


def answers_to_standard_events(
    model: EventModel, points: Sequence[OperatingPoint], f0_hz: float
) -> Answers:
    """Play the standard events at every operating point of the PCC, p, q, v.

    Raises IbridError where nothing is left to which a generic model could be fitted.
    """
    left_out: list[str] = []
    fitted, held_out = (
        tuple(_answers(model, points, f0_hz, kinds, left_out)) for kinds in (FITTED, HELD_OUT)
    )
    if not fitted:
        raise IbridError(f"the model answers none of the standard events: {left_out[0]}")
    source = "answers of the identified model to standard events"
    return Answers(
        Events(fitted, f0_hz=f0_hz, source=source),
        Events(held_out, f0_hz=f0_hz, source=source) if held_out else None,
        tuple(left_out),
    )


def _answers(
    model: EventModel,
    points: Sequence[OperatingPoint],
    f0_hz: float,
    kinds: Sequence[tuple[str, float]],
    left_out: list[str],
) -> Iterator[EventRecord]:
    for point in points:
        events = [_event(kind, value, point) for kind, value in kinds]
        records = named_records([point], events, f0_hz, _RATE, _LENGTH)
        for name, op, event, length in records:
            label = name if len(points) == 1 else f"{point.name} {name}"
            record = _at_rest(label, op, event, length)
            try:
                (played,) = play(model, Events((record,), f0_hz=f0_hz)).records
            except IbridError as error:
                left_out.append(f"{label}: {error}")
                continue
            if played.left is not None:
                left_out.append(f"{label}: the model leaves at {played.left:.3g} s")
                continue
            yield _in_frames(replace(record, i=played.current), f0_hz)


def _event(kind: str, value: float, point: OperatingPoint) -> Event:
    """Of set points the value is a change."""
    rest = {"p_ref": point.p, "q_ref": point.q}.get(kind, 0.0)
    return Event(kind, rest + value, at=_AT, lasts=_LASTS.get(kind))


def _at_rest(name: str, op: OperatingPoint, event: Event, length: float) -> EventRecord:
    """The voltage and the set points of an event, with the current of the rest throughout."""
    time = np.arange(round(length * _RATE) + 1) / _RATE
    v = event.voltage(time, op.v)
    current = np.tile([op.p / op.v, -op.q / op.v], (len(time), 1))
    rest = replace(op, name=name)
    voltage = to_pairs(v)
    rest_end = float(time[np.searchsorted(time, event.at) - 1])
    return EventRecord(rest, time, voltage, current, rest_end, told=event.told(time, op))


def _in_frames(record: EventRecord, f0_hz: float) -> EventRecord:
    """The record as the estimator shows it."""
    window = window_of(_WINDOW, f0_hz)
    every = round(_RATE / _FRAMES)
    first = int(np.ceil(-window.offsets[0] * _FRAMES))
    tags = record.time[::every][first:]
    through = window.matrix(tags, record.time)
    told = {name: value[::every][first:] for name, value in record.told.items()}
    return replace(
        record,
        time=tags,
        v=np.asarray(through @ record.v),
        i=np.asarray(through @ record.i),
        told=told,
        window=window,
        f0_hz=f0_hz,
    )
