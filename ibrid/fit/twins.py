"""Discrete twins: other parameter values that give the same admittance exactly, or nearly.

The zeros of two PI controllers in cascade can be swapped (`Swap`): kP_i' = kI_i kP_o / kI_o, kP_o'
= kP_i kI_o / kI_i and R_F' = R_F + kP_i - kP_i' leave the terminal response unchanged when all
outer loops share their gains, the current is measured unfiltered and no delay lies in the loop.
Otherwise the swap is a good start for a second minimum.

Two slow corners of a cascade that damps with the fast part of the voltage can be exchanged
(`CornerSwap`), nearly. With u_r = (kP + kI/s)(i_ref - i) + k (e - omega_c/(s + omega_c) e), the
axes decoupled, the current obeys

    (L/omega_0 s + R + kP + kI/s) i = (kP + kI/s) i_ref - (1 - (k s)/(s + omega_c)) e

whose left side is L/omega_0 (s + a)(s + b)/s with a fast a and a slow b. In the response to e, b
and omega_c can be exchanged, L and 1 - k scaled by b/omega_c. In that to i_ref nothing changes
where the zero kI/kP lies on b, that is where the controller is tuned to cancel the filter's pole,
kI/kP = omega_0 R/L; otherwise the exchange is a good start for a second minimum.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.problem import Coordinates, Problem
from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.signals import Signal
from ibrid.structure.reading.wiring import PLANT, Wiring

#: Half width of what is drawn anew, of logarithms, and where the corner is drawn, rad/s.
SPREAD, SLOW = 2.0, (3.0, 3000.0)


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
        """R_F, in search coordinates: of the two, the twin with the larger one is the less
        plausible.
        """
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


@dataclass(frozen=True)
class CornerSwap:
    """Entries of x that take part.

    `filter` : L_F and R_F. `inner` : kP and kI of the current control. `damping` : gain and corner.
    `couplings` : inductances that are scaled with L_F. `typical` : of L_F in x.
    """

    filter: tuple[int, ...]
    inner: tuple[int, ...]
    damping: tuple[int, ...]
    couplings: tuple[int, ...]
    typical: float
    omega_0: float

    @property
    def entries(self) -> tuple[int, ...]:
        """All entries of x that take part."""
        return (*self.inner, *self.filter, *self.damping, *self.couplings)

    def implausibility(self, x: np.ndarray) -> float:
        """Of the two, the one whose inductance is further from what is typical is the less
        plausible.
        """
        return abs(float(x[self.filter[0]]) - self.typical)

    def apply(self, theta: np.ndarray) -> np.ndarray:
        """Physical values with the corners exchanged; not numbers where the loop has no slow real
        corner.
        """
        (at_l, at_r), (at_p, at_i), (at_k, at_c) = self.filter, self.inner, self.damping
        inductance, resistance = theta[at_l] / self.omega_0, theta[at_r] + theta[at_p]
        inside = resistance**2 - 4 * inductance * theta[at_i]
        root = np.sqrt(inside) if inside >= 0 else np.nan
        slow, fast = 2 * theta[at_i] / (resistance + root), (resistance + root) / (2 * inductance)
        scale = slow / theta[at_c]
        other = theta.copy()
        other[[at_l, at_p, *self.couplings]] *= scale
        other[at_r] = scale * inductance * (fast + theta[at_c]) - other[at_p]
        other[at_k] = 1 - scale * (1 - theta[at_k])
        other[at_c] = slow
        return other

    def spread(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Physical values with the same fast dynamics and other slow corners: scale, corner, kI and
        R drawn anew.
        """
        scale, integral, resistance = np.exp(rng.uniform(-SPREAD, SPREAD, 3))
        other = theta.copy()
        other[[self.filter[0], self.inner[0], *self.couplings]] *= scale
        other[self.damping[0]] = 1 - scale * (1 - theta[self.damping[0]])
        other[self.damping[1]] = np.exp(rng.uniform(*np.log(SLOW)))
        other[self.inner[1]] *= integral
        other[self.filter[1]] *= resistance
        return other


@dataclass(frozen=True)
class Twins:
    """The exchanges that a diagram admits: of the zeros of `cascades`, and of slow `corners`."""

    cascades: tuple[Swap, ...]
    corners: tuple[CornerSwap, ...]


def find_twins(problem: Problem, wiring: Wiring, omega_0: float) -> Twins:
    """The exchanges among the free numbers of a problem, which is of this wiring."""
    entry = {
        member: index
        for index, one in enumerate(problem.numbers)
        for member in one.parameter.members
    }
    return Twins(_cascades(entry, wiring), _corners(entry, wiring, problem.typical, omega_0))


def _cascades(entry: Mapping[tuple[str, str], int], wiring: Wiring) -> tuple[Swap, ...]:
    """Every cascade of scalar PI blocks, packed to dq, into a PI block on both axes, where the
    gains and R_F are free.

    entry : (instance, parameter) -> its place in x.
    """
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
        if (
            resistance is not None
            and outer
            and min(own) >= 0
            and all(min(pair) >= 0 for pair in outer)
        ):
            swaps.append(Swap(own, tuple(sorted(outer)), resistance))
    return tuple(swaps)


def _corners(
    entry: Mapping[tuple[str, str], int], wiring: Wiring, typical: np.ndarray, omega_0: float
) -> tuple[CornerSwap, ...]:
    """One for each plant with a current control and such a damping beside it, where the numbers are
    free and its own.
    """

    def at(name: str, *parameters: str) -> tuple[int, ...]:
        chosen = parameters or wiring.kinds[name].parameters
        return tuple(entry[name, one] for one in chosen if (name, one) in entry)

    swaps = []
    for plant in (name for name, kind in wiring.kinds.items() if kind.family == PLANT):
        command, voltage = f"{plant}.u_r", f"{plant}.e"
        regulators, gains = wiring.makers(command, Element.PI), wiring.makers(command, Element.GAIN)
        pairs = [(gain, slow) for gain in gains for slow in _slow_parts(wiring, gain, voltage)]
        if len(regulators) != 1 or len(pairs) != 1:
            continue
        (inner,), ((gain, slow),) = regulators, pairs
        groups = at(plant, "L_F", "R_F"), at(inner), (*at(gain), *at(slow))
        couplings = tuple(
            one
            for element in COUPLINGS
            for name in wiring.makers(command, element)
            for one in at(name)
        )
        if all(len(group) == 2 for group in groups):
            swaps.append(CornerSwap(*groups, couplings, float(typical[groups[0][0]]), omega_0))
    return tuple(swaps)


def _slow_parts(wiring: Wiring, gain: str, voltage: str) -> Sequence[str]:
    """The low-pass of a voltage that a gain gets less, beside that voltage itself."""
    if voltage not in wiring.sources[f"{gain}.in_"]:
        return ()
    signs = wiring.makers(f"{gain}.in_", Element.SIGN)
    filters = [name for sign in signs for name in wiring.makers(f"{sign}.in_", Element.LOW_PASS)]
    return [
        name
        for name in filters
        if wiring.kinds[name].order == 2 and wiring.sources[f"{name}.in_"] == (voltage,)
    ]


def twins_of(
    coordinates: Coordinates, swaps: Sequence[Swap | CornerSwap], x: np.ndarray
) -> list[np.ndarray]:
    """The twins of x; one outside the boxes is moved to their edges, which the noise may have let
    it cross.
    """
    found = [swap.apply(coordinates.to_theta(x)) for swap in swaps]
    return [
        coordinates.to_x(np.clip(one, coordinates.low, coordinates.high))
        for one in found
        if np.isfinite(one).all()
    ]
