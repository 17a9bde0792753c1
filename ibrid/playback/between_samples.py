"""What a model makes of a voltage that is not known exactly: the covariance of its current.

Law: at rest x' = A x + B v, i = C x + D v. The voltage is wrong by a sqrt(30) s (1 - s) in an interval, s from 0 to 1 (rms a), mostly
with the opposite in the next one, and by a hat over two intervals at a sample; each answers with a pulse that later samples see.
They are independent, so that the covariance is the sum over all pulses p of p p^T. Few matter: those at the edges of an event.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

#: Part of a spline's error that does not turn in the next interval: of drawn edges a third and less of the areas is left.
AREA = 1.0 / 3.0
#: Parts of an interval in which an answer is summed.
PARTS = 32
#: Slowest decay, 1/s, of what a pulse leaves: a model that is unstable at rest is no measure of what is missing.
SLOWEST = 1.0
#: Intervals and samples with the largest errors whose pulses are kept; directions that they span at most.
LARGEST, DIRECTIONS = 100, 40
#: How far a pulse may be wrong, relative: the model that makes it is not the right one yet.
PULSE_ERROR = 0.3

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Shared:
    """Errors that samples share: `columns` (R, M) orthogonal, in deviations of each number, each of a variance of one."""

    columns: np.ndarray

    def cut(self, numbers: int) -> "Shared":
        """Of the first numbers alone."""
        return Shared(self.columns[:numbers])

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (S, R) in deviations of each number, without the part that these errors explain.

        Law: (I + W W^T)^(-1/2) r, W the columns.
        """
        directions, kept = self._directions
        return residual - ((residual @ directions) * (1.0 - kept)) @ directions.T if len(kept) else residual

    @property
    def logarithm(self) -> float:
        """Of the determinant of I + W W^T."""
        return -2.0 * float(np.log(self._directions[1]).sum())

    @cached_property
    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal directions (R, M), and the part of a residual along each that stays."""
        if not self.columns.size:
            return np.zeros((len(self.columns), 0)), np.zeros(0)
        directions, sizes, _ = np.linalg.svd(self.columns, full_matrices=False)
        return directions, 1.0 / np.hypot(1.0, sizes)


@dataclass(frozen=True, eq=False)
class RecordNoise:
    """By what the current of a record is judged.

    current : (N,) standard deviation of each measured component.
    sigma : (N, 2) deviation that weighs a sample: of errors that vary together so much larger that they count as often as they
        are independent.
    expected : (N, 2) deviation that noise and sampling leave. independent : (N, 2) how often a number counts.
    shared : what samples share beside sigma.
    """

    current: np.ndarray
    sigma: np.ndarray
    expected: np.ndarray
    independent: np.ndarray
    shared: Shared

    def cut(self, samples: int) -> "RecordNoise":
        """Of the first samples alone."""
        each = (one[:samples] for one in (self.current, self.sigma, self.expected, self.independent))
        return RecordNoise(*each, self.shared.cut(2 * samples))

    @property
    def logarithm(self) -> float:
        """Of the determinant of its covariance over that of the measured noise, as often as numbers are independent."""
        wider = self.independent * np.log(self.independent * (self.sigma / self.current[:, None]) ** 2)
        return float(wider.sum()) + self.shared.logarithm

    def whitened(self, error: np.ndarray) -> np.ndarray:
        """(S, 2 N) residuals of unit variance of errors (S, N, 2) of the current."""
        return self.shared.whitened((error / self.sigma).reshape(len(error), -1))


def noise_alone(current: np.ndarray) -> RecordNoise:
    """Of a record whose voltage is known at all times. current : (N,) deviation of each component."""
    sigma = np.repeat(current[:, None], 2, axis=1)
    return RecordNoise(current, sigma, sigma, np.ones(sigma.shape), Shared(np.zeros((sigma.size, 0))))


def noise_and_sampling(
    current: np.ndarray,
    matrices: Matrices,
    time: np.ndarray,
    between: np.ndarray,
    at_samples: np.ndarray,
    waves: np.ndarray,
) -> RecordNoise:
    """Of a record whose voltage has errors.

    current : (N,) standard deviation of each component. matrices : A, B, C, D of a model at rest. time : (N,) s. between :
    (N - 1, 2) rms error of the voltage within each interval. at_samples : (N,) standard deviation of each component there.
    waves : (2 N, M) further errors that samples of the current share, of a variance of one.
    """
    noise = current[:, None] ** 2
    bump, hat = _pulses(matrices, float(np.median(np.diff(time))), len(time))
    there_and_back = (bump - np.concatenate([np.zeros((1, 2, 2)), bump[:-1]])) / np.sqrt(2.0)
    swinging, lasting, hats = np.sqrt(1 - AREA**2) * between, AREA * between, np.repeat(at_samples[:, None], 2, axis=1)
    by_sampling, by_noise = _summed(swinging, there_and_back) + _summed(lasting, bump), _summed(hats, hat)
    loose = by_noise + PULSE_ERROR**2 * by_sampling  # varies together, along directions that nobody knows well
    known, unknown = np.hstack([_columns(swinging, there_and_back), _columns(lasting, bump)]), _columns(hats, hat)
    whole = np.sqrt(noise + loose).ravel()
    together = _together(np.hstack([PULSE_ERROR * known, unknown]) / whole[:, None])
    sigma = np.sqrt(noise + together * loose)
    shared = _few(np.hstack([known, waves]) / sigma.ravel()[:, None])
    return RecordNoise(
        current, sigma, np.sqrt(noise + by_noise + by_sampling), (noise + loose) / sigma**2, Shared(shared)
    )


def _pulses(matrices: Matrices, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2, 2) current (row) at later samples by an error of one of each component (column): rms, in the interval that ends
    at the first of them; and at the first of them itself."""
    a, b, c, d = matrices
    a = _decaying(a)
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


def free_answers(matrices: Matrices, step: float, count: int, states: np.ndarray) -> np.ndarray:
    """(S, count, 2) current at samples of a model that begins at some states (S, n)."""
    a, _, c, _ = matrices
    onward, answers = expm(_decaying(a) * step).T, np.empty((len(states), count, 2))
    for k in range(count):
        answers[:, k] = states @ c.T
        states = states @ onward
    return answers


def _decaying(a: np.ndarray) -> np.ndarray:
    """A state matrix none of whose modes grows."""
    growth = float(np.linalg.eigvals(a).real.max(initial=-np.inf))
    return a - max(growth + SLOWEST, 0.0) * np.eye(len(a))


def _summed(errors: np.ndarray, pulses: np.ndarray) -> np.ndarray:
    """(N, 2) variance by independent errors (N or N - 1, 2), whose pulses end with the last samples."""
    count, first = len(pulses), len(pulses) - len(errors)
    variance = np.zeros((count, 2))
    for row in range(2):
        for column in range(2):
            answer = np.convolve(errors[:, column] ** 2, pulses[:, row, column] ** 2)
            variance[first:, row] += answer[: count - first]
    return variance


def _columns(errors: np.ndarray, pulses: np.ndarray) -> np.ndarray:
    """(2 N, M) pulses of the largest errors, times these."""
    count, first = len(pulses), len(pulses) - len(errors)
    columns = []
    for k in np.argsort(-np.hypot(*errors.T), kind="stable")[:LARGEST]:
        for column in np.flatnonzero(errors[k]):
            answer = np.zeros((count, 2))
            answer[first + k :] = errors[k, column] * pulses[: count - first - k, :, column]
            columns.append(answer.ravel())
    return np.array(columns).T if columns else np.zeros((2 * count, 0))


def _together(columns: np.ndarray) -> float:
    """Numbers that vary together, 1 or more: |R|_F^2 / tr R of the covariance R that columns (R, M) make."""
    gram = columns.T @ columns
    trace = float(np.trace(gram))
    return max(float((gram**2).sum()) / trace, 1.0) if trace > 1e-12 else 1.0


def _few(columns: np.ndarray) -> np.ndarray:
    """(R, at most `DIRECTIONS`) orthogonal columns with nearly the same covariance, those that noise hides left out."""
    squares, turns = np.linalg.eigh(columns.T @ columns)
    kept = [k for k in np.argsort(-squares)[:DIRECTIONS] if squares[k] > PULSE_ERROR**2]
    return columns @ turns[:, kept]
