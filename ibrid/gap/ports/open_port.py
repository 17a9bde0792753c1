"""A model with an unknown transfer function at a port: the admittance as a function of one complex
number at each frequency.

Opened at the port, with the output w and the input z = Z_u v + Z_w w of its block, y = Y_u v +
Y_w w (a linear fractional transformation). Closed by w = g z, g = 1 + Delta, the admittance is
Y(g) = Y_u + Y_w g (I - g Z_w)^-1 Z_u: another g costs products of 2 x 2 matrices alone.
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
    """The model of a port's diagram at the M operating points of a sweep with K common frequencies.

    Attributes
    ----------
    symbolic : SymbolicModel
        Its free parameters are those of the given diagram.
    coordinates : Coordinates
        Of the search: theta <-> x.
    omega : ndarray
        (K,) rad/s.
    port_rows : ndarray
        (r,) rows of the port's block; r = 1 for a scalar, 2 for dq.
    delay_rows : ndarray
        (D,) rows of the delays.
    rows, columns : ndarray
        (E,) position of the entries that depend on parameters.
    """

    def __init__(self, port: Port, kinds: Vocabulary, sweep: Sweep) -> None:
        wiring = wire(port.diagram, (*kinds, *PORT_KINDS))
        self.symbolic = model = symbolic_model(
            wiring, equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0
        )
        self.coordinates = Coordinates(model.parameters)
        self.omega = sweep.points[0].omega
        self._pqv = [np.array([point.op.p, point.op.q, point.op.v]) for point in sweep.points]
        self.port_rows = np.array(
            [k for k, name in enumerate(model.states) if split_port(name)[0] == port.block]
        )
        pattern = model.pattern
        self.delay_rows = np.flatnonzero(pattern.delay_parameter >= 0)
        varying, self._varying_index = np.unique(pattern.derivative_entry, return_inverse=True)
        self.rows = pattern.rows[varying]
        self.columns = pattern.columns[varying]

    def at(self, theta: np.ndarray) -> "OpenedModel | None":
        """Open the model at parameters theta (P,).

        None where an operating point does not exist.
        """
        matrix, slopes = self._evaluate_entries(theta)
        if not (np.isfinite(matrix).all() and np.isfinite(slopes).all()):
            return None
        n = self.symbolic.pattern.size
        port = self.port_rows
        # without the block's own lag, in whose place the unknown transfer function is
        matrix[..., port, port] += 1.0
        phi = self._dynamics(theta)
        inside = matrix[..., :n, :].copy()
        inside[..., port, :] = 0.0
        try:
            inverse = np.linalg.inv(phi[:, None, :, None] * np.eye(n) - inside[..., :n])
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(inverse).all():
            return None
        to_port = matrix[..., port, :]
        to_output = matrix[..., n:, :]
        y_by_signal = to_output[..., :n] @ inverse
        z_by_signal = to_port[..., :n] @ inverse
        x_u = inverse @ inside[..., n:]
        return OpenedModel(
            model=self,
            y_u=to_output[..., n:] + to_output[..., :n] @ x_u,
            y_w=y_by_signal[..., port],
            z_u=to_port[..., n:] + to_port[..., :n] @ x_u,
            z_w=z_by_signal[..., port],
            x_u=x_u,
            x_w=inverse[..., port],
            y_by_signal=y_by_signal,
            z_by_signal=z_by_signal,
            slopes=slopes,
            delay_slopes=1j * self.omega[:, None] * phi[:, self.delay_rows],
        )

    def _evaluate_entries(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the model's matrix and its derivatives at parameters theta (P,).

        Returns
        -------
        tuple of ndarray
            (1, M, n + 2, n + 2) matrix, the outer signals last; (M, E, P) derivative of the entries
            that depend on parameters.
        """
        pattern = self.symbolic.pattern
        n = pattern.size
        matrix = np.zeros((1, len(self._pqv), n + 2, n + 2))
        slopes = np.zeros((len(self._pqv), len(self.rows), len(theta)))
        for m, pqv in enumerate(self._pqv):
            values, derivatives = self.symbolic.entries(theta, pqv)
            matrix[0, m, pattern.rows, pattern.columns] = np.asarray(values).ravel()
            flat = np.asarray(derivatives).ravel()
            slopes[m, self._varying_index, pattern.derivative_parameter] = flat
        return matrix, slopes

    def _dynamics(self, theta: np.ndarray) -> np.ndarray:
        """Return the diagonal (K, n) that the signals are multiplied by in their equations.

        j omega for a state, e^(j omega T) for a delay, 1 at the port.
        """
        delays = self.symbolic.pattern.delays(theta[None])[0]
        j_omega = 1j * self.omega[:, None]
        phi = np.where(delays < 0, j_omega, np.exp(j_omega * np.maximum(delays, 0.0)))
        phi[:, self.port_rows] = 1.0
        return phi


@dataclass(frozen=True, eq=False)
class OpenedModel:
    """A model at one set of parameters, opened at its port.

    At K frequencies and M operating points, with r = 1 for a scalar port and 2 for dq, n signals,
    and P parameters.

    Parameters
    ----------
    y_u, y_w : ndarray
        (K, M, 2, 2) and (K, M, 2, r), from v and from w to y.
    z_u, z_w : ndarray
        (K, M, r, 2) and (K, M, r, r), from v and from w to z.
    x_u, x_w : ndarray
        (K, M, n, 2) and (K, M, n, r), from v and from w to all signals.
    y_by_signal, z_by_signal : ndarray
        (K, M, 2, n) and (K, M, r, n), from a number added to the equation of each signal to y and
        to z.
    slopes : ndarray
        (M, E, P) derivative of the entries that depend on parameters.
    delay_slopes : ndarray
        (K, D) derivative of each delay's row by its time.
    """

    model: OpenPort
    y_u: np.ndarray
    y_w: np.ndarray
    z_u: np.ndarray
    z_w: np.ndarray
    x_u: np.ndarray
    x_w: np.ndarray
    y_by_signal: np.ndarray
    z_by_signal: np.ndarray
    slopes: np.ndarray
    delay_slopes: np.ndarray

    def response(self, g: np.ndarray) -> np.ndarray:
        """Return Y (..., K, M, 2, 2) at g (..., K); not finite where the loop is singular."""
        factor = g[..., None, None, None]
        return self.y_u + self.y_w @ (factor * self._feedback(factor)) @ self.z_u

    def slope_by_transfer(self, g: np.ndarray) -> np.ndarray:
        """Return dY/dg (..., K, M, 2, 2) at g (..., K); Y is analytic in g."""
        feedback = self._feedback(g[..., None, None, None])
        return self.y_w @ feedback @ feedback @ self.z_u

    def slope_by_parameters(self, g: np.ndarray) -> np.ndarray:
        """Return dY/dtheta (K, M, 2, 2, P) at g (K,).

        Law: dY = L dM R, with the rows of M at the port times g.
        """
        model = self.model
        factor = g[:, None, None, None]
        closed = factor * self._feedback(factor)
        right = self.x_u + self.x_w @ closed @ self.z_u
        left = self.y_by_signal + self.y_w @ closed @ self.z_by_signal
        by_delay = left[..., model.delay_rows] * self.delay_slopes[:, None, None, :]
        left[..., model.port_rows] *= factor
        identity = np.broadcast_to(np.eye(2), self.y_u.shape)
        left = np.concatenate([left, identity], axis=3)
        right = np.concatenate([right, identity], axis=2).swapaxes(2, 3)
        outer = left[..., :, None, model.rows] * right[..., None, :, model.columns]
        count, points, *_, entries = outer.shape
        slope = outer.reshape(count, points, 4, entries) @ self.slopes
        slope = slope.reshape(count, points, 2, 2, self.slopes.shape[2])
        for index, row in enumerate(model.delay_rows):
            parameter = model.symbolic.pattern.delay_parameter[row]
            slope[..., parameter] -= by_delay[..., index, None] * right[:, :, None, :, row]
        return slope

    def _feedback(self, factor: np.ndarray) -> np.ndarray:
        """Return (I - g Z_w)^-1 (..., K, M, r, r) by Cramer's rule; infinite where singular."""
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
