"""Sweep by linearisation: exact Jacobians of the nonlinear model at its equilibrium."""

from dataclasses import dataclass

import numpy as np

from ibrid.errors import OperatingPointError
from ibrid.measurement.sweep import OperatingPoint
from ibrid.plants.reference import ReferenceInverter


@dataclass(frozen=True, eq=False)
class Linearisation:
    """dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ around an equilibrium; current out of the inverter, per unit.

    states : names of x; A (n, n), B (n, 2), C (2, n), D (2, 2); x_eq (n,) the equilibrium itself.
    """

    states: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x_eq: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        """(n,) rad/s."""
        return np.linalg.eigvals(self.A)

    @property
    def is_stable(self) -> bool:
        """Every pole has a negative real part."""
        return bool((np.real(self.poles) < 0).all())

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex: Y = C (j omega I - A)^-1 B + D at `frequency`, (K,) Hz."""
        omega = 2 * np.pi * np.asarray(frequency, dtype=float)
        resolvent = 1j * omega[:, None, None] * np.eye(len(self.A)) - self.A
        return self.C @ np.linalg.solve(resolvent, np.broadcast_to(self.B, (len(omega), *self.B.shape))) + self.D


def state_space(plant: ReferenceInverter, op: OperatingPoint) -> Linearisation:
    """Linearise at an operating point; OperatingPointError when it does not exist."""
    rest = plant.at_rest(op)
    A, B, C, D = (np.asarray(m) for m in plant.dynamics.jacobian(rest.x, [op.v, 0.0], rest.r))
    return Linearisation(plant.dynamics.states, A, B, C, D, rest.x)


def is_stable(plant: ReferenceInverter, op: OperatingPoint, *, margin: float = 0.0) -> bool:
    """Whether, on a stiff grid, every pole lies left of -margin rad/s; no operating point, no stability."""
    try:
        return bool((np.real(state_space(plant, op).poles) < -margin).all())
    except OperatingPointError:
        return False
