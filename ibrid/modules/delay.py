"""Transport delay of a digital controller: exact in frequency responses, a Pade form in matrices and exports.

The Pade form of exp(-s T) is that of exp(-z) with z = s T, so its matrices are constants, A and B divided by T.
"""

from functools import cache
from math import factorial, pi, radians

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from ibrid.modules.kind import Matrices, ModuleKind, Range
from ibrid.signals import Signal

HIGHEST_PADE_ORDER = 12
PHASE_TOLERANCE = radians(1.0)


@cache
def _unit_delay(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Pade form of exp(-z) in coordinates whose controllability Gramian is the identity; (n,n), (n,), (n,), ().

    Coefficients c_k = (2n-k)!/(k!(n-k)!) of z^k, the numerator with alternating signs.
    """
    coefficients = np.array(
        [factorial(2 * order - k) // (factorial(k) * factorial(order - k)) for k in range(order + 1)]
    )
    scale = float(coefficients[0] / coefficients[-1]) ** (1.0 / order)  # z = scale * z' keeps the companion form small
    denominator = coefficients * scale ** np.arange(order + 1.0)
    numerator = denominator * (-1.0) ** np.arange(order + 1)
    through = numerator[-1] / denominator[-1]
    companion = np.diag(np.ones(order - 1), 1)
    companion[-1] = -denominator[:-1] / denominator[-1]
    b = np.zeros(order)
    b[-1] = 1.0
    c = (numerator[:-1] - through * denominator[:-1]) / denominator[-1]
    root = np.linalg.cholesky(solve_continuous_lyapunov(companion, -np.outer(b, b)))
    a = np.linalg.solve(root, companion @ root)
    return a * scale, np.linalg.solve(root, b) * scale, c @ root, float(through)


def pade_order(delay: float, highest_frequency: float) -> int:
    """Smallest order whose phase is within 1 degree of exp(-j omega T) up to `highest_frequency` (Hz), at most 12."""
    angles = np.linspace(0.0, 2 * pi * highest_frequency * delay, 50)[1:]
    for order in range(1, HIGHEST_PADE_ORDER + 1):
        if _phase_error(order, angles).max() <= PHASE_TOLERANCE:
            return order
    return HIGHEST_PADE_ORDER


def pade_limit(delay: float, order: int) -> float:
    """Frequency (Hz) up to which the phase of that Pade form is within 1 degree of exp(-j omega T)."""
    angles = np.linspace(0.0, 4.0 * order, 400)[1:]
    wrong = _phase_error(order, angles) > PHASE_TOLERANCE
    return float((angles[np.argmax(wrong)] if wrong.any() else angles[-1]) / (2 * pi * delay))


def _phase_error(order: int, angles: np.ndarray) -> np.ndarray:
    a, b, c, d = _unit_delay(order)
    response = [c @ np.linalg.solve(1j * z * np.eye(order) - a, b) + d for z in angles]
    return np.abs(np.angle(response * np.exp(1j * angles)))


def pade_state_space(T_d, order: int) -> Matrices:
    """Pade form on both axes; `T_d` in seconds, a float or a symbol; states d first, then q."""
    a, b, c, through = _unit_delay(order)
    empty = [0.0] * order
    rows = [[value / T_d for value in row] for row in a.tolist()]
    inputs = [value / T_d for value in b.tolist()]
    return (
        [row + empty for row in rows] + [empty + row for row in rows],
        [[value, 0.0] for value in inputs] + [[0.0, value] for value in inputs],
        [c.tolist() + empty, empty + c.tolist()],
        [[through, 0.0], [0.0, through]],
    )


def _pass_through(T_d):
    """The matrices without the lag: assembly inserts exp(-s T_d) or the Pade form."""
    return [], [], [[], []], [[1, 0], [0, 1]]


DELAY = ModuleKind(
    name="Delay",
    family="dynamic control",
    law="out = exp(-s T_d) in_ on each axis, in the controller's frame",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    parameters={"T_d": Range(1e-6, 5e-4, 1e-4, "s", "delay", divides=True)},
    state_space=_pass_through,
    dc_gain=1.0,
    delay="T_d",
    extended=True,
    reference="control and modulation delay of a digital controller, usually 1.5 sampling periods",
)
