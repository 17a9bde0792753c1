"""The reward that ranks candidates."""

import math

#: Keeps the logarithm finite for an exact fit.
SMALLEST_ERROR = 1e-8
#: What everything gets that has no fit; below the reward of any error under 1e40.
UNFITTED_REWARD = -100.0


def reward(nrmse: float | None) -> float:
    """-ln(NRMSE + 1e-8), equation (16) of the paper; -100 without a fit."""
    if nrmse is None or not math.isfinite(nrmse):
        return UNFITTED_REWARD
    return max(-math.log(nrmse + SMALLEST_ERROR), UNFITTED_REWARD + 1.0)
