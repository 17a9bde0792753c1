"""Modes of a fitted model, read from the poles of its record: frequency and damping, and their
picture in the complex plane.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.border import takes_kinds
from ibrid.evaluation.record import Record
from ibrid.report.look.style import DANGER, MUTED, Axes, series

#: Imaginary part over real part up to which a pole is a real one.
ROUNDING = 1e-6


@dataclass(frozen=True)
class PolePair:
    """A pole pair: `frequency` of oscillation, Im p / 2 pi in Hz; `damping` -Re p / |p|; `real` in
    1/s.
    """

    frequency: float
    damping: float
    real: float


@takes_kinds
def modes(poles: Sequence[Sequence[float]], highest: float = math.inf) -> list[PolePair]:
    """Oscillating modes up to `highest` (Hz), the least damped first."""
    pole_pairs = []
    for real, imaginary in poles:
        if ROUNDING * abs(real) < imaginary <= 2 * math.pi * highest:
            pole_pairs.append(
                PolePair(imaginary / (2 * math.pi), -real / math.hypot(real, imaginary), real)
            )
    return sorted(pole_pairs, key=lambda one: one.damping)


def slowest(poles: Sequence[Sequence[float]]) -> float:
    """Largest real part in 1/s; -inf without poles."""
    return max((real for real, _ in poles), default=-math.inf)


def unstable_points(record: Record) -> list[str]:
    """Operating points at which the model is unstable."""
    return [name for name, fine in record.stable.items() if not fine]


def measured_up_to(record: Record) -> float:
    """Highest measured frequency in Hz."""
    return float(record.settings.get("frequency_hz", [0.0, math.inf])[1])


#: Damping ratios whose lines help to read the plot.
DAMPING = (0.01, 0.1, 0.5)
#: Linear part of the scales: 1/s for the real part, Hz for the frequency.
LINEAR = 1.0


def draw_poles(axes: Sequence[Axes], record: Record) -> None:
    """Upper half plane of every operating point; poles right of zero are unstable."""
    (plane,) = axes
    poles = {
        name: np.array(found, dtype=float).reshape(-1, 2) for name, found in record.poles.items()
    }
    everything = np.concatenate(list(poles.values()))
    reach = 2.0 * max(10.0, float(np.abs(everything[:, 0]).max(initial=0.0)))
    height = 2.0 * max(10.0, float(everything[:, 1].max(initial=0.0)) / (2 * np.pi))
    right = max(0.5, 3.0 * float(everything[:, 0].max(initial=0.0)))
    pole_plane(plane, reach, right, height)
    _damping_lines(plane, height)
    for index, (name, found) in enumerate(poles.items()):
        colour, marker, _ = series(index)
        upper = found[found[:, 1] >= 0]
        plane.plot(
            upper[:, 0],
            upper[:, 1] / (2 * np.pi),
            linestyle="none",
            marker=marker,
            markersize=6.5,
            markerfacecolor="none",
            markeredgewidth=1.4,
            color=colour,
            label=name,
        )
    plane.set_xticks(_decades(-reach, right))
    plane.set_yticks(_decades(0.0, height))
    plane.minorticks_off()


def pole_plane(plane: Axes, reach: float, right: float, height: float) -> None:
    """Scales, names and limits (1/s, Hz) of the upper half plane, the unstable part shaded."""
    plane.set_xscale("symlog", linthresh=LINEAR)
    plane.set_yscale("symlog", linthresh=LINEAR)
    plane.axvspan(0, right, color=DANGER, alpha=0.10, linewidth=0)
    plane.axvline(0, color=DANGER, linewidth=1.0)
    plane.set(xlim=(-reach, right), ylim=(-0.4, height))
    plane.set(xlabel="real part  (1/s)", ylabel="imaginary part / 2π  (Hz)")


def _damping_lines(plane: Axes, height: float) -> None:
    """Straight where both scales are logarithmic; they are not drawn elsewhere."""
    for ratio in DAMPING:
        slope = 2 * np.pi * ratio / np.sqrt(1 - ratio**2)
        frequency = np.array([max(LINEAR, LINEAR / slope), height])
        plane.plot(-slope * frequency, frequency, color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)))
        middle = float(np.sqrt(frequency[0] * frequency[1]))
        plane.annotate(
            f"{100 * ratio:g} %",
            (-slope * middle, middle),
            fontsize=9,
            color=MUTED,
            ha="right",
            va="top",
        )


def _decades(low: float, high: float) -> list[float]:
    """Ticks at powers of ten and zero, every second one where there are many."""
    below = [-(10.0**n) for n in range(8, -1, -1) if -(10.0**n) >= low]
    above = [10.0**n for n in range(9) if 10.0**n <= high]
    if len(below) > 4:
        below = [one for one in below if round(np.log10(-one)) % 2 == 0]
    return [*below, 0.0, *above]
