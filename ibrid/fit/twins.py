"""Discrete twins: other parameter values that give the same admittance exactly, or nearly.

The zeros of two PI controllers in cascade can be swapped: kP_i' = kI_i kP_o / kI_o, kP_o' = kP_i kI_o / kI_i and
R_F' = R_F + kP_i - kP_i' leave the terminal response unchanged when all outer loops share their gains, the current is
measured unfiltered and no delay lies in the loop. Otherwise the swap is a good start for a second minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.corner_swap import CornerSwap
from ibrid.fit.problem import Problem
from ibrid.modules.behaviour import Element
from ibrid.signals import Signal
from ibrid.structure.reading.wiring import Wiring


@dataclass(frozen=True)
class Swap:
    """Entries of x that take part: inner and outer gains and the filter resistance."""

    inner: tuple[int, int]
    outer: tuple[tuple[int, int], ...]
    resistance: int

    @property
    def entries(self) -> tuple[int, ...]:
        """All entries of x that take part."""
        return (*self.inner, *(index for pair in self.outer for index in pair), self.resistance)

    def implausibility(self, x: np.ndarray) -> float:
        """R_F, in search coordinates: of the two, the twin with the larger one is the less plausible."""
        return float(x[self.resistance])

    def apply(self, theta: np.ndarray) -> np.ndarray:
        """Physical values with the zeros swapped."""
        k_p, k_i = (theta[index] for index in self.inner)
        ratios = [theta[p] / theta[i] for p, i in self.outer]
        other = theta.copy()
        swapped = k_i * float(np.exp(np.mean(np.log(ratios))))
        other[self.inner[0]] = swapped
        for p, i in self.outer:
            other[p] = k_p * theta[i] / k_i
        other[self.resistance] = theta[self.resistance] + k_p - swapped
        return other


def find_swaps(problem: Problem, wiring: Wiring) -> tuple[Swap, ...]:
    """Every cascade of scalar PI blocks, packed to dq, into a PI block on both axes, where the gains and R_F are free."""
    entry = {member: index for index, one in enumerate(problem.numbers) for member in one.parameter.members}
    resistance = entry.get((wiring.plant, "R_F"))

    def gains(name: str) -> tuple[int, int]:
        proportional, integral = wiring.kinds[name].parameters
        return entry.get((name, proportional), -1), entry.get((name, integral), -1)

    swaps = []
    for inner in wiring.having(Element.PI, signal=Signal.DQ_VEC):
        outer = {
            gains(name)
            for pack in wiring.makers(f"{inner}.in_", Element.PACK)
            for axis in wiring.kinds[pack].inputs
            for name in wiring.makers(f"{pack}.{axis}", Element.PI)
        }
        own = gains(inner)
        if resistance is not None and outer and min(own) >= 0 and all(min(pair) >= 0 for pair in outer):
            swaps.append(Swap(own, tuple(sorted(outer)), resistance))
    return tuple(swaps)


def twins_of(problem: Problem, swaps: Sequence[Swap | CornerSwap], x: np.ndarray) -> list[np.ndarray]:
    """The twins of x; one outside the boxes is moved to their edges, which the noise may have let it cross."""
    coordinates = problem.coordinates
    found = [swap.apply(coordinates.to_theta(x)) for swap in swaps]
    return [
        coordinates.to_x(np.clip(one, coordinates.low, coordinates.high)) for one in found if np.isfinite(one).all()
    ]
