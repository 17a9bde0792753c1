"""Fewer samples of a record: every k-th behind one low-pass for voltage and current, which a linear
relation does not feel.
"""

from collections.abc import Sequence

import numpy as np

#: Largest difference of intervals, relative, of samples that are even.
EVEN = 0.02
#: Taps of the low-pass for each sample that is left out.
TAPS = 20


def sampling_rate(time: np.ndarray) -> float | None:
    """Samples per s of even samples; None of others."""
    intervals = np.diff(time)
    if not len(intervals) or np.ptp(intervals) > EVEN * np.median(intervals):
        return None
    return 1.0 / float(np.median(intervals))


def every_kth(
    time: np.ndarray, waves: Sequence[np.ndarray], k: int
) -> tuple[np.ndarray, list[np.ndarray], float]:
    """Every k-th sample of waves (N, ...) with its time, and the part of white noise's deviation
    that the low-pass leaves.
    """
    from scipy.signal import (
        firwin,
        resample_poly,
    )  # half a second, for records of many samples alone

    low_pass = np.asarray(firwin(TAPS * k + 1, 1 / k, window="blackman"), dtype=float)
    fewer = [resample_poly(wave, 1, k, axis=0, window=low_pass, padtype="edge") for wave in waves]
    return time[::k], fewer, float(np.sqrt(np.sum(low_pass**2)))
