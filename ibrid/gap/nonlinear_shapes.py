"""Memoryless nonlinearities of a port: what leaves it when a signal moves about its operating value."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: (deviation (..., r, n), value at rest (..., r, 1), threshold) -> deviation behind, and its slopes (..., r, r, n).
Law = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Shape:
    """`name`, `parameter` : of the nonlinearity and its threshold. `law` : what it does. `limits` : True for a limit that
    the value at rest must not reach, so that its threshold counts from there. `rises` : True where the gain grows with
    the amplitude."""

    name: str
    parameter: str
    law: Law
    limits: bool
    rises: bool


def _dead_zone(x: np.ndarray, rest: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    y = np.maximum(x - width, 0.0) + np.minimum(x + width, 0.0)
    return y, _each(np.abs(x) > width)


def _saturation(x: np.ndarray, rest: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    return np.clip(x, -limit, limit), _each(np.abs(x) < limit)


def _magnitude_limit(x: np.ndarray, rest: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    whole = rest + x
    d, q = whole[..., 0, :], whole[..., 1, :]
    square = np.maximum(d**2 + q**2, 1e-300)
    factor = limit / np.sqrt(square)
    within = factor >= 1.0
    factor = np.where(within, 1.0, factor)
    along = np.where(within, 0.0, factor / square)  # what is lost of the direction in which the signal points
    slope = np.empty((*whole.shape[:-2], 2, 2, whole.shape[-1]))
    slope[..., 0, 0, :], slope[..., 1, 1, :] = factor - along * d**2, factor - along * q**2
    slope[..., 0, 1, :] = slope[..., 1, 0, :] = -along * d * q
    return whole * factor[..., None, :] - rest, slope


def _axis_limit(axis: int) -> Law:
    def law(x: np.ndarray, rest: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
        whole = rest + x
        inside = np.ones(whole.shape, dtype=bool)
        inside[..., axis, :] = np.abs(whole[..., axis, :]) < limit
        y = whole.copy()
        y[..., axis, :] = np.clip(whole[..., axis, :], -limit, limit)
        return y - rest, _each(inside)

    return law


def _each(open_: np.ndarray) -> np.ndarray:
    """Slopes of a law that acts on each axis by itself, (..., r, r, n)."""
    return np.eye(open_.shape[-2])[..., None] * open_[..., None, :]


DEAD_ZONE = Shape("dead zone", "width", _dead_zone, limits=False, rises=True)
SATURATION = Shape("saturation", "limit", _saturation, limits=False, rises=False)
MAGNITUDE_LIMIT = Shape("limit of the magnitude", "limit", _magnitude_limit, limits=True, rises=False)
D_LIMIT = Shape("limit of the d axis", "limit_d", _axis_limit(0), limits=True, rises=False)
Q_LIMIT = Shape("limit of the q axis", "limit_q", _axis_limit(1), limits=True, rises=False)


def rest_size(shape: Shape, rest: np.ndarray) -> np.ndarray:
    """What of a value at rest (..., r) a limit has to leave room for, (...)."""
    if shape is D_LIMIT or shape is Q_LIMIT:
        return np.abs(rest[..., 0 if shape is D_LIMIT else 1])
    return np.linalg.norm(rest, axis=-1)
