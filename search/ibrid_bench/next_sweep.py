"""Does `ibrid next` ask well? Poor data of hidden inverters, as many more frequencies chosen in seven ways, both structures
fitted again: are they told apart, and how much smaller are the deviations?

python -m ibrid_bench.next_sweep [--devices 30] [--seed 1] [--count 2 4 8]

sweep     : the first of the ranking, at one operating point, asked of both structures
campaign  : spread over operating points, asked of both
twice     : the same in two halves, fitted in between
sharp     : spread, asked for the parameters of the answer alone
random    : random frequencies at a random operating point
scattered : each at an operating point of its own, both at random
log       : log-spaced at a random operating point

The device has a filter before its PLL; a rival has another effect of the catalogue in its place, and is taken where eight
frequencies at one operating point leave it within odds of 20 to 1, and 16 at each of nine do not.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ibrid.analysis.experiments import Among, campaign, experiments
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
LOW, HIGH = 5.0, 5000.0
#: Odds, as a difference of the Bayesian information criterion.
DECIDED = {odds: 2 * np.log(odds) for odds in (20.0, 150.0)}
WAYS = ("sweep", "campaign", "twice", "sharp", "random", "scattered", "log")

_Pair = tuple[Record, Record]
_Plan = list[tuple[OperatingPoint, np.ndarray]]


def main() -> None:
    """A line a device, then the table."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.next_sweep")
    parser.add_argument("--devices", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, nargs="+", default=(2, 4, 8), help="frequencies that are chosen")
    arguments = parser.parse_args()
    found: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
    for number, case in enumerate(islice(_cases(arguments.seed), arguments.devices), 1):
        words = []
        for count in arguments.count:
            words.append(f" {count}:")
            for way in WAYS:
                found[count, way].append(_outcome(case, way, count))
                words.append(f"{way} {found[count, way][-1][0]:.0f}")
        print(f"{number:3d} {' '.join(words)}", flush=True)
    for (count, way), outcomes in found.items():
        apart, deviations = np.array(outcomes).T
        shares = ", ".join(f"{np.mean(apart > above):.0%} at {odds:g}:1" for odds, above in DECIDED.items())
        smaller = np.median(deviations / np.array(found[count, "log"])[:, 1])
        print(f"{count} frequencies, {way:9s} told apart {shares}   deviations x {smaller:.2f} of log-spaced")


@dataclass(frozen=True)
class _Case:
    """A hidden device, its structure and a rival, both fitted to poor data; `points` where it can be measured."""

    plant: ReferenceInverter
    points: tuple[OperatingPoint, ...]
    poor: Sweep
    known: Record
    rival: Record
    seed: int


def _cases(seed: int) -> Iterator[_Case]:
    """Devices that poor data leave ambiguous and rich data do not."""
    rng = np.random.default_rng(seed)
    while True:
        plant = random_stable(rng, population="textbook", pll_filter=True)
        points = tuple(op for op in Among().points() if op.name != FIRST and _stable(plant, op))
        if not (points and _stable(plant, operating_point(FIRST))):
            continue
        truth = parse_program(plant.program)
        poor = _measured(plant, operating_point(FIRST), np.geomspace(LOW, HIGH, COUNT), rng)
        known = evaluate(truth, poor, objective="sigma")
        rival = _rival(truth, known, poor, rng)
        if rival is None:
            continue
        rich = [(op, np.geomspace(LOW, HIGH, 16)) for op in points]
        case = _Case(plant, points, poor, known, rival, int(rng.integers(2**31)))
        after, data = _again(case, (known, rival), poor, rich, rng)
        if _difference(after, data) < DECIDED[20.0]:  # nothing that can be measured tells
            continue
        with suppress(IbridError):  # raised where what is known so far is not stable anywhere
            _asked(case, (known, rival), 1)
            yield case


def _outcome(case: _Case, way: str, count: int) -> tuple[float, float]:
    """By how much the criterion of the rival exceeds that of the truth, fitted again, and the deviation of the truth."""
    rng = np.random.default_rng(case.seed)
    pair, data = (case.known, case.rival), case.poor
    for part in (count - count // 2, count // 2) if way == "twice" else (count,):
        try:
            chosen = _chosen(case, pair, way, part, rng)
        except IbridError:  # both models are unstable now wherever the device is not: a question that has no answer
            chosen = []
        pair, data = _again(case, pair, data, chosen, rng)
    return _difference(pair, data), _deviation(pair[0])


def _chosen(case: _Case, pair: _Pair, way: str, count: int, rng: np.random.Generator) -> _Plan:
    """Operating points with the frequencies that are measured there."""
    if way == "sweep":
        best = experiments(pair, _names(pair), _Able(count=count, events=(), able=case.points))[0]
        return [(best.op, np.array(best.frequencies))]
    if way in ("campaign", "twice"):
        return _asked(case, pair, count)
    if way == "sharp":
        return _asked(case, pair[:1], count)
    ops = [case.points[int(k)] for k in rng.integers(len(case.points), size=count)]
    frequencies = np.sort(np.exp(rng.uniform(np.log(LOW), np.log(HIGH), count)))
    if way == "scattered":
        return [(op, frequencies[k : k + 1]) for k, op in enumerate(ops)]
    return [(ops[0], frequencies if way == "random" else np.geomspace(LOW, HIGH, count))]


@dataclass(frozen=True)
class _Able(Among):
    """Operating points at which the device can be measured."""

    able: tuple[OperatingPoint, ...] = ()

    def points(self) -> tuple[OperatingPoint, ...]:
        return self.able


def _asked(case: _Case, records: Sequence[Record], count: int) -> _Plan:
    found = campaign(records, _names(records), _Able(count=count, events=(), able=case.points))
    if found is None:
        raise IbridError("no operating point can be asked")
    return [(op, np.array(frequencies)) for op, frequencies in found.sweeps]


def _names(records: Sequence[Record]) -> list[str]:
    return [structure_hash(one.diagram) for one in records]


def _again(case: _Case, pair: _Pair, data: Sweep, plan: _Plan, rng: np.random.Generator) -> tuple[_Pair, Sweep]:
    """Measure the plan, and fit both to all data."""
    points = list(data.points)
    for op, frequency in plan:
        named = replace(op, name=f"{op.name} {len(points)}")  # an operating point may be measured twice
        points += _measured(case.plant, named, frequency, rng).points
    data = replace(data, points=tuple(points))
    one, other = (evaluate(each.diagram, data, objective="sigma") for each in pair)
    return (one, other), data


def _difference(pair: _Pair, data: Sweep) -> float:
    return _bic(pair[1], data) - _bic(pair[0], data)


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
        if record.covariance and abs(_bic(record, data) - _bic(known, data)) < DECIDED[20.0]:
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
