"""Log-probabilities of given answers to one question under a causal language model; the question is
read once where it can be.

The answers stand behind the question side by side in one sequence, each token at the place in which
its answer has it, and a mask lets an answer see the question and its own beginning. So a group
costs one question and its answers, nothing is padded, and the gradient is the one that each answer
would have alone. A model whose attention has a window, goes by the distance in the sequence or is
none reads each answer alone behind the question, at the cost of a question each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import Tensor  # pyright: ignore[reportMissingImports]
from transformers.cache_utils import DynamicLayer  # pyright: ignore[reportMissingImports]

from ibrid_policy.backend import read_so_far


@dataclass(frozen=True)
class Scored:
    """(N, L) each: `logprobs` and `entropy` (nats) at every token, `real` where there is one; 0
    elsewhere.
    """

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

    model : of transformers, causal; takes input_ids, use_cache and logits_to_keep.
    masks : for each answer the tokens that were allowed at each place, (L_i, V), or None for all.
    """
    device = next(model.parameters()).device
    tokens = torch.tensor([token for one in answers for token in one], device=device)
    lengths = torch.tensor([len(one) for one in answers])
    real = torch.arange(int(lengths.max()))[None] < lengths[:, None]
    logits = (_side_by_side if side_by_side(model) else _each_alone)(model, prompt, answers)
    distribution = _log_softmax(logits, _allowed(masks, lengths.tolist()))
    logprobs = distribution.gather(1, tokens[:, None])[:, 0]
    with torch.no_grad():
        finite = distribution.clamp(min=torch.finfo(distribution.dtype).min)
        entropy = -(finite.exp() * finite).sum(-1)
    real = real.to(device)
    padded = torch.zeros(real.shape, dtype=logprobs.dtype, device=device)
    return Scored(padded.masked_scatter(real, logprobs), padded.masked_scatter(real, entropy), real)


def side_by_side(model: Any) -> bool:
    """Whether answers that stand side by side in one cache are read as each would be alone; found
    once for a model.

    Its cache must keep every token, since a window shows only where a question is longer than it;
    then both ways must say the same of a made-up question, to the square root of the precision of
    the weights.
    """
    if model not in _EXACT:
        _EXACT[model] = _exact(model)
    return _EXACT[model]


#: What `side_by_side` found.
_EXACT: WeakKeyDictionary[Any, bool] = WeakKeyDictionary()
#: A question and answers for the comparison; of different lengths, and so that an order that is
#: mixed up shows.
QUESTION, ANSWERS = (1, 2, 3, 2), ((3, 1, 2), (2, 3))


@torch.no_grad()
def _exact(model: Any) -> bool:
    weight = next(model.parameters())
    try:
        read = model(
            input_ids=torch.tensor([QUESTION], device=weight.device),
            use_cache=True,
            logits_to_keep=1,
        )
        (kept,) = read_so_far(read).values()
        if not all(type(layer) is DynamicLayer for layer in kept.layers):
            return False
        found = _side_by_side(model, QUESTION, ANSWERS)
    except (
        RuntimeError,
        ValueError,
        AttributeError,
        TypeError,
        IndexError,
    ):  # its forward knows no such mask or cache
        return False
    alone = _each_alone(model, QUESTION, ANSWERS)
    return bool(
        (found - alone).abs().max() <= torch.finfo(weight.dtype).eps ** 0.5 * alone.abs().max()
    )


def _side_by_side(model: Any, prompt: Sequence[int], answers: Sequence[Sequence[int]]) -> Tensor:
    """What the model says before each token of all answers in turn, (T, V), by one pass over all
    answers.
    """
    device = next(model.parameters()).device
    read = model(
        input_ids=torch.tensor([list(prompt)], device=device), use_cache=True, logits_to_keep=1
    )
    said = [read.logits[0].float()]
    behind = [
        (row, place, token)
        for row, one in enumerate(answers)
        for place, token in enumerate(one[:-1])
    ]
    if behind:
        rows, places, given = torch.tensor(behind, device=device).T
        own = (rows[:, None] == rows) & (places[:, None] >= places)
        seen = torch.cat([own.new_ones(len(rows), len(prompt)), own], dim=1)
        after = model(
            input_ids=given[None],
            position_ids=(len(prompt) + places)[None],
            attention_mask=seen[None, None],
            use_cache=True,
            **read_so_far(read),
        )
        said.append(after.logits[0].float())
    where, row = [], 0
    for one in answers:
        where += [0, *range(row + 1, row + len(one))]
        row += len(one) - 1
    return torch.cat(said)[torch.tensor(where, device=device)]


def _each_alone(model: Any, prompt: Sequence[int], answers: Sequence[Sequence[int]]) -> Tensor:
    """The same as `_side_by_side`, by one pass over the question with each answer."""
    device = next(model.parameters()).device
    said = []
    for one in answers:
        row = torch.tensor([[*prompt, *one[:-1]]], device=device)
        said.append(
            model(input_ids=row, use_cache=False, logits_to_keep=len(one))
            .logits[0, -len(one) :]
            .float()
        )
    return torch.cat(said)


def _log_softmax(logits: Tensor, allowed: np.ndarray | None) -> Tensor:
    if allowed is not None:
        room = np.zeros((len(allowed), logits.shape[1] - allowed.shape[1]), dtype=bool)
        logits = logits.masked_fill(
            ~torch.from_numpy(np.hstack([allowed, room])).to(logits.device), -torch.inf
        )
    return torch.log_softmax(logits, dim=-1)


def _allowed(masks: Sequence[np.ndarray | None], lengths: Sequence[int]) -> np.ndarray | None:
    """The masks of all answers in turn, (T, V); None when nothing is forbidden."""
    size = next((mask.shape[1] for mask in masks if mask is not None), None)
    if size is None:
        return None
    every = zip(masks, lengths, strict=True)
    return np.vstack(
        [np.ones((length, size), dtype=bool) if mask is None else mask for mask, length in every]
    )
