"""Log-probabilities of given answers to one question under a causal language model; the question is read once.

The answers stand behind the question side by side in one sequence, each token at the place in which its answer has it, and a
mask lets an answer see the question and its own beginning. So a group costs one question and its answers, nothing is
padded, and the gradient is the one that each answer would have alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import Tensor  # pyright: ignore[reportMissingImports]


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
) -> Scored:
    """What the model says of each token of each answer, with gradient where gradients are on.

    model : takes input_ids, position_ids, attention_mask (1, 1, tokens, seen), past_key_values, use_cache and logits_to_keep as
    the decoders of transformers do.
    masks : for each answer the tokens that were allowed at each place, (L_i, V), or None for all.
    """
    device = next(model.parameters()).device
    tokens = torch.tensor([token for one in answers for token in one], device=device)
    lengths = torch.tensor([len(one) for one in answers])
    real = torch.arange(int(lengths.max()))[None] < lengths[:, None]
    distribution = _log_softmax(_logits(model, prompt, answers, device), _allowed(masks, lengths.tolist()))
    logprobs = distribution.gather(1, tokens[:, None])[:, 0]
    with torch.no_grad():
        finite = distribution.clamp(min=torch.finfo(distribution.dtype).min)
        entropy = -(finite.exp() * finite).sum(-1)
    real = real.to(device)
    padded = torch.zeros(real.shape, dtype=logprobs.dtype, device=device)
    return Scored(padded.masked_scatter(real, logprobs), padded.masked_scatter(real, entropy), real)


def _logits(model: Any, prompt: Sequence[int], answers: Sequence[Sequence[int]], device: torch.device) -> Tensor:
    """What the model says before each token of all answers in turn, (T, V)."""
    read = model(input_ids=torch.tensor([list(prompt)], device=device), use_cache=True, logits_to_keep=1)
    said = [read.logits[0].float()]
    behind = [(row, place, token) for row, one in enumerate(answers) for place, token in enumerate(one[:-1])]
    if behind:
        rows, places, given = torch.tensor(behind, device=device).T
        own = (rows[:, None] == rows) & (places[:, None] >= places)
        seen = torch.cat([own.new_ones(len(rows), len(prompt)), own], dim=1)
        after = model(
            input_ids=given[None],
            position_ids=(len(prompt) + places)[None],
            attention_mask=seen[None, None],
            past_key_values=read.past_key_values,
            use_cache=True,
        )
        said.append(after.logits[0].float())
    where, row = [], 0
    for one in answers:
        where += [0, *range(row + 1, row + len(one))]
        row += len(one) - 1
    return torch.cat(said)[torch.tensor(where, device=device)]


def _log_softmax(logits: Tensor, allowed: np.ndarray | None) -> Tensor:
    if allowed is not None:
        room = np.zeros((len(allowed), logits.shape[1] - allowed.shape[1]), dtype=bool)
        logits = logits.masked_fill(~torch.from_numpy(np.hstack([allowed, room])).to(logits.device), -torch.inf)
    return torch.log_softmax(logits, dim=-1)


def _allowed(masks: Sequence[np.ndarray | None], lengths: Sequence[int]) -> np.ndarray | None:
    """The masks of all answers in turn, (T, V); None when nothing is forbidden."""
    size = next((mask.shape[1] for mask in masks if mask is not None), None)
    if size is None:
        return None
    every = zip(masks, lengths, strict=True)
    return np.vstack([np.ones((length, size), dtype=bool) if mask is None else mask for mask, length in every])
