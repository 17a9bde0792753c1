"""An inverter whose PLL leaves voltage on its q axis, written out as x' = f(x, v) in the grid's
frame, and its sweeps.

The grid turns at omega_0, the PLL's own frequency is `slower` rad/s below; without integral action
it rests with e_q = slower/kP_pll. Derivatives are complex steps, so they are exact to rounding.
"""

from dataclasses import dataclass
from math import asin, atan2, pi

import numpy as np
from scipy.optimize import fsolve

from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

OMEGA_0 = 2 * pi * 50
J = np.array([[0.0, -1.0], [1.0, 0.0]])
STEP = 1e-30


@dataclass(frozen=True)
class OffAxisInverter:
    """Per unit, rad/s. C_F = 0: an L filter with its power at the terminals, else an LCL filter
    with that at `node`.

    kP, kI : of the power control, both zero for constant current references. e_q_ref : of the PLL,
    which integrates with kI_pll.
    ahead, decoupled : the parts of the voltage and of the reactance's drop that the command has in
    it.
    """

    slower: float = 0.0
    e_q_ref: float = 0.0
    kP_pll: float = 60.0
    kI_pll: float = 0.0
    kP: float = 0.02
    kI: float = 20.0
    kP_current: float = 0.3
    kI_current: float = 10.0
    ahead: float = 1.0
    decoupled: float = 1.0
    L_F: float = 0.15
    R_F: float = 0.005
    C_F: float = 0.066
    L_g: float = 0.15
    R_g: float = 0.02
    node: str = "capacitor"

    def e_q_at_rest(self) -> float:
        return self.e_q_ref + (0.0 if self.kI_pll else self.slower / self.kP_pll)

    def rates(self, x: np.ndarray, v: np.ndarray, references: np.ndarray) -> np.ndarray:
        """x : i_ti, e, i_g (an L filter: i_g alone), delta, integrals of PLL, current and power
        control.
        """
        i, x = x[:2], x[2:]
        e, i_g, x = (x[:2], x[2:4], x[4:]) if self.C_F else (v, i, x)
        delta, locked, regulated, powers = x[0], x[1], x[2:4], x[4:6]
        turn = np.array([[np.cos(delta), np.sin(delta)], [-np.sin(delta), np.cos(delta)]])
        e_c, i_c, i_g_c = turn @ e, turn @ i, turn @ i_g
        error = e_c[1] - self.e_q_ref
        faster = self.kP_pll * error + self.kI_pll * locked - self.slower
        missing = references - np.array([e_c @ i_g_c, e_c @ J @ i_g_c])
        of_power = np.array([1, -1]) * (self.kP * missing + self.kI * powers)
        reference = of_power if self.kI else references
        u = self.kP_current * (reference - i_c) + self.kI_current * regulated + self.ahead * e_c
        u = turn.T @ (u + self.decoupled * self.L_F * (1 + faster / OMEGA_0) * J @ i_c)
        filtered = OMEGA_0 / self.L_F * (u - e - self.R_F * i) - OMEGA_0 * J @ i
        if self.C_F:
            capacitor = OMEGA_0 / self.C_F * (i - i_g) - OMEGA_0 * J @ e
            line = OMEGA_0 / self.L_g * (e - v - self.R_g * i_g) - OMEGA_0 * J @ i_g
            filtered = np.concatenate([filtered, capacitor, line])
        integrated = error if self.kI_pll else 0.0 * error
        return np.concatenate(
            [filtered, [faster, integrated], reference - i_c, missing if self.kI else 0.0 * missing]
        )

    def at_rest(self, p: float, q: float, v: float) -> tuple[np.ndarray, np.ndarray]:
        """States and references."""
        terminal = np.array([v, 0.0])

        def unbalanced(z: np.ndarray) -> np.ndarray:
            e, i_g = z[:2], z[2:]
            at = e if self.node == "capacitor" else terminal
            drop = self.R_g * i_g + self.L_g * J @ i_g if self.C_F else 0.0
            return np.concatenate([e - terminal - drop, [at @ i_g - p, at @ J @ i_g - q]])

        z = fsolve(unbalanced, [v, 0.0, p, -q], xtol=1e-13, full_output=True)[0]
        e, i_g = z[:2], z[2:]
        i = i_g + self.C_F * J @ e
        delta = atan2(e[1], e[0]) - asin(self.e_q_at_rest() / np.hypot(*e))
        turn = np.array([[np.cos(delta), np.sin(delta)], [-np.sin(delta), np.cos(delta)]])
        i_c = turn @ i
        u = turn @ (e + self.R_F * i + self.L_F * J @ i)
        regulated = (
            u - self.ahead * turn @ e - self.decoupled * self.L_F * J @ i_c
        ) / self.kI_current
        locked = self.slower / self.kI_pll if self.kI_pll else 0.0
        powers = np.array([1, -1]) * i_c / self.kI if self.kI else np.zeros(2)
        references = np.array([e @ i_g, e @ J @ i_g]) if self.kI else i_c
        circuit = np.concatenate([i, e, i_g]) if self.C_F else i
        x = np.concatenate([circuit, [delta, locked], regulated, powers])
        assert np.abs(self.rates(x, terminal, references)).max() < 1e-8
        return x, references

    def admittance(self, frequency: np.ndarray, p: float, q: float, v: float) -> np.ndarray:
        """(K, 2, 2) of the current out of the inverter."""
        x, references = self.at_rest(p, q, v)
        terminal = np.array([v, 0.0])
        n = len(x)
        a = [
            self.rates(x + 1j * STEP * unit, terminal, references).imag / STEP for unit in np.eye(n)
        ]
        b = [
            self.rates(x + 0j, terminal + 1j * STEP * unit, references).imag / STEP
            for unit in np.eye(2)
        ]
        first = 4 if self.C_F else 0
        c = np.eye(n)[first : first + 2]
        moved = np.abs(np.array(a)).max(axis=0) > 0  # an integral that is not there has no rate
        a_moved, b_moved = np.array(a).T[np.ix_(moved, moved)], np.array(b).T[moved]
        return np.array(
            [
                c[:, moved] @ np.linalg.solve(2j * pi * f * np.eye(moved.sum()) - a_moved, b_moved)
                for f in frequency
            ]
        )

    def sweep(self, points: list[tuple[float, float, float]], frequency: np.ndarray) -> Sweep:
        """At operating points (p, q, v)."""
        swept = [
            PointSweep(
                OperatingPoint(f"op{k}", *point), frequency, self.admittance(frequency, *point)
            )
            for k, point in enumerate(points)
        ]
        return Sweep(tuple(swept), f0_hz=OMEGA_0 / (2 * pi), power_node=self.node)

    @property
    def values(self) -> dict[str, float]:
        """Of the diagrams gfl_exact and gfl_l_filter with such a PLL."""
        of_pll = {
            "pll.kP_pll": self.kP_pll,
            "pll.kI_pll": self.kI_pll,
            "pll.e_q_ref": self.e_q_at_rest(),
        }
        plant = {f"plant.{key}": getattr(self, key) for key in ("L_F", "R_F", "C_F", "L_g", "R_g")}
        loops = {"power.kP": self.kP, "power.kI": self.kI, "decoupling.L": self.L_F}
        return {
            **plant,
            **of_pll,
            **loops,
            "current.kP": self.kP_current,
            "current.kI": self.kI_current,
        }
