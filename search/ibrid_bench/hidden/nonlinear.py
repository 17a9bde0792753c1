"""What a small-signal model cannot hold: a dead zone before the PLL, a limit of the current
reference.
"""

from dataclasses import dataclass
from math import isfinite

import casadi as ca

from ibrid.errors import IbridError

#: A limit that nothing reaches.
_NEVER = 1e9


@dataclass(frozen=True)
class Nonlinearity:
    """Thresholds, per unit. deadband : e_q is taken for zero up to it and less it beyond; 0: not
    there.
    limit : of the magnitude of the current reference, whose direction stays; None: not there.

    Raises IbridError for a threshold that is none.
    """

    deadband: float = 0.0
    limit: float | None = None

    def __post_init__(self) -> None:
        if not (isfinite(self.deadband) and self.deadband >= 0):
            raise IbridError(f"a deadband must be zero or positive; found {self.deadband:g}.")
        if self.limit is not None and not (isfinite(self.limit) and self.limit > 0):
            raise IbridError(f"a current limit must be positive; found {self.limit:g}.")

    @property
    def thresholds(self) -> tuple[float, float]:
        """Deadband and limit as the equations take them."""
        return self.deadband, _NEVER if self.limit is None else self.limit


def dead_zone(x: ca.SX, width: ca.SX) -> ca.SX:
    """0 where |x| <= width, x less the width beyond."""
    return ca.fmax(x - width, 0) + ca.fmin(x + width, 0)


def limited(x: ca.SX, limit: ca.SX) -> ca.SX:
    """A vector (2,) shortened to the limit where it is longer."""
    return x * ca.fmin(1, limit / ca.norm_2(x))
