"""What is kept of the updates of a run, short enough for a ledger of hundreds of runs."""

from collections.abc import Sequence
from itertools import pairwise

from ibrid_policy.learning.updates import Update, mean_of_known

#: Of `ibrid_policy.learning.updates.Update`.
TOLD = (
    "reward",
    "gain",
    "valid",
    "siblings",
    "entropy",
    "divergence",
    "clipped",
    "gradient",
    "drift",
)
PARTS = 8


def told(updates: Sequence[Update]) -> list[dict[str, float | None]]:
    """Means over each of `PARTS` parts of the updates, in their order and of about equal length, to
    four digits; None where nothing is known. A part for each update where there are fewer.
    """
    ends = [len(updates) * number // PARTS for number in range(PARTS + 1)]
    parts = [updates[begin:end] for begin, end in pairwise(ends) if end > begin]
    return [
        {name: _short(mean_of_known(getattr(one, name) for one in part)) for name in TOLD}
        for part in parts
    ]


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")
