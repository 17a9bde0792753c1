"""Log-probabilities of given answers to one question under a causal language model; the question is read once.

What the model keeps of the question (keys and values) is shared by the answers, with its gradient, so a group costs one
question and its answers, not one question for each answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor


@dataclass(frozen=True)
class Scored:
    """(N, L) each: `logprobs` and `entropy` (nats) at every token, `real` where there is one; 0 elsewhere."""

    logprobs: Tensor
    entropy: Tensor
    real: Tensor


def score(
    model: Any,
    prompt: Sequence[int],
    answers: Sequence[Sequence[int]],
    masks: Sequence[np.ndarray | None],
    pad: int,
) -> Scored:
    """What the model says of each token of each answer, with gradient where gradients are on.

    model : takes input_ids, past_key_values, use_cache, logits_to_keep as those of transformers do.
    masks : for each answer the tokens that were allowed at each place, (L_i, V), or None for all.
    """
    device = next(model.parameters()).device
    longest = max(len(one) for one in answers)
    tokens = torch.tensor([[*one, *[pad] * (longest - len(one))] for one in answers], device=device)
    real = torch.tensor([[place < len(one) for place in range(longest)] for one in answers], device=device)
    asked = torch.tensor([list(prompt)], device=device)
    read = model(input_ids=asked, use_cache=True, logits_to_keep=1)
    logits = read.logits.float().expand(len(answers), -1, -1)
    if longest > 1:
        kept = read.past_key_values
        kept.batch_repeat_interleave(len(answers))
        said = model(input_ids=tokens[:, :-1], past_key_values=kept, use_cache=True)
        logits = torch.cat([logits, said.logits.float()], dim=1)
    allowed = _allowed(masks, logits.shape, device)
    if allowed is not None:
        logits = logits.masked_fill(~allowed, -torch.inf)
    distribution = torch.log_softmax(logits, dim=-1)
    logprobs = distribution.gather(2, tokens[:, :, None])[:, :, 0]
    with torch.no_grad():
        finite = distribution.clamp(min=torch.finfo(distribution.dtype).min)
        entropy = -(finite.exp() * finite).sum(-1)
    return Scored(torch.where(real, logprobs, 0.0), torch.where(real, entropy, 0.0), real)


def _allowed(masks: Sequence[np.ndarray | None], shape: torch.Size, device: torch.device) -> Tensor | None:
    """(N, L, V) bool; everything is allowed at places that hold no token. None when nothing is forbidden."""
    if all(one is None for one in masks):
        return None
    found = np.ones(tuple(shape), dtype=bool)
    for row, mask in zip(found, masks, strict=True):
        if mask is not None:
            row[: len(mask), : mask.shape[1]] = mask
            row[: len(mask), mask.shape[1] :] = False
    return torch.from_numpy(found).to(device)
