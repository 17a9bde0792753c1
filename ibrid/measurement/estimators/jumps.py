"""A wave that jumps, from what the window of an estimator made of it.

Law: where nothing jumps a window changes slow waves little. Around a jump it makes s(t - t_j) of
each step of one, its step response, beside a cubic: x(t) = a + b t + c t^2 + d t^3 + sum of e_j s(t
- t_j). Times are tried on a grid and refined, amplitudes are linear in them. With steps in place of
their responses the wave is what went into the estimator; what is left over after a few jumps says
where it could not be rebuilt.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from ibrid.frozen import Frozen
from ibrid.measurement.estimators.window import Window

#: What the window would change once more, per unit and in deviations of the noise, from which on a
#: jump is looked for.
CHANGES, NOISES = 2.5e-3, 6.0
#: Jumps of one place at most; part of the largest change, and deviations of the noise, that may be
#: left over for fewer.
MOST, LEFT, NOISE_LEFT = 5, 6e-3, 5.0
#: Times tried for a jump in each interval between frames, and at least and at most in a window;
#: frames either side of a place that hold the cubic; rounds of refining.
TRIED, IN_WINDOW, HELD, ROUNDS = 4, (16, 32), 4, 10
#: Part of a window, one over this, that jumps are apart at least.
APART = 8
#: Coefficients of a polynomial beside the jumps.
SMOOTH = 4


@dataclass(frozen=True, eq=False)
class Jumps(Frozen):
    """`times` (J,), s, and complex `sizes` (J,).

    `smooth` (N,) : the rest of the wave. `missed` (N,) : frames near which no jump explains the
    wave.
    """

    times: np.ndarray
    sizes: np.ndarray
    smooth: np.ndarray
    missed: np.ndarray


def jumps_in(time: np.ndarray, wave: np.ndarray, window: Window, noise: float) -> Jumps:
    """The jumps of a complex wave (N,) seen through a window; noise : standard deviation of each
    component.
    """
    times, sizes = list[float](), list[complex]()
    smooth, missed = wave.astype(complex), np.zeros(len(time), dtype=bool)
    for begin, end in places_of_jumps(time, wave, window, noise):
        piece = time[begin:end]
        tolerance = max(
            NOISE_LEFT * noise, LEFT * float(np.ptp(np.abs(wave[begin:end] - wave[begin])))
        )
        moments, amplitudes, left = explained(piece, wave[begin:end], window, tolerance)
        for at in piece[left > tolerance]:
            missed |= np.abs(time - at) <= 0.5 * window.span
        times += moments
        sizes += amplitudes
    for at, size in zip(times, sizes, strict=True):
        smooth = smooth - size * window.step_response(time - at)
    return Jumps(np.array(times), np.array(sizes, dtype=complex), smooth, missed)


def places_of_jumps(
    time: np.ndarray, wave: np.ndarray, window: Window, noise: float
) -> Iterator[tuple[int, int]]:
    """Frames (from, to) that the window would change once more, with some still ones on either
    side.
    """
    changed = np.abs(window.centred.matrix(time, time) @ wave - wave) > max(CHANGES, NOISES * noise)
    interval = float(np.median(np.diff(time)))
    reach = max(int(np.ceil(window.span / interval)), 1) + HELD
    near = np.convolve(changed, np.ones(2 * reach + 1), mode="same")[: len(time)] > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def explained(
    time: np.ndarray, wave: np.ndarray, window: Window, tolerance: float, most: int = MOST
) -> tuple[list[float], list[complex], np.ndarray]:
    """Times and sizes of the fewest jumps that explain a piece, and what they leave; of `most`
    those that leave least.
    """
    candidates, times = _candidates(time, window), list[float]()
    responses = window.step_response(time[:, None] - candidates)
    sizes, left = _sizes(time, wave, window, times)
    best = times, sizes, left
    for _ in range(most):
        if (
            best[2].max() <= tolerance
            or len(time) < 2 * len(times) + SMOOTH + 3
            or not len(candidates)
        ):
            break
        apart = np.abs(candidates[:, None] - np.array(times).reshape(1, -1)).min(
            axis=1, initial=np.inf
        )
        free = np.flatnonzero(apart > window.span / APART)
        if not len(free):
            break
        place = free[_most_telling(responses[:, free], _basis(time, window, times), wave)]
        times = _refined(time, wave, window, [*times, float(candidates[place])])
        sizes, left = _sizes(time, wave, window, times)
        if float((left**2).sum()) < float((best[2] ** 2).sum()):
            best = times, sizes, left
    return best[0], best[1].tolist(), best[2]


def _most_telling(columns: np.ndarray, basis: np.ndarray, wave: np.ndarray) -> int:
    """Which column (n, K) takes most of what a basis leaves of a wave."""
    known = np.linalg.qr(basis)[0]
    columns = columns - known @ (known.T @ columns)
    left = wave - known @ (known.T @ wave)
    return int(
        np.argmax(np.abs(columns.T @ left) ** 2 / np.maximum((columns**2).sum(axis=0), 1e-9))
    )


def _candidates(time: np.ndarray, window: Window) -> np.ndarray:
    """Times at which a jump may lie: those that frames of the piece see."""
    tried = window.span * TRIED / float(np.median(np.diff(time)))
    step = window.span / float(np.clip(tried, *IN_WINDOW))
    return np.arange(time[0] + window.ends[0] + step, time[-1] + window.ends[1], step)


def _basis(time: np.ndarray, window: Window, times: Sequence[float]) -> np.ndarray:
    """(n, K) a polynomial, and the responses to steps at times."""
    smooth = legendre.legvander(2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0, SMOOTH - 1)
    return np.hstack([smooth, window.step_response(time[:, None] - np.array(times).reshape(1, -1))])


def _sizes(
    time: np.ndarray, wave: np.ndarray, window: Window, times: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of jumps at times beside a polynomial, and the magnitudes that are left."""
    basis = _basis(time, window, times)
    coefficients = np.linalg.lstsq(basis, wave, rcond=None)[0]
    return coefficients[SMOOTH:], np.abs(wave - basis @ coefficients)


def _refined(time: np.ndarray, wave: np.ndarray, window: Window, times: list[float]) -> list[float]:
    """Each time moved, by steps that halve, to where least is left."""
    step = window.span / IN_WINDOW[0]
    least = float((_sizes(time, wave, window, times)[1] ** 2).sum())
    for _ in range(ROUNDS):
        for place, sign in [(place, sign) for place in range(len(times)) for sign in (1.0, -1.0)]:
            moved = [*times]
            moved[place] += sign * step
            if np.diff(np.sort(moved)).min(initial=np.inf) < window.span / APART:
                continue  # two that are nearly one, of opposite signs, explain anything
            squares = float((_sizes(time, wave, window, moved)[1] ** 2).sum())
            if squares < least:
                times, least = moved, squares
        step /= 2.0
    return times
