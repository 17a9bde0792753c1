"""The high-frequency end: above the control's reach an inverter is the inductance of its filter."""

from dataclasses import dataclass

import numpy as np

from ibrid.measurement.sweeps.sweep import PointSweep

_DECADES = 1 / 3
_SLOPE = (-1.4, -0.85)
_PHASE = np.deg2rad(20)
_LARGEST_REACTANCE = 0.6


@dataclass(frozen=True)
class Tail:
    """An inductive tail.

    direction : +1 if the current counts out of the inverter (Y = -1 / (j omega L)), -1 if into it.
    reactance : apparent x = omega_0 L, per unit, as the declared units have it.
    """

    direction: int
    reactance: float


def inductive_tail(
    point: PointSweep, f0_hz: float, largest: float = _LARGEST_REACTANCE
) -> Tail | None:
    """The tail of one operating point, or None if its last third of a decade does not look like an
    inductance.

    It does when ||Y|| falls with slope -1.4 .. -0.85 (steeper just above a resonance), Ydd and Yqq
    have one sign and a phase within 20 degrees of +90 (or -90), outweigh Ydq and Yqd three times,
    and x = f0 / (f |Y|) is at most `largest`: ideal voltage feedforward without delay makes the
    inverter look like a far larger inductance, of either sign.
    """
    last = point.frequency >= point.frequency[-1] * 10**-_DECADES
    if last.sum() < 3:
        last[-3:] = True
    if last.sum() < 3:
        return None
    frequency, values = point.frequency[last], point.admittance[last]
    size = np.linalg.norm(values, axis=(1, 2)) / np.sqrt(2)
    if not (size > 0).all():
        return None
    slope = np.polyfit(np.log(frequency), np.log(size), 1)[0]
    diagonal = values[:, [0, 1], [0, 1]]
    off_diagonal = values[:, [0, 1], [1, 0]]
    direction = int(np.sign(np.median(np.imag(diagonal))))
    away = (
        np.abs(np.angle(diagonal * -1j * direction))
        if direction
        else np.full(diagonal.shape, np.inf)
    )
    reactance = float(np.median(f0_hz / (frequency * size)))
    inductive = (
        _SLOPE[0] <= slope <= _SLOPE[1]
        and np.median(away, axis=0).max() <= _PHASE
        and np.median(np.abs(diagonal)) >= 3 * np.median(np.abs(off_diagonal))
        and reactance <= largest
    )
    return Tail(direction, reactance) if inductive else None


def signs_of_tail(
    point: PointSweep, f0_hz: float, largest: float = _LARGEST_REACTANCE
) -> tuple[int, int]:
    """+1 where the inductive tail has the current out, -1 into the inverter; +1 where it turns as
    with the q axis leading d, -1 as with it lagging; 0 where it does not say.

    Law: an inductance seen in dq is Z = L (s + omega_0 J), so (Zqd - Zdq) / (Zdd + Zqq) = f0 / (j
    f) with the q axis leading. Control turns it too: the verdict needs all of the last third of a
    decade between half and twice of that.
    """
    tail = inductive_tail(point, f0_hz, largest)
    if tail is None:
        return 0, 0
    last = point.frequency >= point.frequency[-1] * 10**-_DECADES
    last[-3:] = True
    impedance = np.linalg.inv(point.admittance[last])
    turned = (impedance[:, 1, 0] - impedance[:, 0, 1]) / (impedance[:, 0, 0] + impedance[:, 1, 1])
    ratio = np.real(1j * turned * point.frequency[last] / f0_hz)
    if (np.abs(ratio) < 0.5).any() or (np.abs(ratio) > 2).any() or len(set(np.sign(ratio))) != 1:
        return tail.direction, 0
    return tail.direction, int(np.sign(ratio[0]))
