"""What a record says about its residual, as numbers: by frequency band and entry of the
admittance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.evaluation.record import Record
from ibrid.fit.kernel import admittance
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep

_SHAPE = (len(BAND_NAMES), len(ENTRIES))


@dataclass(frozen=True, eq=False)
class ResidualMeans:
    """Means over operating points; arrays (4 bands, 4 entries), not a number where nothing was
    measured.

    `total` : NRMSE. `share` : of the squared error, by band (4,). `error` : relative to the
    measured norm of the part.
    `turn` : complex, the residual over the measurement, of modulus 1 where their ratio is the same
    at all frequencies.
    `size` : root mean square of the measurement, per unit. `angle` : complex, its mean over its
    mean modulus.
    `at_bound` : "instance.parameter" of numbers at an end of their box.
    """

    points: int
    total: float
    share: np.ndarray
    error: np.ndarray
    turn: np.ndarray
    size: np.ndarray
    angle: np.ndarray
    at_bound: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "points": self.points,
            "total": self.total,
            "share": _plain(self.share),
            "error": _plain(self.error),
            "turn": [_plain(np.real(self.turn)), _plain(np.imag(self.turn))],
            "size": _plain(self.size),
            "angle": [_plain(np.real(self.angle)), _plain(np.imag(self.angle))],
            "at_bound": list(self.at_bound),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Back from plain data."""

        def array(value: Sequence) -> np.ndarray:
            return np.array(value, dtype=float).reshape(-1 if np.ndim(value) == 1 else _SHAPE)

        def complex_array(value: Sequence) -> np.ndarray:
            return array(value[0]) + 1j * array(value[1])

        return cls(
            data["points"],
            data["total"],
            array(data["share"]),
            array(data["error"]),
            complex_array(data["turn"]),
            array(data["size"]),
            complex_array(data["angle"]),
            tuple(data["at_bound"]),
        )


def residual_of(record: Record, sweep: Sweep) -> ResidualMeans:
    """The residual of a record with a fit, at the operating points that were fitted."""
    names = tuple(record.nrmse_by_op)
    measured = [sweep.point(name) for name in names]
    found = _responses(record, sweep, names)
    parts = [
        _parts(model, point.admittance, band_index(point.frequency))
        for model, point in zip(found, measured, strict=True)
    ]
    error, turn, size, angle = (_mean([part[index] for part in parts]) for index in range(4))
    share = np.array([record.share_by_band.get(name) or 0.0 for name in BAND_NAMES])
    at_bound = tuple(dict.fromkeys(one.split()[0] for one in record.at_bound))
    return ResidualMeans(
        len(names),
        float(record.nrmse or 0.0),
        share,
        np.real(error),
        turn,
        np.real(size),
        angle,
        at_bound,
    )


def _responses(record: Record, sweep: Sweep, names: Sequence[str]) -> list[np.ndarray]:
    """Model admittances (K, 2, 2) at the measured frequencies; the matrices are built once for all
    points.
    """
    model = symbolic_model(record.wiring, **record.physics)
    found = []
    for name in names:
        theta = np.array([record.parameters[name][one.name] for one in model.parameters])
        point, omega = record.point(name).pqv, 2 * np.pi * sweep.point(name).frequency
        found.append(admittance(model, theta, point, omega))
    return found


def _parts(model: np.ndarray, measured: np.ndarray, bands: np.ndarray) -> tuple[np.ndarray, ...]:
    error, size = np.full(_SHAPE, np.nan), np.full(_SHAPE, np.nan)
    turn, angle = np.full(_SHAPE, np.nan, complex), np.full(_SHAPE, np.nan, complex)
    for band in range(len(BAND_NAMES)):
        here = bands == band
        for column, place in enumerate(ENTRIES.values()):
            y, r = measured[here][:, *place], (model - measured)[here][:, *place]
            norm, wrong = np.linalg.norm(y), np.linalg.norm(r)
            if not norm > 0:
                continue
            error[band, column] = wrong / norm
            size[band, column] = norm / np.sqrt(len(y))
            turn[band, column] = np.vdot(y, r) / (norm * wrong) if wrong > 0 else 0.0
            angle[band, column] = y.sum() / np.abs(y).sum()
    return error, turn, size, angle


def _mean(parts: list[np.ndarray]) -> np.ndarray:
    """Mean over operating points; nan where none has the part."""
    stacked = np.array(parts)
    number = (~np.isnan(stacked)).sum(axis=0)
    return np.where(number > 0, np.nansum(stacked, axis=0) / np.maximum(number, 1), np.nan)


def _plain(array: np.ndarray) -> list:
    return (
        [[None if np.isnan(one) else round(float(one), 6) for one in row] for row in array]
        if array.ndim == 2
        else [round(float(one), 6) for one in array]
    )
