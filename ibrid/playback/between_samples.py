"""What a model makes of a voltage that is not known exactly: the covariance of its current.

Law: the voltage is wrong by a sqrt(30) s (1 - s) in an interval, s from 0 to 1 (rms a), mostly with
the opposite in the next one, and by a hat over two intervals at a sample. Each makes a pulse p in
the current that later samples see. They are independent, so that the covariance is the sum of p p^T
over all pulses. Few matter: those at the edges of an event.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm
from scipy.special import xlogy

from ibrid.measurement.estimators.correlation import Correlated

#: Part of a spline's error that does not turn in the next interval: of drawn edges a third and less
#: of the areas is left.
AREA = 1.0 / 3.0
#: Parts of an interval in which an answer is summed.
PARTS = 32
#: Slowest decay, 1/s, of what a pulse leaves: a model that is unstable at rest is no measure of
#: what is missing.
SLOWEST = 1.0
#: Intervals and samples with the largest errors whose pulses are kept, those below a part of the
#: largest left out; directions that they span at most, and the least of a deviation that is one.
LARGEST, SMALL, DIRECTIONS, HIDDEN = 80, 1e-3, 40, 0.3
#: Samples of all pulses of a long record at most, and pulses at least.
MOST, FEWEST = 1_600_000, 8

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Shared:
    """Errors that samples share: `columns` (R, M) orthogonal, in deviations of each number, each of
    a variance of one.
    """

    columns: np.ndarray

    def cut(self, numbers: int) -> "Shared":
        """Of the first numbers alone."""
        return Shared(self.columns[:numbers])

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (S, R) in deviations of each number, without the part that these errors
        explain.

        Law: (I + W W^T)^(-1/2) r, W the columns.
        """
        directions, kept = self._directions
        return (
            residual - ((residual @ directions) * (1.0 - kept)) @ directions.T
            if len(kept)
            else residual
        )

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

    current_sigma : (N,) standard deviation of each measured component.
    sigma : (N, 2) deviation that weighs a sample: of errors that vary together so much larger that
    they count as often as they
        are independent.
    expected : (N, 2) deviation that noise, sampling and channels leave. independent : (N, 2) how
    often a number counts.
    shared : what samples share beside sigma. correlated : how frames of an estimator share their
    noise, None of waveforms.
    """

    current_sigma: np.ndarray
    sigma: np.ndarray
    expected: np.ndarray
    independent: np.ndarray
    shared: Shared
    correlated: Correlated | None = None

    def cut(self, samples: int) -> "RecordNoise":
        """Of the first samples alone."""
        current, sigma, expected, independent = (
            one[:samples]
            for one in (self.current_sigma, self.sigma, self.expected, self.independent)
        )
        correlated = None if self.correlated is None else self.correlated.cut(samples)
        return RecordNoise(
            current, sigma, expected, independent, self.shared.cut(2 * samples), correlated
        )

    def of_predictions(self, k: int, left: float) -> "RecordNoise":
        """Of every k-th sample behind a low-pass that leaves a part of each deviation, as
        predictions are judged: by all that noise, sampling and channels leave of each sample. Their
        errors die away, so that samples vary together for a moment.
        """
        current, expected = (left * one[::k] for one in (self.current_sigma, self.expected))
        if self.correlated is not None:  # frames are never decimated
            return replace(self, correlated=None)
        return RecordNoise(
            current,
            expected,
            expected,
            np.ones(expected.shape),
            Shared(np.zeros((expected.size, 0))),
        )

    def every_kth(self, k: int, left: float) -> "RecordNoise":
        """Of every k-th sample behind a low-pass that leaves a part of the current's own
        deviation.
        """
        if k == 1:
            return self
        sigma, expected, independent = (
            one[::k] for one in (self.sigma, self.expected, self.independent)
        )
        columns = self.shared.columns.reshape(len(self.current_sigma), -1)[::k].reshape(
            sigma.size, -1
        )
        return RecordNoise(
            left * self.current_sigma[::k], sigma, expected, independent, Shared(columns)
        )

    @property
    def logarithm(self) -> float:
        """Of the determinant of its covariance over that of the measured noise, as often as numbers
        are independent.
        """
        sigma = np.where(
            self.independent > 0, self.sigma, 1.0
        )  # frames that are not judged weigh nothing
        wider = xlogy(
            self.independent, self.independent * (sigma / self.current_sigma[:, None]) ** 2
        )
        return float(wider.sum()) + self.shared.logarithm

    def whitened(self, error: np.ndarray) -> np.ndarray:
        """(S, 2 N) residuals of unit variance of errors (S, N, 2) of the current."""
        if self.correlated is not None:
            return self.correlated.whitened(error / self.sigma).reshape(len(error), -1)
        return self.shared.whitened((error / self.sigma).reshape(len(error), -1))


def noise_alone(current: np.ndarray) -> RecordNoise:
    """Of a record whose voltage is known at all times.

    current : (N,) deviation of each component.
    """
    sigma = np.repeat(current[:, None], 2, axis=1)
    return RecordNoise(
        current, sigma, sigma, np.ones(sigma.shape), Shared(np.zeros((sigma.size, 0)))
    )


def noise_of_frames(current: np.ndarray, kept: np.ndarray, correlated: Correlated) -> RecordNoise:
    """Of frames of an estimator.

    current : (N,) or (N, 2) deviation of each component. kept : (N,) frames that are judged.
    """
    sigma = np.broadcast_to(current.reshape(len(kept), -1), (len(kept), 2))
    judged = np.where(kept[:, None], sigma, np.inf)
    counted = np.repeat(kept[:, None], 2, axis=1).astype(float)
    none = Shared(np.zeros((sigma.size, 0)))
    return RecordNoise(
        sigma[:, 0], judged, np.where(kept[:, None], sigma, 0.0), counted, none, correlated
    )


@dataclass(frozen=True, eq=False)
class OpenVoltage:
    """What nobody knows of a record's voltage.

    intervals : (M,) between samples, increasing, that matter. between : (M, 2) rms error of each
    component within them.
    at_samples : (N,) standard deviation of each component at the samples.
    """

    intervals: np.ndarray
    between: np.ndarray
    at_samples: np.ndarray


def open_voltage(between: np.ndarray, at_samples: np.ndarray) -> OpenVoltage:
    """Of errors in all intervals (N - 1, 2) the largest."""
    size = np.hypot(*between.T)
    largest = np.argsort(-size, kind="stable")[: _room(len(at_samples))]
    intervals = np.sort(largest[size[largest] > SMALL * size.max(initial=0.0)])
    return OpenVoltage(intervals, between[intervals], at_samples)


def noise_and_sampling(
    current: np.ndarray,
    matrices: Matrices,
    step: float,
    voltage: OpenVoltage,
    pulses: np.ndarray | None,
    waves: np.ndarray,
    rounding: np.ndarray,
    pulse_error: float,
) -> RecordNoise:
    """Of a record whose voltage has errors.

    current : (N,) standard deviation of each component. matrices : A, B, C, D of a model at rest.
    step : s between samples.
    pulses : (2 M, N, 2) of the current by an rms of one in each interval, in d and then in q; None:
    those of the model at rest.
    waves, rounding : (2 N, K) further errors that samples of the current share, of a variance of
    one.
    pulse_error : relative, of waves and of the pulses; rounding is too small for its own to matter.
    """
    count = len(current)
    at_rest, hat = _pulses(matrices, step, count)
    if pulses is None or not np.isfinite(pulses).all():
        pulses = _moved(at_rest, voltage.intervals)
    known = _columns(voltage, pulses)
    hats = np.repeat(voltage.at_samples[:, None], 2, axis=1)
    by_sampling, by_noise = (known**2).sum(axis=1).reshape(count, 2), _summed(hats, hat)
    by_waves = (np.hstack([waves, rounding]) ** 2).sum(axis=1).reshape(count, 2)
    noise, known = current[:, None] ** 2, np.hstack([known, waves])
    loose = by_noise + pulse_error**2 * (known**2).sum(axis=1).reshape(
        count, 2
    )  # along directions that nobody knows well
    whole = np.sqrt(noise + loose).ravel()[:, None]
    together = _together(np.hstack([pulse_error * known, _hats(hats, hat)]) / whole)
    sigma = np.sqrt(noise + together * loose)
    shared = Shared(_few(np.hstack([known, rounding]) / sigma.ravel()[:, None]))
    expected = np.sqrt(noise + by_noise + by_sampling + by_waves)
    return RecordNoise(current, sigma, expected, (noise + loose) / sigma**2, shared)


def _room(samples: int) -> int:
    """How many pulses of a record with so many samples are kept."""
    return max(min(LARGEST, MOST // samples), FEWEST)


def _columns(voltage: OpenVoltage, pulses: np.ndarray) -> np.ndarray:
    """(2 N, K) what independent errors of the voltage make: such as stay, and such as turn in the
    next interval.
    """
    numbers = 2 * len(voltage.at_samples)
    each = pulses.reshape(len(voltage.intervals), 2, numbers)
    staying = AREA * voltage.between[:, :, None] * each
    beside = np.flatnonzero(np.diff(voltage.intervals) == 1)
    size = np.sqrt((1.0 - AREA**2) / 2.0) * voltage.between[beside, :, None]
    turning = size * (each[beside] - each[beside + 1])
    return np.concatenate([staying, turning]).reshape(2 * (len(staying) + len(turning)), numbers).T


def _moved(pulses: np.ndarray, intervals: np.ndarray) -> np.ndarray:
    """(2 M, N, 2) pulses (N, 2, 2) of a model at rest that begin behind each of some intervals."""
    count, moved = len(pulses), []
    for k in intervals:
        for column in range(2):
            answer = np.zeros((count, 2))
            answer[k + 1 :] = pulses[: count - k - 1, :, column]
            moved.append(answer)
    return np.array(moved).reshape(2 * len(intervals), count, 2)


def _pulses(matrices: Matrices, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2, 2) current (row) at later samples by an error of one of each component (column):
    rms, in the interval that ends at the first of them; and at the first of them itself.
    """
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
    """(N, 2) variance by independent errors (N or N - 1, 2), whose pulses end with the last
    samples.
    """
    count, first = len(pulses), len(pulses) - len(errors)
    from scipy.signal import fftconvolve  # half a second, for drawn edges alone

    variance = np.zeros((count, 2))
    for row in range(2):
        for column in range(2):
            answer = fftconvolve(errors[:, column] ** 2, pulses[:, row, column] ** 2)
            variance[first:, row] += np.maximum(answer[: count - first], 0.0)
    return variance


def _hats(errors: np.ndarray, hats: np.ndarray) -> np.ndarray:
    """(2 N, K) pulses of the largest errors at samples (N, 2), times these."""
    largest = np.sort(np.argsort(-errors[:, 0], kind="stable")[: _room(len(errors))])
    largest = largest[errors[largest, 0] > 0]
    before = np.maximum(largest - 1, 0)  # a hat begins an interval before its sample
    sizes = errors[largest].reshape(-1, 1)
    return (sizes * _moved(hats, before).reshape(len(sizes), 2 * len(hats))).T


def _together(columns: np.ndarray) -> float:
    """Numbers that vary together, 1 or more: |R|_F^2 / tr R of the covariance R that columns (R, M)
    make.
    """
    gram = columns.T @ columns
    trace = float(np.trace(gram))
    return max(float((gram**2).sum()) / trace, 1.0) if trace > 1e-12 else 1.0


def _few(columns: np.ndarray) -> np.ndarray:
    """(R, at most `DIRECTIONS`) orthogonal columns with nearly the same covariance, those that
    noise hides left out.
    """
    squares, turns = np.linalg.eigh(columns.T @ columns)
    kept = [k for k in np.argsort(-squares)[:DIRECTIONS] if squares[k] > HIDDEN**2]
    return columns @ turns[:, kept]
