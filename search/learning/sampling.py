"""Independent answers of a causal language model to one question, with the log-probability of every token; torch.

The question is read once. The answers stand behind it side by side in one sequence, each token at the place in which its
answer has it, and a mask lets an answer see the question and itself: so a long question is kept once, not once for each
answer. Temperature 1, nothing cut off: the log-probabilities are those of the distribution that was drawn from.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from search.policy.interface import Sampled

#: Tokens allowed after those of an answer so far, (V,) bool; None for all.
Guide = Callable[[tuple[int, ...]], np.ndarray | None]
#: Whom a token of the question belongs to.
EVERYBODY = -1


def sample_answers(
    model: Any,
    prompt: Sequence[int],
    number: int,
    *,
    end: Sequence[int],
    longest: int,
    seed: int,
    guide: Guide | None = None,
) -> list[Sampled]:
    """`number` answers of at most `longest` tokens; one that ends has the end token last.

    Tokens are drawn where the cumulated probability passes a random number; those are drawn before, one for every place,
    so an answer does not depend on when the others end.
    """
    device = next(model.parameters()).device
    chances = np.random.default_rng(seed).random((longest, number))
    answers: list[list[int]] = [[] for _ in range(number)]
    logprobs: list[list[float]] = [[] for _ in range(number)]
    going = list(range(number))
    owners = torch.full((len(prompt),), EVERYBODY)
    with torch.inference_mode():
        read = model(input_ids=torch.tensor([list(prompt)], device=device), use_cache=True, logits_to_keep=1)
        kept = read.past_key_values
        logits = read.logits[0].float().expand(number, -1)
        for place in range(longest):
            distribution = _distribution(logits, [tuple(answers[one]) for one in going], guide)
            chosen = _drawn(distribution, torch.from_numpy(chances[place, going]).to(device))
            said = distribution.gather(1, chosen[:, None])[:, 0].tolist()
            for one, token, logprob in zip(going, chosen.tolist(), said, strict=True):
                answers[one].append(token)
                logprobs[one].append(logprob)
            staying = [row for row, one in enumerate(going) if answers[one][-1] not in end]
            if not staying or place + 1 == longest:
                break
            chosen, going = chosen[staying], [going[row] for row in staying]
            rows = torch.tensor(going)
            owners = torch.cat([owners, rows])
            seen = (owners == EVERYBODY) | (owners == rows[:, None])
            logits = model(
                input_ids=chosen[None],
                position_ids=torch.full((1, len(going)), len(prompt) + place, device=device),
                attention_mask=seen[None, None].to(device),
                past_key_values=kept,
                use_cache=True,
            ).logits[0].float()  # fmt: skip
    return [Sampled(tuple(some), tuple(said)) for some, said in zip(answers, logprobs, strict=True)]


def _distribution(logits: torch.Tensor, before: Sequence[tuple[int, ...]], guide: Guide | None) -> torch.Tensor:
    """Log-probabilities, (rows, V), of what may come next."""
    if guide is not None:
        masks = [guide(one) for one in before]
        if any(mask is not None for mask in masks):
            allowed = np.zeros(tuple(logits.shape), dtype=bool)
            for row, mask in zip(allowed, masks, strict=True):
                row[:] = True if mask is None else np.concatenate([mask, np.zeros(len(row) - len(mask), dtype=bool)])
            logits = logits.masked_fill(~torch.from_numpy(allowed).to(logits.device), -torch.inf)
    return torch.log_softmax(logits, dim=-1)


def _drawn(distribution: torch.Tensor, chances: torch.Tensor) -> torch.Tensor:
    """The tokens at which the cumulated probability passes `chances`; never one of probability zero."""
    cumulated = distribution.double().exp().cumsum(-1)
    wanted = chances[:, None] * cumulated[:, -1:]
    chosen = torch.searchsorted(cumulated, wanted, right=True)[:, 0]
    return torch.where(chosen < distribution.shape[1], chosen, distribution.argmax(-1))  # rounding at the very end
