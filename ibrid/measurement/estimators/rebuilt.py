"""The voltage that went into an estimator, between and at its frames, with the jumps that its
window smears.

Law: v = v_s + sum of c_j step(t - t_j). The smooth part is what the window W shows of it, put back
by the window's delay and corrected twice, v_s <- v_s + (x - W v_s): of a wave of frequency f an
error of (1 - W(f))^3 is left (van Cittert, Zeitschrift fuer Physik 69, 1931). A model that answers
to v, seen through W, is what the estimator shows of its current, limits and all.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import csr_matrix

from ibrid.frozen import Frozen
from ibrid.measurement.estimators.jumps import LEFT, NOISE_LEFT, NOISES, Jumps, explained, jumps_in
from ibrid.measurement.estimators.window import Window, fourier, triangle

#: Times a cycle at which the voltage is rebuilt; part of their distance in which a jump happens.
TIMES, EDGE = 16, 0.1
#: Weight of a window behind the end of a record from which on a frame there is not judged.
UNSEEN = 0.02
#: Corrections of the smooth part.
CORRECTED = 2
#: A window that is not known shows where two frames differ by at least this, per unit, in the
#: frames either side of them.
CHANGE, FRAMES = 0.02, 32
#: Lengths tried of it, up to this part of those frames; rounds in which the length is refined;
#: jumps that may explain them.
LENGTHS, PART, REFINED, JUMPS = 24, 0.4, 6, 3


@dataclass(frozen=True, eq=False)
class Rebuilt(Frozen):
    """`time` (M,), s, and `v` (M,), complex.

    `matrix` (N, M) : takes a wave at these times to frames. `masked` (N,) : frames that tell
    nothing, since the voltage in their window is not known. `jumps` : what was found.
    """

    time: np.ndarray
    v: np.ndarray
    matrix: csr_matrix
    masked: np.ndarray
    jumps: Jumps


def rebuilt(
    tags: np.ndarray, wave: np.ndarray, window: Window, noise: float, f0_hz: float
) -> Rebuilt:
    """The voltage behind a complex wave (N,) at tags, s; noise : standard deviation of each of its
    components, per unit.
    """
    jumps = jumps_in(tags, wave, window, noise)
    end = tags[-1] + max(float(window.offsets[-1]), 0.0)
    step = 1.0 / (TIMES * f0_hz)
    even = np.append(np.arange(tags[0], end - 0.5 * step, step), end)
    edges = np.concatenate([jumps.times - 0.5 * EDGE * step, jumps.times + 0.5 * EDGE * step])
    edges = edges[(edges > even[0]) & (edges < even[-1])]
    apart = np.array([np.abs(jumps.times - at).min(initial=np.inf) for at in even]) > EDGE * step
    apart[[0, -1]] = True
    time = np.unique(np.concatenate([even[apart], edges]))
    matrix = window.matrix(tags, time)
    shown = np.clip(time + window.delay, tags[0], tags[-1])
    v = CubicSpline(tags, jumps.smooth)(shown)
    for _ in range(CORRECTED):
        v = v + CubicSpline(tags, jumps.smooth - matrix @ v)(shown)
    for at, size in zip(jumps.times, jumps.sizes, strict=True):
        v = v + size * np.clip((time - at) / (EDGE * step) + 0.5, 0.0, 1.0)
    beyond = _beyond(tags, window)
    return Rebuilt(time, v, matrix, jumps.missed | (beyond > UNSEEN), jumps)


def _beyond(tags: np.ndarray, window: Window) -> np.ndarray:
    """(N,) part of the window of each frame that lies behind the last one."""
    later = tags[:, None] + window.offsets > tags[-1] + 1e-9
    return (later * np.abs(window.weights)).sum(axis=1) / np.abs(window.weights).sum()


def found_window(tags: np.ndarray, wave: np.ndarray, noise: float) -> tuple[Window, float]:
    """The window that the voltage's largest jump shows, and its length, s; one that takes a sample
    alone, and zero, without one.

    Its length is one number, fitted to the wave (N,); of a Fourier window and a triangle that which
    explains it with fewer jumps, and leaves less.
    """
    interval = float(np.median(np.diff(tags)))
    changes = np.abs(np.diff(wave))
    largest = int(np.argmax(changes))
    if changes[largest] < max(CHANGE, NOISES * noise):
        return Window("unknown", np.zeros(1), np.ones(1)), 0.0
    piece = slice(max(largest - FRAMES, 0), largest + FRAMES)
    time, part = tags[piece], wave[piece]
    tolerance = max(NOISE_LEFT * noise, LEFT * float(np.ptp(np.abs(part - part[0]))))

    def missed(length: float, shape: Callable[[float], Window]) -> tuple[int, float]:
        times, _, left = explained(time, part, shape(length), tolerance, JUMPS)
        return len(times) + bool(left.max() > tolerance), float((left**2).sum())

    longest = PART * float(time[-1] - time[0])
    lengths = np.geomspace(min(2.0 * interval, 0.5 * longest), longest, LENGTHS)
    tried = [(missed(length, shape), length, shape) for length in lengths for shape in SHAPES]
    least, length, shape = min(tried, key=lambda one: one[0])
    step = lengths[1] / lengths[0]
    for _ in range(REFINED):
        step = np.sqrt(step)
        least, length = min(
            (least, length), *((missed(one, shape), one) for one in (length / step, length * step))
        )
    return shape(length), float(length)


def _fourier(length: float) -> Window:
    offsets, weights = fourier(1.0, 1.0 / length)  # one cycle, as long as that
    return Window("unknown", offsets, weights / weights.sum())


def _triangle(length: float) -> Window:
    offsets, weights = triangle(length)
    return Window("unknown", offsets, weights / weights.sum())


#: Shapes of a window that is not known.
SHAPES = (_fourier, _triangle)
