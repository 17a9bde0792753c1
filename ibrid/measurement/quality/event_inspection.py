"""The first look at records of events: rest, windows, depth, noise, and what each record can and
cannot tell.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import where_it_is_said
from ibrid.frozen import Frozen
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.recordings.event_rest import SLOWEST_HZ, noise_at_rest
from ibrid.measurement.recordings.event_windows import returns_at, windows_of
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.quantities import counted, hertz
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.showing import brief, made_above, shown
from ibrid.writing import write_json

#: Loops, the slowest first, and where they act, Hz: rules of thumb, of a plant controller too.
LOOPS = (
    ("plant controller, set points and droop", SLOWEST_HZ, 1.0),
    ("outer loops of power and voltage", 0.5, 10.0),
    ("synchronisation (PLL)", 5.0, 100.0),
    ("current loop", 100.0, 1000.0),
    ("filter resonance and delay", 1000.0, np.inf),
)
#: Voltages that ride-through logic leaves alone, per unit; a current that stays within this part of
#: its mean is flat.
CALM, FLAT = (0.9, 1.1), 0.01


@dataclass(frozen=True)
class RecordInspection(Frozen):
    """One record. Per unit, s, Hz, degrees.

    lowest, highest : means of the voltage over half a cycle. largest_current : likewise. angle :
    the largest departure of the angle; frequency : the lowest and the highest mean over a cycle
    after the event began, None where the voltage is lost.
    noise : of each component of the current, from sigma or from what is left of the rest beside its
    ripple.
    voltage_noise : of the voltage, by its third differences at rest. window : of the estimator,
    None of waveforms; bandwidth_hz : up to where it and the rate leave something of a wave.
    """

    rest: OperatingPoint
    begins: float
    samples: int
    rate_hz: float
    even: bool
    rest_end: float
    offset_hz: float
    negative: float
    zero: float | None
    windows: Mapping[str, tuple[float, float]]
    event: str
    lowest: float
    highest: float
    returns_at: float | None
    angle: float
    frequency: tuple[float, float] | None
    largest_current: float
    noise: float
    noise_from: str
    voltage_noise: float
    window: str | None
    bandwidth_hz: float
    remarks: tuple[str, ...]
    tells: tuple[str, ...]
    cannot_tell: tuple[str, ...]


#: Where inspections are written as text.
_TABLE = "ibrid.measurement.quality.inspection_table"


@dataclass(frozen=True, repr=False)
class EventsInspection:
    """What the first look at events finds."""

    source: str
    f0_hz: float
    power_node: str
    s_base_va: float | None
    v_base_v: float | None
    records: tuple[RecordInspection, ...]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        names = "; ".join(record.rest.name for record in self.records)
        return brief(
            f"<EventsInspection: {self.source or 'events'}, "
            f"{counted(len(self.records), 'record')} ({names})",
            f", {counted(len(self.warnings), 'warning')}>",
        )

    def __str__(self) -> str:
        """The blocks that `ibrid inspect` prints."""
        return made_above(self, _TABLE, "format_events_inspection")

    def _repr_html_(self) -> str:
        """The blocks and the warnings, for notebooks."""
        return shown(self, "pages.notebook", "inspection_html")

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each record."""
        return made_above(self, "ibrid.measurement.dataframe", "inspection_frame")

    def save(self, path: str | PathLike[str]) -> None:
        """Write the JSON of `to_json`, replacing the file atomically."""
        write_json(Path(path), self.to_json())

    def to_json(self) -> dict[str, object]:
        """Plain numbers, text, lists and dictionaries; unknown is None."""
        return {"schema": "ibrid.event-inspection/1", **asdict(self)}


def inspect_events(events: Events) -> EventsInspection:
    """Look at records before anything is fitted to them."""
    return EventsInspection(
        events.source,
        events.f0_hz,
        events.power_node,
        events.s_base_va,
        events.v_base_v,
        tuple(_inspect(record, events.f0_hz) for record in events.records),
        tuple(map(where_it_is_said, contradictions(events))),
    )


def _inspect(record: EventRecord, f0_hz: float) -> RecordInspection:
    later = record.time > record.rest_end
    step = np.diff(record.time)
    v, i = (_half_cycle(record, np.hypot(*value.T), f0_hz) for value in (record.v, record.i))
    back = returns_at(record, f0_hz)
    positive = np.stack([_half_cycle(record, one, f0_hz) for one in record.v.T])
    angle = np.unwrap(np.arctan2(positive[1], positive[0]))
    alive = later.any() and v.min() > 0.05
    shown = later if later.any() else np.ones(len(v), dtype=bool)
    facts = {
        "lowest": float(v[shown].min()),
        "highest": float(v[shown].max()),
        "returns_at": back if later.any() and back < record.time[-1] else None,
        "angle": float(np.rad2deg(angle[np.argmax(np.abs(angle))])) if alive else 0.0,
        "frequency": _frequency(record, angle, back, f0_hz) if alive else None,
        "largest_current": float(i.max()),
    }
    noise = (
        noise_at_rest(record, f0_hz)[0] if record.sigma is None else float(np.median(record.sigma))
    )
    rate = 1 / float(np.median(step))
    tells, cannot = _telling(record, facts, rate, noise, f0_hz)
    return RecordInspection(
        rest=record.rest,
        begins=float(record.time[0]),
        samples=len(record.time),
        rate_hz=rate,
        even=bool(np.ptp(step) < 1e-3 * np.median(step)),
        rest_end=record.rest_end,
        offset_hz=record.offset_hz,
        negative=record.negative,
        zero=record.zero,
        windows=windows_of(record, f0_hz),
        event=_event(record, facts) if later.any() else "nothing happens",
        noise=noise,
        noise_from="sigma" if record.sigma is not None else "rest",
        voltage_noise=record.voltage_noise,
        window=None if record.window is None else record.window.name,
        bandwidth_hz=_bandwidth(record, rate),
        remarks=tuple(map(where_it_is_said, record.remarks)),
        tells=tells,
        cannot_tell=cannot,
        **facts,
    )


def _bandwidth(record: EventRecord, rate: float) -> float:
    """Frequency, Hz, up to which a record shows something: half of its rate, or where its window
    leaves 1/sqrt(2).
    """
    return min(rate / 2, np.inf if record.window is None else record.window.bandwidth_hz)


def _half_cycle(record: EventRecord, value: np.ndarray, f0_hz: float) -> np.ndarray:
    """Means over the half cycle before each sample: what a negative sequence or a spike adds is
    gone.
    """
    whole = np.concatenate([[0.0], np.cumsum(np.diff(record.time) * (value[1:] + value[:-1]) / 2)])
    from_ = np.maximum(record.time - 0.5 / f0_hz, record.time[0])
    width = record.time - from_
    mean = (whole - np.interp(from_, record.time, whole)) / np.where(width > 0, width, 1)
    return np.where(width > 0, mean, value)


def _frequency(
    record: EventRecord, angle: np.ndarray, back: float, f0_hz: float
) -> tuple[float, float] | None:
    """Lowest and highest mean over a cycle, a cycle away from the jumps at the begin and the end of
    the event.
    """
    cycle = 1 / f0_hz
    time = record.time[
        (record.time >= record.rest_end + cycle) & (record.time <= record.time[-1] - cycle)
    ]
    time = time[(time < back - cycle) | (time > back + cycle)]
    if not len(time):
        return None
    turned = np.interp(time + 1 / f0_hz, record.time, angle) - np.interp(time, record.time, angle)
    mean = f0_hz + record.offset_hz + turned * f0_hz / (2 * np.pi)
    return float(mean.min()), float(mean.max())


def _event(record: EventRecord, facts: Mapping[str, Any]) -> str:
    low, high, v = record.rest.v - facts["lowest"], facts["highest"] - record.rest.v, record.rest.v
    back = facts["returns_at"]
    lasting = ", to the end" if back is None else f" for {back - record.rest_end:.3g} s"
    if max(low, high) >= 0.02:
        level = facts["lowest"] if low >= high else facts["highest"]
        return f"{'dip' if low >= high else 'swell'} from {v:.3g} to {level:.3g}{lasting}"
    if facts["frequency"] is not None and np.ptp(facts["frequency"]) > 0.05:
        return f"frequency from {facts['frequency'][0]:.4g} to {facts['frequency'][1]:.4g} Hz"
    if abs(facts["angle"]) >= 1:
        return f"the angle moves by {facts['angle']:.3g} degrees{lasting}"
    return "the voltage hardly moves"


def _telling(
    record: EventRecord, facts: Mapping[str, Any], rate: float, noise: float, f0_hz: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the record can tell, and what it cannot: laws of large signals act only where they are
    reached.
    """
    tells, cannot = [], []
    if facts["lowest"] < CALM[0]:
        tells.append(f"low-voltage logic: the voltage falls to {facts['lowest']:.3g}")
    else:
        cannot.append(
            f"low-voltage logic: the voltage never falls below {CALM[0]:g}, nothing of it could act"
        )
    if facts["highest"] > CALM[1]:
        tells.append(
            "high-voltage logic and the limit of the command: the voltage rises to "
            f"{facts['highest']:.3g}"
        )
    else:
        cannot.append(
            f"high-voltage logic: the voltage never rises above {CALM[1]:g}, nothing of it could "
            "act"
        )
    resting = float(np.hypot(*record.i_rest))
    if facts["largest_current"] > 1.02 * resting + 3 * noise:
        tells.append(
            f"a limit of the current up to {facts['largest_current']:.3g}: one above was not "
            "reached"
        )
    else:
        cannot.append("a limit of the current: it is never larger than at rest, none was reached")
    tells += _flat(record, f0_hz, noise)
    if facts["returns_at"] is None:
        cannot.append("the recovery: the record ends before the voltage comes back")
    if facts["frequency"] is not None and np.ptp(facts["frequency"]) > 0.05:
        tells.append("loops that act on the frequency")
    else:
        cannot.append("droop and inertia, well: the frequency hardly moves")
    moved = float(np.sqrt(np.mean(np.sum((record.i - record.i_rest) ** 2, axis=1))))
    if moved < 3 * noise * np.sqrt(2):
        cannot.append(
            f"anything finer: the current moves by {moved:.2g}, its noise is "
            f"{noise * np.sqrt(2):.2g}"
        )
    if record.window is None:
        cannot.append(f"anything above {hertz(rate / 2)}, half its sampling rate")
    else:
        of_loops = _of_loops(
            _bandwidth(record, rate), 1.0 / float(record.time[-1] - record.rest_end + 1.0 / rate)
        )
        tells += of_loops[0]
        cannot += of_loops[1]
    return tuple(tells), tuple(cannot)


def _of_loops(highest: float, lowest: float) -> tuple[list[str], list[str]]:
    """What frames show of each loop, from a frequency, Hz, to which the event lasts, to that which
    window and rate leave.
    """
    tells, cannot = [], []
    for name, low, high in LOOPS:
        band = f"{hertz(low)} to {hertz(high)}" if np.isfinite(high) else f"above {hertz(low)}"
        if high <= highest and low >= lowest:
            tells.append(f"{name} ({band})")
        elif low < highest and high > lowest:
            tells.append(f"a part of {name} ({band}): it sees {hertz(lowest)} to {hertz(highest)}")
        elif low >= highest:
            cannot.append(
                f"{name} ({band}), ever: window and rate leave nothing above {hertz(highest)}"
            )
        else:
            cannot.append(
                f"{name} ({band}): what follows the event is shorter than one of its periods"
            )
    return tells, cannot


def _flat(record: EventRecord, f0_hz: float, noise: float) -> Iterator[str]:
    """Currents that stand still through the last half of the event at another size than at rest, or
    cease.
    """
    window = windows_of(record, f0_hz).get("during")
    if window is None:
        return
    inside = (record.time > sum(window) / 2) & (record.time <= window[1])
    size = np.hypot(*record.i[inside].T)
    resting = float(np.hypot(*record.i_rest))
    if size.size < 4:
        return
    if size.max() < 0.1 * resting + 3 * noise and resting > 0.2:
        yield (
            f"blocking: the current falls to {size.mean():.2g} while the voltage is away "
            "(momentary_cessation?)"
        )
    elif np.ptp(size) < FLAT * size.mean() + 6 * noise and size.mean() > 1.02 * resting + 3 * noise:
        yield (
            f"a limit that may act: the current stands at {size.mean():.4g} in the event "
            "(current_limit?)"
        )
