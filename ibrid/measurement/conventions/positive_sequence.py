"""A scan of the positive sequence alone, as the 2x2 admittance that it would be if the sequences
were not coupled.
"""

import numpy as np

from ibrid.errors import SweepError

#: What a sweep file says of itself where it was made of such a scan.
NOTE = "matrix: positive sequence"
#: What such a scan leaves open.
WORDS = (
    "the positive sequence alone was measured: the coupling of the sequences is taken as zero and "
    "the negative one as the "
    "positive, so what acts on one axis alone (PLL, power loops, DC link, usually up to some 200 "
    "Hz) cannot be told from these "
    "data; trust filter, current control and delay, and scan the 2x2 matrix for the rest"
)


def uncoupled(
    frequency: np.ndarray, response: np.ndarray, f0_hz: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies in the dq frame, Hz, matrices (K, 2, 2) of modified sequences without coupling,
    and the rows they come from.

    Law: with Y(g) of a positive-sequence voltage at g in the network, pp at the dq frequency f is
    Y(f0 + f), nn is the conjugate of Y(f0 - f) for f below f0 and, negative sequence taken as the
    positive, Y(f - f0) above it. So a row above f0 is pp at g - f0, one below it the conjugate of
    nn at f0 - g; the other of the two is interpolated. A row at f0 is none in dq.

    frequency : (n,) Hz in the network, each once. response : (n,) complex.

    Raises SweepError where no frequency has its partner within the scan.
    """
    order = np.argsort(frequency)
    network, response = frequency[order], response[order]
    partner = np.abs(network - 2 * f0_hz)
    dq = np.abs(network - f0_hz)
    kept = (dq > 1e-7 * f0_hz) & (network[0] <= partner) & (partner <= network[-1])
    if kept.sum() < 3:
        raise SweepError(
            f"a positive-sequence scan must reach from below to above {f0_hz:g} Hz, since dq joins "
            f"frequencies {2 * f0_hz:g} Hz "
            f"apart; found {network[0]:g} to {network[-1]:g} Hz."
        )
    beside = np.interp(partner, network, np.real(response)) + 1j * np.interp(
        partner, network, np.imag(response)
    )
    below = network < f0_hz
    upper = np.where(below, beside, response)
    lower = np.where(below, response, beside)
    matrix = np.zeros((len(network), 2, 2), complex)
    matrix[:, 0, 0] = upper
    matrix[:, 1, 1] = np.where(dq < f0_hz, lower.conj(), lower)
    places = np.flatnonzero(kept)
    places = places[
        np.lexsort((below[places], np.round(dq[places], 9)))
    ]  # of two rows at one frequency that above f0
    places = places[np.append(True, np.diff(dq[places]) > 1e-7 * dq[places][1:])]
    return dq[places], matrix[places], order[places]
