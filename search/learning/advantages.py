"""How much better an answer is than the others to the same question, and what its reward is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from search.step import Status, Step, rl_reward

#: Paper, section V.C.
EPSILON = 1e-6


def group_advantages(rewards: Sequence[float | None], floor: float = 0.0) -> np.ndarray | None:
    """(r - mean)/(max(std, floor) + 1e-6) over a group, (N,), nan where a reward is not known (None).

    mean, std : of the known rewards, std with 1/N. floor : what the noise of a fit makes of equal answers; differences
    below it then stay small. None for a group that teaches nothing: fewer than two known rewards, or all the same.
    """
    found = np.array([np.nan if one is None else one for one in rewards], dtype=float)
    known = found[np.isfinite(found)]
    if known.size < 2 or known.max() == known.min():
        return None
    return (found - known.mean()) / (max(float(known.std()), floor) + EPSILON)


@dataclass(frozen=True)
class Rewarded:
    """`reward` : None for a lost worker. `status` : how the step, or its twin in this batch, ended. `sibling` : True when
    another answer of the batch had the same structure before."""

    reward: float | None
    status: Status
    sibling: bool


def rewarded(step: Step, steps: Sequence[Step], first: int) -> Rewarded:
    """The reward of a step of the batch whose first step is `first`.

    A structure that was known before the batch counts as unchanged (-0.3); one that an earlier answer of the batch has, as
    that answer.
    """
    if step.status is Status.DUPLICATE and step.same_as is not None and step.same_as >= first:
        twin = steps[step.same_as]
        return Rewarded(rl_reward(twin.status, twin.reward), twin.status, True)
    return Rewarded(rl_reward(step.status, step.reward), step.status, False)
