"""The steady state of a reference inverter: Newton's method on the nonlinear model, from phasors of
its filter.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2, sqrt

import numpy as np

from ibrid.errors import OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.dynamics import Dynamics
from ibrid.plants.output_filter import FilterParameters

_J = np.array([[0.0, -1.0], [1.0, 0.0]])
_STEPS = 30


@dataclass(frozen=True, eq=False)
class AtRest:
    """x (n,) states and r (m,) set-points at which nothing moves and p, q are those asked for."""

    x: np.ndarray
    r: np.ndarray


def capacitor_voltage(m: FilterParameters, op: OperatingPoint) -> float:
    """Magnitude E of the voltage at which p and q are measured (the PCC voltage with an L filter).

    Law: E^4 - (v^2 + 2 (R_g p + L_g q)) E^2 + (R_g^2 + L_g^2)(p^2 + q^2) = 0, the larger root.
    Raises OperatingPointError when there is no real root: the grid-side impedance cannot carry that
    power.
    """
    if m.filter == "L":
        return op.v
    b = op.v**2 + 2 * (m.R_g * op.p + m.L_g * op.q)
    discriminant = b**2 - 4 * (m.R_g**2 + m.L_g**2) * (op.p**2 + op.q**2)
    if discriminant < 0 or b <= 0:
        raise OperatingPointError(
            f"operating point {op.name} (p = {op.p:g}, q = {op.q:g}, v = {op.v:g}) does not exist "
            "behind "
            f"L_g = {m.L_g:g}, R_g = {m.R_g:g} per unit: less power, a higher v or a smaller L_g "
            "is needed."
        )
    return sqrt((b + sqrt(discriminant)) / 2)


def filter_at_rest(m: FilterParameters, op: OperatingPoint) -> dict[str, float]:
    """States of the output filter in the frame of e, and that frame's angle as `angle`; per unit,
    rad.

    Raises OperatingPointError when the operating point does not exist.
    """
    e = np.array([capacitor_voltage(m, op), 0.0])
    i_g = np.array([op.p, -op.q]) / e[0]
    v = e - (m.R_g * i_g + m.L_g * _J @ i_g)
    found = {"angle": atan2(-v[1], v[0])}
    for name, value in {"i_ti": i_g + m.C_F * _J @ e, "e": e, "i_g": i_g}.items():
        found |= {f"plant.{name}_d": float(value[0]), f"plant.{name}_q": float(value[1])}
    return found


def at_rest(dynamics: Dynamics, guess: Mapping[str, float], op: OperatingPoint) -> AtRest:
    """Solve f(x, [v, 0], r) = 0 with p and q as asked, from a guess of states by name; others and r
    start at zero.

    Raises OperatingPointError when Newton's method does not settle.
    """
    x = np.array([guess.get(name, 0.0) for name in dynamics.states])
    z, v_DQ, pq = np.concatenate([x, np.zeros(dynamics.set_points)]), [op.v, 0.0], [op.p, op.q]
    for _ in range(_STEPS):
        x, r = np.split(z, [len(dynamics.states)])
        residual, jacobian = (np.asarray(one) for one in dynamics.at_rest(x, v_DQ, r, pq))
        scale = np.maximum(
            np.abs(jacobian).max(axis=1), 1e-300
        )  # rates are per second, powers per unit
        try:
            step = np.linalg.solve(jacobian / scale[:, None], residual.ravel() / scale)
        except np.linalg.LinAlgError:
            break
        z = z - step
        # 1e-12 of each state, or of one per unit where the state is smaller: rounding level
        if np.all(np.abs(step) <= 1e-12 * np.maximum(1.0, np.abs(z))):
            return AtRest(*np.split(z, [len(dynamics.states)]))
    raise OperatingPointError(
        f"the equilibrium at operating point {op.name} must be found within {_STEPS} Newton steps; "
        "it was not, try an "
        "operating point further from the limit of L_g."
    )
