"""What in the records of events contradicts what they say of themselves, or spoils a fit: a
sentence each.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.measurement.recordings.event_rest import current_sequences
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.standing_samples import STOOD
from ibrid.measurement.sweeps.quantities import counted, engineering, percent

#: A voltage at rest beyond this is not one of a grid; what it then is close to, and what that
#: usually means.
_USUAL, _CLOSE = (0.85, 1.15), 0.06
_FACTORS = {
    np.sqrt(
        3
    ): "between two phases taken as of one, or v_base_v of one phase taken as line to line",
    1 / np.sqrt(3): "v_base_v is line to line, and the voltages are of a phase on that base",
    np.sqrt(2): "v_base_v is rms, and a peak was given",
    1 / np.sqrt(2): "the columns hold rms values, or v_base_v is a peak",
    np.sqrt(3 / 2): "an invariant of power in place of amplitude was used for dq",
    np.sqrt(
        2 / 3
    ): "volts were divided by v_base_v itself; its peak of a phase is v_base_v sqrt(2/3)",
    3 / 2: "phases were added without the factor 2/3",
    1e3: "the columns are in V and the base in kV",
    1e-3: "the columns are in kV and the base in V",
}
#: Sequences at rest beyond this part of the voltage; currents at rest beyond this, per unit.
_UNBALANCED, _LOADED = 0.03, 1.25
#: Largest current, per unit, that may be one of a secondary side, or kA.
_SECONDARY = 0.05
#: Negative sequence of the current at rest, of the positive one, that no inverter makes; smallest
#: current that tells; degrees within which one that leads or lags by a third of a turn is of other
#: phases.
_MIXED, _TELLS, _THIRD = 0.2, 0.05, 8.0
#: Degrees off the voltage between which a current is so rather by its phases than by its sign.
_TURNED = (98.0, 150.0)
#: A step of time so many times the usual one, and longer than this part of a cycle, is a gap where
#: the voltage moves by this; one longer than the last part, behind which the voltage may have gone
#: and come, is a gap wherever it is.
_GAP, _PART, _MOVES, _LONG = 5.0, 0.1, 0.01, 0.5
#: A step of time so many times that between frames is a gap: a frame is missing.
_MISSING = 1.5
#: From where on the outer loops of an inverter act, Hz.
_OUTER_HZ = 0.5
#: Remarks on reading that are warnings.
_GRAVE = (
    "frames are left out",
    "signals at other times",
    "no angle and no frequency",
    "window is not known",
    "clipped",
    "stands out",
    "stand out",
    "a gap",
    "the data end early",
    "that the configuration announces",
    "without a ratio",
    STOOD,
)


def contradictions(events: Events) -> tuple[str, ...]:
    """Sentences on units, direction of the current, gaps and unbalance; what could not be read at
    all is an error on reading.
    """
    return tuple(
        sentence
        for record in events.records
        for sentence in _of(record, events.f0_hz, events.s_base_va)
    )


def _of(record: EventRecord, f0_hz: float, base_va: float | None) -> Iterator[str]:
    yield from (
        f"{record.name}: {one}." for one in record.remarks if any(words in one for words in _GRAVE)
    )
    yield from _slow_samples(record)
    yield from _sizes(record, base_va)
    yield from _unbalance(record)
    gaps = tuple(_gaps(record, f0_hz))
    yield from gaps
    turned = tuple(_phases_of_the_current(record, f0_hz))
    yield from turned
    if not gaps:
        yield from _nothing_happens(record)
    if record.rest.p < -0.02 and not turned:
        yield (
            f"{record.name}: p at rest is {record.rest.p:.3g}, the inverter takes power in; if it "
            "feeds the grid, its current "
            "counts into it: import it with --current in, or write a line current: in into the "
            "file (the sign is a hint, a storage may charge)."
        )


def _nothing_happens(record: EventRecord) -> Iterator[str]:
    """Whether the rest lasts to the end; a set point that moves ends it too."""
    if record.rest_end >= record.time[-1] and not record.steps_told:
        yield (
            f"{record.name}: nothing happens in it, voltage and current stay at rest from "
            f"{record.time[0]:.4g} to {record.time[-1]:.4g} s; was it cut before the event? A "
            "model is judged by its answer to one."
        )


def _slow_samples(record: EventRecord) -> Iterator[str]:
    step = float(np.median(np.diff(record.time)))
    if step > 1 / (2 * _OUTER_HZ):
        yield (
            f"{record.name}: one value each {step:.4g} s shows nothing above {1 / (2 * step):.3g} "
            "Hz, of the controls of an inverter at most its plant controller; record rms values "
            "each ms to 20 ms."
        )


def _sizes(record: EventRecord, base_va: float | None) -> Iterator[str]:
    v, i = record.rest.v, float(np.hypot(*record.i_rest))
    if not _USUAL[0] < v < _USUAL[1]:
        factor = min(_FACTORS, key=lambda one: abs(np.log(v / one)))
        likely = (
            f", nearly {factor:.4g}: {_FACTORS[factor]}" if abs(np.log(v / factor)) < _CLOSE else ""
        )
        yield (
            f"{record.name}: the voltage at rest is {v:.4g} per "
            f"unit{likely or ', check unit and v_base_v'}."
        )
    if i > _LOADED:
        thousand = (
            ", A in place of kA, or s_base_va in kVA or MVA?"
            if i > 100
            else ", check unit, s_base_va and v_base_v"
        )
        powers = (
            ""
            if record.window is None
            else " (powers per unit of the system's base and not of the device's?)"
        )
        yield f"{record.name}: the current at rest is {i:.4g} per unit{thousand}{powers}."
    elif 0 < (largest := float(np.hypot(*record.i.T).max())) < _SECONDARY:
        base = (
            f", or a base that is too large ({engineering(base_va, 'VA')}; s_base_va is in VA)"
            if base_va
            else ""
        )
        yield (
            f"{record.name}: the current is never above {largest:.2g} per unit, kA in place of A, "
            "or currents of the secondary side of transformers (--ratio i=1000/5 multiplies them)"
            f"{base}, unless the inverter idles?"
        )


def _unbalance(record: EventRecord) -> Iterator[str]:
    if record.negative > _UNBALANCED * record.rest.v:
        yield (
            f"{record.name}: a negative sequence of {percent(record.negative / record.rest.v)} of "
            "the voltage at rest ripples at "
            "twice the frequency; a model of the positive sequence does not answer for it."
        )
    if record.zero is not None and record.zero > _UNBALANCED * record.rest.v:
        yield (
            f"{record.name}: a zero sequence of up to {percent(record.zero / record.rest.v)} of "
            "the voltage at rest is left out."
        )


def _missing_frames(record: EventRecord, step: np.ndarray) -> Iterator[str]:
    usual = float(np.median(step))
    gaps = np.flatnonzero(step > _MISSING * usual)
    if len(gaps):
        longest = gaps[np.argmax(step[gaps])]
        missing = int(np.round(step[gaps] / usual - 1.0).sum())
        yield (
            f"{record.name}: about {counted(missing, 'frame')} missing in "
            f"{counted(len(gaps), 'gap')}, the longest of "
            f"{step[longest]:.3g} s from {record.time[longest]:.4g} s; nothing is known of the "
            "voltage there."
        )


def _phases_of_the_current(record: EventRecord, f0_hz: float) -> Iterator[str]:
    if record.window is not None:  # one sequence is all there is
        return
    positive, negative = current_sequences(record, f0_hz)
    if negative > max(_MIXED * positive, _TELLS):
        yield (
            f"{record.name}: the current at rest has a negative sequence of {negative:.3g} beside "
            "a positive one of "
            f"{positive:.3g}; a channel of the currents is swapped, reversed or missing."
        )
        return
    angle = float(np.rad2deg(np.arctan2(record.rest.q, record.rest.p)))
    size = abs(angle)
    if positive > _TELLS and _TURNED[0] < size < _TURNED[1]:
        later = "ib, ic, ia" if angle < 0 else "ic, ia, ib"
        yield (
            f"{record.name}: the current at rest is {size:.0f} degrees off the voltage; its "
            "channels are probably not in the order of those of the voltage "
            f"({abs(size - 120):.0f} degrees once {later} are taken as "
            "ia, ib, ic: --channels), or it takes power in and counts into the inverter "
            "(--current in; p and q at rest tell)."
        )
    elif positive > _TELLS and min(abs(size - 60), abs(size - 120)) < _THIRD:
        yield (
            f"{record.name}: the current at rest is {size:.0f} degrees off the voltage; if "
            "it should be in phase, its "
            "channels are not in the order of those of the voltage (a hint: p and q at rest may be "
            "so)."
        )


def _gaps(record: EventRecord, f0_hz: float) -> Iterator[str]:
    step = np.diff(record.time)
    if record.window is not None:
        yield from _missing_frames(record, step)
        return
    moved = np.hypot(*np.diff(record.v, axis=0).T) > _MOVES
    gaps = np.flatnonzero(
        step > np.maximum(_GAP * np.median(step), np.where(moved, _PART, _LONG) / f0_hz)
    )
    if len(gaps):
        k = gaps[np.argmax(step[gaps])]
        hidden = (
            "while the voltage moves"
            if moved[k]
            else "in which the voltage may have left and come back"
        )
        yield (
            f"{record.name}: {len(gaps)} gap{'s' if len(gaps) > 1 else ''} in time, the longest "
            f"{step[k] * 1e3:.3g} ms at "
            f"{record.time[k]:.4g} s {hidden}; nothing is known of it there."
        )
