"""How an evaluation can end, and the reward that ranks candidates; an illegal diagram or a failed
fit is no exception.
"""

import math
from enum import StrEnum


class Outcome(StrEnum):
    """`ok`: fitted.

    `invalid`: the grammar refuses the diagram. `failed`: no fit exists. `unfinished`: ended from
    outside, so that nothing is known; files of before say `timeout`.
    """

    OK = "ok"
    INVALID = "invalid"
    FAILED = "failed"
    UNFINISHED = "unfinished"

    @classmethod
    def _missing_(cls, value: object) -> "Outcome | None":
        return cls.UNFINISHED if value == "timeout" else None


#: Keeps the logarithm finite for an exact fit.
SMALLEST_ERROR = 1e-8
#: What everything gets that has no fit; below the reward of any error under 1e40.
UNFITTED_REWARD = -100.0


def reward(nrmse: float | None) -> float:
    """-ln(NRMSE + 1e-8), equation (16) of the paper; -100 without a fit."""
    if nrmse is None or not math.isfinite(nrmse):
        return UNFITTED_REWARD
    return max(-math.log(nrmse + SMALLEST_ERROR), UNFITTED_REWARD + 1.0)
