"""From the conventions of a file to ours: per unit, admittance, current out of the inverter, q axis
leading d.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.header import Header
from ibrid.measurement.conventions.rotation import propagate
from ibrid.measurement.sweeps.sweep import LARGEST

Q_MIRROR = np.diag([1.0, -1.0])
"""T: reverses the q axis; Y -> T Y T."""

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""J: puts what lies on d on q; Y -> J Y J', the same for +90 and -90 degrees."""

TO_SEQUENCE = np.array([[1, 1j], [1, -1j]]) / np.sqrt(2)
"""S, unitary: Y_pn = S Y_dq S^H = 1/2 [[1, j], [1, -j]] Y_dq [[1, 1], [-j, j]]; p sits at f + f0, n
at f - f0.
"""


@dataclass(frozen=True)
class Quantity:
    """What the columns hold: admittance "Y" or impedance "Z", in dq or as modified sequences."""

    letter: str = "Y"
    sequence: bool = False


def to_ours(
    matrix: np.ndarray,
    sigma: np.ndarray | None,
    header: Header,
    quantity: Quantity,
    place: Callable[[int], str],
) -> tuple[np.ndarray, np.ndarray | None]:
    """Convert one response to our convention, with its uncertainty to first order.

    Parameters
    ----------
    matrix : complex, (K, 2, 2), in the file's convention.
    sigma : (K, 2, 2), standard deviation of each real and imaginary part, in the same unit; None if
    unknown.
    place : says, for an index along K, where that row is ("scan.csv line 12").

    Returns
    -------
    Admittance and sigma. For Y = L M R with constant L, R, and for an inverse with L = -R = Y,
    errors that are independent and circular give sigma_ij^2 = sum |L_ia|^2 |R_bj|^2 sigma_ab^2
    exactly to first order; that errors of different entries become correlated is not kept.

    Raises
    ------
    SweepError : unit and columns contradict each other, a base is missing, an impedance is
    singular, or a number
        overflows.
    """
    scale = _per_unit(header, quantity, place)
    with np.errstate(all="ignore"):
        matrix = matrix * scale
        sigma = None if sigma is None else sigma * scale
        if quantity.sequence:
            back = TO_SEQUENCE.conj().T
            matrix = back @ matrix @ TO_SEQUENCE
            sigma = None if sigma is None else propagate(back, sigma, TO_SEQUENCE)
        if quantity.letter == "Z":
            matrix, sigma = _inverse(matrix, sigma, place)
        if header.current == "in":
            matrix = -matrix
        if header.q_axis == "lags":
            matrix = Q_MIRROR @ matrix @ Q_MIRROR
        if header.voltage_axis == "q":
            matrix = QUARTER_TURN.T @ matrix @ QUARTER_TURN
            sigma = None if sigma is None else propagate(QUARTER_TURN.T, sigma, QUARTER_TURN)
    for values, name in ((matrix, "admittance"), (sigma, "sigma")):
        if values is not None:
            _check_size(values, name, place)
    return matrix, sigma


def _check_size(values: np.ndarray, name: str, place: Callable[[int], str]) -> None:
    """Refuse what squares to infinity or zero: no measurement is that large or small, and nothing
    later must care.
    """
    size = np.abs(values).max(axis=(1, 2))
    wrong = ~(size < LARGEST)
    if not size.max() > 1 / LARGEST:
        wrong = size > 0
    if wrong.any():
        k = int(np.argmax(wrong))
        raise SweepError(
            f"{place(k)}: {name} must be of a size that can be, found {size[k]:.3g} per unit; "
            "check unit and numbers."
        )


def _per_unit(header: Header, quantity: Quantity, place: Callable[[int], str]) -> float:
    if header.unit == "pu":
        return 1.0
    fitting = {"Y": "S", "Z": "ohm"}[quantity.letter]
    if header.unit != fitting:
        raise SweepError(
            f"{place(0)}: {quantity.letter} columns must be in {fitting} or pu; found unit: "
            f"{header.unit}, "
            "correct the unit or the names of the columns."
        )
    if header.s_base_va is None or header.v_base_v is None:
        missing = "s_base_va" if header.s_base_va is None else "v_base_v"
        raise SweepError(
            f"{place(0)}: unit: {header.unit} must come with s_base_va and v_base_v; {missing} is "
            "missing."
        )
    base = header.v_base_v**2 / header.s_base_va
    return base if fitting == "S" else 1 / base


def _inverse(
    matrix: np.ndarray, sigma: np.ndarray | None, place: Callable[[int], str]
) -> tuple[np.ndarray, np.ndarray | None]:
    size = np.abs(matrix).max(axis=(1, 2), keepdims=True)
    unit = np.where(size > 0, matrix / np.where(size > 0, size, 1), 0)
    smallest = np.linalg.svd(unit, compute_uv=False)[:, -1]
    if (smallest < 1e-12).any():
        raise SweepError(
            f"{place(int(np.argmin(smallest)))}: the impedance matrix must be invertible; found a "
            "singular one, "
            "remove that frequency."
        )
    inverse = np.linalg.inv(unit) / size
    return inverse, None if sigma is None else propagate(inverse, sigma, inverse)
