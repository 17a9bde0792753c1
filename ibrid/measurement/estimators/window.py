"""The window through which an estimator of phasors or rms values sees voltage and current: weights
about a time tag.

Law: in the frame that turns at 2 pi f0 a phasor is x(t) = sum of w_k z(t + tau_k), z = d + j q of
the phases, sum of w_k = 1. What makes it linear is that the frame is that of the nominal frequency,
whatever the grid's is. The reference filters of phasor measurement units lie about their tag; a
Fourier window and a filter of first order end at it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix, lil_matrix, vstack

from ibrid.errors import SweepError, near
from ibrid.frozen import Frozen
from ibrid.measurement.estimators.reference_filters import m_class, p_class

#: How a window is said in a file.
FORMS = ("none", "dft:CYCLES", "c37.118-P:RATE", "c37.118-M:RATE", "first_order:SECONDS", "unknown")
#: Parts of a cycle of a Fourier window, or of a time constant of a filter of first order, in which
#: its weights lie.
PARTS, PARTS_OF_CONSTANT = 64, 16
#: Time constants after which nothing is left of a filter of first order: exp(-14) is a millionth.
CONSTANTS = 14
#: Longest Fourier window, cycles; shortest and longest time constant, s.
MOST_CYCLES, CONSTANT = 100.0, (1e-4, 100.0)
#: Tags of which weights are found together; weights that are none.
ROWS, NONE = 64, 1e-12
#: Weight of a window by its ends that does not count as its length.
BESIDE = 0.02


@dataclass(frozen=True, eq=False)
class Window(Frozen):
    """Weights (K,), summing to one, at `offsets` (K,) from the tag, s, increasing.

    `name` : as files say it.
    """

    name: str
    offsets: np.ndarray
    weights: np.ndarray

    def __repr__(self) -> str:
        return f"<Window {self.name}>"

    @property
    def smears(self) -> bool:
        """Whether it takes more than the sample at its tag."""
        return len(self.offsets) > 1

    @property
    def known(self) -> bool:
        """False of one that the file leaves open and that was found from the voltage."""
        return not self.name.startswith("unknown")

    @cached_property
    def ends(self) -> tuple[float, float]:
        """From when to when, beside the tag, it takes all but `BESIDE` of its weight at either end,
        s.
        """
        if not self.smears:
            return 0.0, 0.0
        size = np.cumsum(np.abs(self.weights)) / np.abs(self.weights).sum()
        first, last = np.searchsorted(size, [BESIDE, 1.0 - BESIDE])
        return float(self.offsets[first]), float(self.offsets[min(last, len(size) - 1)])

    @property
    def span(self) -> float:
        """Its length but for the ends, s."""
        return self.ends[1] - self.ends[0]

    @property
    def delay(self) -> float:
        """By how much what it shows lies behind what was, s."""
        return -float(self.weights @ self.offsets)

    @property
    def centred(self) -> "Window":
        """The same about its tag."""
        return replace(self, offsets=self.offsets + self.delay)

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Complex gain at frequencies (...,) beside the nominal one, Hz, those below it
        negative.
        """
        turns = np.multiply.outer(np.asarray(frequency, dtype=float), self.offsets)
        return np.exp(2j * np.pi * turns) @ self.weights

    @cached_property
    def bandwidth_hz(self) -> float:
        """Frequency beside the nominal one up to which the gain is 1/sqrt(2) and more, Hz; infinite
        without a window.
        """
        if not self.smears:
            return np.inf
        frequency = np.arange(0.0, 40.0, 0.02) / float(np.ptp(self.offsets))
        gain = np.abs(self.response(frequency))
        below = int(np.argmax(gain < np.sqrt(0.5)))
        return float(
            np.interp(-np.sqrt(0.5), -gain[below - 1 : below + 1], frequency[below - 1 : below + 1])
        )

    @cached_property
    def _edges(self) -> np.ndarray:
        """(K + 1,) between which each weight is spread evenly: what a sampler's own filter makes of
        it.
        """
        middle = 0.5 * (self.offsets[1:] + self.offsets[:-1])
        first, last = 2.0 * self.offsets[0] - middle[0], 2.0 * self.offsets[-1] - middle[-1]
        return np.concatenate([[first], middle, [last]])

    @cached_property
    def _sums(self) -> np.ndarray:
        """(K + 1,) weight up to each edge."""
        return np.concatenate([[0.0], np.cumsum(self.weights)])

    def step_response(self, time: np.ndarray) -> np.ndarray:
        """What it makes at tags `time` (...,), s, of a unit step at zero."""
        if not self.smears:
            return np.where(np.asarray(time) >= 0.0, 1.0, 0.0)
        return 1.0 - np.interp(-np.asarray(time, dtype=float), self._edges, self._sums)

    def matrix(self, tags: np.ndarray, time: np.ndarray) -> csr_matrix:
        """(N, M) that takes a wave at M times to phasors at N increasing tags; between the times it
        is a line, beyond them it stays.

        Law: with G the second integral of the weights about a tag, the line from 1 at time m to 0
        at its neighbours has the part (G_(m+1) - G_m) / (t_(m+1) - t_m) - (G_m - G_(m-1)) / (t_m -
        t_(m-1)).
        """
        if not self.smears:
            return Window("none", np.array([-1e-9, 1e-9]), np.full(2, 0.5)).matrix(tags, time)
        parts = []
        for first in range(0, len(tags), ROWS):
            some = tags[first : first + ROWS]
            reach = np.searchsorted(time, [some[0] + self._edges[0], some[-1] + self._edges[-1]])
            begin, end = max(int(reach[0]) - 2, 0), min(int(reach[1]) + 2, len(time))
            begin, end = min(begin, len(time) - 2), max(end, 2)
            around = time[begin:end]
            slopes = np.diff(self._twice(around - some[:, None]), axis=1) / np.diff(around)
            ends = np.zeros((len(slopes), 1)), np.ones((len(slopes), 1))
            rows = np.diff(np.hstack([ends[0], slopes, ends[1]]), axis=1)
            whole = lil_matrix((len(some), len(time)))
            whole[:, begin:end] = np.where(np.abs(rows) > NONE, rows, 0.0)
            parts.append(csr_matrix(whole))
        return csr_matrix(vstack(parts))

    def _twice(self, x: np.ndarray) -> np.ndarray:
        """The second integral of the weights up to x (...,), s."""
        edges, sums = self._edges, self._sums
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (sums[1:] + sums[:-1]) * np.diff(edges))])
        place = np.clip(np.searchsorted(edges, x) - 1, 0, len(edges) - 2)
        since = np.minimum(np.maximum(x - edges[place], 0.0), (edges[1:] - edges[:-1])[place])
        slope = (self.weights / np.diff(edges))[place]
        inside = whole[place] + sums[place] * since + 0.5 * slope * since**2
        return inside + np.maximum(x - edges[-1], 0.0)


def window_of(text: str, f0_hz: float) -> Window:
    """The window that a file says. SweepError for an unknown form or a number out of range.

    `unknown` gives one without a length, which `recordings` finds from the voltage.
    """
    kind, _, said = text.strip().partition(":")
    if kind in ("none", "unknown") and not said:
        return Window(kind, np.zeros(1), np.ones(1))
    if kind not in _MAKERS:
        raise SweepError(
            f"window must be {', '.join(FORMS)}; found {text[:60]!r}, "
            f"{near(kind, [*_MAKERS, 'none'])}"
        )
    try:
        number = float(said)
    except ValueError:
        number = np.nan
    if not (np.isfinite(number) and number > 0):
        form = next(one for one in FORMS if one.startswith(f"{kind}:"))
        raise SweepError(f"window is written {form}, with a positive number; found {text[:60]!r}.")
    offsets, weights = _MAKERS[kind](number, f0_hz)
    return Window(text.strip(), offsets, weights / weights.sum())


def fourier(cycles: float, f0_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and weights of a Fourier window of so many cycles that ends at its tag."""
    if cycles > MOST_CYCLES:
        raise SweepError(
            f"window: a Fourier window has at most {MOST_CYCLES:g} cycles; found {cycles:g}."
        )
    count = max(round(PARTS * cycles), PARTS)
    offsets = (np.arange(count) + 0.5 - count) * cycles / f0_hz / count
    return offsets, np.ones(count)


def triangle(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and weights of a triangle about its tag, of so many s."""
    part = (np.arange(2 * PARTS) + 0.5) / PARTS - 1.0
    return 0.5 * seconds * part, 1.0 - np.abs(part)


def first_order(seconds: float, f0_hz: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and weights of 1 / (1 + s T), which ends at its tag."""
    if not CONSTANT[0] <= seconds <= CONSTANT[1]:
        raise SweepError(
            f"window: the time constant of first_order is from {CONSTANT[0]:g} to {CONSTANT[1]:g} "
            f"s; found {seconds:g}."
        )
    part = seconds / PARTS_OF_CONSTANT
    offsets = part * (np.arange(CONSTANTS * PARTS_OF_CONSTANT)[::-1] + 0.5)
    return -offsets, np.exp(-offsets / seconds)


_Maker = Callable[[float, float], tuple[np.ndarray, np.ndarray]]
_MAKERS: dict[str, _Maker] = {
    "dft": fourier,
    "c37.118-P": p_class,
    "c37.118-M": m_class,
    "first_order": first_order,
}
