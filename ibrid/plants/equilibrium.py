"""The steady state of the grid-following inverter: Newton's method on the nonlinear model, from the closed form."""

from math import atan2, sqrt

import numpy as np

from ibrid.errors import OperatingPointError
from ibrid.measurement.sweep import OperatingPoint
from ibrid.plants.gfl import Dynamics, GFLParameters


def capacitor_voltage(parameters: GFLParameters, op: OperatingPoint) -> float:
    """Magnitude E of the voltage at which p and q are measured (the PCC voltage with an L filter).

    Law: E^4 - (v^2 + 2 (R_g p + L_g q)) E^2 + (R_g^2 + L_g^2)(p^2 + q^2) = 0, the larger root.
    Raises OperatingPointError when there is no real root: the grid-side impedance cannot carry that power.
    """
    m = parameters
    if m.filter == "L":
        return op.v
    b = op.v**2 + 2 * (m.R_g * op.p + m.L_g * op.q)
    discriminant = b**2 - 4 * (m.R_g**2 + m.L_g**2) * (op.p**2 + op.q**2)
    if discriminant < 0 or b <= 0:
        raise OperatingPointError(
            f"operating point {op.name} (p = {op.p:g}, q = {op.q:g}, v = {op.v:g}) does not exist behind "
            f"L_g = {m.L_g:g}, R_g = {m.R_g:g} per unit: less power, a higher v or a smaller L_g is needed."
        )
    return sqrt((b + sqrt(discriminant)) / 2)


def gfl_equilibrium(parameters: GFLParameters, dynamics: Dynamics, op: OperatingPoint, omega_0: float) -> np.ndarray:
    """The state x (n,) with f(x, [v, 0], [p, q]) = 0, by Newton's method from the closed form.

    The references p* and q* equal op.p and op.q, which are measured at the capacitor.
    Raises OperatingPointError when the operating point does not exist or Newton's method does not settle.
    """
    m, rotate = parameters, np.array([[0.0, -1.0], [1.0, 0.0]])
    e = np.array([capacitor_voltage(m, op), 0.0])
    i_g = np.array([op.p, -op.q]) / e[0]
    v = e - (m.R_g * i_g + m.L_g * rotate @ i_g)
    i_ti = i_g + m.C_F * rotate @ e
    u_r = e + m.R_F * i_ti + m.L_F * rotate @ i_ti
    integral = u_r - m.feedforward * e - m.assumed_inductance * rotate @ i_ti
    guess = {
        "plant.i_ti_d": i_ti[0],
        "plant.i_ti_q": i_ti[1],
        "plant.e_d": e[0],
        "plant.i_g_d": i_g[0],
        "plant.i_g_q": i_g[1],
        "pll.angle": atan2(-v[1], v[0]),
        "power_filter.p": op.p,
        "power_filter.q": op.q,
        "power_p.integral": i_ti[0] / m.kI_power,
        "power_q.integral": -i_ti[1] / m.kI_power,
        "current.integral_d": integral[0] * omega_0 / m.kI_current,
        "current.integral_q": integral[1] * omega_0 / m.kI_current,
    }
    x = np.array([guess.get(name, 0.0) for name in dynamics.states])
    v_DQ, r = np.array([op.v, 0.0]), np.array([op.p, op.q])
    for _ in range(20):
        step = np.linalg.solve(np.asarray(dynamics.jacobian(x, v_DQ, r)[0]), np.asarray(dynamics.f(x, v_DQ, r)).ravel())
        x = x - step
        # 1e-12 of each state, or of one per unit where the state is smaller: rounding level
        if np.all(np.abs(step) <= 1e-12 * np.maximum(1.0, np.abs(x))):
            return x
    raise OperatingPointError(
        f"the equilibrium at operating point {op.name} must be found within 20 Newton steps; the last step was "
        f"{np.abs(step).max():.1e}, try an operating point further from the limit of L_g."
    )
