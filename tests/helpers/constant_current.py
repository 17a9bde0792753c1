"""A device in closed form: an L filter under PI control of a constant current, in the frame of a
filtered PLL.
"""

import numpy as np

from ibrid.measurement import OperatingPoint, PointSweep, Sweep, add_noise

EYE, J = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
GRID = np.geomspace(1, 4000, 48)
POINTS = ((0.9, 0.1), (0.4, -0.3))


def constant_current(f0: float, p: float, q: float, decoupling: float) -> np.ndarray:
    """Y of an L filter under PI control of a constant current in the frame of a filtered PLL, in
    closed form.

    Z i = -(v + s L/w0 J i0 delta), Z = (R + kP + kI/s + s L/w0) I + (L - decoupling) J, delta = H
    v_q.
    """
    i_0, L, omega_0 = np.array([p, -q]), 0.15, 2 * np.pi * f0
    result = []
    for s in 2j * np.pi * GRID:
        loop = (63.0 + 990.0 / s) / s / (1 + s / 1885.0)
        angle = np.array([0, loop / (1 + loop)])
        impedance = (0.26 + 98.0 / s + s * L / omega_0) * EYE + (L - decoupling) * J
        seen = EYE - np.outer(J @ [1, 0], angle) + L / omega_0 * s * np.outer(J @ i_0, angle)
        result.append(np.outer(J @ i_0, angle) - np.linalg.inv(impedance) @ seen)
    return np.array(result)


def constant_current_sweep(
    f0: float, declared: float, noise_db: float | None = None, decoupling: float = 0.0
) -> Sweep:
    """Its sweep at two operating points, in a file that says so of f0."""
    points = (
        PointSweep(OperatingPoint(f"p={p}", p, q), GRID, constant_current(f0, p, q, decoupling))
        for p, q in POINTS
    )
    sweep = Sweep(tuple(points), f0_hz=declared, power_node="pcc")
    return sweep if noise_db is None else add_noise(sweep, noise_db, rng=np.random.default_rng(0))
