"""Cases with records of events: a drawn device with one limit or block that its model lacks, or
none, apart from the package.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ibrid_bench.events.device import OMEGA, Device, at_rest, linear, poles, simulate
from ibrid_bench.events.recorder import Recorder, recorded

from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.playback.recording import event_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook

#: What the numbers are drawn around, within a factor `SPREAD` each way; deviation of the nominal
#: values from the truth.
TYPICAL = {
    "L_F": 0.15,
    "R_F": 0.005,
    "C_F": 0.066,
    "L_g": 0.15,
    "R_g": 0.01,
    "kP_pll": 60.0,
    "kI_pll": 1400.0,
    "w_pll": 3000.0,
    "kP": 0.02,
    "kI": 20.0,
    "kP_c": 0.5,
    "kI_c": 15.0,
    "decoupling": 0.15,
}
SPREAD, ASTRAY = 1.35, 0.15
NAMES = {
    "L_F": "plant.L_F",
    "R_F": "plant.R_F",
    "C_F": "plant.C_F",
    "L_g": "plant.L_g",
    "R_g": "plant.R_g",
    "kP_pll": "pll.kP_pll",
    "kI_pll": "pll.kI_pll",
    "w_pll": "pll_filter.omega_c",
    "kP": "power.kP",
    "kI": "power.kI",
    "kP_c": "current.kP",
    "kI_c": "current.kI",
    "decoupling": "decoupling.L",
}
#: What is missing in the model; nothing; nothing, but a limit that no record reaches.
LIMITS = (
    "current_limit",
    "command_limit",
    "pll_freeze",
    "momentary_cessation",
    "voltage_support",
    "reference_ramp",
)
#: Blocks that act at any voltage.
BLOCKS = ("pll_filter", "delay", "damping", "feedforward_filter")
HIDDEN = (*LIMITS, *BLOCKS, "nothing", "unreached")
#: Current, per unit, beyond which no inverter stays connected: a limit may make its control swing.
LARGEST = 3.0
#: Part of the answer that a hidden limit or block must change, and which one that is not reached
#: may.
REACHED, UNREACHED = 0.05, 1e-6
#: Of the events, s; times of the simulation, 1/s: at least so many, and so many times the
#: recorder's rate.
LENGTH, AT, LASTS, RISE = 0.3, 0.06, 0.1, 1e-3
BETWEEN, TIMES = 1e5, 20
FREQUENCY = np.geomspace(5.0, 2000.0, 16)


@dataclass(frozen=True, eq=False)
class EventCase:
    """`hidden` : what the `diagram` lacks. `limits` : of the device. `held` : name of the record
    that is not for the fit.
    `numbers` : of the device, without its limits; of a family by the names of its diagram.
    """

    hidden: str
    limits: Mapping[str, Mapping[str, Any]]
    diagram: Diagram
    values: Mapping[str, float]
    events: Events
    held: str
    sweep: Sweep | None
    numbers: Mapping[str, float] = field(default_factory=dict)


def draw(
    hidden: str,
    seed: int,
    noise_db: float | None,
    *,
    swept: bool,
    recorder: Recorder | None = None,
    rise: float = RISE,
) -> EventCase:
    """A case, the same for the same arguments.

    noise_db : below the rms of what happens, of a sweep and, without a recorder, of one with 5,000
    samples per s. swept : with a
    sweep. rise : of the edges, s.
    """
    rng = np.random.default_rng([seed, HIDDEN.index(hidden)])
    recorder = recorder or Recorder(5000.0, noise_db=noise_db)
    stepped = recorder.program
    fine = recorder.rate if stepped else max(BETWEEN, TIMES * recorder.rate)
    while True:
        numbers, lacks = _numbers(hidden, rng)
        point = (float(rng.uniform(0.4, 0.9)), float(rng.uniform(-0.3, 0.3)), 1.0)
        limits, words = _limit(hidden, numbers, point, rng)
        device, without = Device(numbers, limits), Device({**numbers, **dict.fromkeys(lacks, 0.0)})
        at = AT + rng.uniform(0.0, 1.0, len(words)) / recorder.rate
        shapes = [
            _shape(word, begin, rise, point[2], fine) for word, begin in zip(words, at, strict=True)
        ]
        try:
            if np.real(poles(without, point)).max() > -1.0:
                continue
            answers = [simulate(device, point, time, v, trapezoidal=stepped) for time, v in shapes]
            simpler = answers
            if without != device:
                simpler = [
                    simulate(without, point, time, v, trapezoidal=stepped) for time, v in shapes
                ]
        except ValueError:
            continue
        if max(np.hypot(*i.T).max() for i in answers) > LARGEST or not all(map(_settles, answers)):
            continue
        change = [
            np.linalg.norm(i - other) / np.linalg.norm(i - i[0])
            for i, other in zip(answers, simpler, strict=True)
        ]
        if hidden in (*LIMITS, *BLOCKS) and not (change[0] > REACHED and change[-1] > REACHED):
            continue
        if hidden == "unreached" and max(change) > UNREACHED:
            continue
        break
    values = {
        NAMES[name]: value * float(np.exp(ASTRAY * rng.standard_normal()))
        for name, value in numbers.items()
        if name in NAMES
        and without.numbers[name]
        and (numbers["C_F"] or name not in ("C_F", "L_g", "R_g"))
    }
    turn = np.array([1.0, 1.0j])
    waves = {
        word: (time, v @ turn, i @ turn)
        for word, (time, v), i in zip(words, shapes, answers, strict=True)
    }
    events = recorded(recorder, waves, OMEGA / (2 * np.pi), rng)
    sweep = (
        _swept(device, point, noise_db, 1.0 / recorder.rate if stepped else 0.0, rng)
        if swept
        else None
    )
    name = (
        "gfl_l_filter"
        if not numbers["C_F"]
        else "gfl_pll_filter_exact"
        if without.numbers["w_pll"]
        else "gfl_exact"
    )
    return EventCase(
        hidden, limits, textbook(name), values, events, events.names[-1], sweep, numbers
    )


def _numbers(hidden: str, rng: np.random.Generator) -> tuple[dict[str, float], tuple[str, ...]]:
    """The numbers of a device, and which of them are those of the hidden block."""
    numbers = {name: value * SPREAD ** rng.uniform(-1, 1) for name, value in TYPICAL.items()} | {
        "feedforward": 1.0
    }
    numbers["decoupling"] = numbers["L_F"]
    if hidden != "pll_filter" and rng.random() < 0.5:
        numbers["w_pll"] = 0.0
    if (
        hidden == "voltage_support"
    ):  # behind an LCL filter its loop over the filter's resonance is unstable from k = 0.3 on
        numbers["C_F"] = numbers["w_pll"] = 0.0
    if hidden == "delay":
        numbers["delay"] = float(rng.uniform(50e-6, 200e-6))
    if hidden == "damping":
        numbers["k_damping"] = float(rng.uniform(0.05, 0.4))
    if hidden == "feedforward_filter":
        numbers["w_feedforward"] = float(2 * np.pi * np.exp(rng.uniform(np.log(300), np.log(1500))))
    hides = {
        "pll_filter": "w_pll",
        "delay": "delay",
        "damping": "k_damping",
        "feedforward_filter": "w_feedforward",
    }
    return numbers, (hides[hidden],) if hidden in hides else ()


def _settles(i: np.ndarray) -> bool:
    """Whether what swings grows no more."""
    swing = np.hypot(*(i[1:] - i[:-1]).T)
    tenth = len(swing) // 10
    return float(swing[-tenth:].max()) <= float(swing[-4 * tenth : -3 * tenth].max())


def _limit(
    hidden: str,
    numbers: Mapping[str, float],
    point: tuple[float, float, float],
    rng: np.random.Generator,
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """The limits of a device, and three events of which the first and the last reach them."""
    low, lower = (float(rng.uniform(*ends)) for ends in ((0.45, 0.6), (0.35, 0.5)))
    phase = f"phase:{rng.uniform(5, 15):.1f}"
    words = [f"dip:{low:.3f}", phase, f"dip:{lower:.3f}"]
    windup, size = bool(rng.random() < 0.25), float(np.hypot(point[0], point[1]))
    if hidden == "current_limit":
        mode = ("magnitude", "d", "q")[int(rng.integers(3))]
        return {
            hidden: {"i_max": size * rng.uniform(1.1, 1.3), "mode": mode, "windup": windup}
        }, words
    if hidden == "command_limit":
        x, _ = at_rest(Device(numbers), *point)
        swells = [f"swell:{rng.uniform(1.1, 1.2):.4f}", phase, f"swell:{rng.uniform(1.1, 1.2):.4f}"]
        most = abs(complex(x[2], x[3]) + 1j * numbers["L_F"] * complex(x[0], x[1])) * rng.uniform(
            1.02, 1.06
        )
        return {hidden: {"u_max": most, "windup": windup}}, swells
    if hidden == "pll_freeze":
        return {hidden: {"v_freeze": float(rng.uniform(0.65, 0.85))}}, words
    if hidden == "momentary_cessation":
        law = {
            "v_block": rng.uniform(0.65, 0.85),
            "t_hold": rng.uniform(0.01, 0.05),
            "ramp": rng.uniform(5, 20),
        }
        return {hidden: {name: float(value) for name, value in law.items()}}, words
    if hidden == "voltage_support":
        return {
            hidden: {"k": float(rng.uniform(1, 3)), "dead": float(rng.uniform(0.04, 0.12))}
        }, words
    if hidden == "reference_ramp":
        return {hidden: {"ramp": float(rng.uniform(0.5, 2.0))}}, words
    if hidden == "unreached":
        return {"current_limit": {"i_max": 3.0, "mode": "magnitude", "windup": False}}, words
    return {}, words


def _shape(
    word: str, at: float, rise: float, v: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) and voltage (n, 2) of an event, between the samples of any recorder."""
    time = np.arange(round(LENGTH * rate)) / rate
    lasting = "" if word.startswith("phase") else f",for={LASTS}"
    shape = event_of(f"{word},at={at},rise={rise}{lasting}").voltage(time, v)
    return time, np.stack([np.real(shape), np.imag(shape)], axis=1)


def _swept(
    device: Device,
    point: tuple[float, float, float],
    noise_db: float | None,
    step: float,
    rng: np.random.Generator,
) -> Sweep:
    """Two operating points, that of the records and with the other sign of q; sigma stated where
    there is noise.

    step : of the program that simulates the device, s; 0 for a device that is continuous.
    """
    points = []
    for p, q, v in (point, (point[0], -point[1] - 0.1, point[2])):
        answer = linear(device, (p, q, v)).response(FREQUENCY, step)
        x, _ = at_rest(device, p, q, v)
        turned = complex(x[4], x[5]) * np.exp(1j * x[6])  # to the frame of the PCC's voltage
        op = OperatingPoint(
            f"p={v * turned.real:.4f},q={-v * turned.imag:.4f}",
            v * turned.real,
            -v * turned.imag,
            v,
        )
        if noise_db is None:
            points.append(PointSweep(op, FREQUENCY, answer))
            continue
        sigma = 10 ** (-noise_db / 20) * np.abs(answer)
        noise = (
            sigma
            * (rng.standard_normal(answer.shape) + 1j * rng.standard_normal(answer.shape))
            / np.sqrt(2)
        )
        points.append(PointSweep(op, FREQUENCY, answer + noise, sigma / np.sqrt(2)))
    return Sweep(tuple(points), f0_hz=OMEGA / (2 * np.pi), power_node="pcc", source="drawn")
