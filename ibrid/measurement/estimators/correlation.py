"""The noise of frames: what white noise before an estimator becomes behind its window, and how
frames are weighed by it.

Law: frames at t and t' share the samples that both windows take, so that their noise has the
covariance s^2 sum of w_k w_l over the samples in common, over that of t = t'. With its Cholesky
factor L the errors L^-1 e are independent, of one variance. A part of the variance is taken to be
each frame's own (rounding, and what is not white before the window), so that no weight is beyond
reason.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded

from ibrid.frozen import Frozen
from ibrid.measurement.estimators.window import Window

#: Part of the variance that is each frame's own; correlations below this are none.
OWN, NONE = 0.1, 1e-3
#: Frames at rest from which a noise can be told.
ENOUGH = 10


@dataclass(frozen=True, eq=False)
class Correlated(Frozen):
    """Noise that frames share.

    `kept` (N,) : those that are judged. `factor` (b + 1, K) : the lower triangle L of their
    correlations R = L L^T, banded as SciPy has it.
    """

    kept: np.ndarray
    factor: np.ndarray

    def cut(self, frames: int) -> "Correlated":
        """Of the first frames alone."""
        kept = self.kept[:frames]
        return Correlated(kept, self.factor[:, : int(kept.sum())])

    def whitened(self, error: np.ndarray) -> np.ndarray:
        """Independent errors of the same variance of errors (S, N, 2); zero where a frame is not
        judged.
        """
        whole = np.zeros_like(error)
        if not self.kept.any():
            return whole
        rows = np.moveaxis(error[:, self.kept], 1, 0)
        depth = len(self.factor) - 1
        finite = np.nan_to_num(rows.reshape(len(rows), -1))
        white = solve_banded((depth, 0), self.factor, finite).reshape(rows.shape)
        white[:, ~np.isfinite(error).all(axis=(1, 2))] = np.nan
        whole[:, self.kept] = np.moveaxis(white, 0, 1)
        return whole


def correlated(time: np.ndarray, window: Window, kept: np.ndarray) -> Correlated:
    """The correlations of frames at times (N,); kept (N,) : those that are judged."""
    tags = time[kept]
    depth = (
        0
        if not len(tags)
        else int(np.max(np.searchsorted(tags, tags + _reach(window)) - np.arange(len(tags)) - 1))
    )
    rows = np.zeros((max(depth, 0) + 1, len(tags)))
    rows[0] = 1.0
    for below in range(1, len(rows)):
        rows[below, : len(tags) - below] = (1.0 - OWN) * correlation(
            window, tags[below:] - tags[:-below]
        )
    return Correlated(kept, cholesky_banded(rows, lower=True) if len(tags) else rows)


def correlation(window: Window, apart: np.ndarray) -> np.ndarray:
    """Of the noise of two frames so many s apart (...,)."""
    if not window.smears:
        return np.where(np.asarray(apart) == 0.0, 1.0, 0.0)
    step = float(np.mean(np.diff(window.offsets)))
    shared = np.correlate(window.weights, window.weights, "full")
    lags = step * (np.arange(len(shared)) - (len(shared) - 1) / 2)
    return np.interp(np.abs(apart), lags, shared / shared.max(), right=0.0)


def noise_of_frames(
    time: np.ndarray, wave: np.ndarray, rest_end: float, window: Window
) -> tuple[float, float]:
    """Standard deviation of each component of a wave (N, 2) at rest about a constant and a slope,
    and its degrees of freedom; (0, infinite) where too few frames rest.

    Law: of correlated noise a fit of two columns leaves s^2 tr((I - P) R).
    """
    rest = time <= rest_end
    count = int(rest.sum())
    if count < ENOUGH:
        return 0.0, np.inf
    time = time[rest] - time[0]
    known = np.linalg.qr(np.stack([np.ones(count), time], axis=1))[0]
    left = wave[rest] - known @ (known.T @ wave[rest])
    shared = correlation(window, time[:, None] - time)
    loose = shared - known @ (known.T @ shared)
    trace = float(np.trace(loose))
    independent = trace**2 / max(float((loose * loose.T).sum()), 1e-12)
    return float(np.sqrt((left**2).sum() / (2.0 * max(trace, 1e-12)))), 2.0 * independent


def _reach(window: Window) -> float:
    """How far frames apart share noise, s."""
    longest = float(np.ptp(window.offsets))
    apart = np.linspace(0.0, longest, 400)
    shared = np.flatnonzero(np.abs(correlation(window, apart)) > NONE)
    return float(apart[shared[-1]]) if longest else 0.0
