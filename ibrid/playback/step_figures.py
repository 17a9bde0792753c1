"""How a set point that steps is followed: reaction, rise, settling and overshoot, of the measured
power and of the model's.

Law: with the power y, its mean y_0 at rest and y_1 in the last tenth of what follows the step at
t_0: reaction, the time from t_0 to a tenth of y_1 - y_0; rise, from there to nine tenths; settling,
the time from t_0 after which y stays within a twentieth of y_1 - y_0 about y_1; overshoot, how far
y goes beyond y_1, of y_1 - y_0.

Reference: IEEE Std 2800-2022, clause 3 (step response time, settling time); DyCoV 1.1 for the
tenths.
"""

from dataclasses import asdict, dataclass

import numpy as np

from ibrid.measurement.recordings.dq_pairs import to_complex
from ibrid.playback.compare import PlayedRecord
from ibrid.writing import PlainData

#: Parts of the change from and to which a rise counts; band of settling; part of what follows that
#: is its end.
FROM, TO, BAND, LAST = 0.1, 0.9, 0.05, 0.1
#: Change of a power, per unit, that is one.
LEAST = 1e-3


@dataclass(frozen=True)
class StepFigures:
    """Times, s, from the step on, None where they are not reached; `overshoot`, a part of the
    change.
    """

    reaction_s: float | None
    rise_s: float | None
    settling_s: float | None
    overshoot: float


def step_figures(played: PlayedRecord) -> PlainData | None:
    """For `playback.json`: which set point steps, when, and the figures of both sides; None where
    none steps and stays.
    """
    record = played.record
    if len(record.steps_told) != 1 or played.left is not None:
        return None
    name, told = next(iter(record.steps_told.items()))
    moved, arrived = (np.abs(told) > part * np.abs(told).max() for part in (FROM, 1.0 - BAND))
    if name not in ("p_ref", "q_ref") or not arrived[int(np.argmax(arrived)) :].all():
        return None
    kept, begin = ~record.masked, float(record.time[np.argmax(moved)])
    sides = {}
    for side, current in (("measured", record.i), ("model", played.current)):
        power = to_complex(record.v) * np.conj(to_complex(current))
        value = np.real(power) if name == "p_ref" else np.imag(power)
        figures = figures_of(record.time[kept], value[kept], begin)
        if figures is None:
            return None
        sides[side] = asdict(figures)
    return {"set_point": name, "at_s": begin, **sides}


def figures_of(time: np.ndarray, value: np.ndarray, begin: float) -> StepFigures | None:
    """Figures of a wave (N,) that steps at `begin`, s; None where it does not change, or is not
    known on either side.
    """
    behind = time >= begin
    if behind.all() or not behind.any():
        return None
    last = time >= time[-1] - LAST * (time[-1] - begin)
    start, end = float(value[~behind].mean()), float(value[last].mean())
    change = end - start
    if abs(change) < LEAST:
        return None
    part = (value[behind] - start) / change
    since = time[behind] - begin
    tenth, nine_tenths = (_reached(since, part, level) for level in (FROM, TO))
    outside = np.flatnonzero(np.abs(part - 1.0) > BAND)
    settled = (
        0.0
        if not len(outside)
        else None
        if outside[-1] == len(part) - 1
        else float(since[outside[-1] + 1])
    )
    rise = None if tenth is None or nine_tenths is None else nine_tenths - tenth
    return StepFigures(tenth, rise, settled, max(float(part.max()) - 1.0, 0.0))


def _reached(since: np.ndarray, part: np.ndarray, level: float) -> float | None:
    """When a level is first reached, on the line between two samples; None where it is not."""
    above = np.flatnonzero(part >= level)
    if not len(above):
        return None
    k = int(above[0])
    if k == 0:
        return float(since[0])
    return float(np.interp(level, part[k - 1 : k + 1], since[k - 1 : k + 1]))
