"""A hidden device as a measurement sees it: its admittance at an operating point, and whether it
runs there at all.

Exact: Jacobians of the nonlinear equations at the computed steady state, closed at each frequency
by exp(-j omega T).
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from ibrid_bench.hidden.equations import equations, values_of
from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.rest import at_rest
from ibrid_bench.hidden.winding import unstable_zeros

from ibrid.errors import OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode

__all__ = ["OMEGA_60", "Device", "Linearised", "admittance", "linearise", "power_node_of", "stable"]

OMEGA_60 = 2 * pi * 60


@dataclass(frozen=True, eq=False)
class Linearised:
    """x' = A x + B s + E v, s_out = C x + D s + F v, i_DQ = G x + H s + K v, with s = s_out delayed
    by `delays` (m,) s, and its mean over `holds` (m,) s.
    """

    matrices: tuple[np.ndarray, ...]
    delays: np.ndarray
    holds: np.ndarray

    def admittance(self, s: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex at s (K,), rad/s."""
        to_cut, to_out = self._open(s)
        m, late = len(self.delays), self._late(s)
        cut = np.linalg.solve(np.eye(m) - late * to_cut[:, :, :m], late * to_cut[:, :, m:])
        return to_out[:, :, m:] + to_out[:, :, :m] @ cut

    def difference(self, s: np.ndarray) -> np.ndarray:
        """(K,) det(I - L(s) P(s)), L of delays and holds, P the transfer around the cuts; zero at a
        pole of the closed device.
        """
        m, late = len(self.delays), self._late(s)
        return np.linalg.det(np.eye(m) - late * self._open(s)[0][:, :, :m])

    @property
    def open_poles(self) -> np.ndarray:
        """(n,) rad/s, with the loops cut."""
        return np.linalg.eigvals(self.matrices[0])

    @property
    def poles(self) -> np.ndarray:
        """(n,) rad/s, of the closed device; only without delays."""
        A, B, _, C, D, *_ = self.matrices
        return np.linalg.eigvals(A + B @ np.linalg.solve(np.eye(len(D)) - D, C))

    def _late(self, s: np.ndarray) -> np.ndarray:
        """(K, m, 1) exp(-s T) (1 - exp(-s T_h)) / (s T_h)."""
        turned = s[:, None] * self.holds
        held = np.where(turned == 0, 1.0, -np.expm1(-turned) / np.where(turned == 0, 1.0, turned))
        return (np.exp(-s[:, None] * self.delays) * held)[:, :, None]

    def _open(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transfer from (s, v) to s_out (K, m, m + 2) and to i_DQ (K, 2, m + 2)."""
        A, B, E, C, D, F, G, H, K = self.matrices
        x = np.linalg.solve(
            s[:, None, None] * np.eye(len(A)) - A, np.hstack([B, E])[None].astype(complex)
        )
        return C @ x + np.hstack([D, F]), G @ x + np.hstack([H, K])


def linearise(
    device: Device,
    op: OperatingPoint,
    omega_0: float = OMEGA_60,
    *,
    power_node: PowerNode | None = None,
) -> Linearised:
    """At an operating point (p, q, v per unit) and a nominal frequency in rad/s;
    OperatingPointError if there is none.
    """
    rest = at_rest(device, op, power_node or power_node_of(device), omega_0)
    eq = equations(device.structure)
    found = eq.linearised(rest.x, rest.s, [op.v, 0.0], rest.r, values_of(device, omega_0))
    delays = [device.T_d] * 2 + [
        one for one in (device.comb_delay, device.T_current) if one is not None for _ in "dq"
    ]
    holds = [device.T_hold or 0.0] * 2 + [0.0] * (eq.cut - 2)
    return Linearised(
        tuple(np.asarray(one.full()) for one in found), np.array(delays), np.array(holds)
    )


def power_node_of(device: Device) -> PowerNode:
    """Where p and q are measured unless told otherwise: the capacitor, or the PCC behind an L
    filter.
    """
    return "capacitor" if device.filter == "LCL" else "pcc"


def admittance(
    device: Device,
    op: OperatingPoint,
    frequency_hz: np.ndarray,
    omega_0: float = OMEGA_60,
    *,
    power_node: PowerNode | None = None,
) -> np.ndarray:
    """(K, 2, 2) complex: Y at `frequency_hz` (K,), current out, q leading, per unit, in the frame
    of the PCC voltage.

    Raises OperatingPointError when the operating point does not exist.
    """
    s = 2j * pi * np.asarray(frequency_hz, dtype=float)
    return linearise(device, op, omega_0, power_node=power_node).admittance(s)


def stable(
    device: Device,
    op: OperatingPoint,
    omega_0: float = OMEGA_60,
    *,
    power_node: PowerNode | None = None,
    margin: float = 1.0,
) -> bool:
    """Whether, on a stiff grid, the operating point exists and every pole lies left of -margin
    rad/s.

    With delays the poles are counted: those of the cut device that lie to the right, and the turns
    of det(I - L(s) P(s)) around zero along the line Re s = -margin.
    """
    try:
        linear = linearise(device, op, omega_0, power_node=power_node)
    except OperatingPointError:
        return False
    longest = float(max(linear.delays + linear.holds))
    if not longest:
        return bool((np.real(linear.poles) < -margin).all())
    return unstable_zeros(linear.difference, linear.open_poles, -margin, longest) == 0
