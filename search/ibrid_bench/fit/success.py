"""How often a fit finds the right minimum: known structures clean and noisy, wrong structures
against the best known.
"""

import statistics
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from ibrid_bench.fit.devices import Device

from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.diagram import Diagram

#: Far more effort than usual, to know the best.
THOROUGH = FitSettings(starts=192, kept=24, kept_misfit=48, agreeing=100, hops=6, kicked=48)


@dataclass(frozen=True)
class Success:
    """Outcome over devices and seeds: `errors` (devices, seeds), `best` (devices,) known, `seconds`
    per fit.
    """

    errors: np.ndarray
    best: np.ndarray
    seconds: tuple[float, ...]

    @property
    def ratios(self) -> np.ndarray:
        """Errors over the best known (devices, seeds)."""
        return self.errors / self.best[:, None]

    @property
    def median_seconds(self) -> float:
        """Median time of a fit."""
        return statistics.median(self.seconds)


def solved(devices: Iterable[Device], seeds: int, *, how: FitSettings | None = None) -> Success:
    """Fits of the true structure to clean data."""
    return _run([(one.diagram, one.sweep) for one in devices], seeds, settings=how)


def noisy(devices: Iterable[Device], seeds: int, decibel: float) -> Success:
    """Fits of the true structure to noisy data."""
    return _run(
        [(one.diagram, one.noisy(decibel, index)) for index, one in enumerate(devices)],
        seeds,
        thorough=True,
    )


def wrong(devices: Iterable[Device], seeds: int, candidate: Diagram) -> Success:
    """Fits of a wrong structure to clean data."""
    return _run([(candidate, one.sweep) for one in devices], seeds, thorough=True)


def _run(
    cases: list[tuple[Diagram, Sweep]],
    seeds: int,
    *,
    settings: FitSettings | None = None,
    thorough: bool = False,
) -> Success:
    errors, best, seconds = [], [], []
    for diagram, sweep in cases:
        records = [evaluate(diagram, sweep, seed=seed, settings=settings) for seed in range(seeds)]
        found = [_error(record) for record in records]
        known = [_error(evaluate(diagram, sweep, seed=1000, settings=THOROUGH))] if thorough else []
        errors.append(found)
        best.append(min(found + known))
        seconds += [record.seconds for record in records]
    return Success(np.array(errors), np.maximum(np.array(best), 1e-15), tuple(seconds))


def _error(record: Record) -> float:
    return np.inf if record.nrmse is None else record.nrmse
