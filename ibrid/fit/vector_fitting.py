"""Seeds from vector fitting: the poles of the measured response, by scikit-rf, rank the starts of a fit.

Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052. The paper seeds its fits from such poles.
"""

import warnings

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.problem import Problem
from ibrid.measurement.sweep import PointSweep

#: Real and complex-conjugate poles of the rational fit; fewer when there are few frequencies.
REAL_POLES, COMPLEX_PAIRS = 3, 4


def fitted_poles(problem: Problem) -> list[np.ndarray]:
    """Stable poles (rad/s) of a rational fit to each operating point's four entries.

    Raises IbridError when scikit-rf is not installed.
    """
    found = []
    for point in problem.points:
        count = len(point.frequency)
        pairs = min(COMPLEX_PAIRS, max(1, count // 4))
        poles = relocated_poles(point, min(REAL_POLES, count // 4), pairs)
        found.append(poles[np.abs(poles) > 0])
    return found


def relocated_poles(
    point: PointSweep, real: int, pairs: int, *, spacing: str = "lin", enforce_dc: bool = True
) -> np.ndarray:
    """Poles (rad/s) common to the four entries, of a complex pair the upper one; none where scikit-rf breaks off.

    spacing : of the starting poles, "lin" or "log". Data without noise may leave poles beyond their order so undetermined
    that the equations are singular. Raises IbridError when scikit-rf is not installed.
    """
    try:
        from skrf import Frequency, Network
        from skrf.vectorFitting import VectorFitting
    except ImportError:
        raise IbridError("vector fitting needs scikit-rf; install it with: pip install 'ibrid[vectorfit]'") from None
    band = Frequency.from_f(point.frequency, unit="Hz")
    fit = VectorFitting(Network(frequency=band, y=point.admittance, z0=1.0, name="admittance"))
    with warnings.catch_warnings():  # of fits that do not converge, whose poles are judged by whoever asked
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


def pole_distances(problem: Problem, x: np.ndarray, measured: list[np.ndarray]) -> np.ndarray:
    """Sum over measured poles of |log(pole / nearest model pole)|, for starts x (S, P) -> (S,)."""
    total = np.zeros(len(x))
    for m, poles in enumerate(measured):
        model = np.linalg.eigvals(problem.state_matrices(x, m)).astype(complex)
        model = np.where(np.abs(model) > 0, model, 1e-9)
        upper = np.where(np.imag(model) < 0, np.conj(model), model)
        ratio = poles[None, :, None] / upper[:, None, :]
        total += np.hypot(np.log(np.abs(ratio)), np.angle(ratio)).min(axis=2).sum(axis=1)
    return total
