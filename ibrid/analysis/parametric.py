"""The model of a record at one operating point: its response over frequency, and both as functions of its parameters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ibrid.assembly.symbolic import SymbolicModel, symbolic_matrices, symbolic_model
from ibrid.evaluation.record import Record
from ibrid.fit.kernel import respond
from ibrid.fit.problem import Coordinates, Problem
from ibrid.measurement.sweep import OperatingPoint, PointSweep
from ibrid.structure.wiring import Wiring, wire

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
#: Hz, in place of zero where a sweep needs positive frequencies.
NEARLY_ZERO = 1e-12
#: Largest relative step of a parameter in a central difference: the cube root of rounding.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class ParametricModel:
    """Admittance and matrices of a record as functions of x (P,), the search coordinates of its free parameters.

    `op` : one of the record's operating points. Search coordinates are logarithms of positive parameters. Built once, so that
    many frequencies can be asked.
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

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex at frequencies in Hz, as `Record.response`: per unit, current out, delays exact."""
        model, omega = self._model, 2 * np.pi * np.asarray(frequency, dtype=float)
        values = np.array(model.values_only(self._theta, [self.op.p, self.op.q, self.op.v])).ravel()
        return respond(values, model.rows, model.columns, model.delays(self._theta[None])[0], omega, model.size)

    def slopes(self, frequency: np.ndarray) -> np.ndarray:
        """dY/dx at the record's values and frequencies in Hz: (K, 2, 2, P) complex, delays exact."""
        frequency = np.maximum(frequency, NEARLY_ZERO)
        nothing_measured = PointSweep(self.op, frequency, np.ones((len(frequency), 2, 2), dtype=complex))
        return self.problem([nothing_measured]).jacobians(self.x)[0]

    def problem(self, points: Sequence[PointSweep]) -> Problem:
        """The fitting problem of the model and some measured points."""
        return Problem(self._model, points)

    def matrix_slopes(self, directions: np.ndarray, of: Callable[[Matrices], np.ndarray]) -> list[np.ndarray]:
        """Derivatives of `of((A, B, C, D))` along the columns of `directions` (P, R) in x, by central differences.

        The matrices have the record's Pade forms of the delays.
        """
        found = []
        for direction in (self.coordinates.slope(self._theta)[:, None] * directions).T:
            relative = np.abs(direction) / np.maximum(np.abs(self._theta), np.finfo(float).tiny)
            step = STEP / max(float(relative.max(initial=0.0)), 1e-300)
            ends = [of(self._matrices_at(self._theta + sign * step * direction)) for sign in (1.0, -1.0)]
            found.append((ends[0] - ends[1]) / (2 * step))
        return found

    def _matrices_at(self, theta: np.ndarray) -> Matrices:
        a, b, c, d = self._matrices(theta, [self.op.p, self.op.q, self.op.v])
        return np.array(a), np.array(b), np.array(c), np.array(d)

    @cached_property
    def _theta(self) -> np.ndarray:
        values = self.record.parameters[self.op.name]
        return np.array([values[name] for name in self.names], dtype=float)

    @cached_property
    def _model(self) -> SymbolicModel:
        return symbolic_model(self._wiring, **self._physics)

    @cached_property
    def _matrices(self) -> ca.Function:
        return symbolic_matrices(self._wiring, dict(self.record.settings["pade_orders"]), **self._physics)

    @cached_property
    def _wiring(self) -> Wiring:
        return wire(self.record.diagram, self.record.vocabulary)

    @property
    def _physics(self) -> dict[str, Any]:
        settings = self.record.settings
        return {
            "equilibrium": settings["equilibrium"],
            "power_node": settings["power_node"],
            "omega_0": 2 * np.pi * float(settings["f0_hz"]),
        }
