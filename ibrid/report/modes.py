"""Modes of a fitted model, read from the poles of its record: frequency and damping ratio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ibrid.evaluation.record import Record


@dataclass(frozen=True)
class Mode:
    """A pole pair: `frequency` of oscillation, Im p / 2 pi in Hz; `damping` -Re p / |p|; `real` in 1/s."""

    frequency: float
    damping: float
    real: float


def modes(poles: Sequence[Sequence[float]], highest: float = math.inf) -> list[Mode]:
    """Oscillating modes up to `highest` (Hz), the least damped first."""
    found = []
    for real, imaginary in poles:
        size = math.hypot(real, imaginary)
        if 0 < imaginary <= 2 * math.pi * highest:
            found.append(Mode(imaginary / (2 * math.pi), -real / size, real))
    return sorted(found, key=lambda one: one.damping)


def slowest(poles: Sequence[Sequence[float]]) -> float:
    """Largest real part in 1/s; -inf without poles."""
    return max((real for real, _ in poles), default=-math.inf)


def unstable_points(record: Record) -> list[str]:
    """Operating points at which the model is unstable."""
    return [name for name, fine in record.stable.items() if not fine]


def measured_up_to(record: Record) -> float:
    """Highest measured frequency in Hz."""
    return float(record.settings.get("frequency_hz", [0.0, math.inf])[1])
