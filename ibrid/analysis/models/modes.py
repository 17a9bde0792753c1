"""Modes of a state matrix: frequency, damping, which states take part, and how sure all that is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig

from ibrid.border import takes_kinds
from ibrid.frozen import Frozen
from ibrid.writing import PlainData

#: A real part (rad/s) below this counts as stable; above zero only to forgive rounding.
STABLE_BELOW = 1e-6
#: Damping ratio from which on a pole pair does not oscillate visibly.
OVERDAMPED = 0.99
#: Two-sided 95 % of a normal distribution.
QUANTILE = 1.959963984540054


@dataclass(frozen=True)
class Mode:
    """A real pole, or a pair by its upper one.

    `pole` : rad/s. `states` : (name, share) of the states that take part most.
    `real_deviation`, `imag_deviation` : one standard deviation of both parts, rad/s;
    `damping_deviation` : of the damping ratio; None where the parameters have no covariance.
    """

    pole: complex
    states: tuple[tuple[str, float], ...]
    real_deviation: float | None = None
    imag_deviation: float | None = None
    damping_deviation: float | None = None

    @property
    def frequency(self) -> float:
        """|Im p| / 2 pi, the frequency of oscillation in Hz; 0 for a real pole."""
        return abs(self.pole.imag) / (2 * np.pi)

    @property
    def damping(self) -> float:
        """-Re p / |p|; 1 for a stable real pole, negative when unstable."""
        return -self.pole.real / abs(self.pole) if self.pole != 0 else 0.0

    @property
    def stable(self) -> bool:
        """Its real part is not positive."""
        return self.pole.real < STABLE_BELOW

    def plain(self) -> PlainData:
        """For JSON."""
        return {
            "pole": [self.pole.real, self.pole.imag],
            "frequency_hz": self.frequency,
            "damping": self.damping,
            "deviation": None
            if self.real_deviation is None
            else {
                "real": self.real_deviation,
                "imag": self.imag_deviation,
                "damping": self.damping_deviation,
            },
            "states": dict(self.states),
        }


@takes_kinds
def modes(
    A: np.ndarray, states: Sequence[str], slopes: Sequence[np.ndarray] | None = None
) -> tuple[Mode, ...]:
    """Modes of A (n, n), the rightmost first.

    slopes : derivatives of A along independent standard normal directions; by the delta method
        d(lambda) = w' dA v / w' v the deviations follow. None: no deviations.
    """
    shares = participation(A, states)
    poles = [complex(one) for one in shares.poles]
    order = sorted(
        (k for k, one in enumerate(poles) if one.imag >= 0), key=lambda k: -poles[k].real
    )
    if slopes is None:
        return tuple(Mode(poles[k], shares.largest(k)) for k in order)
    moved = pole_slopes(A, slopes)
    return tuple(
        Mode(poles[k], shares.largest(k), *_deviations(poles[k], moved[:, k])) for k in order
    )


def pole_slopes(A: np.ndarray, slopes: Sequence[np.ndarray]) -> np.ndarray:
    """(R, n) derivatives of the poles of A along R directions, in the order of `participation`."""
    if not len(A):
        return np.zeros((len(slopes), 0), dtype=complex)
    left, right = eigenvectors(A)[1:]
    sums = np.einsum("ki,ki->i", left.conj(), right)
    return np.array(
        [np.einsum("ki,kl,li->i", left.conj(), one, right) / sums for one in slopes]
    ).reshape(-1, len(A))


def least_damped(modes: Sequence[Mode]) -> list[Mode]:
    """Modes that oscillate visibly, the least damped first."""
    oscillating = [one for one in modes if one.damping < OVERDAMPED and one.pole.imag > 0]
    return sorted(oscillating, key=lambda one: one.damping)


def rightmost(A: np.ndarray) -> complex:
    """The pole with the largest real part, of a pair the upper one; -inf without states."""
    one = max(np.linalg.eigvals(A), key=lambda pole: pole.real, default=complex(-np.inf))
    return complex(one.real, abs(one.imag))


def _deviations(pole: complex, moved: np.ndarray) -> tuple[float, float, float]:
    size = abs(pole) or 1.0
    real, imag = np.real(moved), np.imag(moved)
    damping = (
        real * pole.imag**2 - imag * pole.real * pole.imag
    ) / size**3  # of -Re p / |p|, up to the sign
    parts = [float(np.linalg.norm(part)) for part in (real, imag, damping)]
    return parts[0], parts[1], parts[2]


@dataclass(frozen=True, eq=False)
class Participation(Frozen):
    """Modes of dx/dt = A x and how the named states share in them.

    `poles` (n,) rad/s. `factors` (n states, n modes) complex: p_ki = w_ki v_ki of left and right
    eigenvectors with w_i' v_i = 1, which is also d(lambda_i)/d(a_kk); every row and every column
    sums to 1. `states` (n,) names.
    """

    states: tuple[str, ...]
    poles: np.ndarray
    factors: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(n states, n modes) magnitudes of the factors over their sum in each mode."""
        size = np.abs(self.factors)
        return size / size.sum(axis=0)

    def largest(
        self, mode: int, number: int = 3, least: float = 0.05
    ) -> tuple[tuple[str, float], ...]:
        """The states with the largest shares in a mode, at most `number`, none below `least`."""
        shares = self.shares[:, mode]
        order = np.argsort(-shares, kind="stable")[:number]
        return tuple((self.states[k], float(shares[k])) for k in order if shares[k] >= least)


@takes_kinds
def participation(A: np.ndarray, states: Sequence[str]) -> Participation:
    """Participation factors of a state matrix A (n, n), rad/s; they do not depend on the units of
    the states.

    Modes with equal poles share one eigenspace, in which factors of single modes mean little.
    Source: Perez-Arriaga, Verghese and Schweppe, 1982.
    """
    if not len(A):
        return Participation((), np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex))
    poles, left, right = eigenvectors(A)
    products = left.conj() * right
    sums = products.sum(axis=0)
    safe = np.where(
        np.abs(sums) > np.finfo(float).tiny, sums, 1.0
    )  # zero where a pole is defective
    return Participation(tuple(states), poles, products / safe)


def eigenvectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poles (n,), left eigenvectors (n, n) with w' A = lambda w', and right ones, as columns."""
    found: Any = eig(A, left=True, right=True)
    return found[0], found[1], found[2]
