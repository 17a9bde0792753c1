"""What a generic model cannot show: in which bands of frequency of which events its current misses
more than a twentieth of what the device answers.

Law: the discrete Fourier transform of the difference of the currents, over that of the departure
from rest in the same record, by energy.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ibrid.playback.compare import PlayedRecord

#: Bands, Hz beside the nominal frequency.
BANDS = ((0.0, 2.0), (2.0, 8.0), (8.0, 20.0), (20.0, 50.0))
#: Difference in a band over the departure of the whole record, rms, from which on it is told.
TOLD = 0.05


@dataclass(frozen=True)
class BlindBand:
    """`left` : the difference in the band over the departure in the whole record, rms."""

    event: str
    low_hz: float
    high_hz: float
    left: float


def blind_bands(played: PlayedRecord) -> Iterator[BlindBand]:
    """The bands of a record that the model does not show, in ascending frequency."""
    record = played.record
    if record.still or played.nrmse is None:
        return
    step = float(np.median(np.diff(record.time)))
    frequency = np.abs(np.fft.fftfreq(len(record.time), step))
    departure = (record.i - record.i_rest) @ np.array([1.0, 1.0j])
    difference = (played.current - record.i) @ np.array([1.0, 1.0j])
    whole = float(np.linalg.norm(departure))
    energy = np.abs(np.fft.fft(difference)) ** 2 / len(difference)
    for low, high in BANDS:
        left = float(np.sqrt(energy[(frequency >= low) & (frequency < high)].sum())) / whole
        if left > TOLD:
            yield BlindBand(record.name, low, high, left)
