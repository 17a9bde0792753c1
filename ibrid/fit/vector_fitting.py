"""Seeds from vector fitting: the poles of the measured response, by scikit-rf, rank the starts of a fit.

Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052. The paper seeds its fits from such poles.
"""

import warnings

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.problem import Problem

#: Real and complex-conjugate poles of the rational fit; fewer when there are few frequencies.
REAL_POLES, COMPLEX_PAIRS = 3, 4


def fitted_poles(problem: Problem) -> list[np.ndarray]:
    """Stable poles (rad/s) of a rational fit to each operating point's four entries.

    Raises IbridError when scikit-rf is not installed.
    """
    try:
        from skrf import Frequency, Network
        from skrf.vectorFitting import VectorFitting
    except ImportError:
        raise IbridError(
            "vector-fitting seeds need scikit-rf; install it with: pip install 'ibrid[vectorfit]'"
        ) from None
    found = []
    for point in problem.points:
        count = len(point.frequency)
        pairs = min(COMPLEX_PAIRS, max(1, count // 4))
        band = Frequency.from_f(point.frequency, unit="Hz")
        fit = VectorFitting(Network(frequency=band, y=point.admittance, z0=1.0, name="admittance"))
        with warnings.catch_warnings():  # a rough fit is good enough to rank starts
            warnings.simplefilter("ignore")
            fit.vector_fit(n_poles_real=min(REAL_POLES, count // 4), n_poles_cmplx=pairs, parameter_type="y")
        poles = np.asarray(fit.poles)
        found.append(poles[np.abs(poles) > 0])
    return found


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
