"""The grid side of an LCL filter from the highest frequencies, where impedances add: -1/Y = R_g +
L_g S + S^-1 / C_F.

S = (s I + omega_0 J) / omega_0 is the per-unit inductor of the rotating frame. Here a sum of terms
is the physics, and sparse regression finds it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from ibrid_bench.baselines.sparse import sparse_regression
from ibrid_bench.baselines.weighing import scales, stacked

from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.modules.plant import LCL

#: Share of the frequencies, from the highest, at which the filter rules.
TOP = 0.3
I, J = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
MIRROR = np.diag([1.0, -1.0])
#: Corners of the lags in the library, Hz: what of the control may be seen at the top.
LAGS = (300.0, 1000.0, 3000.0)


@dataclass(frozen=True)
class SeriesFilter:
    """Per unit. All zero: the terminals themselves."""

    R_g: float = 0.0
    L_g: float = 0.0
    C_F: float = 0.0

    @property
    def found(self) -> Mapping[str, float]:
        """Name as in the textbook diagrams -> value; empty where no filter was seen."""
        return {f"plant.{name}": value for name, value in vars(self).items() if value}

    def inwards(self, frequency: np.ndarray, omega_0: float, admittance: np.ndarray) -> np.ndarray:
        """(K, 2, 2) load admittance of what lies behind the capacitor, from Y at the terminals
        (current out).
        """
        _, shunt = self._branches(frequency, omega_0)
        return np.linalg.inv(self.capacitor_impedance(frequency, omega_0, admittance)) - shunt

    def capacitor_impedance(
        self, frequency: np.ndarray, omega_0: float, admittance: np.ndarray
    ) -> np.ndarray:
        """(K, 2, 2) load impedance at the capacitor, the capacitor included: -1/Y less the series
        branch.
        """
        series, _ = self._branches(frequency, omega_0)
        return -np.linalg.inv(admittance) - series

    def outwards(self, frequency: np.ndarray, omega_0: float, behind: np.ndarray) -> np.ndarray:
        """The inverse of `inwards`."""
        series, shunt = self._branches(frequency, omega_0)
        return -np.linalg.inv(series + np.linalg.inv(behind + shunt))

    def at_rest(self, op: OperatingPoint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Voltage at the capacitor, current to the grid and current from the converter, (2,) each
        in the grid frame.
        """
        values = {"L_F": 0.0, "R_F": 0.0, **vars(self)}
        rest = plant_equilibrium(LCL, values, op.p, op.q, op.v, "capacitor" if self.C_F else "pcc")
        return np.array(rest["e"], dtype=float), np.array(rest["i_g"]), np.array(rest["i_ti"])

    def _branches(self, frequency: np.ndarray, omega_0: float) -> tuple[np.ndarray, np.ndarray]:
        inductor = rotating(frequency, omega_0)
        return self.R_g * I + self.L_g * inductor, self.C_F * inductor


def series_filter(sweep: Sweep) -> SeriesFilter:
    """The filter that sparse regression sees at the top of the band; zeros unless both L_g and C_F
    are among its terms.
    """
    scale, known = scales(sweep.points)
    rows, targets, names = [], [], ()
    for point, spread in zip(sweep.points, scale, strict=True):
        top = slice(-max(2, round(TOP * len(point.frequency))), None)
        terms = impedance_terms(point.frequency[top], sweep.omega_0)
        names = tuple(terms)
        y = point.admittance[top]
        rows.append(np.array([stacked(y @ term @ y / spread[top]) for term in terms.values()]).T)
        targets.append(stacked(-y / spread[top]))
    found = sparse_regression(np.concatenate(rows), np.concatenate(targets), known=known)
    value = {names[place]: c for place, c in zip(found.chosen, found.coefficients, strict=True)}
    inductance, elastance = value.get("S", 0.0), value.get("1/S", 0.0)
    if inductance <= 0 or elastance <= 0:
        return SeriesFilter()
    return SeriesFilter(
        max(float(value.get("I", 0.0)), 0.0), float(inductance), float(1 / elastance)
    )


def impedance_terms(frequency: np.ndarray, omega_0: float) -> dict[str, np.ndarray]:
    """The library of twenty: name -> (K, 2, 2). Constants, inductor, capacitor, their products with
    J, higher powers, lags.
    """
    s = 2j * np.pi * frequency[:, None, None]
    inductor = rotating(frequency, omega_0)
    capacitor = np.linalg.inv(
        inductor + 1e-6 * I
    )  # at omega_0 itself an ideal one would be infinite
    whole = np.ones_like(s)
    terms = {"I": I * whole, "J": J * whole, "K": MIRROR * whole, "JK": J @ MIRROR * whole}
    for name, matrix in (("S", inductor), ("1/S", capacitor), ("1/S^2", capacitor @ capacitor)):
        terms |= {name: matrix, f"J {name}": J @ matrix}
    terms["1/S^3"] = capacitor @ capacitor @ capacitor
    for hertz in LAGS:
        lag = 1 / (1 + s / (2 * np.pi * hertz))
        terms |= {
            f"lag {hertz:g}": lag * I,
            f"J lag {hertz:g}": lag * J,
            f"K lag {hertz:g}": lag * MIRROR,
        }
    return terms


def rotating(frequency: np.ndarray, omega_0: float) -> np.ndarray:
    """(K, 2, 2) complex: (s I + omega_0 J) / omega_0, one per unit of inductance in the rotating
    frame.
    """
    return 2j * np.pi * np.asarray(frequency, dtype=float)[:, None, None] / omega_0 * I + J
