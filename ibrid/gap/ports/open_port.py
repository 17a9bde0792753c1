"""A model whose transfer at a port is left open: the admittance as a function of one complex number
per frequency.

Opened at the port, with w leaving its block and z = Z_u v + Z_w w entering it, y = Y_u v + Y_w w.
Closed by w = g z, g = 1 + Delta, the admittance is Y(g) = Y_u + Y_w g (I - g Z_w)^-1 Z_u: another g
costs products of 2 x 2 matrices alone.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit.problem import Coordinates
from ibrid.gap.ports.port_kinds import PORT_KINDS
from ibrid.gap.ports.ports import Port
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.reading.wiring import split_port, wire


class OpenPort:
    """The model of a port's diagram at the operating points of a sweep, which have one frequency
    grid.

    symbolic : its free parameters are those of the given diagram. coordinates : theta <-> x. omega
    : (K,) rad/s.
    """

    def __init__(self, port: Port, kinds: Vocabulary, sweep: Sweep) -> None:
        wiring = wire(port.diagram, (*kinds, *PORT_KINDS))
        self.symbolic = model = symbolic_model(
            wiring, equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0
        )
        self.coordinates = Coordinates(model.parameters)
        self.omega = sweep.points[0].omega
        self._fields = [np.array([one.op.p, one.op.q, one.op.v]) for one in sweep.points]
        self.through = np.array(
            [k for k, name in enumerate(model.states) if split_port(name)[0] == port.block]
        )
        pattern = model.pattern
        self.delayed = np.flatnonzero(pattern.delay_parameter >= 0)
        varying, self._place = np.unique(pattern.derivative_entry, return_inverse=True)
        self.rows, self.columns = pattern.rows[varying], pattern.columns[varying]

    def at(self, theta: np.ndarray) -> "OpenedModel | None":
        """The opened model at parameters theta (P,); None where an operating point does not
        exist.
        """
        model, pattern, n = self.symbolic, self.symbolic.pattern, self.symbolic.pattern.size
        matrix = np.zeros((1, len(self._fields), n + 2, n + 2))
        slopes = np.zeros((len(self._fields), len(self.rows), len(theta)))
        for m, field in enumerate(self._fields):
            values, derivatives = model.entries(theta, field)
            matrix[0, m, pattern.rows, pattern.columns] = np.asarray(values).ravel()
            slopes[m, self._place, pattern.derivative_parameter] = np.asarray(derivatives).ravel()
        if not (np.isfinite(matrix).all() and np.isfinite(slopes).all()):
            return None
        matrix[..., self.through, self.through] += (
            1.0  # the block's own lag, in whose place the open transfer is
        )
        delays = pattern.delays(theta[None])[0]
        phi = np.where(
            delays < 0,
            1j * self.omega[:, None],
            np.exp(1j * self.omega[:, None] * np.maximum(delays, 0.0)),
        )
        phi[:, self.through] = 1.0
        inside = matrix[..., :n, :].copy()
        inside[..., self.through, :] = 0.0
        try:
            inverse = np.linalg.inv(phi[:, None, :, None] * np.eye(n) - inside[..., :n])
        except np.linalg.LinAlgError:
            return None
        entering, leaving = matrix[..., self.through, :], matrix[..., n:, :]
        left, arriving = leaving[..., :n] @ inverse, entering[..., :n] @ inverse
        if not np.isfinite(inverse).all():
            return None
        x_u = inverse @ inside[..., n:]
        return OpenedModel(
            model=self,
            y_u=leaving[..., n:] + leaving[..., :n] @ x_u,
            y_w=left[..., self.through],
            z_u=entering[..., n:] + entering[..., :n] @ x_u,
            z_w=arriving[..., self.through],
            x_u=x_u,
            x_w=inverse[..., self.through],
            left=left,
            arriving=arriving,
            slopes=slopes,
            turns=1j * self.omega[:, None] * phi[:, self.delayed],
        )


@dataclass(frozen=True, eq=False)
class OpenedModel:
    """A model at one set of parameters, opened at its port, at K frequencies and M operating
    points.

    `y_u` : (K, M, 2, 2). `y_w` : (K, M, 2, r). `z_u` : (K, M, r, 2). `z_w` : (K, M, r, r); r = 1
    for a scalar, 2 for dq. `x_u`, `x_w` : (K, M, n, 2) and (K, M, n, r), what v and w make of all n
    signals. `left`, `arriving` : (K, M, 2, n) and (K, M, r, n), what a number added to each
    signal's equation makes of y and z. `slopes` : (M, E, P) of the entries that vary. `turns` : (K,
    D), derivative of each delay's row by its time.
    """

    model: OpenPort
    y_u: np.ndarray
    y_w: np.ndarray
    z_u: np.ndarray
    z_w: np.ndarray
    x_u: np.ndarray
    x_w: np.ndarray
    left: np.ndarray
    arriving: np.ndarray
    slopes: np.ndarray
    turns: np.ndarray

    def response(self, g: np.ndarray) -> np.ndarray:
        """Y at g (..., K) -> (..., K, M, 2, 2); not finite where the closed loop is singular."""
        factor = g[..., None, None, None]
        return self.y_u + self.y_w @ (factor * self._feedback(factor)) @ self.z_u

    def slope_by_transfer(self, g: np.ndarray) -> np.ndarray:
        """dY/dg = dY/dDelta at g (..., K) -> (..., K, M, 2, 2); Y is analytic in g."""
        feedback = self._feedback(g[..., None, None, None])
        return self.y_w @ feedback @ feedback @ self.z_u

    def slope_by_parameters(self, g: np.ndarray) -> np.ndarray:
        """dY/dtheta at g (K,) -> (K, M, 2, 2, P): dY = L dM R, with the rows of M at the port times
        g.
        """
        model, factor = self.model, g[:, None, None, None]
        closed = factor * self._feedback(factor)
        right = self.x_u + self.x_w @ closed @ self.z_u
        left = self.left + self.y_w @ closed @ self.arriving
        turned = left[..., model.delayed] * self.turns[:, None, None, :]
        left[..., model.through] *= factor
        identity = np.broadcast_to(np.eye(2), self.y_u.shape)
        left = np.concatenate([left, identity], axis=3)
        right = np.concatenate([right, identity], axis=2).swapaxes(2, 3)
        outer = left[..., :, None, model.rows] * right[..., None, :, model.columns]
        count, points, *_, entries = outer.shape
        slope = (outer.reshape(count, points, 4, entries) @ self.slopes).reshape(
            count, points, 2, 2, self.slopes.shape[2]
        )
        for index, row in enumerate(model.delayed):
            parameter = model.symbolic.pattern.delay_parameter[row]
            slope[..., parameter] -= turned[..., index, None] * right[:, :, None, :, row]
        return slope

    def _feedback(self, factor: np.ndarray) -> np.ndarray:
        """(I - g Z_w)^-1 by Cramer's rule, which says infinity where there is none."""
        z = self.z_w
        if z.shape[-1] == 1:
            return 1.0 / (1.0 - factor * z)
        adjugate = np.eye(2) - factor * self._adjugate
        determinant = (
            adjugate[..., :1, :1] * adjugate[..., 1:, 1:]
            - adjugate[..., :1, 1:] * adjugate[..., 1:, :1]
        )
        return adjugate / determinant

    @cached_property
    def _adjugate(self) -> np.ndarray:
        """[[d, -b], [-c, a]] of Z_w, so that I - g times it is the adjugate of I - g Z_w."""
        return np.trace(self.z_w, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - self.z_w
