"""What a sweep says in sequence coordinates, before anything is fitted: SOGI or resonant control,
and dead time.

A perturbation of the positive sequence at f0 + f and one of the negative sequence at f0 - f (f in
dq) are the two components of Y_pn = S Y_dq S^H; the impedances seen there are 1/Y_pp and 1/Y_nn,
with the other sequence's voltage held. A feedforward through a SOGI passes the negative sequence of
the fundamental, f = 2 f0, and nothing beside it: a peak of the impedance that the negative sequence
sees. A resonator on both axes at n f0 is a peak for both sequences. Dead time is a resistance D/r
across the current at rest and D a^2/r^3 along it, r^2 = |i|^2 + a^2; beside feedforward and loops
it is seldom seen without a fit.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ibrid.frozen import Frozen
from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Multiple of f0 in dq -> ln|Z| there over that beside it, of both sequences.
Peaks = dict[int, tuple[float, float]]
#: ln|Z| at a multiple of f0 above the mean of its values a factor `BESIDE` below and above, from
#: which on it is a peak.
PEAK, BESIDE = 0.85, 1.6
#: Multiples of f0 in dq at which controllers are tuned.
TUNED = (2, 6)
#: Band in which the resistance is taken, Hz; least number of operating points, and least spread of
#: |i| between them.
BAND, POINTS, SPREAD = (100.0, 2000.0), 4, 3.0
#: Of the spread of the resistance, how much the law of dead time must leave unexplained at most;
#: and usual losses, per unit.
LEFT, LOSS = 0.1, (0.002, 0.2)


@dataclass(frozen=True)
class SequenceView(Frozen):
    """`impedance` : operating point -> (K, 2) complex, per unit, seen by the positive sequence at
    f0 + f and by the negative one at f0 - f, f of the sweep. `peaks` : operating point -> multiple
    of f0 -> ln of how far the impedance rises there, for the positive and the negative sequence.
    `resistance` : (operating point, |i|, along it, across it), per unit, median over the band.
    `sentences` : what that means.
    """

    impedance: dict[str, np.ndarray]
    peaks: dict[str, Peaks]
    resistance: tuple[tuple[str, float, float, float], ...]
    sentences: tuple[str, ...]


def sequence_view(sweep: Sweep) -> SequenceView:
    """The sweep seen by sequences; peaks that all operating points share, and a resistance that
    follows dead time, in words.
    """
    impedance = {point.op.name: _seen(point) for point in sweep.points}
    peaks = {
        point.op.name: _peaks(point.frequency, impedance[point.op.name], sweep.f0_hz)
        for point in sweep.points
    }
    resistance = tuple(found for point in sweep.points if (found := _resistance(point)) is not None)
    return SequenceView(
        impedance, peaks, resistance, (*_of_peaks(peaks, sweep.f0_hz), *_of_resistance(resistance))
    )


def _seen(point: PointSweep) -> np.ndarray:
    y = TO_SEQUENCE @ -point.admittance @ TO_SEQUENCE.conj().T
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1 / np.stack([y[:, 0, 0], y[:, 1, 1]], axis=1)


def _peaks(frequency: np.ndarray, impedance: np.ndarray, f0: float) -> Peaks:
    """Where the sweep has points between the multiple and both of its sides, or on it."""
    peaks = {}
    size, place = np.log(np.abs(impedance)), np.log(frequency)
    for multiple in TUNED:
        at, below, above = (np.log(multiple * f0 * factor) for factor in (1.0, 1 / BESIDE, BESIDE))
        beside = ((place > below) & (place < above)).sum()
        if place[0] > below or place[-1] < above or beside < 2 or not np.isfinite(size).all():
            continue
        rises = [
            float(
                np.interp(at, place, one)
                - (np.interp(below, place, one) + np.interp(above, place, one)) / 2
            )
            for one in size.T
        ]
        peaks[multiple] = (rises[0], rises[1])
    return peaks


def _of_peaks(peaks: dict[str, Peaks], f0: float) -> Iterator[str]:
    for multiple in TUNED:
        rises = [found[multiple] for found in peaks.values() if multiple in found]
        if not rises:
            continue
        positive, negative = (min(one[axis] for one in rises) for axis in (0, 1))
        if negative > PEAK and positive > PEAK:
            yield (
                f"both sequences see an impedance that peaks at {multiple} f0 in dq "
                f"({multiple * f0:g} Hz): resonant control "
                "is tuned to it; try the effect resonant_control."
            )
        elif negative - max(positive, 0.0) > PEAK and multiple == TUNED[0]:
            yield (
                f"the negative sequence sees an impedance that peaks at f0 ({np.exp(negative):.1f} "
                "times as large as beside "
                f"it, at {2 * f0:g} Hz in dq): the voltage feedforward passes a SOGI band-pass, or "
                "the negative sequence is "
                "under control of its own, resonant or PI; try the effects "
                "feedforward_band_pass, resonant_control and negative_sequence_control."
            )


def _resistance(point: PointSweep) -> tuple[str, float, float, float] | None:
    """Of Z in the band, along the current at rest and across it; None without three points there or
    without a current.
    """
    inside = (point.frequency >= BAND[0]) & (point.frequency <= BAND[1])
    i = np.array([point.op.p, -point.op.q]) / point.op.v
    size = float(np.hypot(*i))
    if inside.sum() < 3 or size == 0:
        return None
    along = i / size
    across = np.array([-along[1], along[0]])
    try:
        z = np.linalg.inv(-point.admittance[inside]).real
    except np.linalg.LinAlgError:
        return None
    return (
        point.op.name,
        size,
        float(np.median(along @ z @ along)),
        float(np.median(across @ z @ across)),
    )


def _of_resistance(resistance: tuple[tuple[str, float, float, float], ...]) -> list[str]:
    """Dead time where its law explains how both resistances depend on |i|: c + D/r across, c + D
    a^2/r^3 along.
    """
    if len(resistance) < POINTS:
        return []
    size, along, across = (np.array([one[k] for one in resistance]) for k in (1, 2, 3))
    if size.max() < SPREAD * size.min():
        return []
    measured = np.concatenate([across, along])
    spread = float(((measured - measured.mean()) ** 2).sum())
    best, loss = np.inf, 0.0
    for a in np.geomspace(0.02, 0.5, 15):
        r = np.hypot(size, a)
        law = np.column_stack([np.ones(2 * len(size)), np.concatenate([1 / r, a * a / r**3])])
        found, *_ = np.linalg.lstsq(law, measured, rcond=None)
        left = float(((law @ found - measured) ** 2).sum())
        if left < best:
            best, loss = left, float(found[1])
    if best > LEFT * spread or not LOSS[0] <= loss <= LOSS[1]:
        return []
    least, most = int(np.argmin(size)), int(np.argmax(size))
    return [
        f"the resistance falls with the current, from {across[least]:.3g} across it at |i| = "
        f"{size[least]:.2g} to "
        f"{across[most]:.3g} at {size[most]:.2g}, and is larger across the current than along it, "
        "as dead time of about "
        f"{loss:.2g} per unit of voltage makes it; try the effect dead_time."
    ]
