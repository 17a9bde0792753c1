"""Does `ibrid next` ask well? Poor data of hidden inverters, one more sweep chosen in four ways at equal cost, both structures
fitted again: are they told apart, and how much smaller are the deviations?

python -m ibrid_bench.next_sweep [--devices 30] [--seed 1] [--count 2 4 8]

The device has a filter before its PLL; a rival has another effect of the catalogue in its place, and is taken where eight
frequencies at one operating point leave it within odds of 20 to 1, and 16 at each of nine do not.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ibrid.analysis.experiments import Among, experiments
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.measurement.noise import add_noise
from ibrid.measurement.sweep import OperatingPoint, Sweep, measured_numbers
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import insertions
from ibrid.plants.random_plants import random_stable
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import operating_point, sweep
from ibrid.structure.canonical import structure_hash
from ibrid.structure.diagram import Diagram
from ibrid.structure.library import textbook
from ibrid.structure.program import parse_program

COUNT, DECIBEL, RIVALS = 8, 40.0, 10
FIRST = "p=0.5,q=0"
#: Odds of 20 to 1, as a difference of the Bayesian information criterion.
DECIDED = 2 * np.log(20.0)


def main() -> None:
    """A line a device, then the table."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.next_sweep")
    parser.add_argument("--devices", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--count", type=int, nargs="+", default=(2, 4, 8), help="frequencies of the sweep that is chosen"
    )
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    told: dict[tuple[int, str], list[bool]] = defaultdict(list)
    deviations: dict[tuple[int, str], list[float]] = defaultdict(list)
    devices = 0
    while devices < arguments.devices:
        plant = random_stable(rng, population="textbook", pll_filter=True)
        points = [op for op in Among().points() if op.name != FIRST and _stable(plant, op)]
        truth = parse_program(plant.program)
        if not _stable(plant, operating_point(FIRST)):
            continue
        poor = _measured(plant, operating_point(FIRST), np.geomspace(5.0, 5000.0, COUNT), rng)
        known = evaluate(truth, poor, objective="sigma")
        rival = _rival(truth, known, poor, rng)
        if rival is None:
            continue
        rich = Sweep(
            tuple(one for op in points for one in _measured(plant, op, np.geomspace(5.0, 5000.0, 16), rng).points),
            f0_hz=poor.f0_hz,
        )
        if _apart((known, rival), rich)[0] < DECIDED:  # nothing that can be measured tells
            continue
        try:
            ways = {count: _ways((known, rival), points, count, rng) for count in arguments.count}
        except (IbridError, StopIteration):  # what is known so far is not stable anywhere
            continue
        words, devices = [], devices + 1
        for count, choices in ways.items():
            words.append(f" {count}:")
            for way, (op, frequency) in choices.items():
                more = Sweep((*poor.points, *_measured(plant, op, frequency, rng).points), f0_hz=poor.f0_hz)
                apart, deviation = _apart((known, rival), more)
                told[count, way].append(bool(apart > DECIDED))
                deviations[count, way].append(deviation)
                words.append(f"{way} {apart:.0f}")
        print(f"{devices:3d} {' '.join(words)}", flush=True)
    for (count, way), decided in told.items():
        smaller = np.median(np.array(deviations[count, way]) / np.array(deviations[count, "log"]))
        words = f"{count} frequencies, {way:8s} told apart {np.mean(decided):.0%} of {len(decided)}"
        print(f"{words}   deviations x {smaller:.2f} of log-spaced")


def _apart(records: Sequence[Record], data: Sweep) -> tuple[float, float]:
    """By how much the criterion of the second exceeds that of the first, fitted again, and the deviation of the first."""
    after = [evaluate(one.diagram, data, objective="sigma") for one in records]
    return _bic(after[1], data) - _bic(after[0], data), _deviation(after[0])


def _ways(
    records: Sequence[Record], points: Sequence[OperatingPoint], count: int, rng: np.random.Generator
) -> dict[str, tuple[OperatingPoint, np.ndarray]]:
    """What is measured: asked of both structures, asked of the answer alone, at random, and log-spaced at a random point.

    points : where the device is stable; a question about another cannot be answered, so the next best is taken.
    """
    names = [structure_hash(one.diagram) for one in records]
    able = {(op.p, op.q, op.v) for op in points}
    asked, sharp = (
        next(
            one
            for one in experiments(records[:n], names[:n], Among(count=count, events=()))
            if (one.op.p, one.op.q, one.op.v) in able
        )
        for n in (2, 1)
    )
    random = points[int(rng.integers(len(points)))]
    return {
        "next": (asked.op, np.array(asked.frequencies)),
        "sharp": (sharp.op, np.array(sharp.frequencies)),
        "random": (random, np.sort(np.exp(rng.uniform(np.log(5.0), np.log(5000.0), count)))),
        "log": (points[int(rng.integers(len(points)))], np.geomspace(5.0, 5000.0, count)),
    }


def _stable(plant: ReferenceInverter, op: OperatingPoint) -> bool:
    try:
        sweep(plant, [op], np.array([50.0]))
    except IbridError:
        return False
    return True


def _measured(plant: ReferenceInverter, op: OperatingPoint, frequency: np.ndarray, rng: np.random.Generator) -> Sweep:
    return add_noise(sweep(plant, [op], frequency), DECIBEL, rng=rng)


def _rival(truth: Diagram, known: Record, data: Sweep, rng: np.random.Generator) -> Record | None:
    """Another effect on the textbook diagram that the data do not exclude, the likeliest of some; None: they exclude all."""
    others = [one.diagram for one in insertions(textbook("gfl_exact"), VOCABULARY)]
    others = [one for one in others if structure_hash(one) != structure_hash(truth)]
    found = []
    for index in rng.permutation(len(others))[:RIVALS]:
        record = evaluate(others[int(index)], data, objective="sigma")
        if record.covariance and abs(_bic(record, data) - _bic(known, data)) < DECIDED:
            found.append(record)
    return min(found, key=lambda one: _bic(one, data), default=None)


def _bic(record: Record, data: Sweep) -> float:
    if record.over_noise is None:
        return float("inf")
    numbers = measured_numbers(data.points)
    return numbers * record.over_noise**2 + np.log(numbers) * record.free_parameters


def _deviation(record: Record) -> float:
    """Geometric mean of the deviations that the data see."""
    matrix = np.diag(np.array(record.covariance.get("matrix", [[1.0]]), dtype=float))
    if not matrix.size:
        raise IbridError("the record holds no covariance")
    return float(np.exp(np.mean(np.log(np.sqrt(np.maximum(matrix, 1e-12))))))


if __name__ == "__main__":
    main()
