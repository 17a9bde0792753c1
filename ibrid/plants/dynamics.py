"""A nonlinear state-space model of a reference inverter in CasADi, and what makes it rest at an operating point."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca


@dataclass(frozen=True)
class Dynamics:
    """x' = f(x, v_DQ, r), i_DQ = g(x, v_DQ) as CasADi functions; r (m,) are set-points, constant in a sweep.

    states : names, one per entry of x, in the naming of the block diagrams where such a state exists.
    f : (x, v_DQ (2,), r) -> x', per second.
    g : (x, v_DQ) -> i_DQ (2,), out of the inverter.
    asked : (x, v_DQ, r, pq (2,)) -> (m,), zero where the set-points make p and q what they should be.
    """

    states: tuple[str, ...]
    f: ca.Function
    g: ca.Function
    asked: ca.Function

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, v_DQ, r) -> A, B (for v_DQ), C, D."""
        x, v_DQ, r = self._symbols()
        x_dot, i_DQ = self.f(x, v_DQ, r), self.g(x, v_DQ)
        matrices = [ca.jacobian(x_dot, x), ca.jacobian(x_dot, v_DQ), ca.jacobian(i_DQ, x), ca.jacobian(i_DQ, v_DQ)]
        return ca.Function("linearised", [x, v_DQ, r], [ca.densify(m) for m in matrices])

    @cached_property
    def at_rest(self) -> ca.Function:
        """(x, v_DQ, r, pq) -> what is zero at rest (n + m,), and its Jacobian by (x, r)."""
        (x, v_DQ, r), pq = self._symbols(), ca.SX.sym("pq", 2)
        residual = ca.vertcat(self.f(x, v_DQ, r), self.asked(x, v_DQ, r, pq))
        return ca.Function("at_rest", [x, v_DQ, r, pq], [residual, ca.densify(ca.jacobian(residual, ca.vertcat(x, r)))])

    @property
    def set_points(self) -> int:
        """Number of set-points."""
        return self.f.numel_in(2)

    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return ca.SX.sym("x", len(self.states)), ca.SX.sym("v_DQ", 2), ca.SX.sym("r", self.set_points)
