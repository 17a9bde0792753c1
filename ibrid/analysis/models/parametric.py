"""The model of a record at one operating point: its response over frequency, and both as functions
of its parameters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ibrid.assembly.symbolic import SymbolicModel, symbolic_matrices, symbolic_model
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.anchor import null_directions
from ibrid.fit.kernel import admittance
from ibrid.fit.problem import Coordinates, Problem
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
#: Hz, in place of zero where a sweep needs positive frequencies.
NEARLY_ZERO = 1e-12
#: Largest relative step of a parameter in a central difference: the cube root of rounding.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class ParametricModel:
    """Admittance and matrices of a record as functions of x (P,), the search coordinates of its
    free parameters.

    `op` : one of the record's operating points. Search coordinates are logarithms of positive
    parameters. Built once, so that many frequencies can be asked.
    """

    record: Record
    op: OperatingPoint

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of x."""
        return tuple(one.name for one in self._model.parameters)

    @cached_property
    def coordinates(self) -> Coordinates:
        """theta <-> x, with the boxes."""
        return Coordinates(self._model.parameters)

    @cached_property
    def x(self) -> np.ndarray:
        """(P,) the record's values."""
        return self.coordinates.to_x(self._theta)

    def admittance(self, frequency: np.ndarray, x: np.ndarray | None = None) -> np.ndarray:
        """(K, 2, 2) complex at frequencies in Hz, as `Record.response`: per unit, current out,
        delays exact; at the record's values, or at x (P,).
        """
        omega = 2 * np.pi * np.asarray(frequency, dtype=float)
        theta = self._theta if x is None else self.coordinates.to_theta(x)
        return admittance(self._model, theta, self.op.pqv, omega)

    def slopes(self, frequency: np.ndarray) -> np.ndarray:
        """dY/dx at the record's values and frequencies in Hz: (K, 2, 2, P) complex, delays
        exact.
        """
        frequency = np.maximum(frequency, NEARLY_ZERO)
        nothing_measured = PointSweep(
            self.op, frequency, np.ones((len(frequency), 2, 2), dtype=complex)
        )
        return self.problem([nothing_measured]).jacobians(self.x)[0]

    def problem(self, points: Sequence[PointSweep]) -> Problem:
        """The fitting problem of the model and some measured points."""
        return Problem(self._model, points)

    def matrix_slopes(
        self, directions: np.ndarray, of: Callable[[Matrices], np.ndarray]
    ) -> list[np.ndarray]:
        """Derivatives of `of((A, B, C, D))` along the columns of `directions` (P, R) in x, by
        central differences.

        The matrices have the record's Pade forms of the delays.
        """
        slopes = []
        for direction in (self.coordinates.slope(self._theta)[:, None] * directions).T:
            relative = np.abs(direction) / np.maximum(np.abs(self._theta), np.finfo(float).tiny)
            step = STEP / max(float(relative.max(initial=0.0)), 1e-300)
            ends = [
                of(self._matrices_at(self._theta + sign * step * direction)) for sign in (1.0, -1.0)
            ]
            slopes.append((ends[0] - ends[1]) / (2 * step))
        return slopes

    def _matrices_at(self, theta: np.ndarray) -> Matrices:
        a, b, c, d = self._matrices(theta, self.op.pqv)
        return np.array(a), np.array(b), np.array(c), np.array(d)

    @cached_property
    def _theta(self) -> np.ndarray:
        values = self.record.parameters[self.op.name]
        return np.array([values[name] for name in self.names], dtype=float)

    @cached_property
    def _model(self) -> SymbolicModel:
        return symbolic_model(self.record.wiring, **self.record.physics)

    @cached_property
    def _matrices(self) -> ca.Function:
        record = self.record
        return symbolic_matrices(
            record.wiring, dict(record.settings["pade_orders"]), **record.physics
        )


#: Frequencies, over the measured range, at which the fitted points are asked what they can see.
FREQUENCIES = 60
#: A change of x along an invisible direction names the parameters that take at least this part of
#: its largest one.
NAMED = 0.05


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """x = x_hat + root z + hidden h with independent standard normal z, h.

    `root` (P, R) : one standard deviation along what the data see. `hidden` (P, H) : along what
    they do not, by the boxes. `names` (P,) : of the parameters. `others` : x (P,) of other minima
    within the noise, each with its relative likelihood.
    """

    names: tuple[str, ...]
    root: np.ndarray
    hidden: np.ndarray
    others: tuple[tuple[np.ndarray, float], ...] = ()

    @property
    def directions(self) -> np.ndarray:
        """(P, R + H) all of them."""
        return np.hstack([self.root, self.hidden])

    def open_parameters(self, hidden: np.ndarray) -> tuple[str, ...]:
        """Names of the parameters that move along some of the hidden directions, `hidden` (H,) true
        or false.
        """
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
    if (
        sorted(labels) != sorted(model.names)
        or matrix.shape != (size, size)
        or not np.isfinite(matrix).all()
    ):
        raise IbridError(
            "the record's covariance does not fit its parameters; make it again with ibrid evaluate"
        )
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
    others = tuple(
        (np.array(other["x"], dtype=float)[order], float(np.exp(-other["chi2_above"] / 2.0)))
        for other in record.covariance.get("other_minima", ())
    )
    return Uncertainty(model.names, box[:, None] * root, box[:, None] * blind, others)


def _invisible(record: Record, model: ParametricModel) -> np.ndarray:
    """(P, H) directions in x along which no response at the fitted points changes."""
    settings = record.settings
    low, high = (float(one) for one in settings["frequency_hz"])
    frequency = np.geomspace(low, high, FREQUENCIES) if high > low else np.array([low])
    names = settings.get("fitted_points", settings["operating_points"])
    points = [
        PointSweep(record.point(name), frequency, record.response(name, frequency))
        for name in names
    ]
    return null_directions(model.problem(points), model.x)
