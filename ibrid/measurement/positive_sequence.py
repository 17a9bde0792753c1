"""A scan of the positive sequence alone, as the 2x2 admittance that it would be if the sequences were not coupled."""

import numpy as np

from ibrid.errors import SweepError

#: What a sweep file says of itself where it was made of such a scan.
NOTE = "matrix: positive sequence"
#: What such a scan leaves open.
WORDS = (
    "the positive sequence alone was measured: the coupling of the sequences is taken as zero and the negative one as the "
    "positive, so what acts on one axis alone (PLL, power loops, DC link, usually up to some 200 Hz) cannot be told from these "
    "data; trust filter, current control and delay, and scan the 2x2 matrix for the rest"
)


def uncoupled(frequency: np.ndarray, response: np.ndarray, f0_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in the dq frame, Hz, and matrices (K, 2, 2) of modified sequences without coupling.

    Law: with Y(f) of a positive-sequence voltage at f in the network, pp at the dq frequency f is Y(f + f0), nn is the conjugate
    of Y(f0 - f) below f0 and, negative sequence taken as the positive, Y(f - f0) above it. Missing neighbours are interpolated.

    frequency : (n,) Hz in the network. response : (n,) complex.

    Raises SweepError where no frequency has its neighbour within the scan.
    """
    order = np.argsort(frequency)
    frequency, response = frequency[order], response[order]
    other = np.abs(frequency - 2 * f0_hz)
    kept = (frequency > f0_hz) & (frequency[0] <= other) & (other <= frequency[-1])
    if kept.sum() < 3:
        raise SweepError(
            f"a positive-sequence scan must reach from below to above {f0_hz:g} Hz, since dq joins frequencies {2 * f0_hz:g} Hz "
            f"apart; found {frequency[0]:g} to {frequency[-1]:g} Hz."
        )
    beside = np.interp(other, frequency, np.real(response)) + 1j * np.interp(other, frequency, np.imag(response))
    below = frequency < 2 * f0_hz
    matrix = np.zeros((len(frequency), 2, 2), complex)
    matrix[:, 0, 0] = response
    matrix[:, 1, 1] = np.where(below, beside.conj(), beside)
    return (frequency - f0_hz)[kept], matrix[kept]
