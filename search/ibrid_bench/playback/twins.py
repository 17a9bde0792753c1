"""Twins that no sweep tells apart, the zeros of power and current PI swapped, and the records that
do.

kP' = kI kP_c / kI_c and kP_c' = kI_c kP / kI with R_F' = R_F + kP_c - kP_c' leave every small
answer as it is. Devices are drawn and simulated apart from the package; a sweep at two points and
one record of each kind, both with 60 dB, are fitted together.
"""

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from ibrid_bench.events.cases import NAMES, SPREAD, TYPICAL
from ibrid_bench.events.device import Device, at_rest, simulate

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.playback.compare import model_of_program, nrmse, play
from ibrid.playback.recording import event_of
from ibrid.structure.diagrams.library import textbook

POINT, LENGTH, RATE, AT = (0.8, 0.1, 1.0), 0.3, 5000.0, 0.06
NOISE, FREQUENCY = 1e-3, np.geomspace(5.0, 2000.0, 16)
#: What is recorded, and the limit that the device has: a factor on the current or the command at
#: rest.
RECORDS: Mapping[str, tuple[str, str, float]] = {
    "step of 1 %": ("step:0.01", "", 0.0),
    "dip to 0.6, no limit reached": ("dip:0.6,for=0.1", "", 0.0),
    "dip to 0.6 that reaches the current limit": ("dip:0.6,for=0.1", "current_limit", 1.2),
    "swell to 1.25 that reaches the voltage limit": ("swell:1.25,for=0.1", "command_limit", 1.04),
}


@dataclass(frozen=True)
class Told:
    """`twin` : how far the twin's current is from the device's, of what happens.

    `apart` : the fit has no other answer left, and its gain of the current controller is, as a
    ratio, nearer to the device's than to the twin's. `gain` : of the fit, over the device's.
    `sentence` : what it says of the twin.
    """

    kind: str
    seed: int
    twin: float
    apart: bool
    gain: float | None
    sentence: str


def drawn(seed: int) -> dict[str, float]:
    """Numbers of a device, and those of a twin that has a filter resistance within its box."""
    rng = np.random.default_rng(seed)
    while True:
        numbers = {name: value * SPREAD ** rng.uniform(-1, 1) for name, value in TYPICAL.items()}
        numbers |= {"feedforward": 1.0, "decoupling": numbers["L_F"], "w_pll": 0.0}
        if 1e-5 < twin_of(numbers)["R_F"] < 1.0:
            return numbers


def twin_of(numbers: Mapping[str, float]) -> dict[str, float]:
    """The device with the zeros of both PI controllers swapped."""
    inner, outer = (
        numbers["kI_c"] * numbers["kP"] / numbers["kI"],
        numbers["kI"] * numbers["kP_c"] / numbers["kI_c"],
    )
    return {**numbers, "kP_c": inner, "kP": outer, "R_F": numbers["R_F"] + numbers["kP_c"] - inner}


def told(seed: int, known: Container[str] = ()) -> Iterator[Told]:
    """Every kind of record of one device; known : kinds that are left out."""
    numbers = drawn(seed)
    values, twin = (values_of(one) for one in (numbers, twin_of(numbers)))
    sweep = sweep_of(values, np.random.default_rng([seed, 1]))
    for kind, (word, limit, factor) in RECORDS.items():
        rng = np.random.default_rng([seed, 2 + list(RECORDS).index(kind)])
        if kind in known:
            continue
        limits = limits_of(numbers, limit, factor)
        clean = record_of(Device(numbers, limits), word)
        own = {f"{limit}.{name}": value for name, value in limits.get(limit, {}).items()}
        (played,) = play(
            model_of_program(textbook("gfl_exact"), {**twin, **own}), Events((clean,))
        ).records
        error = nrmse(played.current, clean)
        level = NOISE * float(np.sqrt(np.mean((clean.i - clean.i_rest) ** 2)))
        noisy = clean.i + level * rng.standard_normal(clean.i.shape)
        seen = EventRecord(
            clean.rest, clean.time, clean.v, noisy, clean.rest_end, np.full(len(noisy), level)
        )
        away = np.inf if error is None else error
        try:
            record = evaluate_events(textbook("gfl_exact"), Events((seen,)), sweep, values=own)
        except IbridError as refused:
            yield Told(kind, seed, away, False, None, str(refused))
            continue
        gain = next(iter(record.parameters.values()))["current.kP"]
        nearer = abs(np.log(gain / values["current.kP"])) < abs(np.log(gain / twin["current.kP"]))
        apart = not record.twins and bool(nearer)
        yield Told(kind, seed, away, apart, gain / values["current.kP"], _sentence(record))


def _sentence(record: Record) -> str:
    return next((one for one in record.identifiability if "excluded by the records" in one), "")


def values_of(numbers: Mapping[str, float]) -> dict[str, float]:
    """Of the diagram `gfl_exact`."""
    return {
        NAMES[name]: value for name, value in numbers.items() if name in NAMES and name != "w_pll"
    }


def limits_of(numbers: Mapping[str, float], limit: str, factor: float) -> dict[str, dict[str, Any]]:
    """A limit of current or command at so many times its value at rest; none for ""."""
    if not limit:
        return {}
    x, _ = at_rest(Device(numbers), *POINT)
    if limit == "current_limit":
        return {
            limit: {
                "i_max": factor * float(np.hypot(x[0], x[1])),
                "mode": "magnitude",
                "windup": False,
            }
        }
    command = complex(x[2], x[3]) + (numbers["R_F"] + 1j * numbers["L_F"]) * complex(x[0], x[1])
    return {limit: {"u_max": factor * abs(command), "windup": False}}


def record_of(device: Device, word: str) -> EventRecord:
    """What a recorder at the PCC of the device sees, without noise."""
    time = np.arange(round(LENGTH * RATE)) / RATE
    shape = event_of(f"{word},at={AT}").voltage(time, POINT[2])
    v = np.stack([np.real(shape), np.imag(shape)], axis=1)
    i = simulate(device, POINT, time, v)
    return EventRecord(
        OperatingPoint("record", float(i[0, 0]), float(-i[0, 1]), POINT[2]), time, v, i, AT
    )


def sweep_of(values: Mapping[str, float], rng: np.random.Generator) -> Sweep:
    """Two operating points of the diagram `gfl_exact` at values, with noise."""
    ops = [OperatingPoint(f"q={q:g}", 0.8, q) for q in (0.1, -0.3)]
    empty = np.broadcast_to(np.eye(2, dtype=complex), (len(FREQUENCY), 2, 2))
    asked = Sweep(tuple(PointSweep(op, FREQUENCY, empty) for op in ops), power_node="pcc")
    record = record_at(textbook("gfl_exact"), asked, dict(values))
    points = []
    for op in ops:
        answer = record.response(op.name, FREQUENCY)
        sigma = NOISE * np.abs(answer) / np.sqrt(2)
        noise = sigma * (rng.standard_normal(answer.shape) + 1j * rng.standard_normal(answer.shape))
        points.append(PointSweep(op, FREQUENCY, answer + noise, sigma))
    return Sweep(tuple(points), power_node="pcc", source="drawn")
