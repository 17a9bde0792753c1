"""What a model makes of a voltage that is not known exactly: the variance of its current, sample by sample.

Law: at rest x' = A x + B v, i = C x + D v. An error of the voltage in one interval, a sqrt(30) s (1 - s) with s from 0 to 1 and rms a,
and one at one sample, a hat over two intervals, answer with pulses that later samples see; errors of intervals and samples are
independent, so that variances add. What comes out is correlated: `count` of its numbers are worth one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

#: Parts of an interval in which the answer is summed.
PARTS = 8
#: Slowest decay, 1/s, of what a pulse leaves: a model that is unstable at rest is no measure of what is missing.
SLOWEST = 20.0
#: Of all intervals, those with the largest errors, by which the correlation is judged.
LARGEST = 100

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Uncertain:
    """`variance` : (N, 2) of the current, d and q. `count` : numbers that vary together, 1 or more."""

    variance: np.ndarray
    count: float


def uncertain_current(
    matrices: Matrices, time: np.ndarray, between: np.ndarray, at_samples: np.ndarray, sigma: np.ndarray
) -> Uncertain:
    """Of a model whose voltage has errors.

    matrices : A, B, C, D at rest. time : (N,) s. between : (N - 1, 2) rms error within each interval; at_samples : (N,) standard
    deviation of each component at the samples. sigma : (N,) of the measured current, beside which the correlation counts.
    """
    step = float(np.median(np.diff(time)))
    lasting, hat = _pulses(matrices, step, len(time))
    variance = _summed(between**2, lasting) + _summed(np.repeat(at_samples[:, None] ** 2, 2, axis=1), hat)
    return Uncertain(variance, _together(between, lasting, np.sqrt(variance + sigma[:, None] ** 2)))


def _pulses(matrices: Matrices, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2, 2) current (row) at later samples by an error of rms one of each component (column): in the interval that ends at
    the first of them, and at the first of them itself."""
    a, b, c, d = matrices
    growth = float(np.linalg.eigvals(a).real.max(initial=-np.inf))
    a = a - max(growth + SLOWEST, 0.0) * np.eye(len(a))
    part = expm(a * step / PARTS)
    middle = expm(a * step / (2 * PARTS)) @ b * (step / PARTS)
    bump, rising, falling = (np.zeros_like(b) for _ in range(3))
    for k in range(PARTS):
        s = (k + 0.5) / PARTS
        bump, rising, falling = part @ bump, part @ rising, part @ falling
        bump = bump + np.sqrt(30.0) * s * (1 - s) * middle
        rising, falling = rising + s * middle, falling + (1 - s) * middle
    whole = np.linalg.matrix_power(part, PARTS)
    lasting, hat = np.empty((count, 2, 2)), np.empty((count, 2, 2))
    hat[0] = c @ rising + d
    after = whole @ rising + falling
    for k in range(count):
        lasting[k] = c @ bump
        bump = whole @ bump
        if k:
            hat[k] = c @ after
            after = whole @ after
    return lasting, hat


def _summed(squares: np.ndarray, pulses: np.ndarray) -> np.ndarray:
    """(N, 2) variance by independent errors, from the interval before the second sample on or at the first one."""
    count = len(pulses)
    found = np.zeros((count, 2))
    first = count - len(squares)
    for row in range(2):
        for column in range(2):
            answer = np.convolve(squares[:, column], pulses[:, row, column] ** 2)
            found[first:, row] += answer[: count - first]
    return found


def _together(between: np.ndarray, pulses: np.ndarray, sigma: np.ndarray) -> float:
    """Numbers of the current that vary together: |R|_F^2 / tr R, of the covariance R of what the intervals leave over sigma."""
    count = len(pulses)
    columns = []
    size = np.hypot(*between.T)
    for k in np.argsort(size)[::-1][:LARGEST]:
        for column in np.flatnonzero(between[k]):
            answer = np.zeros((count, 2))
            answer[k + 1 :] = between[k, column] * pulses[: count - k - 1, :, column]
            columns.append((answer / sigma).ravel())
    if not columns:
        return 1.0
    gram = np.array(columns) @ np.array(columns).T
    trace = float(np.trace(gram))
    return max(float((gram**2).sum()) / trace, 1.0) if trace > 1e-12 else 1.0
