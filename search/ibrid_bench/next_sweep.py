"""Does `ibrid next` ask well? Poor data of hidden inverters, as many more frequencies chosen in
five ways, both structures fitted again: are they told apart, and how much smaller are the
deviations?

python -m ibrid_bench.next_sweep [--devices 30] [--seed 1] [--count 2 4 8]

structures : the first of the ranking, asked of both
parameters : asked for all parameters of the answer
named      : asked for one of them, drawn
random     : random frequencies at a random operating point
log        : log-spaced there

The device has a filter before its PLL; a rival has another effect of the catalogue in its place,
and is taken where eight frequencies at one operating point leave it within odds of 20 to 1, and 16
at each of nine do not.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ibrid.analysis.new_data.experiments import Among, experiments
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep, measured_numbers
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import insertions
from ibrid.plants.random_plants import random_stable
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import operating_point, sweep
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

COUNT, DECIBEL, RIVALS = 8, 40.0, 10
FIRST = "p=0.5,q=0"
LOW, HIGH = 5.0, 5000.0
#: Odds, as a difference of the Bayesian information criterion.
DECIDED = {odds: 2 * np.log(odds) for odds in (20.0, 150.0)}
WAYS = ("structures", "parameters", "named", "random", "log")

_Pair = tuple[Record, Record]
_Asked = tuple[OperatingPoint, np.ndarray]


def main() -> None:
    """A line a device, then the table."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.next_sweep")
    parser.add_argument("--devices", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--count", type=int, nargs="+", default=(2, 4, 8), help="frequencies that are chosen"
    )
    arguments = parser.parse_args()
    found: dict[tuple[int, str], list[tuple[float, float, float]]] = defaultdict(list)
    for number, case in enumerate(islice(_cases(arguments.seed), arguments.devices), 1):
        words = []
        for count in arguments.count:
            words.append(f" {count}:")
            for way in WAYS:
                found[count, way].append(_outcome(case, way, count))
                words.append(f"{way} {found[count, way][-1][0]:.0f}")
        print(f"{number:3d} {' '.join(words)}", flush=True)
    for (count, way), outcomes in found.items():
        apart, *deviations = np.array(outcomes).T
        shares = ", ".join(
            f"{np.mean(apart > above):.0%} at {odds:g}:1" for odds, above in DECIDED.items()
        )
        all_of_them, named = np.median(
            np.array(deviations) / np.array(found[count, "log"])[:, 1:].T, axis=1
        )
        words = (
            f"{count} frequencies, {way:10s} told apart {shares}   of log-spaced: deviations x "
            f"{all_of_them:.2f}"
        )
        print(f"{words}, of the drawn one x {named:.2f}")


@dataclass(frozen=True)
class _Case:
    """A hidden device, its structure and a rival, both fitted to poor data.

    `points` : where it can be measured. `named` : a parameter that somebody asks for.
    """

    plant: ReferenceInverter
    points: tuple[OperatingPoint, ...]
    poor: Sweep
    known: Record
    rival: Record
    named: str
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
        case = _Case(
            plant,
            points,
            poor,
            known,
            rival,
            str(rng.choice(_seen(known))),
            int(rng.integers(2**31)),
        )
        after, data = _again(case, (known, rival), poor, rich, rng)
        if _difference(after, data) < DECIDED[20.0]:  # nothing that can be measured tells
            continue
        with suppress(IbridError):  # raised where what is known so far is not stable anywhere
            _chosen(case, "structures", 1, rng)
            yield case


def _outcome(case: _Case, way: str, count: int) -> tuple[float, float, float]:
    """By how much the criterion of the rival exceeds that of the truth, fitted again; the mean
    deviation of the truth's parameters, and that of the named one.
    """
    rng = np.random.default_rng(case.seed)
    pair, data = _again(
        case, (case.known, case.rival), case.poor, [_chosen(case, way, count, rng)], rng
    )
    names, deviations = _deviations(pair[0])
    mean = float(np.exp(np.mean(np.log(deviations))))
    return _difference(pair, data), mean, float(deviations[names.index(case.named)])


def _chosen(case: _Case, way: str, count: int, rng: np.random.Generator) -> _Asked:
    """The operating point and the frequencies that are measured."""
    if way in ("structures", "parameters", "named"):
        asked = (case.known, case.rival) if way == "structures" else (case.known,)
        named = (case.named,) if way == "named" else ()
        among = _Able(count=count, events=(), parameters=named, able=case.points)
        best = experiments(asked, [structure_hash(one.diagram) for one in asked], among)[0]
        return best.op, np.array(best.frequencies)
    op = case.points[int(rng.integers(len(case.points)))]
    frequencies = np.sort(np.exp(rng.uniform(np.log(LOW), np.log(HIGH), count)))
    return op, frequencies if way == "random" else np.geomspace(LOW, HIGH, count)


@dataclass(frozen=True)
class _Able(Among):
    """Operating points at which the device can be measured."""

    able: tuple[OperatingPoint, ...] = ()

    def points(self) -> tuple[OperatingPoint, ...]:
        return self.able


def _again(
    case: _Case, pair: _Pair, data: Sweep, plan: Sequence[_Asked], rng: np.random.Generator
) -> tuple[_Pair, Sweep]:
    """Measure the plan, and fit both to all data."""
    points = list(data.points)
    for op, frequency in plan:
        points += _measured(case.plant, op, frequency, rng).points
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


def _measured(
    plant: ReferenceInverter, op: OperatingPoint, frequency: np.ndarray, rng: np.random.Generator
) -> Sweep:
    return add_noise(sweep(plant, [op], frequency), DECIBEL, rng=rng)


def _rival(truth: Diagram, known: Record, data: Sweep, rng: np.random.Generator) -> Record | None:
    """Another effect on the textbook diagram that the data do not exclude, the likeliest of some;
    None: they exclude all.
    """
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


def _deviations(record: Record) -> tuple[list[str], np.ndarray]:
    """Names and relative deviations of the free parameters."""
    matrix = np.diag(np.array(record.covariance.get("matrix", [[1.0]]), dtype=float))
    if not matrix.size:
        raise IbridError("the record holds no covariance")
    return list(record.covariance["names"]), np.sqrt(np.maximum(matrix, 1e-12))


def _seen(record: Record) -> list[str]:
    """Parameters that the data tell to a factor of three."""
    return [
        name
        for name, deviation in zip(*_deviations(record), strict=True)
        if deviation < np.log(3.0)
    ]


if __name__ == "__main__":
    main()
