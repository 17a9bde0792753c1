"""Where the error lies: by operating point, frequency band and entry of the admittance."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep

#: By the name of a part; None where there are no data of it.
Errors = dict[str, float | None]


@dataclass(frozen=True)
class ErrorParts:
    """NRMSE per operating point; per band and per entry, relative to the measured norm of the same
    part and averaged over operating points, None when empty; the share of the squared error per
    band; and the whole table [point][band][entry].
    """

    by_op: dict[str, float]
    by_band: Errors
    by_entry: Errors
    share_by_band: Errors
    table: dict[str, dict[str, Errors]]


def nrmse(model: np.ndarray, point: PointSweep) -> float:
    """Equation (10) of the paper at one operating point; model (K, 2, 2)."""
    return float(np.linalg.norm(model - point.admittance) / np.linalg.norm(point.admittance))


def error_parts(responses: list[np.ndarray], points: tuple[PointSweep, ...]) -> ErrorParts:
    """Resolve the error of responses (K, 2, 2), one per measured operating point."""
    by_band: dict[str, list[float | None]] = {name: [] for name in BAND_NAMES}
    by_entry: dict[str, list[float | None]] = {name: [] for name in ENTRIES}
    shares: dict[str, list[float | None]] = {name: [] for name in BAND_NAMES}
    table: dict[str, dict[str, Errors]] = {}
    for response, point in zip(responses, points, strict=True):
        squared = np.abs(response - point.admittance) ** 2
        norm = np.abs(point.admittance) ** 2
        bands = band_index(point.frequency)
        total = squared.sum()
        table[point.op.name] = {}
        for index, name in enumerate(BAND_NAMES):
            here = bands == index
            shares[name].append(float(squared[here].sum() / total) if total > 0 else 0.0)
            if here.any():
                by_band[name].append(_ratio(squared[here].sum(), norm[here].sum()))
            table[point.op.name][name] = {
                entry: _ratio(squared[here, i, j].sum(), norm[here, i, j].sum())
                if here.any()
                else None
                for entry, (i, j) in ENTRIES.items()
            }
        for entry, (i, j) in ENTRIES.items():
            by_entry[entry].append(_ratio(squared[:, i, j].sum(), norm[:, i, j].sum()))
    return ErrorParts(
        by_op={
            point.op.name: nrmse(response, point)
            for response, point in zip(responses, points, strict=True)
        },
        by_band={name: _mean(values) for name, values in by_band.items()},
        by_entry={name: _mean(values) for name, values in by_entry.items()},
        share_by_band={
            name: _mean(values) if by_band[name] else None for name, values in shares.items()
        },
        table=table,
    )


def _ratio(squared: float, norm: float) -> float | None:
    """Relative error of a part; None where it is measured as zero."""
    return float(np.sqrt(squared / norm)) if norm > 0 else None


def _mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def mean_or_none(errors: Iterable[float | None]) -> float | None:
    """The mean; None without errors, and where one is unknown: the model has no such operating
    point.
    """
    mean = float(np.mean([nan if error is None else error for error in errors] or nan))
    return mean if isfinite(mean) else None


def noise_floor(points: Sequence[PointSweep]) -> float | None:
    """NRMSE that noise of the given sigma leaves on average, mean over operating points."""
    levels = [
        float(np.sqrt(2.0) * np.linalg.norm(point.sigma) / np.linalg.norm(point.admittance))
        for point in points
        if point.sigma is not None
    ]
    return float(np.mean(levels)) if len(levels) == len(points) else None
