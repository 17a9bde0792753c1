"""The voltage that is injected: many sinusoids at once, a whole number of periods each, with a low
peak.

Law: s(n) = sum over lines k of cos(2 pi b_k n / N + phi_k), n = 0 .. N - 1, with odd bins b_k. What
a device makes of it by even powers lies in even bins, and never on a line (odd multisine); bins
that are not excited show what noise, transients and odd powers leave (guard bins). The phases are
chosen for a low crest factor.

References: Pintelon & Schoukens, System Identification: A Frequency Domain Approach, 2012, sections
4.3 and 5.3. Schroeder, IEEE Trans. Inf. Theory 16, 1970. Van der Ouderaa, Schoukens & Renneboog,
IEEE Trans. Instrum. Meas. 37, 1988.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from ibrid.errors import SweepError
from ibrid.frozen import Frozen

#: Periods of the lowest line at least, where its bin is odd; the share of the sampling rate below
#: which all lines must lie; seconds of a period at least, in which a transient decays so far that
#: it is told from noise.
LEAST_BIN, HIGHEST, SHORTEST = 5, 0.45, 0.2
#: Samples of a period at most; periods of the nominal frequency in which samples and it must meet
#: for whole ones of both.
LONGEST, MEETING = 4_000_000, 20
#: Starts with random phases; rounds in which peaks are clipped, and to which part of the highest
#: from the first to the last of them; samples of a period of the highest line.
STARTS, ROUNDS, CLIPPED, FINER = 1, 200, (0.4, 0.9), 4


@dataclass(frozen=True, eq=False)
class Multisine(Frozen):
    """bins : (K,) odd, ascending.

    samples : N of a period. step_s : between samples. phases : (K,) rad.
    """

    bins: np.ndarray
    samples: int
    step_s: float
    phases: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """(K,) Hz."""
        return self.bins / (self.samples * self.step_s)

    def wave(self, peak: float) -> np.ndarray:
        """(N,) one period that reaches `peak`."""
        shape = _shape(self.bins, self.phases, self.samples)
        return peak / np.abs(shape).max() * shape

    def line_amplitude(self, peak: float) -> float:
        """Of each line, where the wave reaches `peak`."""
        return peak / float(np.abs(_shape(self.bins, self.phases, self.samples)).max())

    @property
    def guards(self) -> np.ndarray:
        """(K, 2) of each line the nearest odd bins on either side that are not excited."""
        excited = set(self.bins.tolist())
        last = self.samples // 2 - 1
        pairs = [
            (_free(line, -2, excited, last), _free(line, 2, excited, last))
            for line in self.bins.tolist()
        ]
        return np.array([[low or high, high or low] for low, high in pairs])


def multisine_for(
    frequency: Sequence[float] | np.ndarray,
    step_s: float,
    f0_hz: float,
    sampling_hz: float | None = None,
) -> Multisine:
    """A multisine with a line near each frequency, none where an image or an alias of another one
    lies.

    Parameters
    ----------
    frequency : Hz, ascending. The lines are at the nearest odd bins that are free.
    step_s : s between samples. The period is a whole number of them, and of periods of the nominal
    frequency where those meet.
    sampling_hz : of the device's control, whose aliases are avoided; None: 1 / step_s.

    Raises
    ------
    SweepError : a frequency above what the sampling shows, or so low that a period has too many
    samples.
    """
    asked = np.asarray(frequency, dtype=float)
    highest = HIGHEST / step_s
    if asked[-1] > highest:
        raise SweepError(
            f"frequencies must lie below {highest:g} Hz, {HIGHEST:g} of the device's sampling rate "
            f"of {1 / step_s:g} Hz; "
            f"found {asked[-1]:g} Hz, ask for lower ones or give the device a smaller step_s."
        )
    samples = _samples(asked, step_s, f0_hz)
    bins, meeting = _bins(asked, samples, step_s, f0_hz, sampling_hz or 1 / step_s)
    if meeting:
        samples *= 2
        bins, _ = _bins(asked, samples, step_s, f0_hz, sampling_hz or 1 / step_s)
    return Multisine(bins, samples, step_s, _phases(bins))


def _samples(asked: np.ndarray, step_s: float, f0_hz: float) -> int:
    """Of a period in which odd bins are as near as the frequencies, the lowest being at least bin
    `LEAST_BIN`.
    """
    nearest = float(np.diff(asked).min(initial=asked[0]))
    period = max(LEAST_BIN / float(asked[0]), 2.0 / nearest, SHORTEST)
    meeting = next((n for n in range(1, MEETING + 1) if _is_whole(n / (f0_hz * step_s))), None)
    unit = round(meeting / (f0_hz * step_s)) if meeting else 2
    samples = unit * ceil(period / (unit * step_s) - 1e-9)
    if samples > LONGEST:
        raise SweepError(
            f"frequencies from {asked[0]:g} Hz on, as near as these, need a period of "
            f"{samples * step_s:g} s, "
            f"{samples} samples, at most {LONGEST} are taken; ask for fewer or higher frequencies."
        )
    return samples


def _is_whole(number: float) -> bool:
    return abs(number - round(number)) < 1e-9 * number


def _mirrors(period: float, f0_hz: float, sampling_hz: float) -> list[tuple[int, int]]:
    """(sign, shift) such that a line at bin b has an image at sign b + shift.

    Images of an unbalanced device lie 2 f0 beside a line; what is sampled comes back at the
    sampling rate less the frequency, in the frame that turns as well as in the one that stands.
    """
    twice = round(2 * f0_hz * period)
    rate = round(sampling_hz * period)
    return [(1, twice), (1, -twice), (-1, twice), (-1, rate), (-1, rate - twice)]


def _bins(
    asked: np.ndarray, samples: int, step_s: float, f0_hz: float, sampling_hz: float
) -> tuple[np.ndarray, int]:
    """For each frequency the nearest odd bin on which no line and no image of one lies, and how
    many found only one with an image; where there is none, two frequencies have one bin.
    """
    period = samples * step_s
    mirrors = _mirrors(period, f0_hz, sampling_hz)
    last = samples // 2 - 1
    meeting = 0
    taken: set[int] = set()
    avoided: set[int] = set()
    for place in (asked * period).tolist():
        nearest = 2 * round((place - 1) / 2) + 1
        near = [nearest, nearest + 2, nearest - 2, nearest + 4, nearest - 4]
        free = [
            bin_ for bin_ in near if 1 <= bin_ <= last and bin_ not in taken and bin_ not in avoided
        ]
        if not free:
            free = [bin_ for bin_ in near if 1 <= bin_ <= last and bin_ not in taken]
            meeting += 1
        if free:
            taken.add(free[0])
            avoided |= {sign * free[0] + shift for sign, shift in mirrors}
    return np.array(sorted(taken)), meeting


def _phases(bins: np.ndarray) -> np.ndarray:
    """(K,) phases of a low crest factor: from Schroeder's and from random ones peaks are clipped,
    and the phases of the lines of what is left are taken, `ROUNDS` times; the best of all are kept.
    """
    rng = np.random.default_rng(0)
    places = np.arange(len(bins)) / len(bins)
    schroeder = -2 * np.pi * np.cumsum(np.diff(bins, prepend=bins[0]) * places)
    starts = [schroeder, *rng.uniform(0, 2 * np.pi, (STARTS, len(bins)))]
    samples = 2 ** ceil(np.log2(FINER * (int(bins[-1]) + 1)))
    best = schroeder
    lowest = np.inf
    for phases in starts:
        for share in np.linspace(*CLIPPED, ROUNDS):
            shape = _shape(bins, phases, samples)
            peak = float(np.abs(shape).max())
            if peak < lowest:
                best, lowest = phases, peak
            clipped = np.clip(shape, -share * peak, share * peak)
            phases = np.angle(np.fft.rfft(clipped)[bins])
    return best


def _shape(bins: np.ndarray, phases: np.ndarray, samples: int) -> np.ndarray:
    lines = np.zeros(samples // 2 + 1, dtype=complex)
    lines[bins] = np.exp(1j * phases)
    return np.fft.irfft(lines, samples) * (samples / 2)


def _free(line: int, step: int, excited: set[int], last: int) -> int:
    """The nearest bin in a direction that is not excited; 0 where there is none."""
    bin_ = line + step
    while 1 <= bin_ <= last:
        if bin_ not in excited:
            return bin_
        bin_ += step
    return 0
