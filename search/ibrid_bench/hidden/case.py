"""A case: a sweep of a device that hides something, and what an engineer who does not know it
believes in.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from ibrid_bench.hidden.declaration import SEVERITIES, HiddenEffect, Severity, Verdict
from ibrid_bench.hidden.device import admittance
from ibrid_bench.hidden.effects import HIDDEN
from ibrid_bench.hidden.elsewhere import CONVENTIONS, FOREIGN
from ibrid_bench.hidden.hiding import Hiding, choose, hide
from ibrid_bench.hidden.nominal import nominal_values
from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.points import HELD_OUT, operating_points
from ibrid_bench.hidden.program import block_diagram

from ibrid.errors import IbridError
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import frequency_grid
from ibrid.writing import write_whole

Kind = Literal[
    "effect", "pair", "nothing", "parameters", "foreign", "convention", "wrong-noise", "triple"
]
KINDS: tuple[Kind, ...] = get_args(Kind)
#: How many effects a kind hides, and of which.
_POOLS: Mapping[str, tuple[int, tuple[HiddenEffect, ...]]] = {
    "effect": (1, HIDDEN),
    "pair": (2, HIDDEN),
    "triple": (3, HIDDEN),
    "foreign": (1, FOREIGN),
    "convention": (1, CONVENTIONS),
}
_VERDICTS: Mapping[str, tuple[Verdict, ...]] = {
    "nothing": ("no-gap", "parameters-only"),
    "parameters": ("parameters-only", "no-gap"),
    "wrong-noise": ("no-gap", "parameters-only", "unexplained"),
}
F0_HZ = 60.0
#: Of the seeds of noise, beside those of the devices of a kind.
NOISE = 7
#: Standard deviation that a file of kind "wrong-noise" states, over the true one; and its noise
#: unless told otherwise.
UNDERSTATED, WRONG_NOISE_DB = 0.7, 40.0


@dataclass(frozen=True, eq=False)
class Case:
    """What the workflow gets, and what only the scorer reads.

    sweep : measured. program, values : text and nominal values of the engineer's model. held_out :
    a clean sweep at one further operating point, written in the same convention.
    truth : JSON-able: what is hidden, with its parameters, the true values, and the right verdicts,
    the best first.
    device, model : what was measured, and the model at its true values.
    """

    sweep: Sweep
    program: str
    values: Mapping[str, float]
    held_out: Sweep
    truth: Mapping[str, Any]
    device: Device
    model: Device


def draw_case(
    kind: Kind,
    seed: int,
    *,
    effects: Sequence[str] = (),
    severity: Severity = "clear",
    noise_db: float | None = None,
    sigma: Literal["known", "none"] = "known",
    frequencies: int = 16,
    points: int = 2,
    error: float = 0.15,
) -> Case:
    """Draw a case; the same arguments give the same case, and the same device at every level of
    noise.

    kind : "effect", "pair" and "triple" hide one to three effects of the catalogue, "foreign" what
    it lacks, "convention" a wrongly written sweep; "nothing"; "parameters": some nominal values far
    off; "wrong-noise": sigma stated 0.7 times too small.
    effects : "id", "id:change" or "id:change:variant"; those that a kind hides beyond them are
    drawn.
    noise_db : dB below the norm of Y; None: clean, no sigma. sigma : whether a noisy file states
    it.
    frequencies : number of them from 5 Hz to 5 kHz, logarithmic. points : 1, 2 or 4 operating
    points.
    error : standard deviation of the logarithm of most nominal values, 2.7 times that of some.

    Raises IbridError for words it does not know, effects that do not go together, and where no
    stable device is found.
    """
    if kind not in KINDS or severity not in SEVERITIES:
        words = ", ".join((*KINDS, *SEVERITIES))
        raise IbridError(f"kind and severity must be among {words}; found {kind} and {severity}.")
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    count, pool = _POOLS.get(kind, (len(effects), HIDDEN))
    ops = operating_points(points, rng)
    hiding = hide(
        choose(pool, effects, count, rng), severity, (*ops, HELD_OUT), 2 * pi * F0_HZ, rng
    )
    diagram = block_diagram(hiding.model, 2 * pi * F0_HZ)
    values, far_off = nominal_values(diagram.values, rng, error=error, gross=kind == "parameters")
    frequency = frequency_grid(f"5:5000:{frequencies}")
    level = WRONG_NOISE_DB if noise_db is None and kind == "wrong-noise" else noise_db
    sweep = measured(hiding, ops, frequency)
    if level is not None:
        sweep = add_noise(
            sweep, level, rng=np.random.default_rng([seed, NOISE]), record_sigma=sigma == "known"
        )
    truth = {
        "schema": "ibrid.hidden/1",
        "kind": kind,
        "seed": seed,
        "severity": severity,
        "effects": [
            {
                "id": effect.id,
                "change": effect.change,
                "variant": effect.variant,
                "parameters": parameters,
            }
            for effect, parameters in hiding.effects
        ],
        "verdicts": list(_VERDICTS.get(kind) or _verdicts(hiding)),
        "noise_db": level,
        "sigma": "none" if level is None else sigma,
        "base": hiding.base,
        "values": dict(diagram.values),
        "far_off": far_off,
        "device": as_program(hiding.device),
    }
    return Case(
        _understated(sweep) if kind == "wrong-noise" else sweep,
        diagram.text,
        values,
        measured(
            replace(hiding, measurement=replace(hiding.measurement, swapped=False)),
            (HELD_OUT,),
            frequency,
        ),
        truth,
        hiding.device,
        hiding.model,
    )


def write_case(case: Case, folder: str | Path, truth_folder: str | Path) -> None:
    """Write sweep.csv, model.py, nominal.json and holdout.csv into one folder, truth.json into
    another; both are made.

    Raises IbridError when the two are the same place, or a file cannot be written.
    """
    folder, truth_folder = Path(folder), Path(truth_folder)
    if folder.resolve() == truth_folder.resolve():
        raise IbridError(
            f"the truth must lie in a folder of its own; found {folder} twice, name another."
        )
    for place in (folder, truth_folder):
        place.mkdir(parents=True, exist_ok=True)
    write_sweep(case.sweep, folder / "sweep.csv")
    write_sweep(case.held_out, folder / "holdout.csv")
    write_whole(folder / "model.py", case.program)
    write_whole(folder / "nominal.json", json.dumps(dict(case.values), indent=2) + "\n")
    write_whole(truth_folder / "truth.json", json.dumps(dict(case.truth), indent=2) + "\n")


def as_program(device: Device) -> dict[str, Any] | None:
    """The device itself as a block diagram with its true values; None where modules cannot say
    it.
    """
    try:
        diagram = block_diagram(device, 2 * pi * F0_HZ)
    except IbridError:
        return None
    return {"program": diagram.text, "values": dict(diagram.values)}


def _verdicts(hiding: Hiding) -> tuple[Verdict, ...]:
    """Those of the effect that weighs most: a wrong frame, then what can be named, then what is a
    matter of parameters.
    """
    weight = ("data-convention", "named", "located-unnamed", "parameters-only")
    return min(
        (effect.verdicts for effect, _ in hiding.effects),
        key=lambda verdicts: weight.index(verdicts[0]),
    )


def measured(hiding: Hiding, ops: Sequence[OperatingPoint], frequency: np.ndarray) -> Sweep:
    node = hiding.power_node
    found = tuple(
        PointSweep(
            op, frequency, admittance(hiding.device, op, frequency, 2 * pi * F0_HZ, power_node=node)
        )
        for op in ops
    )
    return hiding.measurement.of(Sweep(found, f0_hz=F0_HZ, power_node=node, source="hidden device"))


def _understated(sweep: Sweep) -> Sweep:
    points = (
        replace(point, sigma=None if point.sigma is None else UNDERSTATED * point.sigma)
        for point in sweep.points
    )
    return replace(sweep, points=tuple(points))
