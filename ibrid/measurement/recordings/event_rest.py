"""The rest before an event: how long it lasts, its operating point, frequency and angle, and what
is unbalanced in it.
"""

from collections.abc import Mapping

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.estimators.correlation import noise_of_frames
from ibrid.measurement.estimators.window import Window
from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs
from ibrid.measurement.recordings.events import LEAST_STEP, EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: Cycles at rest that a record begins with.
CYCLES = 2
#: Frames at rest that a record of an estimator begins with, at least.
FRAMES = 5
#: A departure from rest is beyond this many medians of the deviation at rest, and beyond this much
#: (per unit).
_BEYOND, _FLOOR = 8.0, 1e-5
#: Where the slowest loop of an inverter acts, Hz.
SLOWEST_HZ = 0.01
#: Samples at rest from which a noise can be told.
ENOUGH = 40
#: How much the means of half cycles may differ at rest, per unit: voltage, current.
_WANDER = (0.01, 0.03)
#: Another frequency than the nominal one is turned out up to here, and where it is this many
#: standard errors.
_OFFSET_HZ, _ERRORS = 5.0, 5.0


def noise_at_rest(record: EventRecord, f0_hz: float) -> tuple[float, float]:
    """Standard deviation of each component of the current at rest, per unit, and its degrees of
    freedom.

    What is left beside a constant, a slope, and waves of f0 and 2 f0; (0, infinite) where too few
    samples rest.
    """
    if record.window is not None:
        return noise_of_frames(record.time, record.i, record.rest_end, record.window)
    inside = record.time <= record.rest_end
    time = record.time[inside] - record.time[0]
    if len(time) < ENOUGH:
        return 0.0, np.inf
    columns = [np.ones(len(time)), time / time[-1]]
    columns += [
        wave(2 * np.pi * f0_hz * turns * time) for turns in (1, 2) for wave in (np.cos, np.sin)
    ]
    basis = np.stack(columns, axis=1)
    left = record.i[inside] - basis @ np.linalg.lstsq(basis, record.i[inside], rcond=None)[0]
    freedom = 2.0 * (len(time) - basis.shape[1])
    return float(np.sqrt((left**2).sum() / freedom)), freedom


def current_sequences(record: EventRecord, f0_hz: float) -> tuple[float, float]:
    """Magnitudes of the positive and of the negative sequence of the current at rest, per unit; the
    latter 0 for few samples.
    """
    inside = record.time <= record.rest_end
    found = np.abs(_constants(record.time[inside], to_complex(record.i[inside]), f0_hz))
    return float(found[0]), float(found[-1]) if len(found) > 1 else 0.0


def waves_at_rest(record: EventRecord, value: np.ndarray, f0_hz: float) -> np.ndarray:
    """(3,) magnitudes at rest of a constant and of what turns at -f0 and -2 f0 in a complex signal
    (N,); 0 for few samples.
    """
    inside = record.time <= record.rest_end
    found = np.abs(_constants(record.time[inside], value[inside], f0_hz))
    return np.concatenate([found, np.zeros(3 - len(found))])


def record_from_rest(
    name: str,
    time: np.ndarray,
    v: np.ndarray,
    i: np.ndarray,
    f0_hz: float,
    sigma: np.ndarray | None = None,
    zero: float | None = None,
    remarks: tuple[str, ...] = (),
    window: Window | None = None,
    told: Mapping[str, np.ndarray] | None = None,
) -> EventRecord:
    """A record whose rest is found, and which is turned so that the voltage at rest is [v, 0].

    v, i : (n,) complex, d + j q, in a frame that turns at 2 pi f0_hz, at any constant angle.

    At rest v and i are constants beside a negative sequence (at -2 f0 in this frame), a direct
    component of the phases (at -f0) and noise: the constants are fitted by least squares. A
    frequency at rest beside the nominal one turns them
    slowly. window : of an estimator that made frames of them, in which nothing ripples. told : as
    of `EventRecord`; the rest ends where one of them moves.

    Raises SweepError: no rest of two cycles, no voltage, phases that turn the other way, another
    frequency.
    """
    ripples = window is None
    _check_time(name, time, f0_hz, frames=not ripples)
    begin, cycle = float(time[0]), 1 / f0_hz
    count = int(np.searchsorted(time, begin + CYCLES * cycle * (1 - 1e-9)))
    count = count if ripples else max(count, FRAMES)
    level = np.abs(v[:count]).max()
    if not level > 0.01:
        raise SweepError(
            f"record {name} must begin with a voltage; found at most {level:.2g} per unit, check "
            "its unit (kV in place of V? per unit: --unit pu), or multiply values of a secondary "
            "side: --ratio v=20000/100."
        )
    if ripples:
        _check_sequence(name, _constants(time[:count], v[:count], f0_hz))
    offset, turned = _turned_back(time, v, i, count, f0_hz, ripples)
    _check_rest(name, time[:count], [one[:count] for one in turned], f0_hz, ripples)
    if abs(offset) > _OFFSET_HZ:
        raise SweepError(
            f"record {name}: the voltage at rest must turn at about f0_hz = {f0_hz:g}; found "
            f"{f0_hz + offset:.2f} Hz, "
            "write the nominal frequency into the file as f0_hz, or into a file beside it with the "
            "ending .meta."
        )
    still = min((_moves_at(one) for one in (told or {}).values()), default=len(time))
    if still < count:
        raise SweepError(
            f"record {name}: a set point moves within its rest, at {time[still]:.4g} s; let it "
            "begin earlier."
        )
    for _ in range(6):
        offset, turned = _turned_back(time, v, i, count, f0_hz, ripples)
        found = min(_departure(time, one, count, f0_hz, ripples) for one in turned)
        if min(found, still) <= count:
            break
        count = min(found, still)
    if offset:
        remarks = (
            *remarks,
            f"before the event the frequency is {f0_hz + offset:.4f} Hz; the frame turns with it",
        )
    constants = [_constants(time[:count], one[:count], f0_hz, ripples) for one in turned]
    rest, current = constants[0][0], constants[1][0]
    turn = np.conj(rest) / abs(rest)
    power = rest * np.conj(current)
    aligned = (one * turn for one in turned)
    v, i = (to_pairs(one) for one in aligned)
    return EventRecord(
        rest=OperatingPoint(name, float(power.real), float(power.imag), float(abs(rest))),
        time=time,
        v=v,
        i=i,
        rest_end=float(time[count - 1]),
        sigma=sigma,
        offset_hz=offset,
        negative=float(abs(constants[0][-1])) if len(constants[0]) > 1 else 0.0,
        zero=zero,
        remarks=remarks,
        f0_hz=f0_hz,
        window=window,
        told=told or {},
    )


def _turned_back(
    time: np.ndarray, v: np.ndarray, i: np.ndarray, count: int, f0_hz: float, ripples: bool
) -> tuple[float, list[np.ndarray]]:
    """By which frequency, Hz, the voltage of the first `count` samples turns in its frame, and both
    signals without that.
    """
    offset = _offset_hz(time[:count], v[:count], f0_hz, ripples)
    turn = np.exp(-2j * np.pi * offset * (time - float(time[0])))
    return offset, [one * turn for one in (v, i)]


def _moves_at(told: np.ndarray) -> int:
    """Place of the first sample at which a set point is another; how many there are where it
    stays.
    """
    moved = np.abs(told - told[0]) > LEAST_STEP
    return int(np.argmax(moved)) if moved.any() else len(told)


def _basis(time: np.ndarray, f0_hz: float, ripples: bool = True) -> np.ndarray:
    """(n, 3) a constant, and what stands still or turns backwards in the phases; the constant alone
    for few samples, and where nothing ripples.
    """
    turns = np.array([0, -1, -2] if ripples and len(time) >= 12 else [0])
    return np.exp(2j * np.pi * f0_hz * np.multiply.outer(time, turns))


def _constants(
    time: np.ndarray, value: np.ndarray, f0_hz: float, ripples: bool = True
) -> np.ndarray:
    return np.linalg.lstsq(_basis(time, f0_hz, ripples), value, rcond=None)[0]


def _offset_hz(time: np.ndarray, v: np.ndarray, f0_hz: float, ripples: bool = True) -> float:
    """Slope of the angle of v, beside the ripple that a negative sequence and a direct component
    make; 0 within its error.
    """
    angle = np.unwrap(np.angle(v))
    columns = [np.ones(len(time)), time - time.mean()]
    if ripples and len(time) >= 12:
        for turns in (1, 2):
            columns += [function(2 * np.pi * f0_hz * turns * time) for function in (np.cos, np.sin)]
    basis = np.stack(columns, axis=-1)
    fitted = np.linalg.lstsq(basis, angle, rcond=None)[0]
    freedom = max(len(time) - basis.shape[1], 1)
    variance = (
        np.sum((angle - basis @ fitted) ** 2) / freedom * np.linalg.pinv(basis.T @ basis)[1, 1]
    )
    slope = float(fitted[1])
    return slope / (2 * np.pi) if abs(slope) > max(_ERRORS * np.sqrt(variance), 1e-5) else 0.0


def _departure(
    time: np.ndarray, value: np.ndarray, count: int, f0_hz: float, ripples: bool = True
) -> int:
    """Place of the first sample from which on, for an eighth of a cycle, most samples are away from
    what the first `count` do.
    """
    constants = _constants(time[:count], value[:count], f0_hz, ripples)
    away = np.abs(value - _basis(time, f0_hz, ripples)[:, : len(constants)] @ constants)
    beyond = away > max(_BEYOND * float(np.median(away[:count])), _FLOOR)
    ends = np.searchsorted(time, time + 1 / (8 * f0_hz), side="right")
    total = np.concatenate([[0], np.cumsum(beyond)])
    places = np.arange(len(time))
    lasting = beyond & (2 * (total[ends] - total[places]) >= ends - places)
    return int(np.argmax(lasting)) if lasting.any() else len(time)


def _check_time(name: str, time: np.ndarray, f0_hz: float, *, frames: bool = False) -> None:
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if frames and step > 1 / (2 * SLOWEST_HZ):
        raise SweepError(
            f"record {name} must show a controller at work; found one value each {step:.4g} s, "
            f"while even a plant controller acts above {SLOWEST_HZ:g} Hz: record waveforms, or rms "
            "values each ms to 20 ms."
        )
    if frames and len(time) < FRAMES + 1:
        raise SweepError(
            f"record {name} must have {FRAMES} frames at rest and more behind them; found "
            f"{len(time)}, it is too slow or "
            "too short."
        )
    if len(time) < 4 or time[-1] - time[0] <= CYCLES / f0_hz:
        raise SweepError(
            f"record {name} must be longer than the two cycles at rest that it begins with "
            f"({CYCLES / f0_hz:.4g} s); found "
            f"{len(time)} samples, {time[-1] - time[0] if len(time) else 0:.4g} s."
        )
    if not frames and np.searchsorted(time, time[0] + CYCLES / f0_hz) < 3:
        raise SweepError(
            f"record {name} must have samples within the first two cycles ({CYCLES / f0_hz:.4g} "
            "s), more than two; its rest, "
            "and so its operating point, cannot be read; is the time in s?"
        )


def _check_sequence(name: str, constants: np.ndarray) -> None:
    if len(constants) > 1 and abs(constants[-1]) > abs(constants[0]) > 0.25 * abs(constants[-1]):
        raise SweepError(
            f"record {name}: a voltage of the phases is reversed or missing, its positive sequence "
            f"is {abs(constants[0]):.2f} "
            f"and its negative one {abs(constants[-1]):.2f} per unit; see which channel, or name "
            "the channels."
        )
    if len(constants) > 1 and abs(constants[-1]) > abs(constants[0]):
        raise SweepError(
            f"record {name}: the phases turn the wrong way, the negative sequence of the voltage "
            f"is {abs(constants[-1]):.2f} "
            f"against {abs(constants[0]):.2f} per unit; exchange b and c of the voltages and of "
            "the currents alike, as by --channels vb=COLUMN,vc=COLUMN,ib=COLUMN,ic=COLUMN."
        )


def _check_rest(
    name: str, time: np.ndarray, values: list[np.ndarray], f0_hz: float, ripples: bool = True
) -> None:
    """Means over half cycles stay, and no sample leaves for long."""
    lasting = "two cycles" if ripples else f"{FRAMES} frames and two cycles"
    half = np.minimum(((time - time[0]) * 2 * f0_hz).astype(int), 2 * CYCLES - 1)
    for value, allowed, what in zip(values, _WANDER, ("voltage", "current"), strict=True):
        steady = (
            value
            - _basis(time, f0_hz, ripples)[:, 1:] @ _constants(time, value, f0_hz, ripples)[1:]
        )
        parts = [steady[half == k] for k in range(2 * CYCLES) if (half == k).any()]
        means = np.array([part.mean() for part in parts])
        scatter = max(np.std(part) / np.sqrt(len(part)) for part in parts)
        moved = float(np.abs(means - means[0]).max())
        if moved > max(allowed, 6 * scatter):
            raise SweepError(
                f"record {name} must begin at rest for {lasting} ({CYCLES / f0_hz:.4g} s), where "
                "its operating point is read; "
                f"found the {what} to move by {moved:.2g} per unit within them, let the record "
                "begin earlier."
            )
