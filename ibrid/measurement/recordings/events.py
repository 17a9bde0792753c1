"""What a recorder saw: terminal voltage and current in time, in a frame in which the voltage at
rest is [v, 0].

Everything is per unit on the inverter's base, amplitude-invariant, current out of the inverter, q
leading d (readers convert); v and i are those of the PCC, and so is the operating point at rest.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi
from os import PathLike
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import OperatingPointError, SweepError, near
from ibrid.foreign_text import show_controls
from ibrid.frozen import Frozen, FrozenDict, sealed
from ibrid.measurement.estimators.correlation import noise_of_frames
from ibrid.measurement.estimators.rebuilt import Rebuilt, rebuilt
from ibrid.measurement.estimators.window import Window
from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs
from ibrid.measurement.recordings.resampling import every_kth
from ibrid.measurement.recordings.voltage_noise import noise_and_waves, smoothed
from ibrid.measurement.sweeps.masked import require_unmasked
from ibrid.measurement.sweeps.sweep import (
    OperatingPoint,
    PointSweep,
    PowerNode,
    Sweep,
    require_header,
)
from ibrid.showing import brief, made_above, shown
from ibrid.writing import require_text

#: Least change of a set point, per unit (of f_ref in Hz), that is a step.
LEAST_STEP = 1e-6
#: Of samples that no estimator made.
NO_WINDOW = Window("none", np.zeros(1), np.ones(1))
#: A current that departs from its rest by less, rms, per unit, stays there.
STILL = 1e-6


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class EventRecord(Frozen):
    """One piece of time. Arrays are copied and read-only.

    rest : operating point at the PCC before the event, under the name of the record: p = v i_d, q =
    -v i_q there.
    time : (n,) s, increasing, also unevenly.
    v, i : (n, 2) d and q, per unit; the frame turns at 2 pi (f0 + offset_hz).
    rest_end : s, up to here it is at rest.
    sigma : (n,) standard deviation of each of i_d and i_q; None: unknown.
    offset_hz : frequency at rest less the nominal one.
    negative, zero : magnitudes of the negative sequence of v at rest, and of its zero sequence
    (None: not recorded), per unit.
    remarks : what was done to the samples on reading, sentences.
    f0_hz : nominal frequency, by multiples of which its voltage is told from noise; 0: it is played
    as it is.
    voltage_step, current_step : to which the file's numbers are rounded, per unit, where the noise
    at rest does not show it.
    stepped : whether its samples are the steps of a program that simulates by the trapezoidal rule;
    nothing lies between them.
    window : of the estimator whose frames the samples are, phasors or rms values; None of
    waveforms.
    jumping : whether its voltage may jump between two samples, so that no spline may swing there.
    told : what the device was told, name ("p_ref", "q_ref", "v_ref", "f_ref") -> (n,), per unit,
    f_ref in Hz; empty where it was told nothing new, or nobody wrote it down.

    Raises SweepError when shapes disagree, a number is not finite or the time does not increase.
    """

    rest: OperatingPoint
    time: np.ndarray
    v: np.ndarray
    i: np.ndarray
    rest_end: float
    sigma: np.ndarray | None = None
    offset_hz: float = 0.0
    negative: float = 0.0
    zero: float | None = None
    remarks: tuple[str, ...] = ()
    f0_hz: float = 0.0
    voltage_step: float = 0.0
    current_step: float = 0.0
    stepped: bool = False
    window: Window | None = None
    jumping: bool = False
    told: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_kinds(self)
        count = np.size(self.time)
        for name, shape in {
            "time": (count,),
            "v": (count, 2),
            "i": (count, 2),
            "sigma": (count,),
        }.items():
            if getattr(self, name) is None:
                continue
            require_unmasked(f"{name} of record {self.name}", getattr(self, name))
            object.__setattr__(self, name, self._checked(name, getattr(self, name), shape))
        told = {name: self._checked(name, value, (count,)) for name, value in self.told.items()}
        object.__setattr__(self, "told", FrozenDict(told))
        if count < 4 or (np.diff(self.time) <= 0).any():
            raise SweepError(
                f"record {self.name} must have at least four samples at increasing times; found "
                f"{count}."
            )
        if self.sigma is not None and not (self.sigma > 0).all():
            raise SweepError(
                f"sigma of record {self.name} must be positive; leave it out where the noise is "
                "unknown."
            )

    def _checked(self, name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
        """A copy that cannot be changed; SweepError for another shape and what is not finite."""
        value = _numbers(f"{name} of record {self.name}", values)
        if value.shape != shape or not np.isfinite(value).all():
            raise SweepError(
                f"{name} of record {self.name} must be finite numbers of shape {shape}; found "
                f"shape {value.shape}"
                f"{'' if np.isfinite(value).all() else ' and NaN or infinity'}."
            )
        return sealed(value)

    @property
    def name(self) -> str:
        return self.rest.name

    @property
    def i_rest(self) -> np.ndarray:
        """(2,) current at rest."""
        return np.array([self.rest.p, -self.rest.q]) / self.rest.v

    def until(self, time: float) -> "EventRecord":
        """The same up to a time, s; at least four samples."""
        count = max(int((self.time <= time).sum()), 4)
        cut: dict[str, Any] = {name: getattr(self, name)[:count] for name in ("time", "v", "i")}
        cut["told"] = {name: value[:count] for name, value in self.told.items()}
        return replace(self, **cut, sigma=None if self.sigma is None else self.sigma[:count])

    def every_kth(self, k: int) -> tuple["EventRecord", float]:
        """The same with every k-th of its even samples, low-passed; and the part of its noise that
        the low-pass leaves.
        """
        time, (v, i), left = every_kth(self.time, [self.v, self.i], k)
        sigma = None if self.sigma is None else left * self.sigma[::k]
        told = {name: value[::k] for name, value in self.told.items()}
        return replace(self, time=time, v=v, i=i, sigma=sigma, told=told), left

    @cached_property
    def steps_told(self) -> dict[str, np.ndarray]:
        """Set points that move -> (n,) by how much they are away from the rest, per unit."""
        rest = self.time <= self.rest_end
        away = {name: value - np.median(value[rest]) for name, value in self.told.items()}
        return {name: value for name, value in away.items() if np.abs(value).max() > LEAST_STEP}

    @cached_property
    def still(self) -> str:
        """Where the current stays at rest in all samples that tell something, a sentence that says
        so; else empty.
        """
        moved = (self.i - self.i_rest)[~self.masked]
        if np.linalg.norm(moved) > STILL * np.sqrt(moved.size):
            return ""
        where = " in the frames that are not left out" if self.masked.any() else ""
        return (
            f"nothing happens in record {self.name}: its current stays at rest{where}, so that "
            "there is nothing to compare; "
            "leave it out, or check the channels of the current"
        )

    @property
    def smeared(self) -> bool:
        """Whether an estimator takes more than the moment of a sample."""
        return self.window is not None and self.window.smears

    @cached_property
    def rebuilt(self) -> Rebuilt:
        """The voltage that went into the estimator."""
        wave, window = to_complex(self.v), self.window or NO_WINDOW
        return rebuilt(self.time, wave, window, self.voltage_noise, self.f0_hz)

    @cached_property
    def before_estimator(self) -> "EventRecord":
        """The same with the voltage that went into the estimator, between its frames; its current
        is a spline.
        """
        seen = self.rebuilt
        v, i = (
            to_pairs(seen.v),
            CubicSpline(self.time, self.i)(seen.time),
        )
        told = {name: np.interp(seen.time, self.time, value) for name, value in self.told.items()}
        return replace(
            self,
            time=seen.time,
            v=v,
            i=i,
            sigma=None,
            window=None,
            f0_hz=0.0,
            jumping=True,
            told=told,
        )

    @cached_property
    def masked(self) -> np.ndarray:
        """(N,) samples that tell nothing, since nobody knows the voltage in their window."""
        return self.rebuilt.masked if self.smeared else np.zeros(len(self.time), dtype=bool)

    @property
    def voltage_noise(self) -> float:
        """Standard deviation of the noise of each component of v, per unit; 0 where the rest cannot
        tell.
        """
        if self.window is not None:
            return noise_of_frames(self.time, self.v, self.rest_end, self.window)[0]
        return noise_and_waves(self.time, self.v, self.rest_end, self.f0_hz)[0]

    @cached_property
    def voltage(self) -> CubicSpline:
        """v between the samples, t -> (..., 2): the cubic spline through them, without the noise
        that they have at rest.
        """
        if self.jumping:
            lines = PchipInterpolator(self.time, self.v)
            return CubicSpline.construct_fast(lines.c, lines.x)
        if self.window is not None:
            return CubicSpline(self.time, self.v)
        return CubicSpline(self.time, smoothed(self.time, self.v, self.rest_end, self.f0_hz))

    @cached_property
    def current(self) -> CubicSpline:
        """i between the samples, t -> (..., 2)."""
        return CubicSpline(self.time, self.i)


def _numbers(what: str, values: Any) -> np.ndarray:
    """A copy as real numbers; SweepError for text, complex numbers and rows of unequal length."""
    try:
        held = np.asarray(values)
        if held.dtype.kind not in "biuf":
            raise ValueError
    except ValueError:
        first = np.asarray(values, dtype=object).ravel()[:1].tolist()
        raise SweepError(
            f"{what} must be real numbers; found {type(values).__name__} of {first!s:.60}, give an "
            "array of floats."
        ) from None
    return np.array(held, dtype=float, order="C")


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Events(Frozen):
    """The records of one inverter.

    records : with different names; `events["a"]` is the one of that name.
    f0_hz : nominal frequency, Hz.
    power_node : where the p and q that somebody states for a record are counted; `rest` is at the
    PCC whatever it says.
    s_base_va, v_base_v : per-unit base, if known; v_base_v is line to line, rms.
    notes : comments of the file. source : path or description.

    Raises SweepError when there is no record, two share a name or a number is out of range.
    """

    records: tuple[EventRecord, ...]
    f0_hz: float = 60.0
    power_node: PowerNode = "capacitor"
    s_base_va: float | None = None
    v_base_v: float | None = None
    notes: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        require_kinds(self)
        object.__setattr__(self, "records", tuple(self.records))
        object.__setattr__(self, "notes", tuple(self.notes))
        object.__setattr__(self, "source", show_controls(self.source))
        if not self.records:
            raise SweepError("events must have at least one record; found none.")
        require_header(self, "records", ("f0_hz", "s_base_va", "v_base_v"))

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * pi * self.f0_hz

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(record.name for record in self.records)

    @property
    def solver(self) -> str | None:
        """What a file says of records that are steps of a program, "trapezoidal"; None of
        others.
        """
        return "trapezoidal" if all(record.stepped for record in self.records) else None

    @property
    def window(self) -> str | None:
        """What a file says of the estimator of all records; None of waveforms.

        Raises SweepError where records have different ones, which one file cannot say.
        """
        names = {None if record.window is None else record.window.name for record in self.records}
        if len(names) > 1:
            found = ", ".join(sorted(name or "waveforms" for name in names))
            raise SweepError(
                f"records of one file must have one window; found {found}: write them one by one."
            )
        return names.pop()

    @property
    def mildest_first(self) -> tuple[str, ...]:
        """The names of the records, that whose voltage departs least from its rest first."""
        departure = {
            one.name: np.hypot(*(one.v - [one.rest.v, 0.0]).T).max() for one in self.records
        }
        return tuple(sorted(self.names, key=departure.__getitem__))

    @property
    def rests(self) -> Sweep:
        """The rest of each record as an operating point at which nothing was swept."""
        points = tuple(
            PointSweep(one.rest, np.ones(1), np.eye(2, dtype=complex)[None]) for one in self.records
        )
        return Sweep(points, f0_hz=self.f0_hz, power_node="pcc", source=self.source)

    def __getitem__(self, name: str) -> EventRecord:
        """The record of that name; OperatingPointError, with the near names, if there is none."""
        for record in self.records:
            if record.name == name:
                return record
        raise OperatingPointError(
            f"record {name} is not among the events; {near(name, self.names)}"
        )

    def only(self, *names: str) -> "Events":
        """The events with these records alone, in the given order."""
        return replace(self, records=tuple(self[name] for name in names))

    def require_moving(self, held: Collection[str] = ()) -> None:
        """SweepError where the current of a record stays at rest, but for those held out."""
        if still := next(
            (one.still for one in self.records if one.still and one.name not in held), ""
        ):
            raise SweepError(still)

    def __repr__(self) -> str:
        samples = sum(len(record.time) for record in self.records)
        return brief(
            f"<Events: {len(self.records)} records ({'; '.join(self.names)})",
            f", {samples} samples>",
        )

    def plot(self, ax: Any = None) -> Any:
        """A matplotlib figure of v and i of every record; with ax=(voltage, current), on those."""
        return shown(self, "plotting", "events_plot", ax)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the events file, text in columns, that `read_events` takes back, replacing it
        atomically.
        """
        require_text(path, "an events file")
        made_above(self, "ibrid.measurement.formats.event_csv", "write_events", path)

    def _repr_html_(self) -> str:
        """Voltages and currents of every record, for notebooks."""
        return shown(self, "pages.notebook", "events_html")

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the columns of an events file, frame dq; `read_events` takes it
        back.

        Base, frequency and power node are in its `attrs`. Raises SweepError without pandas.
        """
        return made_above(self, "ibrid.measurement.dataframe", "dataframe")
