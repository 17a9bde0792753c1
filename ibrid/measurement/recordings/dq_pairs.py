"""A signal in dq: pairs (d, q), as records hold it, and d + j q, as it is turned and filtered."""

import numpy as np


def to_complex(pairs: np.ndarray) -> np.ndarray:
    """Return d + j q (...,) of dq pairs (..., 2)."""
    return pairs @ np.array([1.0, 1.0j])


def to_pairs(wave: np.ndarray) -> np.ndarray:
    """Return dq pairs (..., 2) of d + j q (...,)."""
    return np.stack([np.real(wave), np.imag(wave)], axis=-1)
