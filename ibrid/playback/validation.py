"""Error measures of IEC 61400-27-2 between a model and a record: the largest, the mean and the mean
absolute error by window.

Law: e = (model - measured), per unit of the ratings, of P, Q, Ip and Iq of the positive sequence,
in the windows before the fault (one second that ends 50 ms ahead of it), during (from 20 ms behind
it to 20 ms ahead of its clearing) and after (from 60 ms behind that to 20 ms ahead of the end); MXE
= max |e|, ME = mean e, MAE = mean |e|. Waveforms become phasors by a Fourier window of one cycle of
the nominal frequency; both sides pass (w/(s + w))^2, w = 2 pi 15/s, forwards and backwards, window
by window, and are compared every 2 ms. An event that is not cleared has no window during it.

Reference: IEC 61400-27-2:2020, annex C, and the limits that DyCoV 1.1 (RTE, PCS I16) publishes for
it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.recordings.event_rest import noise_at_rest
from ibrid.measurement.recordings.event_windows import returns_at
from ibrid.measurement.recordings.events import EventRecord
from ibrid.playback.compare import Playback, PlayedRecord
from ibrid.writing import PlainData

STANDARD = "iec-61400-27-2"
SIGNALS = ("p", "q", "ip", "iq")
#: Longest part before the fault, s, and what is left out: ahead of the fault, behind it, ahead of
#: and behind its clearing, ahead of the end.
BEFORE, AHEAD, BEHIND, CLEARED, BACK, END = 1.0, 0.05, 0.02, 0.02, 0.06, 0.02
#: Corner of each of two equal poles, Hz; steps of filtering and of comparing, s; samples that a
#: window has at least.
CORNER, STEP, COMPARED, FEWEST = 15.0, 1e-3, 2e-3, 10
#: Window -> limits of MXE, ME and MAE, per unit, beside a simulation and beside a device's own
#: record.
LIMITS = {
    "simulated": {
        "before": (0.05, 0.02, 0.03),
        "during": (0.08, 0.05, 0.07),
        "after": (0.05, 0.02, 0.03),
    },
    "field": {
        "before": (0.08, 0.04, 0.07),
        "during": (0.10, 0.05, 0.08),
        "after": (0.08, 0.04, 0.07),
    },
}
#: Noise at rest, per unit, above which a record is one of a device in the field.
QUIET = 2e-6
MEASURES = ("mxe", "me", "mae")


@dataclass(frozen=True, eq=False)
class Compared:
    """Measured and modelled phasors, d + j q, per unit, at even times (N,)."""

    time: np.ndarray
    v: np.ndarray
    measured: np.ndarray
    model: np.ndarray


def validation(playback: Playback) -> PlainData:
    """For `playback.json` and the records of fits: that of all records of a playback."""
    return validation_of(playback.records)


def validation_of(records: Sequence[PlayedRecord]) -> PlainData:
    """Windows of every record with the measures of each signal, their limits and whether they pass;
    `unfiltered` : the same measures of what is compared without the filter. Records whose
    simulation left have none.
    """
    windows = [entry for one in records if one.left is None for entry in _windows(one)]
    passed = [signal["pass"] for window in windows for signal in window["signals"].values()]
    return {"standard": STANDARD, "pass": bool(passed) and all(passed), "windows": windows}


def windows_of_standard(record: EventRecord, f0_hz: float) -> dict[str, tuple[float, float]]:
    """Window -> (from, to), s, of those that a record has, up to its last frame that tells
    something.
    """
    known = record.time[~record.masked]
    if len(known) < 2:
        return {}
    first, back, end = float(known[0]), returns_at(record, f0_hz), float(known[-1])
    begin, cleared = record.rest_end, back < float(record.time[-1])
    if record.smeared and len(jumps := record.rebuilt.jumps.times):
        begin, back = float(jumps.min()), float(jumps.max()) if cleared else back
    windows = {"before": (max(first, begin - AHEAD - BEFORE), begin - AHEAD)}
    if cleared:
        windows["during"] = begin + BEHIND, back - CLEARED
    windows["after"] = (back if cleared else begin) + BACK, end - END
    return {name: edges for name, edges in windows.items() if edges[1] - edges[0] >= FEWEST * STEP}


def measures(error: np.ndarray) -> dict[str, float]:
    """MXE, ME and MAE of errors (N,)."""
    return {
        "mxe": float(np.abs(error).max()),
        "me": float(error.mean()),
        "mae": float(np.abs(error).mean()),
    }


def _windows(played: PlayedRecord) -> Iterator[PlainData]:
    record = played.record
    windows = windows_of_standard(record, record.f0_hz)
    if not windows:
        return
    compared = _phasors(played)
    noisy = (
        record.sigma is not None
        or max(noise_at_rest(record, record.f0_hz)[0], record.voltage_noise) > QUIET
    )
    reference = "field" if noisy else "simulated"
    for name, (begin, end) in windows.items():
        inside = (compared.time >= begin) & (compared.time <= end)
        if inside.sum() < FEWEST:
            continue
        raw, filtered = (
            _errors(compared, inside, filtered=False),
            _errors(compared, inside, filtered=True),
        )
        limit: dict[str, float] = dict(zip(MEASURES, LIMITS[reference][name], strict=True))
        yield {
            "record": record.name,
            "name": name,
            "t": [begin, end],
            "reference": reference,
            "signals": {
                signal: {
                    **measures(filtered[signal]),
                    "unfiltered": measures(raw[signal]),
                    "limit": limit,
                    "pass": all(
                        abs(value) <= limit[key]
                        for key, value in measures(filtered[signal]).items()
                    ),
                }
                for signal in SIGNALS
            },
        }


def _phasors(played: PlayedRecord) -> Compared:
    """Phasors at even steps: of waveforms behind a Fourier window of a cycle, frames as they are
    but for those that tell nothing.
    """
    record, unit = played.record, np.array([1.0, 1.0j])
    kept = ~record.masked
    even = np.arange(record.time[kept][0], record.time[kept][-1], STEP)
    if record.window is None:
        shows = window_of("dft:1", record.f0_hz).centred.matrix(even, record.time)
        v, measured, model = (
            shows @ (wave @ unit) for wave in (record.v, record.i, played.current)
        )
        return Compared(even, v, measured, model)
    waves = [
        PchipInterpolator(record.time[kept], wave[kept])(even) @ unit
        for wave in (record.v, record.i, played.current)
    ]
    return Compared(even, *waves)


def _errors(compared: Compared, inside: np.ndarray, *, filtered: bool) -> Mapping[str, np.ndarray]:
    """Signal -> model less measured, every 2 ms of a window."""
    v = compared.v[inside]
    sides = [_signals(v, current[inside]) for current in (compared.model, compared.measured)]
    if filtered:
        sides = [{name: _low_passed(one) for name, one in side.items()} for side in sides]
    apart = round(COMPARED / STEP)
    return {name: (sides[0][name] - sides[1][name])[::apart] for name in SIGNALS}


def _signals(v: np.ndarray, i: np.ndarray) -> dict[str, np.ndarray]:
    power, along = v * np.conj(i), i * np.conj(v) / np.maximum(np.abs(v), 1e-6)
    return {"p": np.real(power), "q": np.imag(power), "ip": np.real(along), "iq": -np.imag(along)}


def _low_passed(wave: np.ndarray) -> np.ndarray:
    """Two equal poles, forwards and backwards, so that nothing is delayed."""
    from scipy.signal import bilinear, filtfilt  # half a second, for validation alone

    corner = 2.0 * np.pi * CORNER
    b, a = bilinear([corner**2], [1.0, 2.0 * corner, corner**2], fs=1.0 / STEP)
    return filtfilt(b, a, wave, method="gust")
