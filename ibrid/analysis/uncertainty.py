"""How sure the free parameters of a record are: what the data say, and the boxes where the data say nothing.

A direction that no measured response depends on has no variance in the record's covariance, because the data know nothing
of it. Here the boxes are a prior, uniform within each box (variance width^2 / 12 in the search coordinates), joined with the
data as normal distributions are. So a visible direction keeps the variance that the data give it, and an invisible or a
barely visible one is as uncertain as its boxes allow; where a prediction depends on it, its band is wide.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.analysis.parametric import ParametricModel
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.anchor import null_directions
from ibrid.measurement.sweep import OperatingPoint, PointSweep

#: Frequencies, over the measured range, at which the fitted points are asked what they can see.
FREQUENCIES = 60
#: A change of x along an invisible direction names the parameters that take at least this part of its largest one.
NAMED = 0.05


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """x = x_hat + root z + hidden h with independent standard normal z, h.

    `root` (P, R) : one standard deviation along what the data see. `hidden` (P, H) : along what they do not, by the boxes.
    `names` (P,) : of the parameters.
    """

    names: tuple[str, ...]
    root: np.ndarray
    hidden: np.ndarray

    @property
    def directions(self) -> np.ndarray:
        """(P, R + H) all of them."""
        return np.hstack([self.root, self.hidden])

    def open_parameters(self, hidden: np.ndarray) -> tuple[str, ...]:
        """Names of the parameters that move along some of the hidden directions, `hidden` (H,) true or false."""
        moved = np.abs(self.hidden[:, hidden])
        if not moved.size:
            return ()
        far = (moved > NAMED * moved.max(axis=0)).any(axis=1)
        return tuple(name for name, far_one in zip(self.names, far, strict=True) if far_one)


def uncertainty(record: Record, model: ParametricModel) -> Uncertainty | None:
    """Join the covariance of a record with its boxes; None when the record holds no covariance.

    model : of the same record, at any operating point; it gives the order of the parameters.
    Raises IbridError when the covariance does not belong to the parameters.
    """
    if not record.covariance:
        return None
    size = len(model.names)
    labels = list(record.covariance.get("names", ()))
    matrix = np.array(record.covariance.get("matrix", ()), dtype=float)
    if sorted(labels) != sorted(model.names) or matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise IbridError("the record's covariance does not fit its parameters; make it again with ibrid evaluate")
    if not size:
        return Uncertainty((), np.zeros((0, 0)), np.zeros((0, 0)))
    order = [labels.index(name) for name in model.names]
    box = (model.coordinates.x_high - model.coordinates.x_low) / np.sqrt(12.0)
    seen = matrix[np.ix_(order, order)] / np.outer(box, box)
    blind, _ = np.linalg.qr(_invisible(record, model) / box[:, None])
    beside = np.eye(size) - blind @ blind.T
    values, vectors = np.linalg.eigh(beside @ (seen + seen.T) @ beside / 2.0)
    kept = values > 0
    root = vectors[:, kept] * np.sqrt(values[kept] / (1.0 + values[kept]))
    return Uncertainty(model.names, box[:, None] * root, box[:, None] * blind)


def _invisible(record: Record, model: ParametricModel) -> np.ndarray:
    """(P, H) directions in x along which no response at the fitted points changes."""
    settings = record.settings
    low, high = (float(one) for one in settings["frequency_hz"])
    frequency = np.geomspace(low, high, FREQUENCIES) if high > low else np.array([low])
    points = []
    for name in settings.get("fitted_points", settings["operating_points"]):
        numbers = {key: float(settings["operating_points"][name][key]) for key in "pqv"}
        points.append(PointSweep(OperatingPoint(name, **numbers), frequency, record.response(name, frequency)))
    return null_directions(model.problem(points), model.x)
