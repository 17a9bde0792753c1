"""Whether the served weights are the trained ones: log-probabilities of a few fresh answers,
served, and under the weights before and after an update.
"""

from dataclasses import dataclass
from math import hypot, isfinite, sqrt

import numpy as np

#: What rounding in single precision makes of a log-probability.
ROUNDING = 1e-6
#: How far from the trained weights, in updates, others are served, and so many standard errors make
#: it sure.
FAR, SURE = 0.5, 3.0


@dataclass(frozen=True)
class Probe:
    """`drift` : mean |served - trained|.

    `share` : of the update that the served weights have, 1 for the trained ones and 0 for those
    before; None where the update moved none of these log-probabilities. `error` : its standard
    error.
    """

    drift: float
    share: float | None
    error: float

    @property
    def told(self) -> bool:
        """True where the probe can tell the weights after the update from others."""
        return self.share is not None and abs(abs(self.share - 1.0) - FAR) > SURE * self.error

    @property
    def other(self) -> bool:
        """True where the served weights are others than those after the update."""
        return self.told and self.share is not None and abs(self.share - 1.0) > FAR


def probe(served: np.ndarray, before: np.ndarray, after: np.ndarray) -> Probe:
    """What log-probabilities of the same n tokens, (n,) each, say about the served weights.

    The share s is the least-squares solution of served - before = s (after - before); its error is
    that of the regression, with what is left over and `ROUNDING` as noise. So serving in another
    precision widens the error rather than moving the share.
    """
    drift = float(np.abs(served - after).mean())
    change, seen = after - before, served - before
    size = float(np.linalg.norm(change))
    if size == 0.0 or not isfinite(size) or not np.isfinite(seen).all():
        return Probe(drift, None, 0.0)
    share = float(change @ seen) / size**2
    left = float(np.linalg.norm(seen - share * change)) / sqrt(max(len(change) - 1, 1))
    return Probe(drift, share, hypot(left, ROUNDING) / size)
