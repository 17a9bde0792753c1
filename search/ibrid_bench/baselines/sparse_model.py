"""An admittance as a sparse sum of library terms, at the terminals or behind a filter that was
found first.
"""

from dataclasses import dataclass

import numpy as np
from ibrid_bench.baselines.series_filter import SeriesFilter
from ibrid_bench.baselines.sparse import sparse_regression
from ibrid_bench.baselines.terms import control_terms
from ibrid_bench.baselines.weighing import scales, stacked

from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep


@dataclass(frozen=True, eq=False)
class SparseModel:
    """Behind `filter_` the load admittance is the sum of coefficients times terms, at every
    operating point the same ones.
    """

    filter_: SeriesFilter
    coefficients: dict[str, float]
    omega_0: float

    @property
    def parameters(self) -> int:
        """Coefficients, and values of the filter."""
        return len(self.coefficients) + len(self.filter_.found)

    def admittance(self, op: OperatingPoint, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex at the terminals, per unit, current out."""
        terms = control_terms(frequency, self.omega_0, op, self.filter_)
        behind = np.sum([value * terms[name] for name, value in self.coefficients.items()], axis=0)
        return self.filter_.outwards(frequency, self.omega_0, behind)


def sparse_model(sweep: Sweep, filter_: SeriesFilter) -> SparseModel:
    """Regress the admittance behind a filter on the library, all operating points together.

    An error dB of the admittance behind moves Y at the terminals by Y Z dB Z Y, Z = (B + shunt)^-1;
    so weighted, the regression minimises the error of Y to first order.
    """
    scale, known = scales(sweep.points)
    names, rows, targets = (), [], []
    for point, spread in zip(sweep.points, scale, strict=True):
        terms = control_terms(point.frequency, sweep.omega_0, point.op, filter_)
        names = tuple(terms)
        y = point.admittance
        behind = filter_.inwards(point.frequency, sweep.omega_0, y)
        impedance = filter_.capacitor_impedance(point.frequency, sweep.omega_0, y)
        left, right = y @ impedance, impedance @ y
        rows.append(np.array([stacked(left @ term @ right / spread) for term in terms.values()]).T)
        targets.append(stacked(left @ behind @ right / spread))
    found = sparse_regression(np.concatenate(rows), np.concatenate(targets), known=known)
    values = {
        names[place]: float(c) for place, c in zip(found.chosen, found.coefficients, strict=True)
    }
    return SparseModel(filter_, values, sweep.omega_0)
