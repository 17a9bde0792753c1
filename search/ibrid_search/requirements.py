"""What --require asks of a candidate beyond a small error: stability, passivity over a band."""

import re
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep

_WORDS = ("stable", "passive:LO-HI")
#: Frequencies per decade at which passivity is asked for.
_DENSITY = 50
#: Above minus this (per unit) the admittance counts as passive: rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Requirements:
    """`stable` : no pole in the right half plane at any measured point.

    `passive` : -Y is passive in these bands (Hz).
    """

    stable: bool = False
    passive: tuple[tuple[float, float], ...] = ()

    def require_within(self, sweep: Sweep) -> None:
        """IbridError for a band in which nothing was measured."""
        first = min(point.frequency[0] for point in sweep.points)
        last = max(point.frequency[-1] for point in sweep.points)
        beyond = [
            f"passive:{low:g}-{high:g}" for low, high in self.passive if high < first or low > last
        ]
        if beyond:
            raise IbridError(
                f"--require {beyond[0]} asks beyond the data; choose a band in {first:g}-{last:g} "
                "Hz"
            )

    def unmet(self, record: Record) -> str:
        """Why a fitted candidate is refused, in a sentence; "" when it has what is asked for."""
        if self.stable and (lost := [name for name, fine in record.stable.items() if not fine]):
            return f"it must be stable, but has a pole in the right half plane at {', '.join(lost)}"
        for low, high in self.passive:
            for name in record.stable:
                least = passivity_index(record, name, low, high)
                if not least >= -_ROUNDING:
                    return (
                        f"it must be passive from {low:g} to {high:g} Hz, but min eig of -(Y+Y')/2 "
                        f"is {least:.3g} at {name}"
                    )
        return ""


def parse_requirements(text: str | None) -> Requirements:
    """Read "stable,passive:100-2000"; IbridError for anything else."""
    stable, passive = False, []
    for word in (text or "").split(","):
        word = word.strip()
        band = re.fullmatch(r"passive:([0-9.eE+]+)-([0-9.eE+]+)", word)
        if word == "stable":
            stable = True
        elif band is not None:
            passive.append(_band(word, band[1], band[2]))
        elif word:
            hint = (
                "in Hz, such as passive:100-2000"
                if word.startswith("passive")
                else near(word, _WORDS)
            )
            raise IbridError(
                f"--require takes stable and passive:LO-HI, found {word[:40]!r}; {hint}"
            )
    return Requirements(stable, tuple(passive))


def _band(word: str, low: str, high: str) -> tuple[float, float]:
    try:
        band = float(low), float(high)
    except ValueError:
        band = (0.0, 0.0)
    if not 0 < band[0] < band[1] < 1e7:
        raise IbridError(
            f"--require {word}: a band goes from a lower to a higher frequency in Hz, as "
            "passive:100-2000"
        )
    return band


def passivity_index(record: Record, op: str, low: float, high: float) -> float:
    """Least eigenvalue of -(Y + Y^H)/2 of the model from `low` to `high` Hz at an operating point,
    per unit.
    """
    count = max(2, int(_DENSITY * np.log10(high / low)) + 1)
    y = record.response(op, np.geomspace(low, high, count))
    return float(np.linalg.eigvalsh(-(y + np.conj(np.swapaxes(y, 1, 2))) / 2)[:, 0].min())
