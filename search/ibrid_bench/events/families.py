"""Cases of other families: the nonlinear equations of reference inverters in short steps, their
diagrams without one block.

What forms the grid holds its voltage, so that events are mild: no limit of the current is in these
devices.
"""

from dataclasses import fields, replace
from typing import Any

import casadi as ca
import numpy as np
from ibrid_bench.events.cases import AT, BETWEEN, LARGEST, LASTS, LENGTH, RISE, TIMES, EventCase
from ibrid_bench.events.recorder import Recorder, recorded
from scipy.interpolate import CubicSpline

from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.plants.reference import Parameters, ReferenceInverter
from ibrid.plants.sweeping import is_stable, plant_named, sweep
from ibrid.playback.recording import event_of
from ibrid.structure.diagrams.program import parse_program

#: What the model lacks -> the instances that make it, and the inverters that have it.
BLOCKS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "virtual_impedance": (("virtual_reactance", "minus_drop"), ("gfm_droop", "gfm_vsm")),
    "family_nothing": (
        (),
        ("gfm_droop", "hybrid_gfl_gfm", "gfl_dc_link", "gfm_vsm", "parallel_gfl_gfm"),
    ),
}
#: Spread of the numbers about the published ones, and of nominal values about the truth: of the
#: logarithm.
SPREAD, ASTRAY = 0.15, 0.15
#: Largest step, s.
STEP = 2.5e-6
#: Frequencies of a sweep, Hz.
FREQUENCY = np.geomspace(5.0, 2000.0, 16)


def draw_family(
    hidden: str,
    seed: int,
    noise_db: float | None,
    *,
    swept: bool,
    recorder: Recorder | None = None,
    rise: float = RISE,
) -> EventCase:
    """A case as of `ibrid_bench.events.cases.draw`; hidden : of `BLOCKS`."""
    rng = np.random.default_rng([seed, 66, list(BLOCKS).index(hidden)])
    recorder = recorder or Recorder(5000.0, noise_db=noise_db)
    lacks, names = BLOCKS[hidden]
    published = plant_named(names[seed % len(names)])
    fine = max(BETWEEN, TIMES * recorder.rate)
    while True:
        plant = replace(published, parameters=_moved(published.parameters, rng))
        op = OperatingPoint(
            "rest", float(rng.uniform(0.3, 0.8)), float(rng.uniform(-0.2, 0.2)), 1.0
        )
        depths = rng.uniform(0.85, 0.95, 2)
        words = [f"dip:{depths[0]:.3f}", f"phase:{rng.uniform(2, 4):.1f}", f"dip:{depths[1]:.3f}"]
        at = AT + rng.uniform(0.0, 1.0, len(words)) / recorder.rate
        if not is_stable(plant, op, margin=3.0):
            continue
        time = np.arange(round(LENGTH * fine)) / fine
        shapes = [_voltage(word, begin, rise, time) for word, begin in zip(words, at, strict=True)]
        answers = [_answer(plant, op, time, v) for v in shapes]
        if all(np.isfinite(i).all() and np.abs(i).max() <= LARGEST for i in answers):
            break
    waves = {
        word: (time[:-1], v[:-1], i) for word, v, i in zip(words, shapes, answers, strict=True)
    }
    events = recorded(recorder, waves, plant.f0_hz, rng)
    values = {
        name: value * float(np.exp(ASTRAY * rng.standard_normal()))
        for name, value in plant.diagram_values.items()
        if name.split(".")[0] not in lacks
    }
    diagram = parse_program(_without(plant.program, lacks))
    measured = _swept(plant, op, noise_db, rng) if swept else None
    return EventCase(
        hidden, {}, diagram, values, events, events.names[-1], measured, plant.diagram_values
    )


def _moved(parameters: Parameters, rng: np.random.Generator) -> Any:
    """The same kind of inverter with other numbers."""
    numbers = {
        one.name: value * float(np.exp(SPREAD * rng.standard_normal()))
        for one in fields(parameters)
        if isinstance(value := getattr(parameters, one.name), float)
    }
    return replace(parameters, **numbers)


def _voltage(word: str, begin: float, rise: float, time: np.ndarray) -> np.ndarray:
    lasting = "" if word.startswith("phase") else f",for={LASTS}"
    return event_of(f"{word},at={begin},rise={rise}{lasting}").voltage(time, 1.0)


def _answer(
    plant: ReferenceInverter, op: OperatingPoint, time: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """(N - 1,) current, d + j q, by classical Runge-Kutta steps; v (N,) a cubic spline between.

    Not finite where it leaves.
    """
    dynamics, rest = plant.dynamics, plant.at_rest(op)
    between = time[1] - time[0]
    parts = max(int(np.ceil(between / STEP - 1e-9)), 1)
    h = between / parts
    x, piece = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("piece", 4, 2)
    r = ca.SX(ca.DM(rest.r))

    def rate(state: ca.SX, since: float) -> ca.SX:
        return dynamics.f(state, _cubic(piece, since), r)

    moved = x
    for part in range(parts):
        at = part * h
        k_1 = rate(moved, at)
        k_2 = rate(moved + 0.5 * h * k_1, at + 0.5 * h)
        k_3 = rate(moved + 0.5 * h * k_2, at + 0.5 * h)
        k_4 = rate(moved + h * k_3, at + h)
        moved = moved + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
    step = ca.Function(
        "step", [x, piece], [moved, dynamics.g(x, _cubic(piece, 0.0))], {"cse": True}
    )
    pieces = CubicSpline(time, np.stack([np.real(v), np.imag(v)], axis=1)).c  # (4, N - 1, 2)
    whole = step.mapaccum("whole", pieces.shape[1])
    _, current = whole(rest.x, np.moveaxis(pieces, 1, 0).transpose(1, 0, 2).reshape(4, -1))
    d, q = np.array(current)
    return d + 1j * q


def _cubic(piece: ca.SX, since: float) -> ca.SX:
    """(2,) of coefficients (4, 2), the highest power first."""
    value = piece[0, :]
    for power in range(1, 4):
        value = value * since + piece[power, :]
    return value.T


def _without(program: str, instances: tuple[str, ...]) -> str:
    """Program text without some instances and all that they are connected to."""
    taken = [f'"{name}{end}' for name in instances for end in ('"', ".")]
    return (
        "\n".join(line for line in program.splitlines() if not any(one in line for one in taken))
        + "\n"
    )


def _swept(
    plant: ReferenceInverter, op: OperatingPoint, noise_db: float | None, rng: np.random.Generator
) -> Sweep:
    """Two operating points, that of the records and with the other sign of q."""
    clean = sweep(plant, (op, OperatingPoint("other", op.p, -op.q - 0.1, op.v)), FREQUENCY)
    return clean if noise_db is None else add_noise(clean, noise_db, rng=rng, record_sigma=True)
