"""How much better an answer is than those it is compared with, and what its reward is."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log
from types import MappingProxyType

import numpy as np
from ibrid_search.step import Status, Step, rl_reward
from scipy.optimize import root_scalar
from scipy.special import softmax, xlogy

#: Paper, section V.C.
EPSILON = 1e-6
#: Of the weights of answers from equal ones, nats: as if half of them counted.
DIVERGENCE = log(2.0)
#: Answers are compared by their rewards with the others of their group, which answer the same
#: question (the paper), or by what they gain on their parents with all of their batch.
BASELINES = ("group", "parent")


def mean_advantages(rewards: Sequence[float | None], floor: float = 0.0) -> np.ndarray | None:
    """(r - mean)/(max(std, floor) + 1e-6) over N answers, (N,), nan where a reward is not known
    (None).

    mean, std : of the known rewards, std with 1/N. floor : what the noise of a fit makes of equal
    answers; differences below it then stay small. None where nothing is taught: fewer than two
    known rewards, or all the same.
    """
    found, known = _known(rewards)
    if not _teaches(known):
        return None
    return (found - known.mean()) / (max(float(known.std()), floor) + EPSILON)


def entropic_advantages(rewards: Sequence[float | None], floor: float = 0.0) -> np.ndarray | None:
    """N q - 1 over N answers, (N,), with q = softmax(beta r); nan and None as for
    `mean_advantages`.

    For the sake of the best answer rather than the mean: the gradient is that of ln E exp(beta r) /
    beta. beta is where q lies ln 2 from the uniform distribution (Kullback-Leibler), at most 1 /
    floor. Source: M. Yuksekgonul et al., arXiv 2601.16175.
    """
    found, known = _known(rewards)
    if not _teaches(known):
        return None
    weights = np.full(len(found), np.nan)
    weights[np.isfinite(found)] = softmax(_sharpness(known, floor) * known)
    return known.size * weights - 1.0


def _sharpness(rewards: np.ndarray, floor: float) -> float:
    """beta; the divergence rises with it."""

    def beyond(beta: float) -> float:
        q = softmax(beta * rewards)
        return float(xlogy(q, q * rewards.size).sum()) - DIVERGENCE

    most = 1.0 / max(floor, EPSILON)
    return (
        float(root_scalar(beyond, bracket=(0.0, most), method="brentq").root)
        if beyond(most) > 0
        else most
    )


#: What is made better: the mean answer, or the best.
WAYS: Mapping[str, Callable[[Sequence[float | None], float], np.ndarray | None]] = MappingProxyType(
    {"mean": mean_advantages, "entropic": entropic_advantages}
)


def batch_advantages(
    rewards: Sequence[float | None],
    group: int,
    *,
    advantages: str,
    baseline: str,
    floor: float,
    least: float = -inf,
) -> list[np.ndarray | None]:
    """Advantages of the answers of a batch, an array for each group of so many.

    advantages : of `WAYS`. baseline : of `BASELINES`; "group" compares the answers of each group,
    "parent" those of the batch.
    least : what the best of those compared must lie above. None for a group that teaches nothing:
    what is compared is all alike as far as it is known, the best of it is not good enough, or none
    of the group is known.
    """

    def compared(some: Sequence[float | None]) -> np.ndarray | None:
        best = max((one for one in some if one is not None), default=-inf)
        return WAYS[advantages](some, floor) if best > least else None

    if baseline == "group":
        return [compared(rewards[first : first + group]) for first in range(0, len(rewards), group)]
    found = compared(rewards)
    if found is None:
        return [None] * (len(rewards) // group)
    return [part if np.isfinite(part).any() else None for part in found.reshape(-1, group)]


def _known(rewards: Sequence[float | None]) -> tuple[np.ndarray, np.ndarray]:
    """All rewards, nan where there is none, and those that are known."""
    found = np.array([np.nan if one is None else one for one in rewards], dtype=float)
    return found, found[np.isfinite(found)]


def _teaches(known: np.ndarray) -> bool:
    return bool(known.size >= 2 and known.max() > known.min())


@dataclass(frozen=True)
class Rewarded:
    """`reward` : None for a lost worker.

    `status` : how the step, or its twin in this batch, ended. `sibling` : True when another answer
    of the batch had the same structure before.
    """

    reward: float | None
    status: Status
    sibling: bool


def gain(one: Rewarded, parent: Step, most: float) -> float | None:
    """What an answer gains on the step that it edits: max(R, 0) - max(R_parent, 0) within 0 and
    `most` for a valid one, with R of `ibrid.evaluation.outcome`, so ln(NRMSE_parent / NRMSE) below
    errors of 1; the penalty of any other, None for a lost one.
    """
    if one.status is not Status.OK or one.reward is None:
        return one.reward
    before = rl_reward(Status.OK, parent.reward)
    return None if before is None else min(max(one.reward - before, 0.0), most)


def rewarded(step: Step, steps: Sequence[Step], first: int) -> Rewarded:
    """The reward of a step of the batch whose first step is `first`.

    A structure that was known before the batch counts as unchanged (-0.3); one that an earlier
    answer of the batch has, as that answer.
    """
    if step.status is Status.DUPLICATE and step.same_as is not None and step.same_as >= first:
        twin = steps[step.same_as]
        return Rewarded(rl_reward(twin.status, twin.reward), twin.status, True)
    return Rewarded(rl_reward(step.status, step.reward), step.status, False)
