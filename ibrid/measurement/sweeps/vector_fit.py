"""Vector fitting: what a rational function of sufficient order leaves over is the noise of a sparse
sweep.

B. Gustavsen and A. Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052, with poles common to the
four entries and each entry eliminated by a QR decomposition (D. Deschrijver et al., IEEE Microw.
Wireless Compon. Lett. 18 (2008) 383).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ibrid.errors import IbridError

#: Least |Y|_F at a frequency, over the largest entry of all, beside which a fit means something.
LEAST = 1e-9
#: Least damping ratio of a pole. One on the imaginary axis at a measured frequency, where a single
#: wrong row drives it, would be infinite there; no device has so little.
LEAST_DAMPING = 1e-6
#: Times that the poles are relocated.
ROUNDS = 8
#: Fewest frequencies of an operating point, the largest part of the measured numbers that
#: coefficients may take, the first order, and how many are tried beyond the last one that paid.
FEWEST, SHARE, FIRST, BEYOND = 14, 0.6, 2, 10
#: A further order is taken while it lowers the variance by this many of its standard deviations,
#: sqrt(2 / dof).
PAYS = 2.0
#: Correlation of neighbouring residuals, in its standard deviations, beyond which they are no
#: noise.
STRUCTURED = 4.0
#: Standard deviations by which the estimate is widened: a floor below the noise would refute right
#: models.
CAUTION = 1.0


def vector_fit(
    frequency: np.ndarray, response: np.ndarray, order: int, weight: np.ndarray
) -> np.ndarray:
    """A proper rational function of so many poles at the frequencies.

    frequency : (K,) Hz. response : complex, (K, 2, 2). weight : (K,), of each frequency's error.
    Returns (K, 2, 2).
    """
    return _vector_fit(frequency, response, order, weight, ROUNDS)[0]


def _vector_fit(
    frequency: np.ndarray, response: np.ndarray, order: int, weight: np.ndarray, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same, and its poles over the highest frequency, the upper one of a pair."""
    s = 1j * frequency / frequency[-1]
    poles = starting_poles(frequency / frequency[-1], order)
    values = response.reshape(len(s), 4)
    best, its_poles, least = values * np.nan, poles, np.inf
    for _ in range(rounds):
        fitted = _residues(s, values, poles, weight)
        left = float((np.abs(weight[:, None] * (fitted - values)) ** 2).sum())
        if left < least:
            best, its_poles, least = fitted, poles, left
        poles = _relocated(s, values, poles, weight)
    return best.reshape(response.shape), its_poles


@dataclass(frozen=True, eq=False)
class RationalFit:
    """`order` : number of poles. `poles` : over the highest frequency, the upper one of a pair.
    `response` : complex, (K, 2, 2).
    `variance` : of the residual over |Y|_F, each entry and frequency, `dof` degrees of freedom of
    it. `white` : True where neighbouring residuals are no more alike than noise.
    """

    order: int
    poles: np.ndarray
    response: np.ndarray
    variance: float
    dof: int
    white: bool


def best_fit(
    frequency: np.ndarray,
    response: np.ndarray,
    *,
    highest: int | None = None,
    beyond: int = BEYOND,
    rounds: int = ROUNDS,
) -> RationalFit:
    """The vector fit of the order beyond which the variance does not fall by more than chance;
    weighed by 1/|Y|_F.

    frequency : (K,) Hz; response : complex, (K, 2, 2), zero nowhere. highest : order. beyond :
    orders that are tried after the
    last one that paid. rounds : times that poles are relocated. Raises IbridError where an order of
    2 needs more frequencies.
    """
    weight = 1.0 / np.linalg.norm(response, axis=(1, 2))
    best: RationalFit | None = None
    for order, dof in _orders(len(frequency)):
        if best is not None and order > min(best.order + beyond, highest or order):
            break
        fitted, poles = _vector_fit(frequency, response, order, weight, rounds)
        residual = weight[:, None, None] * (fitted - response)
        variance = float((np.abs(residual) ** 2).sum()) / dof
        if best is None or variance < best.variance * (1.0 - PAYS * np.sqrt(2.0 / dof)):
            best = RationalFit(
                order, poles, fitted, variance, dof, abs(_whiteness(residual)) < STRUCTURED
            )
    if best is None:
        raise IbridError(
            "vector fitting needs at least 4 frequencies at an operating point; found "
            f"{len(frequency)}"
        )
    return best


def left_over(frequency: np.ndarray, response: np.ndarray) -> float | None:
    """Noise of a sweep: the rms error of the matrix over |Y|_F that the best vector fit leaves;
    None where it does not tell.

    It tells nothing where few frequencies are measured, or the residual still has the structure of
    a response.
    """
    return _left_over(frequency.tobytes(), response.tobytes())


@lru_cache(maxsize=256)
def _left_over(frequency: bytes, response: bytes) -> float | None:
    hertz = np.frombuffer(frequency)
    measured = np.frombuffer(response, dtype=complex).reshape(-1, 2, 2)
    size = np.linalg.norm(measured, axis=(1, 2))
    largest = np.abs(measured).max()
    if len(hertz) < FEWEST or not size.min() >= LEAST * largest > 0:
        return None
    measured = measured / largest
    best = best_fit(hertz, measured)
    cautious = best.variance * (1.0 + CAUTION * np.sqrt(2.0 / best.dof))
    return float(np.sqrt(8.0 * cautious)) if best.white else None


def _orders(count: int) -> Iterator[tuple[int, int]]:
    """Orders that so many frequencies afford, each with its degrees of freedom."""
    numbers = 8 * count
    order = FIRST
    while 5 * order + 4 <= SHARE * numbers:
        yield order, numbers - 5 * order - 4
        order += 1


def _whiteness(residual: np.ndarray) -> float:
    """Correlation of neighbours along frequency, in standard deviations of that of white noise."""
    flat = residual.reshape(len(residual), 4)
    pairs = np.real(flat[1:].conj() * flat[:-1]).sum()
    return float(pairs / (np.abs(flat) ** 2).sum() * np.sqrt(2.0 * 4 * len(flat)))


def starting_poles(frequency: np.ndarray, order: int) -> np.ndarray:
    """Pairs that are weakly damped and spaced by decades, the upper pole of each, and a real one of
    an odd order.
    """
    pairs = np.geomspace(frequency[0], 1.0, order // 2) * (-0.1 + 1j)
    real = [-complex(np.sqrt(frequency[0]))] if order % 2 else []
    return np.array([*real, *pairs])


def partial_fractions(s: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """(K, order) complex: a column of a real pole, two of a pair; their coefficients are real."""
    columns = []
    for pole in poles:
        upper, lower = 1 / (s - pole), 1 / (s - np.conj(pole))
        columns += [upper + lower, 1j * (upper - lower)] if pole.imag else [upper]
    return np.stack(columns, axis=1)


def _real(columns: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(columns), np.imag(columns)])


def _residues(
    s: np.ndarray, values: np.ndarray, poles: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """The values (K, 4) of the best residues and constants at given poles."""
    basis = np.column_stack([partial_fractions(s, poles), np.ones_like(s)])
    size = np.linalg.norm(weight[:, None] * basis, axis=0)
    found = np.linalg.lstsq(
        _real(weight[:, None] * basis / size), _real(weight[:, None] * values), rcond=None
    )[0]
    return (basis / size) @ found


def _relocated(
    s: np.ndarray, values: np.ndarray, poles: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Zeros of the scaling function 1 + sum c/(s - p) by which all entries become fractions of the
    same poles.
    """
    basis = partial_fractions(s, poles)
    own = _real(weight[:, None] * np.column_stack([basis, np.ones_like(s)]))
    q, _ = np.linalg.qr(own)
    rows, right = [], []
    for entry in values.T:
        shared = _real(weight[:, None] * basis * entry[:, None])
        target = _real((weight * entry)[:, None])
        shared, target = shared - q @ (q.T @ shared), target - q @ (q.T @ target)
        rows.append(shared)
        right.append(target)
    scaling = np.linalg.lstsq(-np.concatenate(rows), np.concatenate(right)[:, 0], rcond=None)[0]
    matrix, column = _realised(poles)
    zeros = np.linalg.eigvals(matrix - np.outer(column, scaling))
    zeros = zeros[np.imag(zeros) >= 0]
    damped = -np.maximum(np.abs(np.real(zeros)), LEAST_DAMPING * np.abs(zeros))
    return damped + 1j * np.imag(zeros)


def rational_equations(
    s: np.ndarray, values: np.ndarray, poles: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A x = b of (1 + sum c/(s - p)) Y = N with all entries at once: A (K, 8, 5 n + 4), b (K, 8),
    real over imaginary parts.

    x : c (n,), then residues and constant of N (n + 1,), entry by entry. values : complex, (K, 4).
    weight : (K,). At the poles of a fit c = 0, and A is the slope of its response over |Y| by all
    that was fitted.
    """
    basis = partial_fractions(s, poles)
    count, order = basis.shape
    own = np.column_stack([basis, np.ones(count)])
    matrix = np.zeros((count, 4, 5 * order + 4), dtype=complex)
    for entry in range(4):
        first = order + entry * (order + 1)
        matrix[:, entry, :order] = -basis * values[:, [entry]]
        matrix[:, entry, first : first + order + 1] = own
    matrix *= weight[:, None, None]
    right = weight[:, None] * values
    return _real_over_imaginary(matrix), _real_over_imaginary(right)


def _real_over_imaginary(rows: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(rows), np.imag(rows)], axis=1)


def _realised(poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and b of the columns of `partial_fractions` as real states, sum c/(s - p) = c (s - A)^-1
    b.
    """
    paired = np.imag(poles) != 0
    states = np.where(paired, 2, 1)
    first = np.cumsum(states) - states
    pair, upper = first[paired], poles[paired]
    matrix, column = np.zeros((states.sum(),) * 2), np.zeros(states.sum())
    matrix[first, first], column[first] = np.real(poles), 1.0
    matrix[pair + 1, pair + 1], column[pair] = np.real(upper), 2.0
    matrix[pair, pair + 1], matrix[pair + 1, pair] = np.imag(upper), -np.imag(upper)
    return matrix, column
