"""What a sweep says of the device before anything is fitted, in sentences: the law at rest, the
filter, the peaks.

Laws: with constant power at the PCC the first column of Y(0) is (-p, q)/v^2 (`angle_law`); a device
that holds a voltage answers its magnitude with reactive current instead. The high end is the
filter, Y = -1/(j omega L). A peak of
|Y| that is w Hz wide at 1/sqrt(2) of its height has a damping ratio of w / 2f.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.measurement.conventions.tail import inductive_tail
from ibrid.measurement.quality.coverage import resonances
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.quantities import hertz, percent
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Part of |S| within which a low-frequency entry counts as what the law asks for; at least so much
#: per unit.
SETTLED, LEAST = 0.25, 0.1
#: Peaks below are about angle and power (Hz), those above about the filter and the inner loop.
SLOW, FAST = 100.0, 300.0


def physics_in_words(sweep: Sweep) -> tuple[str, ...]:
    """Sentences about the first operating point."""
    point = sweep.points[0]
    return (*_at_rest(point), _high_end(point, sweep.f0_hz), *_peaks(point))


def _at_rest(point: PointSweep) -> Iterator[str]:
    p, q, v, low = point.op.p, point.op.q, point.op.v, hertz(point.frequency[0])
    lowest = point.admittance[0]
    near = max(SETTLED * float(np.hypot(p, q)), LEAST)
    column = [(lowest[0, 0], -p / v**2, "active power"), (lowest[1, 0], q / v**2, "reactive power")]
    for entry, law, name in column:
        if abs(entry - law) <= near:
            yield f"at {low} the {name} does not depend on the size of the voltage: a loop holds it"
        else:
            found = f"(entry {entry:.2f}, held it would be {law:.2f})"
            yield (
                f"at {low} the {name} is not held against the size of the voltage {found}: no "
                "loop, or one that is slower"
            )
    if abs(lowest[1, 0]) > 1.0 + abs(q):
        yield (
            f"reactive current answers the size of the voltage {abs(lowest[1, 0]):.1f} to 1 at "
            f"{low}: a voltage is held, by a "
            "grid-forming control or an AC voltage loop"
        )
    off = float(abs(lowest[:, 1] - np.array([q, p]) / v**2).max())
    if off <= near:
        yield f"the angle has settled at {low}: what synchronises is faster, as a PLL is"
    elif off <= max(float(np.hypot(p, q)), 4 * LEAST):
        yield f"the angle has nearly settled at {low}, as with a PLL of some Hz to some tens of Hz"
    else:
        yield (
            f"the angle has not settled at {low}: what synchronises is slower than that, as a "
            "swing or a droop with a filter is"
        )


def _high_end(point: PointSweep, f0_hz: float) -> str:
    if (tail := inductive_tail(point, f0_hz)) is None:
        return (
            "the highest frequencies are no plain inductance: feedforward, a delay or the filter's "
            "own resonance reach them"
        )
    way = (
        "out of the inverter"
        if tail.direction > 0
        else "into the inverter, against the convention here"
    )
    return (
        f"the highest frequencies are an inductance of {tail.reactance:.3g} pu, the grid side of "
        f"the filter; current {way}"
    )


def _peaks(point: PointSweep) -> Iterator[str]:
    size = np.linalg.norm(point.admittance, axis=(1, 2))
    for peak in resonances(point, estimate_point(point)):
        k = int(np.argmin(abs(point.frequency - peak.frequency)))
        above = size >= size[k] / np.sqrt(2)
        low, high = k, k
        while low > 0 and above[low - 1]:
            low -= 1
        while high + 1 < len(size) and above[high + 1]:
            high += 1
        width = point.frequency[min(high + 1, len(size) - 1)] - point.frequency[max(low - 1, 0)]
        what = (
            "angle or power"
            if peak.frequency < SLOW
            else "filter or inner loop"
            if peak.frequency > FAST
            else "either"
        )
        sharp = high - low < 2  # the measured frequencies are too far apart to tell
        damped = (
            ""
            if sharp
            else f", damped by at most {percent(min(width / (2 * peak.frequency), 1.0))}"
        )
        yield f"a peak at {hertz(peak.frequency)}{damped}: {what}"
