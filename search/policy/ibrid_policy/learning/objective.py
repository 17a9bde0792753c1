"""The objective of a group (paper, section V.C) as pure functions of token log-probabilities;
torch.

All of them take (N, L) arrays: N answers to one question, padded to L tokens, and `real`, True
where there is a token.
"""

from dataclasses import dataclass

import torch  # pyright: ignore[reportMissingImports]
from torch import Tensor  # pyright: ignore[reportMissingImports]


@dataclass(frozen=True)
class Objective:
    """`value` : J, to be made larger.

    The rest are means over tokens, for the page: `clipped` : share whose gradient the clip took
    away. `weight`, `largest_weight` : of importance.
    """

    value: Tensor
    clipped: float
    weight: float
    largest_weight: float


def token_ratios(new: Tensor, old: Tensor) -> Tensor:
    """r = pi_new / pi_old of each token."""
    return torch.exp(new - old)


def importance_weights(train: Tensor, serve: Tensor, most: float = 2.0) -> Tensor:
    """w = min(pi_train / pi_serve, most), without a gradient."""
    return torch.exp(train.detach() - serve).clamp(max=most)


def surrogate(ratio: Tensor, advantage: Tensor, low: float = 0.2, high: float = 0.28) -> Tensor:
    """min(r A, clip(r, 1 - low, 1 + high) A) of each token; advantage : (N, 1)."""
    return torch.minimum(ratio * advantage, ratio.clamp(1 - low, 1 + high) * advantage)


def over_answers(tokens: Tensor, real: Tensor) -> Tensor:
    """Mean over the tokens of each answer, 1/L_i, then over the answers."""
    return ((tokens * real).sum(1) / real.sum(1).clamp(min=1)).mean()


def divergence(new: Tensor, start: Tensor) -> Tensor:
    """Estimate of KL(new || start) from a token drawn from `new`: x - 1 - ln x with x = pi_start /
    pi_new, never negative.
    """
    return torch.exp(start - new) - 1 - (start - new)


def group_objective(
    new: Tensor,
    old: Tensor,
    serve: Tensor,
    advantages: Tensor,
    real: Tensor,
    *,
    low: float = 0.2,
    high: float = 0.28,
    most: float = 2.0,
) -> Objective:
    """J = mean over answers of 1/L sum over tokens of w min(r A, clip(r) A).

    new : log-probabilities with gradient. old : of the trainer before the update. serve : of the
    sampler. advantages : (N,).
    """
    ratio, advantage = token_ratios(new, old), advantages[:, None]
    weight = importance_weights(old, serve, most)
    tokens = surrogate(ratio, advantage, low, high)
    beyond = ((ratio > 1 + high) & (advantage > 0)) | ((ratio < 1 - low) & (advantage < 0))
    number = real.sum().clamp(min=1)
    return Objective(
        value=over_answers(weight * tokens, real),
        clipped=float((beyond & real).sum() / number),
        weight=float((weight * real).sum() / number),
        largest_weight=float(torch.where(real, weight, 0.0).max()),
    )
