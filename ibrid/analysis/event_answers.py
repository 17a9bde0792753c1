"""What structures answer to an event that nobody recorded yet, and along which directions their parameters move it.

A record has thousands of samples, but structures differ in it along few directions: in an orthonormal basis of these, white noise
stays white and nothing is lost.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.linear_model import LinearModel
from ibrid.analysis.parametric import ParametricModel, Uncertainty
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.events import EventRecord
from ibrid.measurement.sweep import OperatingPoint
from ibrid.playback.compare import model_of_record
from ibrid.playback.recording import AFTER, LENGTH, RATE, event_of

#: Largest change of a search coordinate in a difference, and simulation steps times the fastest mode.
STEP, FINE = 1e-4, 1.0
#: A structure at an operating point: its record, matrices, response, and what is known of its parameters.
Structure = tuple[Record, LinearModel, ParametricModel, Uncertainty]


def event_answers(structures: Sequence[Structure], text: str, noise: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each structure the whitened answer (M,), and its slopes (M, R) along directions of standard deviation one.

    text : the event, "dip:0.6". noise : of each sample, relative to the rms of the first one's departure from rest; limits that
    stand beside a program act. Raises IbridError where one has no answer.
    """
    event, linear = event_of(text), structures[0][1]
    time = np.arange(round(max(LENGTH, event.over + AFTER) * RATE) + 1) / RATE
    shape = event.voltage(time, linear.v0[0])
    v = np.stack([np.real(shape), np.imag(shape)], axis=1)
    rest = OperatingPoint(text, linear.p_pcc, linear.q_pcc, linear.v0[0])
    asked = EventRecord(rest, time, v, np.tile(linear.i0, (len(time), 1)), event.at - 1.0 / RATE)
    played = [_played(one, asked) for one in structures]
    first = played[0][0]
    deviation = max(noise * float(np.sqrt(np.mean((first.reshape(-1, 2) - first[:2]) ** 2))), 1e-9)
    differences = [(answer - first)[:, None] for answer, _ in played]
    basis, _ = np.linalg.qr(np.hstack([*differences, *(slopes for _, slopes in played)]))
    return [
        (basis.T @ difference[:, 0] / deviation, basis.T @ slopes / deviation)
        for difference, (_, slopes) in zip(differences, played, strict=True)
    ]


def _played(structure: Structure, asked: EventRecord) -> tuple[np.ndarray, np.ndarray]:
    """The current (2 N,), and its slopes (2 N, R)."""
    record, linear, model, sure = structure
    own = model_of_record(record)
    size = STEP / np.maximum(np.abs(sure.directions).max(axis=0, initial=0.0), STEP)
    thetas = model.coordinates.to_theta(model.x + np.vstack([np.zeros(len(model.x)), (sure.directions * size).T]))
    values = [{**own.values, **dict(zip(model.names, map(float, theta), strict=True))} for theta in thetas]
    answers = [one.current.ravel() for one in own.player(linear.f0_hz).play(asked, values, step=FINE)]
    if not np.isfinite(answers).all():
        raise IbridError(f"the model does not hold out in {asked.name}")
    return answers[0], (np.array(answers[1:]) - answers[0]).T.reshape(-1, len(size)) / size
