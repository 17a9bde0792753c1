"""Three phases and the frame that turns at the nominal frequency, amplitude-invariant; q leads
d.
"""

from math import sqrt

import numpy as np


def turning(first: int, count: int, step_s: float, f0_hz: float) -> np.ndarray:
    """(count,) exp(j 2 pi f0 t) at the samples from `first` on, t = sample times `step_s`."""
    turns = np.arange(first, first + count) * (step_s * f0_hz)
    return np.exp(2j * np.pi * (turns % 1.0))


def to_phases(dq: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(n, 3) phases a, b, c of d + j q (n,)."""
    alpha_beta = dq * turn
    alpha = np.real(alpha_beta)
    beta = np.imag(alpha_beta)
    return np.column_stack(
        [alpha, -0.5 * alpha + sqrt(0.75) * beta, -0.5 * alpha - sqrt(0.75) * beta]
    )


def to_dq(phases: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(n,) d + j q of three phases (n, 3); the zero sequence is dropped."""
    alpha = (2.0 * phases[:, 0] - phases[:, 1] - phases[:, 2]) / 3.0
    beta = (phases[:, 1] - phases[:, 2]) / sqrt(3.0)
    return (alpha + 1j * beta) * turn.conj()
