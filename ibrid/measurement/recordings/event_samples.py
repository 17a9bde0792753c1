"""From the samples of a recorder, phases or dq, in any convention, to records at rest in ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.header import CHOICES as SWEEP_CHOICES
from ibrid.measurement.conventions.header import number_of
from ibrid.measurement.conventions.possible_values import (
    Base,
    require_possible,
    require_possible_samples,
)
from ibrid.measurement.estimators.rebuilt import found_window
from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.recordings.dq_pairs import to_complex
from ibrid.measurement.recordings.event_rest import CYCLES, record_from_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.phasors import FORMS
from ibrid.measurement.recordings.resampling import every_kth, sampling_rate
from ibrid.measurement.recordings.spikes import describe_spikes
from ibrid.measurement.recordings.standing_samples import STOOD, describe_standing
from ibrid.measurement.recordings.steady_state import rests_from

CHOICES: dict[str, tuple[str, ...]] = {
    **SWEEP_CHOICES,
    "unit": ("pu", "si"),
    "frame": ("dq", "abc", "phasor", "rms"),
    "v_is": ("phase", "line"),
    "phase": ("a", "b", "c"),
    "solver": ("continuous", "trapezoidal"),
}
KEYS = (*CHOICES, "f0_hz", "s_base_va", "v_base_v", "window")
#: What is said beside them, s: the part of the records to keep.
SPAN = ("begin", "end")
#: How a note begins that says what was remarked on reading a record from another file.
REMARK = "remark - "
#: Samples per s that no averaged model needs, and those that are kept, at least.
MANY, KEPT = 100e3, 25e3
#: Per unit, far above what a wrong unit makes of kV and kA; what is above is no measurement.
LARGEST = 1e9
#: How far a difference of rounded numbers may be from a multiple of the step, in steps.
WHOLE = 0.02
#: Least step beside the largest difference of neighbouring values that is one: of all digits
#: nothing is left to round. Largest beside the largest value, that of seven bits, and fewest steps
#: that values show: a drawn voltage has a few levels.
FINEST, COARSEST, FEWEST = 1e-9, 0.02, 8
#: Steps in the least difference of a few values at most; so many values have two that are a step
#: apart.
PARTS, MANY_LEVELS = 50, 1000
_THIRD = np.exp(2j * np.pi / 3)
#: A channel that stands at its end for as long, cycles, or as many samples, is clipped: a sine is
#: within 1 % of its peak there. A voltage that moves at rest by less than the last part of what
#: another does is missing.
_STANDS, _SAMPLES, _STILL = 1 / 24, 3, 0.05


@dataclass(frozen=True, eq=False)
class Samples:
    """One record as a file has it.

    v, i : (2, n) d and q, or (3, n) phases; of frames of an estimator d and q of a phase, rms.
    sigma : (n,) of each current
    sample, per unit. told : set points (n,), in the units of the file.
    """

    name: str
    time: np.ndarray
    v: np.ndarray
    i: np.ndarray
    sigma: np.ndarray | None = None
    remarks: tuple[str, ...] = ()
    told: Mapping[str, np.ndarray] = field(default_factory=dict)

    def within(self, begin: float | None, end: float | None) -> "Samples":
        """The part from `begin` to `end`, s; SweepError where fewer than four samples are left."""
        if begin is None and end is None:
            return self
        first, last = (-np.inf if begin is None else begin), (np.inf if end is None else end)
        keep = (self.time >= first) & (self.time <= last)
        if keep.sum() < 4:
            raise SweepError(
                f"record {self.name} spans {self.time[0]:g} to {self.time[-1]:g} s, of which fewer "
                "than four samples lie from "
                f"{first:g} to {last:g} s; say other times: --from, --to."
            )
        sigma = None if self.sigma is None else self.sigma[keep]
        kept = f"kept from {self.time[keep][0]:.6g} to {self.time[keep][-1]:.6g} s, as said"
        return replace(
            self,
            time=self.time[keep],
            v=self.v[:, keep],
            i=self.i[:, keep],
            sigma=sigma,
            remarks=(*self.remarks, kept),
            told={name: value[keep] for name, value in self.told.items()},
        )


def events_of(
    samples: Sequence[Samples],
    header: Mapping[str, Any],
    where: str,
    notes: Sequence[str] = (),
) -> Events:
    """The events that samples make, in our convention.

    header : values of KEYS that are known, and of SPAN; frame is needed. In SI, voltages are phase
    to neutral, peak; the bases of the columns are v_base_v sqrt(2/3) and s_base_va / v_base_v
    sqrt(2/3).

    Raises SweepError: bases are missing, or what event_rest refuses.
    """
    f0_hz = float(header.get("f0_hz", 60.0))
    header = _with_window(header, where)
    bases = _bases(header, where)
    try:
        parts = [one.within(header.get("begin"), header.get("end")) for one in samples]
        records = tuple(_record(one, header, bases, f0_hz, notes) for one in parts)
        base = (
            Base(header.get("s_base_va"), header.get("v_base_v"))
            if header.get("unit") == "si"
            else Base(None, None)
        )
        for record in records:
            require_possible(record.rest, base, f"record {record.name}:", recorded=True)
            require_possible_samples(record.v, record.i, record.name, base)
    except SweepError as reason:
        raise type(reason)(f"{where}: {reason}") from reason
    return Events(
        records,
        f0_hz=f0_hz,
        power_node=header.get("power_node", "capacitor"),
        s_base_va=header.get("s_base_va"),
        v_base_v=header.get("v_base_v"),
        notes=tuple(note for note in notes if not note.startswith(REMARK)),
        source=where,
    )


def _with_window(header: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """The header with the window of phasors and rms values, which is not known where the file says
    none; SweepError for what belongs to other frames.
    """
    frames = header["frame"] in FORMS
    if header["frame"] == "abc" and header.get("window") is not None:
        raise SweepError(
            f"{where}: window is of phasors and rms values, and phases were recorded as they are; "
            "leave it out."
        )
    if (frames or header.get("window") is not None) and header.get(
        "solver", "continuous"
    ) != "continuous":
        raise SweepError(
            f"{where}: solver: trapezoidal is of waveforms, not of frames of an estimator; leave "
            "it out."
        )
    if frames and header.get("q_axis") == "lags":
        raise SweepError(
            f"{where}: q_axis is of frame: dq; angles of phasors, and q, have their usual sign: "
            "leave it out."
        )
    return {**header, "window": header.get("window") or "unknown"} if frames else header


def span_of(keys: Mapping[str, object]) -> dict[str, float]:
    """The part of the records to keep, where keys say it; SweepError for what is no time."""
    span = {
        key: number_of(keys[key], f"the {key} of the records, s")
        for key in SPAN
        if keys.get(key) is not None
    }
    if len(span) == 2 and span["begin"] >= span["end"]:
        raise SweepError(
            f"the end of the records must come after their begin; found {span['begin']:g} to "
            f"{span['end']:g} s."
        )
    return span


def _bases(header: Mapping[str, Any], where: str) -> tuple[float, float]:
    """Peak phase voltage and current that are one per unit; rms ones of phasors and rms values."""
    if header.get("unit", "pu") == "pu":
        return 1.0, 1.0
    missing = [key for key in ("s_base_va", "v_base_v") if header.get(key) is None]
    if missing:
        raise SweepError(
            f"{where}: unit: si must come with s_base_va and v_base_v; {missing[0]} is missing."
        )
    if header["frame"] in FORMS:
        voltage = header["v_base_v"] / np.sqrt(3)
        return voltage, header["s_base_va"] / (3 * voltage)
    voltage = header["v_base_v"] * np.sqrt(2 / 3)
    return voltage, 2 / 3 * header["s_base_va"] / voltage


def _record(
    samples: Samples,
    header: Mapping[str, Any],
    bases: tuple[float, float],
    f0_hz: float,
    notes: Sequence[str],
) -> EventRecord:
    v, i, sigma, zero = samples.v / bases[0], samples.i / bases[1], samples.sigma, None
    begin = f"{REMARK}{samples.name}: "
    remarks = (
        *(note.removeprefix(begin) for note in notes if note.startswith(begin)),
        *samples.remarks,
    )
    if header.get("current") == "in":
        i = -i
    if header["frame"] == "abc":
        _check_phases(samples, f0_hz)
        if not any("clipped" in one for one in remarks):
            pairs = zip(
                ("v_a", "v_b", "v_c", "i_a", "i_b", "i_c"), (*samples.v, *samples.i), strict=True
            )
            clipped = [name for name, value in pairs if _clipped(samples.time, value, f0_hz)]
            remarks += tuple(
                f"{name} stands still at its largest values: it is clipped" for name in clipped
            )
        zero = float(np.abs(v.mean(axis=0)).max())
        v, i = (_park(one, samples.time, f0_hz) for one in (v, i))
        sigma = (
            None if sigma is None else sigma * np.sqrt(2 / 3)
        )  # of d and of q, from three equal independent phases
    else:
        side = -1j if header.get("q_axis") == "lags" and header["frame"] == "dq" else 1j
        v, i = (one[0] + side * one[1] for one in (v, i))
    absurd = np.flatnonzero(np.maximum(np.abs(v), np.abs(i)) > LARGEST)
    if len(absurd):
        at, most = samples.time[absurd[0]], max(abs(v[absurd[0]]), abs(i[absurd[0]]))
        raise SweepError(
            f"record {samples.name}: v and i must be at most {LARGEST:g} per unit; found {most:g} "
            f"at {at:g} s, correct the cell."
        )
    if not any("stands out" in one for one in remarks):  # as the file this was imported from said
        remarks += describe_spikes(samples.time, (v, i), (samples.v, samples.i), bases)
    instantaneous = header["frame"] not in FORMS and header.get("window") is None
    if instantaneous and not any(STOOD in one for one in remarks):
        remarks += describe_standing(samples.time, samples.v, samples.i, f0_hz)
    steps: dict[str, Any] = {"stepped": _stepped(samples, header)}
    if header["frame"] == "dq":  # phases turn through all their steps at rest, which is a noise
        steps |= {
            "voltage_step": _step(samples.v) / bases[0],
            "current_step": _step(samples.i) / bases[1],
        }
    time, v, i, sigma, fewer = _fewer(samples.time, v, i, sigma)
    window = None if header.get("window") is None else window_of(str(header["window"]), f0_hz)
    told = _told(samples, header)
    if fewer and told:
        told = {name: np.interp(time, samples.time, value) for name, value in told.items()}
    try:
        record = record_from_rest(
            samples.name, time, v, i, f0_hz, sigma, zero, (*remarks, *fewer), window, told
        )
    except SweepError:
        if (start := rests_from(time, v, i, f0_hz)) is None:
            raise
        raise SweepError(
            f"record {samples.name} must begin at rest, where its operating point is read; found a "
            "start-up or another change "
            f"first, and steady state from {start:g} s on: add --from {start:g}."
        ) from None
    return replace(seen_through(record) if window else record, **steps)


def _told(samples: Samples, header: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Set points per unit, f_ref in Hz: powers of the base of powers, as delivered, and voltages of
    the base of the columns.
    """
    si = header.get("unit") == "si"
    power = header["s_base_va"] if si else 1.0
    voltage = _bases(header, "")[0] if si else 1.0
    if header["frame"] in FORMS and header.get("v_is") == "line" and si:
        voltage *= np.sqrt(3.0)
    into = -1.0 if header.get("current") == "in" else 1.0
    units = {"p_ref": into / power, "q_ref": into / power, "v_ref": 1.0 / voltage, "f_ref": 1.0}
    return {name: units[name] * value for name, value in samples.told.items()}


def seen_through(record: EventRecord) -> EventRecord:
    """A record of frames whose window, where the file leaves it open, is that which its voltage
    shows; with remarks on it.
    """
    if record.window is None:
        return record
    said = []
    if not record.window.known:
        window, length = found_window(record.time, to_complex(record.v), record.voltage_noise)
        record = replace(record, window=window)
        shown = f"the jump of the voltage is that of one of {length * 1e3:.3g} ms"
        said.append(
            "the estimator's window is not known; "
            f"{shown if length else 'no jump of the voltage shows it: none is taken'}"
        )
    if left_out := record.time[record.masked].tolist():
        said.append(
            f"{len(left_out)} of {len(record.time)} frames are left out, from {left_out[0]:.4g} to "
            f"{left_out[-1]:.4g} s: "
            "the voltage in their window cannot be told, at a jump or behind the end"
        )
    return replace(record, remarks=(*dict.fromkeys([*record.remarks, *said]),))


def _step(values: np.ndarray) -> float:
    """To which values are rounded: a whole part of their least difference of which all are
    multiples; 0 where there is none.
    """
    apart, most = np.diff(np.unique(values)), float(np.abs(values).max())
    if len(apart) < FEWEST or apart.min() <= FINEST * apart.max():
        return 0.0
    whole = float(apart.sum())
    for part in range(1, PARTS + 1 if len(apart) < MANY_LEVELS else 2):
        step = whole / round(whole * part / float(apart.min()))
        if step < COARSEST * most and np.allclose(
            apart / step, np.round(apart / step), rtol=0.0, atol=WHOLE
        ):
            return step
    return 0.0


def _stepped(samples: Samples, header: Mapping[str, Any]) -> bool:
    """Whether the file says that its samples are the steps of a program; SweepError where they
    cannot be.
    """
    if header.get("solver", "continuous") == "continuous":
        return False
    rate = sampling_rate(samples.time)
    if rate is None or rate > MANY:
        steps = (
            "uneven times"
            if rate is None
            else f"{rate / 1e3:.4g} kHz, of which every second one or fewer is kept"
        )
        raise SweepError(
            f"record {samples.name}: solver: trapezoidal says that the samples are the steps of a "
            "program, even and at most "
            f"{MANY / 1e3:g} kHz; found {steps}, leave the key out."
        )
    return True


def _check_phases(samples: Samples, f0_hz: float) -> None:
    """SweepError where a voltage stands still through the rest while another moves."""
    rest = samples.v[:, samples.time <= samples.time[0] + CYCLES / f0_hz]
    swing = np.median(np.abs(rest - np.median(rest, axis=1, keepdims=True)), axis=1)
    if swing.min() < _STILL * swing.max():
        raise SweepError(
            f"record {samples.name}: the voltage of phase {'abc'[int(np.argmin(swing))]} is "
            "missing, it stands still at rest; "
            "see which channel, or name the channels."
        )


def _clipped(time: np.ndarray, phase: np.ndarray, f0_hz: float) -> bool:
    """Whether a channel that moves stands still at one of its ends, for `_STANDS` cycles but not
    for half of one.
    """
    for end in (phase.max(), phase.min()):
        edges = np.flatnonzero(
            np.diff(np.concatenate([[False], phase == end, [False]]).astype(int))
        )
        first, last = edges[::2], edges[1::2] - 1
        lasts = (time[last] - time[first]) * f0_hz
        if ((last - first + 1 >= _SAMPLES) & (lasts > _STANDS) & (lasts < 0.5)).any():
            return True
    return False


def _park(phases: np.ndarray, time: np.ndarray, f0_hz: float) -> np.ndarray:
    """(2/3) (a + b e^{j 120} + c e^{-j 120}) e^{-j 2 pi f0 t}, amplitude-invariant: the positive
    sequence is constant.
    """
    vector = 2 / 3 * (phases[0] + _THIRD * phases[1] + np.conj(_THIRD) * phases[2])
    return vector * np.exp(-2j * np.pi * f0_hz * time)


def _fewer(
    time: np.ndarray, v: np.ndarray, i: np.ndarray, sigma: np.ndarray | None
) -> tuple[Any, ...]:
    """Of many even samples fewer. sigma shrinks as white noise does."""
    rate = sampling_rate(time)
    if rate is None or rate <= MANY:
        return time, v, i, sigma, ()
    k = int(rate / KEPT + 1e-3)
    fewer, (v, i), left = every_kth(time, [v, i], k)
    sigma = None if sigma is None else sigma[::k] * left
    return (
        fewer,
        v,
        i,
        sigma,
        (f"of {rate / 1e3:.4g} kHz, low-passed and resampled to {rate / k / 1e3:.4g} kHz",),
    )
