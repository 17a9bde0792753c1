"""A nonlinear averaged model in CasADi: functions, names, the point at which it rests, its linearisation there."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True, eq=False)
class NonlinearModel:
    """dx/dt = f(x, z, v, r), 0 = g(x, z, v, r), i = h(x, z, v, r); absolute quantities, per unit and rad, time in s.

    v : (2,) terminal voltage [v_D, v_Q]. i : (2,) terminal current out of the inverter, q axis leading.
    `states` : names of x, "instance.state", in the order of the record's state space. `algebraic` : names of z, the
    signals of loops of direct terms; mostly there are none. `references` : names of r, inputs to which a constant adds
    (p* and q* in front of power controllers). `x0`, `z0`, `v0`, `r0`, `i0` : the operating point, at rest.
    """

    states: tuple[str, ...]
    algebraic: tuple[str, ...]
    references: tuple[str, ...]
    f: ca.Function
    g: ca.Function
    h: ca.Function
    x0: np.ndarray
    z0: np.ndarray
    v0: np.ndarray
    r0: np.ndarray

    @property
    def i0(self) -> np.ndarray:
        """(2,) terminal current at rest."""
        return np.array(self.h(*self._at_rest)).ravel()

    def linearised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D) at the operating point, by exact derivatives; small deviations from v0 and i0."""
        f_x, f_z, f_v, g_x, g_z, g_v, h_x, h_z, h_v = (np.array(one) for one in self._derivatives(*self._at_rest))
        z_x, z_v = (np.linalg.solve(g_z, one) if len(self.algebraic) else one for one in (-g_x, -g_v))
        return f_x + f_z @ z_x, f_v + f_z @ z_v, h_x + h_z @ z_x, h_v + h_z @ z_v

    def dae(self, v: ca.SX, *, time: ca.SX | None = None, r: Any = None) -> dict[str, Any]:
        """The problem for `casadi.integrator`, with the terminal voltage as an expression, of time or of parameters.

        r : other references, an expression or numbers; by default those of the operating point.
        """
        x, z = ca.SX.sym("x", len(self.states)), ca.SX.sym("z", len(self.algebraic))
        arguments = (x, z, v, self.r0 if r is None else r)
        problem = {"x": x, "ode": self.f(*arguments)}
        if self.algebraic:
            problem |= {"z": z, "alg": self.g(*arguments)}
        return problem if time is None else problem | {"t": time}

    @property
    def _at_rest(self) -> tuple[np.ndarray, ...]:
        return self.x0, self.z0, self.v0, self.r0

    @cached_property
    def _derivatives(self) -> ca.Function:
        symbols = [ca.SX.sym(name, len(some)) for name, some in zip("xzvr", self._at_rest, strict=True)]
        found = [ca.jacobian(one(*symbols), by) for one in (self.f, self.g, self.h) for by in symbols[:3]]
        return ca.Function("derivatives", symbols, [ca.densify(one) for one in found])
