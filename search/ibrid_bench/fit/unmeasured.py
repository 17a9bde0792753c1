"""Operating points that were not measured: how well they are predicted, and how often the bands
hold the truth.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from ibrid_bench.fit.devices import FREQUENCY
from ibrid_bench.recipes import recipes

from ibrid.analysis.models.prediction import predict
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import operating_point, state_space, sweep
from ibrid.structure.diagrams.program import parse_program

#: Where the inverters, measured at p = 1 and q = +-0.3, are asked.
ELSEWHERE = "p=0.5,q=0"


@dataclass(frozen=True)
class Predicted:
    """An inverter at a point that was not measured: NRMSE from clean data, at a noise level (per
    seed), and coverage.

    `coverage` : part of all real and imaginary parts that lie in their 95 % band, per seed.
    """

    name: str
    clean: float
    noisy: np.ndarray
    coverage: np.ndarray


def inverters() -> list[ReferenceInverter]:
    """The benchmark inverter and the ten random stable ones that ship."""
    return [
        one.plant for one in recipes() if one.name == "paper_like" or one.name.startswith("random_")
    ]


def predicted(
    plants: Iterable[ReferenceInverter], decibel: float, seeds: int, objective: str = "sigma"
) -> list[Predicted]:
    """The true diagram fitted to two measured points, asked elsewhere.

    Every inverter has noise of its own.
    """
    found = []
    for plant in plants:
        noisy = [_one(plant, decibel, seed, objective) for seed in range(seeds)]
        clean, _ = _one(plant, None, 0, "nrmse")
        found.append(Predicted(plant.name, clean, *np.array(noisy).T))
    return found


def _one(
    plant: ReferenceInverter, decibel: float | None, seed: int, objective: str
) -> tuple[float, float]:
    """NRMSE and coverage."""
    data = sweep(plant, None, FREQUENCY)
    if decibel is not None:
        data = add_noise(
            data, decibel, rng=np.random.default_rng([seed, crc32(plant.name.encode())])
        )
    record = evaluate(parse_program(plant.program), data, objective=objective)
    found = predict(record, ELSEWHERE, FREQUENCY)
    true = state_space(plant, operating_point(ELSEWHERE)).admittance(FREQUENCY)
    if found.band is None:
        raise IbridError(f"the fit of {plant.name} holds no covariance")
    inside = [
        (part(found.band[0]) <= part(true)) & (part(true) <= part(found.band[1]))
        for part in (np.real, np.imag)
    ]
    return float(np.linalg.norm(found.admittance - true) / np.linalg.norm(true)), float(
        np.mean(inside)
    )
