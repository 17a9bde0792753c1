"""Transport delay of a digital controller: exact in frequency responses, a Pade form in matrices
and exports; and the forms in which the simulation of a device may draw it.

The Pade form of exp(-s T) is that of exp(-z) with z = s T, so its matrices are constants, A and B
divided by T.
"""

from collections.abc import Callable
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
    """Pade form of exp(-z) in coordinates whose controllability Gramian is the identity; (n,n),
    (n,), (n,), ().

    Coefficients c_k = (2n-k)!/(k!(n-k)!) of z^k, the numerator with alternating signs.
    """
    coefficients = np.array(_coefficients(order))
    scale = float(coefficients[0] / coefficients[-1]) ** (
        1.0 / order
    )  # z = scale * z' keeps the companion form small
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
    """Smallest order whose phase is within 1 degree of exp(-j omega T) up to `highest_frequency`
    (Hz), at most 12.
    """
    angles = np.linspace(0.0, 2 * pi * highest_frequency * delay, 50)[1:]
    for order in range(1, HIGHEST_PADE_ORDER + 1):
        if _phase_error(order, angles).max() <= PHASE_TOLERANCE:
            return order
    return HIGHEST_PADE_ORDER


def pade_limit(delay: float, order: int) -> float:
    """Frequency (Hz) up to which the phase of that Pade form is within 1 degree of exp(-j omega
    T).
    """
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


def _coefficients(order: int) -> list[int]:
    """Coefficients c_k of z^k, k = 0 ..

    order, of N in the Pade form N(-z)/N(z) of exp(-z), the last one 1.
    """
    return [
        factorial(2 * order - k) // (factorial(k) * factorial(order - k)) for k in range(order + 1)
    ]


def _form_matrices(T_d, order: int) -> Matrices:
    """N(-z)/N(z) on both axes, z = s T_d, in companion form; the states of d before those of q, one
    after the other.
    """
    *coefficients, _ = _coefficients(order)
    sign, r = (-1) ** order, 1 / T_d
    left = [
        ((-1) ** k - sign) * coefficient for k, coefficient in enumerate(coefficients)
    ]  # N(-z) - sign N(z)
    a = [
        [r if column == row + 2 else 0 for column in range(2 * order)]
        for row in range(2 * order - 2)
    ]
    a += [[-c * r if one == axis else 0 for c in coefficients for one in (0, 1)] for axis in (0, 1)]
    b = [[0, 0]] * (2 * order - 2) + [[r, 0], [0, r]]
    c = [[number if one == axis else 0 for number in left for one in (0, 1)] for axis in (0, 1)]
    return a, b, c, [[sign, 0], [0, sign]]


def _pade2(T_d):
    return _form_matrices(T_d, 2)


def _pade3(T_d):
    return _form_matrices(T_d, 3)


def _pade4(T_d):
    return _form_matrices(T_d, 4)


def _form(order: int, state_space: Callable[..., Matrices]) -> ModuleKind:
    """The kind of a delay that a simulation draws as its Pade form of an order."""
    *coefficients, _ = _coefficients(order)
    powers = ["", " z", *(f" z^{k}" for k in range(2, order))]
    above = " + ".join(f"{c}{power}" for c, power in zip(coefficients, powers, strict=True))
    return ModuleKind(
        name=f"Pade{order}_dq",
        family="dynamic control",
        law=f"out = N(-z)/N(z) in_ on each axis, z = s T_d and N(z) = {above} + z^{order}: the "
        "delay of a simulation that "
        f"draws it as a Pade form of order {order}",
        inputs={"in_": Signal.DQ_VEC},
        outputs={"out": Signal.DQ_VEC},
        states=tuple(f"pade{number}_{axis}" for number in range(1, order + 1) for axis in "dq"),
        parameters=DELAY.parameters,
        state_space=state_space,
        dc_gain=1.0,
        extended=True,
        reference="G. H. Golub and C. F. Van Loan, Matrix Computations (1989), section 11.3; pade "
        "of MATLAB",
    )


#: Beside `PADE1_DQ` of the paper, which is the form of order 1.
PADE2_DQ, PADE3_DQ, PADE4_DQ = _form(2, _pade2), _form(3, _pade3), _form(4, _pade4)
