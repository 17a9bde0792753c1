"""A near twin of a cascade that damps with the fast part of the voltage: two slow corners exchanged.

With u_r = (kP + kI/s)(i_ref - i) + k (e - omega_c/(s + omega_c) e), the axes decoupled, the current obeys

    (L/omega_0 s + R + kP + kI/s) i = (kP + kI/s) i_ref - (1 - (k s)/(s + omega_c)) e

whose left side is L/omega_0 (s + a)(s + b)/s with a fast a and a slow b. In the response to e, b and omega_c can be exchanged,
L and 1 - k scaled by b/omega_c. In that to i_ref nothing changes where the zero kI/kP lies on b, that is where the controller is
tuned to cancel the filter's pole, kI/kP = omega_0 R/L; otherwise the exchange is a good start for a second minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.problem import Problem
from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.structure.reading.wiring import PLANT, Wiring

#: Half width of what is drawn anew, of logarithms, and where the corner is drawn, rad/s.
SPREAD, SLOW = 2.0, (3.0, 3000.0)


@dataclass(frozen=True)
class CornerSwap:
    """Entries of x that take part. `filter` : L_F and R_F. `inner` : kP and kI of the current control. `damping` : gain and
    corner. `couplings` : inductances that are scaled with L_F. `typical` : of L_F in x."""

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
        """Of the two, the one whose inductance is further from what is typical is the less plausible."""
        return abs(float(x[self.filter[0]]) - self.typical)

    def apply(self, theta: np.ndarray) -> np.ndarray:
        """Physical values with the corners exchanged; not numbers where the loop has no slow real corner."""
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
        """Physical values with the same fast dynamics and other slow corners: scale, corner, kI and R drawn anew."""
        scale, integral, resistance = np.exp(rng.uniform(-SPREAD, SPREAD, 3))
        other = theta.copy()
        other[[self.filter[0], self.inner[0], *self.couplings]] *= scale
        other[self.damping[0]] = 1 - scale * (1 - theta[self.damping[0]])
        other[self.damping[1]] = np.exp(rng.uniform(*np.log(SLOW)))
        other[self.inner[1]] *= integral
        other[self.filter[1]] *= resistance
        return other


def corner_swaps(problem: Problem, wiring: Wiring, omega_0: float) -> tuple[CornerSwap, ...]:
    """One for each plant with a current control and such a damping beside it, where the numbers are free and its own."""
    entry = {member: index for index, one in enumerate(problem.numbers) for member in one.parameter.members}

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
        couplings = tuple(one for element in COUPLINGS for name in wiring.makers(command, element) for one in at(name))
        if all(len(group) == 2 for group in groups):
            swaps.append(CornerSwap(*groups, couplings, float(problem.typical[groups[0][0]]), omega_0))
    return tuple(swaps)


def _slow_parts(wiring: Wiring, gain: str, voltage: str) -> Sequence[str]:
    """The low-pass of a voltage that a gain gets less, beside that voltage itself."""
    if voltage not in wiring.sources[f"{gain}.in_"]:
        return ()
    signs = wiring.makers(f"{gain}.in_", Element.SIGN)
    filters = [name for sign in signs for name in wiring.makers(f"{sign}.in_", Element.LOW_PASS)]
    return [name for name in filters if wiring.kinds[name].order == 2 and wiring.sources[f"{name}.in_"] == (voltage,)]
