"""The steady state of a hidden device: Newton's method on states, command and set-points, from the
phasors of the filter.
"""

from dataclasses import dataclass

import numpy as np
from ibrid_bench.hidden.equations import Equations, equations, values_of
from ibrid_bench.hidden.parameters import Device

from ibrid.errors import OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode

_STEPS = 30


@dataclass(frozen=True, eq=False)
class AtRest:
    """x (n,) states, s (m,) signals at the cuts, r (2,) set-points at which nothing moves and p, q
    are as asked.
    """

    x: np.ndarray
    s: np.ndarray
    r: np.ndarray


def at_rest(device: Device, op: OperatingPoint, power_node: PowerNode, omega_0: float) -> AtRest:
    """Solve x' = 0, s = s_out and p, q = those of the operating point, by choice of the set-points.

    power_node : where p and q are measured: at e, or at the PCC (without what branches draw beside
    the inverter). Raises OperatingPointError when Newton's method does not settle: the operating
    point does not exist.
    """
    eq, n = equations(device.structure), values_of(device, omega_0)
    v_DQ, asked = np.array([op.v, 0.0]), np.array([op.p, op.q])
    z = _guess(device, eq, op, power_node)
    ends = np.cumsum([len(eq.states), eq.cut])
    at = 1 if power_node == "capacitor" else 2
    for _ in range(_STEPS):
        x, s, r = np.split(z, ends)
        found = [np.asarray(one.full()) for one in eq.at_rest(x, s, v_DQ, r, n)]
        residual = np.concatenate([found[0].ravel(), found[at].ravel() - asked])
        step = _solve(np.vstack([found[3], found[3 + at]]), residual)
        if step is None:
            break
        z = z - step
        # rounding level of each unknown, or of one per unit where the unknown is smaller
        if np.all(np.abs(step) <= 1e-12 * np.maximum(1.0, np.abs(z))):
            return AtRest(*np.split(z, ends))
    raise OperatingPointError(
        f"operating point {op.name} (p = {op.p:g}, q = {op.q:g}, v = {op.v:g}) of the hidden "
        "device is not found within "
        f"{_STEPS} Newton steps; less power, a higher v or smaller impedances are needed."
    )


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Scaled by rows first: rates are in per unit per second, powers in per unit."""
    scale = np.abs(matrix).max(axis=1)
    try:
        step = np.linalg.solve(matrix / scale[:, None], right / scale)
    except np.linalg.LinAlgError:
        return None
    return step if np.isfinite(step).all() else None


def _guess(device: Device, eq: Equations, op: OperatingPoint, power_node: PowerNode) -> np.ndarray:
    """(n + m + 2,) unknowns: the filter exactly where its capacitor has no further branch, the
    controller at zero.
    """
    m, lcl = device, device.filter == "LCL"
    grid = complex(m.R_series, m.L_series) + (complex(m.R_g, m.L_g) if lcl else 0.0)
    i, e = complex(op.p, -op.q) / op.v, complex(op.v)
    for _ in range(100):  # a fixed point; Newton's method does the rest
        e = op.v + grid * i
        at_node = e if power_node == "capacitor" else complex(op.v)
        i = (complex(op.p, op.q) / at_node).conjugate()
    i_ti = i + (1j * (m.C_F or 0.0) * e if lcl else 0.0)
    flux = i_ti if m.I_core is None else i_ti / np.hypot(1, abs(i_ti) / m.I_core)
    u = e + m.R_F * i_ti + 1j * m.L_F * flux
    turn = 1.0 if m.kP_pll is None else abs(e) / e
    phasors = {
        "i_ti": flux * turn,
        "v_C": e * turn,
        "v_branch": e * turn,
        "i_g": i * turn,
        "v_shunt": complex(op.v),
    }
    guess = {"v_dc": 1.0, "delta": float(np.angle(1 / turn))}
    for name, value in phasors.items():
        guess |= {f"{name}_d": value.real, f"{name}_q": value.imag}
    for name, value in (
        ("sensor_e", e),
        ("sensor_i_ti", i_ti),
        ("sensor_i_g", i),
        ("magnitude", e),
        ("v_trap", e),
    ):
        guess |= {f"{name}_d": (value * turn).real, f"{name}_q": (value * turn).imag}
    for name in ("sogi", "dsogi"):  # y = e, z = -J y
        guess |= {f"{name}_y_d": abs(e), f"{name}_z_q": -abs(e)} if m.kP_pll is not None else {}
    x = np.array([guess.get(name, 0.0) for name in eq.states])
    s = np.zeros(eq.cut)
    if m.T_current is not None:
        s[-2:] = (i_ti * turn).real, (i_ti * turn).imag
    s[:2] = (u * turn).real, (u * turn).imag
    return np.concatenate([x, s, [op.p, op.q]])
