"""The reference filters of phasor measurement units, classes P and M.

Law: X(t) = (sqrt 2 / G) sum over k of x(t + k dt) W(k) exp(-j omega_0 (t + k dt)), G the sum of the
weights W, k from -N/2 to N/2: a real, symmetric filter about its tag. P: 15 samples a cycle, N =
28, W = 1 - 2 |k| / (N + 2). M: 16 samples a cycle, W = sin(a) / a times Hamming's window, a = 2 pi
2 F k dt, with F and N by nominal frequency and rate. The magnitude of class P is divided by sin(pi
(f0 + 1.625 df) / (2 f0)) besides, the same of voltage and current, which no linear device feels:
left out.

Reference: IEC/IEEE 60255-118-1:2018, annex D.
"""

import numpy as np

from ibrid.errors import SweepError

#: Samples a cycle of classes P and M, and the order of P.
P_SAMPLES, M_SAMPLES, P_ORDER = 15, 16, 28
#: Nominal frequency and rate -> cut-off F, Hz, and order N of class M.
M_FILTERS = {
    (50, 10): (1.779, 806),
    (50, 25): (4.355, 338),
    (50, 50): (7.75, 142),
    (50, 100): (14.1, 66),
    (60, 10): (1.78, 968),
    (60, 12): (2.125, 816),
    (60, 15): (2.64, 662),
    (60, 20): (3.50, 502),
    (60, 30): (5.02, 306),
    (60, 60): (8.19, 164),
    (60, 120): (16.25, 70),
}


def p_class(rate: float, f0_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets, s, and weights; whatever the rate is, they are of about two cycles."""
    k = np.arange(-(P_ORDER // 2), P_ORDER // 2 + 1)
    return k / (P_SAMPLES * f0_hz), 1.0 - 2.0 * np.abs(k) / (P_ORDER + 2)


def m_class(rate: float, f0_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets, s, and weights; SweepError for a rate that has no reference filter."""
    if (round(f0_hz, 6), round(rate, 6)) not in M_FILTERS:
        rates = ", ".join(f"{known:g}" for nominal, known in M_FILTERS if nominal == f0_hz)
        known = (
            f"at {f0_hz:g} Hz those of {rates} frames per s" if rates else "those of 50 and 60 Hz"
        )
        raise SweepError(f"window: of class M {known} are known; found {rate:g}, say unknown.")
    cut_off, order = M_FILTERS[int(f0_hz), int(rate)]
    k = np.arange(-(order // 2), order // 2 + 1)
    hamming = 0.54 + 0.46 * np.cos(2.0 * np.pi * k / order)
    return k / (M_SAMPLES * f0_hz), np.sinc(4.0 * cut_off * k / (M_SAMPLES * f0_hz)) * hamming
