"""Vector fitting with automatic order: Y = D + sum R_k / (s - p_k), the poles common to all four
entries.

B. Gustavsen and A. Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052. Poles by scikit-rf; the
residues by weighted least squares once more, so that known noise counts as it does for the other
methods.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from ibrid_bench.baselines.weighing import information, scales, stacked

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import PointSweep

#: Share of the measured numbers that the coefficients may reach; more would only interpolate the
#: noise.
SHARE = 0.75


@dataclass(frozen=True, eq=False)
class RationalModel:
    """A 2x2 rational function at one operating point.

    poles : (P,) rad/s, of a complex pair the upper one alone. coefficients : (n + 1, 2, 2) real, of
    the columns of `_basis`.
    """

    poles: np.ndarray
    coefficients: np.ndarray

    @property
    def order(self) -> int:
        """Number of poles, a complex pair counted as two."""
        return _order(self.poles)

    @property
    def parameters(self) -> int:
        """Numbers in the model: the poles, four residues for each, and four constants."""
        return self.order + self.coefficients.size

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex at frequencies in Hz."""
        return np.einsum("kn,nij->kij", _basis(self.poles, frequency), self.coefficients)


def vector_fit(point: PointSweep, *, highest: int | None = None) -> RationalModel:
    """The rational model of the order that the Bayesian information criterion chooses.

    highest : order at most; None: the coefficients may be three quarters of the measured numbers.
    Raises IbridError when scikit-rf is missing, there are too few frequencies for a single pole, or
    it finds none.
    """
    affordable = int((SHARE * 8 * len(point.frequency) - 4) / 5)
    highest = affordable if highest is None else min(highest, affordable)
    if highest < 1:
        raise IbridError(
            "vector fitting needs at least 2 frequencies at an operating point; found "
            f"{len(point.frequency)}"
        )
    (scale,), known = scales([point])

    def merit(model: RationalModel) -> float:
        error = (model.admittance(point.frequency) - point.admittance) / scale
        return information(stacked(error), model.parameters, known)

    relocated = (poles for order in range(1, highest + 1) for poles in _relocated(point, order))
    models = [_with_residues(poles, point, scale) for poles in relocated]
    if not models:
        raise IbridError(
            f"vector fitting found no poles in the data of {point.op.name}; check them with: ibrid "
            "inspect"
        )
    return min(models, key=merit)


def _relocated(point: PointSweep, order: int) -> Iterator[np.ndarray]:
    """Poles from starting poles spaced linearly and logarithmically; the criterion judges what came
    out.
    """
    for spacing in ("lin", "log"):
        poles = relocated_poles(point, order % 2, order // 2, spacing=spacing, enforce_dc=False)
        if poles.size:
            yield poles


def _with_residues(poles: np.ndarray, point: PointSweep, scale: np.ndarray) -> RationalModel:
    basis = _basis(poles, point.frequency)
    size = np.linalg.norm(basis, axis=0)
    coefficients = np.empty((basis.shape[1], 2, 2))
    for row, column in np.ndindex(2, 2):
        weight = 1 / scale[:, row, column]
        left, right = weight[:, None] * basis / size, weight * point.admittance[:, row, column]
        both = np.concatenate([left.real, left.imag]), np.concatenate([right.real, right.imag])
        coefficients[:, row, column] = np.linalg.lstsq(*both, rcond=None)[0] / size
    return RationalModel(poles, coefficients)


def _basis(poles: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """(K, n + 1) complex: one column for a real pole, two for a pair, and the constant; their
    coefficients are real.
    """
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    columns = []
    for pole in poles:
        upper, lower = 1 / (s - pole), 1 / (s - np.conj(pole))
        columns += [upper + lower, 1j * (upper - lower)] if pole.imag else [upper]
    return np.column_stack([*columns, np.ones_like(s)])


def _order(poles: np.ndarray) -> int:
    return len(poles) + int(np.count_nonzero(np.imag(poles)))


def relocated_poles(
    point: PointSweep, real: int, pairs: int, *, spacing: str = "lin", enforce_dc: bool = True
) -> np.ndarray:
    """Poles (rad/s) common to the four entries, of a complex pair the upper one; none where
    scikit-rf breaks off.

    spacing : of the starting poles, "lin" or "log". Data without noise may leave poles beyond their
    order so undetermined that the equations are singular. Raises IbridError when scikit-rf is not
    installed.
    """
    try:
        from skrf import Frequency, Network
        from skrf.vectorFitting import VectorFitting
    except ImportError:
        raise IbridError(
            "vector fitting needs scikit-rf; install it with: pip install scikit-rf"
        ) from None
    band = Frequency.from_f(point.frequency, unit="Hz")
    fit = VectorFitting(Network(frequency=band, y=point.admittance, z0=1.0, name="admittance"))
    with (
        warnings.catch_warnings()
    ):  # of fits that do not converge, whose poles are judged by whoever asked
        warnings.simplefilter("ignore")
        try:
            fit.vector_fit(
                n_poles_real=real,
                n_poles_cmplx=pairs,
                init_pole_spacing=spacing,
                parameter_type="y",
                enforce_dc=enforce_dc,
            )
        except (ArithmeticError, np.linalg.LinAlgError):
            return np.zeros(0, dtype=complex)
    poles = np.asarray(fit.poles, dtype=complex)
    return poles if np.isfinite(poles).all() else np.zeros(0, dtype=complex)
