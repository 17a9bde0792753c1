"""Which state takes part in which mode: participation factors of a state matrix."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig


@dataclass(frozen=True, eq=False)
class Participation:
    """Modes of dx/dt = A x and how the named states share in them.

    `poles` (n,) rad/s. `factors` (n states, n modes) complex: p_ki = w_ki v_ki of left and right eigenvectors with w_i' v_i = 1,
    which is also d(lambda_i)/d(a_kk); every row and every column sums to 1. `states` (n,) names.
    """

    states: tuple[str, ...]
    poles: np.ndarray
    factors: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """(n states, n modes) magnitudes of the factors over their sum in each mode."""
        size = np.abs(self.factors)
        return size / size.sum(axis=0)

    def largest(self, mode: int, number: int = 3, least: float = 0.05) -> tuple[tuple[str, float], ...]:
        """The states with the largest shares in a mode, at most `number`, none below `least`."""
        shares = self.shares[:, mode]
        order = np.argsort(-shares, kind="stable")[:number]
        return tuple((self.states[k], float(shares[k])) for k in order if shares[k] >= least)


def participation(A: np.ndarray, states: Sequence[str]) -> Participation:
    """Participation factors of a state matrix A (n, n), rad/s; they do not depend on the units of the states.

    Modes with equal poles share one eigenspace, in which factors of single modes mean little.
    Source: Perez-Arriaga, Verghese and Schweppe, 1982.
    """
    if not len(A):
        return Participation((), np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex))
    poles, left, right = eigenvectors(A)
    products = left.conj() * right
    sums = products.sum(axis=0)
    safe = np.where(np.abs(sums) > np.finfo(float).tiny, sums, 1.0)  # zero where a pole is defective
    return Participation(tuple(states), poles, products / safe)


def eigenvectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poles (n,), left eigenvectors (n, n) with w' A = lambda w', and right ones, as columns."""
    found: Any = eig(A, left=True, right=True)
    return found[0], found[1], found[2]
