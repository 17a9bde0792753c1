"""`python -m ibrid_bench.plants`: which of several devices behind one PCC differs, over drawn
plants; one JSON line each. With `--alone` the device itself is measured again, each time against a
record of its own.

The device is `paper_like`, known from a sweep of it alone at 50 dB. A plant has three to five of
it, with its true values, of drawn ratings behind drawn lines, some at a feeder of their own; its
sweep at the PCC has three operating points and 20 frequencies at 50 dB. In every third nothing has
changed; else one parameter of one device, by a fifth or by half.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import ibrid
from ibrid.analysis.new_data.drift import drift
from ibrid.analysis.several_devices.collector import Collector
from ibrid.analysis.several_devices.freed_fits import PlantFits, SweepFits, plant_model
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import plant_named
from ibrid.structure.network.outside import PortElement

FREQUENCY = np.geomspace(5, 5000, 20)
POINTS = tuple(
    OperatingPoint(f"p={p:g},q={q:g}", p, q, 1.0) for p, q in ((1, 0.3), (1, -0.3), (0.4, 0))
)
FACTORS = (0.8, 1.2, 0.5, 1.5)
#: Fall of T with the true change alone from which on it counts as seen.
SEEN = 20.0


def known_device(seed: int = 0) -> Record:
    """The record of a device measured alone."""
    alone = ibrid.add_noise(
        ibrid.sweep(plant_named("paper_like"), None, np.geomspace(5, 5000, 16)),
        50,
        rng=np.random.default_rng(seed),
    )
    return ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), alone)


def drawn_plant(rng: np.random.Generator) -> Collector:
    """A transformer, two devices at the bus and one to three behind a feeder."""

    def line(low: float, high: float) -> tuple[PortElement, ...]:
        return (
            PortElement(
                "series",
                {"R": float(rng.uniform(0.1, 0.3) * low), "L": float(rng.uniform(low, high))},
            ),
        )

    ratings = rng.uniform(0.5, 1.5, size=int(rng.integers(3, 6)))
    ratings = ratings / ratings.sum()
    devices = [
        Collector(f"inverter_{k}", line(0.03, 0.3), (), float(rating))
        for k, rating in enumerate(ratings, start=1)
    ]
    behind = devices[2:]
    whole = sum(one.rating for one in behind)
    feeder = Collector(
        "feeder",
        line(0.02, 0.1),
        tuple(replace(one, share=one.rating / whole) for one in behind),
        whole,
        whole,
    )
    at_bus = tuple(replace(one, share=one.rating) for one in devices[:2])
    return Collector("", line(0.04, 0.08), (*at_bus, feeder), 1.0)


def case(record: Record, seed: int) -> dict:
    """One plant, its change and what was said of it."""
    rng = np.random.default_rng(seed)
    collector = drawn_plant(rng)
    points = [
        PointSweep(op, FREQUENCY, np.ones((len(FREQUENCY), 2, 2), dtype=complex)) for op in POINTS
    ]
    plant = plant_model(record, collector, points)
    size = plant.parameters
    j = None if seed % 3 == 0 else int(rng.integers(size, size * (1 + len(collector.devices))))
    factor = 1.0 if j is None else float(rng.choice(FACTORS))
    truth = plant_named("paper_like").diagram_values
    values = np.array([truth[name.removeprefix("all.")] for name in plant.names[:size]])
    x = plant.x.copy()
    x[:size] = plant.coordinates.whole.to_x(values)
    x = x + (0.0 if j is None else np.log(factor)) * (np.arange(len(plant.x)) == j)
    answers = [
        replace(one, admittance=seen) for one, seen in zip(points, plant.responses(x), strict=True)
    ]
    data = ibrid.add_noise(Sweep(tuple(answers), 60.0, "pcc"), 50, rng=rng)
    begun = time.perf_counter()
    found = drift(record, data, collector)
    seconds = time.perf_counter() - begun
    name = None if j is None else plant.names[j]
    gain = 0.0
    if j is not None:
        fits = PlantFits(record, data, collector)
        gain = fits.fit(()).cost - fits.fit((j,)).cost
    said = {one.parameter for one in found.changed}
    alike = said.union(*(one.alike for one in found.changed))
    return {
        "seed": seed,
        "devices": len(collector.devices),
        "changed": name,
        "factor": factor,
        "seen": bool(gain > SEEN),
        "verdict": found.verdict,
        "said": sorted(said),
        "device": found.device,
        "right": said == ({name} if name else set()),
        "among": not name or name in alike,
        "seconds": round(seconds, 1),
    }


def case_alone(seed: int) -> dict:
    """The device again at the same points, unchanged in every third case, else one value times 0.8
    or 1.2.
    """
    rng = np.random.default_rng([seed, 1])
    record, truth = known_device(seed), dict(plant_named("paper_like").diagram_values)
    names = sorted(next(iter(record.parameters.values())))
    name = None if seed % 3 == 0 else str(rng.choice(names))
    factor = 1.0 if name is None else float(rng.choice(FACTORS[:2]))
    if name is not None:
        truth[name] *= factor
    clean = ibrid.sweep(plant_named("paper_like"), None, np.geomspace(5, 5000, 16))
    device = record_at(record.diagram, clean, {one: truth[one] for one in names})
    answers = [
        replace(one, admittance=device.response(one.op.name, one.frequency)) for one in clean.points
    ]
    data = ibrid.add_noise(replace(clean, points=tuple(answers)), 50, rng=rng)
    begun = time.perf_counter()
    found = drift(record, data)
    seconds = time.perf_counter() - begun
    fits = SweepFits(record, data)
    gain = 0.0 if name is None else fits.fit(()).cost - fits.fit((fits.names.index(name),)).cost
    said = {one.parameter for one in found.changed}
    alike = said.union(*(one.alike for one in found.changed))
    return {
        "seed": seed,
        "changed": name,
        "factor": factor,
        "seen": bool(gain > SEEN),
        "verdict": found.verdict,
        "said": sorted(said),
        "right": said == ({name} if name else set()),
        "among": not name or name in alike,
        "seconds": round(seconds, 1),
    }


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        prog="ibrid_bench.plants", description="Which device of a plant differs."
    )
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.jsonl")
    parser.add_argument("--alone", action="store_true")
    options = parser.parse_args()
    record = known_device()
    for seed in range(options.first, options.first + options.cases):
        row = case_alone(seed) if options.alone else case(record, seed)
        print(json.dumps(row), flush=True)
        with options.out.open("a") as ledger:
            ledger.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main()
