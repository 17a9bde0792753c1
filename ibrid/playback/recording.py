"""Records of our own inverters: events on the voltage of the grid, answered by the nonlinear
reference models.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import degrees, isfinite, radians

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.assembly.set_points import SET_POINTS
from ibrid.errors import IbridError, near
from ibrid.measurement.recordings.dq_pairs import to_pairs
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.reference import ReferenceInverter
from ibrid.playback.player import FINE, fastest, run
from ibrid.playback.tape import tape_of
from ibrid.ranges import require_in_range, written_number

#: kind -> what its number means, and how long it lasts by default, s (None: to the end).
KINDS: Mapping[str, tuple[str, float | None]] = {
    "dip": ("the voltage that remains, of that at rest", 0.15),
    "swell": ("the voltage, of that at rest", 0.15),
    "step": ("the change of the voltage, per unit", None),
    "phase": ("the jump of the angle, degrees", None),
    "frequency": ("the change of the frequency, Hz", None),
    "p_ref": ("the active power that it is told, per unit", None),
    "q_ref": ("the reactive power that it is told, per unit", None),
}
#: How near a set point of a reference inverter is to its power to be that, per unit.
SAME = 1e-6
#: Beginning, s; how long an edge takes, s (a raised cosine); Hz/s; samples per s; shortest record,
#: and what follows, s.
AT, RISE, RAMP, RATE, LENGTH, AFTER = 0.1, 1e-3, 1.0, 5000.0, 0.4, 0.15
_FORM = "an event is written dip:0.6,at=0.1,for=0.15"


@dataclass(frozen=True)
class Event:
    """One event. `kind`, `value` : as in `KINDS`. `at`, `lasts`, `rise` : s; `ramp` : Hz per s, of
    a frequency.
    """

    kind: str
    value: float
    at: float = AT
    lasts: float | None = None
    rise: float = RISE
    ramp: float = RAMP

    @property
    def name(self) -> str:
        """Of the record."""
        return f"{self.kind}:{self.value:g}"

    @property
    def over(self) -> float:
        """When it is over, s; its beginning where it lasts."""
        return self.at + (self.lasts or 0.0)

    def told(self, time: np.ndarray, op: OperatingPoint) -> dict[str, np.ndarray]:
        """The set point (n,) that moves, by name, from that of a rest on; none of an event on the
        grid.
        """
        if self.kind not in SET_POINTS:
            return {}
        rest = op.p if self.kind == "p_ref" else op.q
        return {self.kind: rest + (self.value - rest) * self._shape(time)}

    def _shape(self, time: np.ndarray) -> np.ndarray:
        """0 before the event, 1 while it lasts."""
        shape = _edge((time - self.at) / self.rise)
        return (
            shape
            if self.lasts is None
            else shape - _edge((time - self.at - self.lasts) / self.rise)
        )

    def voltage(self, time: np.ndarray, v: float) -> np.ndarray:
        """(n,) complex, d + j q in the frame that turns at the nominal frequency; v at rest."""
        if self.kind in SET_POINTS:
            return np.full(len(time), v, dtype=complex)
        if self.kind == "frequency":
            slope, back = (
                np.copysign(self.ramp, self.value),
                np.inf if self.lasts is None else self.over,
            )
            return v * np.exp(
                2j * np.pi * (self._angle(time, slope, self.at) - self._angle(time, slope, back))
            )
        shape = self._shape(time)
        if self.kind == "phase":
            return v * np.exp(1j * radians(self.value) * shape)
        return (
            v + self.value * shape if self.kind == "step" else v * (1 + (self.value - 1) * shape)
        ).astype(complex)

    def _angle(self, time: np.ndarray, slope: float, begin: float) -> np.ndarray:
        """Turns of a frequency that rises from `begin` at a slope (Hz/s) to the value."""
        since, whole = np.clip(time - begin, 0.0, None), self.value / slope
        rising = np.minimum(since, whole)
        return slope * rising**2 / 2 + self.value * (since - rising)


def event_of(text: str) -> Event:
    """An event from "dip:0.6,at=0.1,for=0.15"; also rise=s and, of a frequency, ramp=Hz/s.

    IbridError for another form.
    """
    head, *rest = text.split(",")
    kind, _, value = (part.strip() for part in head.partition(":"))
    if kind not in KINDS:
        raise IbridError(f"{_FORM}, with {', '.join(KINDS)}; found {text!r}, {near(kind, KINDS)}")
    fields = {"value": _number(kind, value, text), "lasts": KINDS[kind][1]}
    names = {"at": "at", "for": "lasts", "rise": "rise"} | (
        {"ramp": "ramp"} if kind == "frequency" else {}
    )
    for part in rest:
        name, _, value = (piece.strip() for piece in part.partition("="))
        if name not in names:
            raise IbridError(
                f"{_FORM}, with {', '.join(names)}; found {part.strip()!r}, {near(name, names)}"
            )
        fields[names[name]] = _number(name, value, text)
        if fields[names[name]] <= 0:
            raise IbridError(
                f"{name} of an event must be positive, {'Hz/s' if name == 'ramp' else 's'}; found "
                f"{value} in {text!r}"
            )
    require_in_range(kind, fields["value"], f"{kind} of an event ({KINDS[kind][0]})", IbridError)
    return Event(kind, **fields)


def record_events(
    plant: ReferenceInverter,
    operating_points: Sequence[OperatingPoint],
    events: Sequence[Event],
    *,
    rate: float = RATE,
    length: float | None = None,
    angle: float = 0.0,
    noise_db: float | None = None,
    seed: int = 0,
) -> Events:
    """What a recorder at the PCC sees: one record for each operating point and event.

    rate : samples per s. length : s; None: what the event needs. angle : rad, of the recorder's
    frame. noise_db : of each sample of the current, below the rms of its departure from rest; None:
    clean.

    Raises OperatingPointError where the inverter has no rest, IbridError for an event outside the
    record and for an inverter that does not ride through without a fault of the simulation.
    """
    if noise_db is not None:
        require_in_range("noise_db", noise_db, "noise_db", IbridError)
    require_in_range("frame_deg", degrees(angle), "the angle of the recorder's frame", IbridError)
    rng = np.random.default_rng(seed)
    records = []
    for name, op, event, whole in named_records(
        operating_points, events, plant.f0_hz, rate, length
    ):
        time = np.arange(round(whole * rate) + 1) / rate
        told, v = event.told(time, op), event.voltage(time, op.v)
        records.append(_seen(_answer(plant, op, time, v, name, told), angle, noise_db, rng))
    return Events(
        tuple(records),
        f0_hz=plant.f0_hz,
        power_node=plant.power_node,
        s_base_va=plant.s_base_va,
        v_base_v=plant.v_base_v,
        source=f"reference inverter {plant.name}",
    )


def named_records(
    operating_points: Sequence[OperatingPoint],
    events: Sequence[Event],
    f0_hz: float,
    rate: float,
    length: float | None,
) -> list[tuple[str, OperatingPoint, Event, float]]:
    """Name, operating point, event and length (s) of a record for each operating point and event,
    with names that differ.

    Raises IbridError for an event outside of its record, and for a rate or a length that no record
    has.
    """
    if rate <= f0_hz:
        raise IbridError(
            f"a rate of {rate:g} samples per s shows no rest; take more than {f0_hz:g}, such as "
            f"{RATE:g}"
        )
    records = []
    names = Counter[str]()
    for op, event in product(operating_points, events):
        whole = length or max(LENGTH, event.over + AFTER)
        if event.over + event.rise >= whole or event.at < 2 / f0_hz:
            raise IbridError(
                f"the event {event.name} from {event.at:g} s to {event.over:g} s must lie in a "
                f"record of {whole:g} s "
                f"that begins with two cycles at rest ({2 / f0_hz:.3g} s); move it or say --length"
            )
        require_in_range(
            "recorded", whole * rate, f"{whole:g} s at a rate of {rate:g} samples per s", IbridError
        )
        name = event.name if len(operating_points) == 1 else f"{op.name} {event.name}"
        names[name] += 1
        name += f" {names[name]}" if names[name] > 1 else ""
        records.append((name, op, event, whole))
    return records


def _answer(
    plant: ReferenceInverter,
    op: OperatingPoint,
    time: np.ndarray,
    v: np.ndarray,
    name: str,
    told: Mapping[str, np.ndarray],
) -> EventRecord:
    dynamics, rest = plant.dynamics, plant.at_rest(op)
    voltage = to_pairs(v)
    moved = _moved_set_points(plant, op, rest.r, time, told)
    symbols = [
        ca.SX.sym("x", len(rest.x)),
        ca.SX.sym("none", 0),
        ca.SX.sym("outside", 3 + len(rest.r)),
        ca.SX.sym("r", len(rest.r)),
    ]
    x, none, outside, r = symbols
    v_DQ = outside[1:3]
    results = [dynamics.f(x, v_DQ, r + outside[3:]), dynamics.g(x, v_DQ), none, none]
    start = np.ascontiguousarray(rest.x[:, None])
    rate = fastest(dynamics.jacobian(rest.x, voltage[0], rest.r)[0]) / FINE
    tape = tape_of(symbols, results, constant=[3])
    current, left, _ = run(
        tape,
        CubicSpline(time, np.hstack([voltage, moved])),
        start,
        np.zeros((0, 1)),
        np.ascontiguousarray(rest.r[:, None]),
        rate,
    )
    if np.isfinite(left[0]):
        raise IbridError(
            f"{plant.name} at {op.name} does not hold out in {name}: its current leaves at "
            f"{left[0]:.4g} s; "
            "choose a milder event or another operating point"
        )
    i = current[:, :, 0]
    happens = (v != v[0]) | np.any(moved != 0.0, axis=1)
    rest_end = float(time[max(int(np.argmax(happens)) - 1, 0)])
    seen = OperatingPoint(name, op.v * i[0, 0], -op.v * i[0, 1], op.v)
    return EventRecord(seen, time, voltage, i, rest_end, told=told)


def _moved_set_points(
    plant: ReferenceInverter,
    op: OperatingPoint,
    r: np.ndarray,
    time: np.ndarray,
    told: Mapping[str, np.ndarray],
) -> np.ndarray:
    """(n, m) by how much each set point of an inverter is away from its rest; IbridError where it
    is told no such power.
    """
    moved = np.zeros((len(time), len(r)))
    for name, value in told.items():
        place = set_point_place(plant, op, r, name)
        moved[:, place] = value - r[place]
    return moved


def set_point_place(plant: ReferenceInverter, op: OperatingPoint, r: np.ndarray, name: str) -> int:
    """Find the place of p_ref or q_ref among the set points r (m,) of an inverter at rest.

    Raises IbridError where it is told no such power.
    """
    powers = dict(zip(SET_POINTS, (op.p, op.q), strict=True))
    taken = [
        role
        for role, power in powers.items()
        if SET_POINTS.index(role) < len(r) and abs(r[SET_POINTS.index(role)] - power) <= SAME
    ]
    if name not in taken:
        raise IbridError(
            f"{plant.name} is not told {name}{f', it takes {taken[0]}' if taken else ''}; "
            "choose another event or inverter"
        )
    return SET_POINTS.index(name)


def _seen(
    record: EventRecord, angle: float, noise_db: float | None, rng: np.random.Generator
) -> EventRecord:
    """The same in the frame of a recorder, with its noise."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    v, i, sigma = record.v @ turn, record.i @ turn, None
    if noise_db is not None:
        spread = float(np.sqrt(np.mean((i - i[0]) ** 2))) * 10 ** (-noise_db / 20)
        sigma = np.full(len(i), max(spread, 1e-12))
        i = i + spread * rng.standard_normal(i.shape)
    return replace(record, v=v, i=i, sigma=sigma)


def _edge(s: np.ndarray) -> np.ndarray:
    """0 before, 1 behind s = 0 to 1, a raised cosine between."""
    return (1 - np.cos(np.pi * np.clip(s, 0.0, 1.0))) / 2


def _number(name: str, text: str, whole: str) -> float:
    try:
        value = written_number(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise IbridError(f"{_FORM}; a number must follow {name}, found {text!r} in {whole!r}")
    return value
