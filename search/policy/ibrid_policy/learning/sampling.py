"""Independent answers of a causal language model to one question, with the log-probability of every
token; torch.

The question is read once. The answers stand behind it side by side in one sequence, each token at
the place in which its answer has it, and a mask lets an answer see the question and itself: so a
long question is kept once, not once for each answer. Where a model does not read answers so
(`scoring.side_by_side`), transformers generates one after the other. Temperature 1, nothing cut
off: the log-probabilities are those of the distribution that was drawn from.
"""

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from transformers import GenerationConfig  # pyright: ignore[reportMissingImports]

from ibrid.errors import IbridError
from ibrid_policy.backend import read_so_far
from ibrid_policy.interface import Sampled
from ibrid_policy.learning.scoring import QUESTION, score, side_by_side

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

    Tokens are drawn where the cumulated probability passes a random number; those are drawn before,
    one for every place, so an answer does not depend on when the others end.
    """
    chances = np.random.default_rng(seed).random((longest, number))
    if side_by_side(model):
        return _side_by_side(model, prompt, chances, end, guide)
    return [_alone(model, prompt, own, end, guide) for own in chances.T]


def require_causal(model: Any, name: str) -> None:
    """Raise IbridError unless the model can be sampled and finds, when its answers are scored, the
    same log-probabilities.

    Equal means: to the square root of the precision of the weights, for answers to a made-up
    question.
    """
    try:
        answers = sample_answers(model, QUESTION, 2, end=(), longest=4, seed=0)
        with torch.no_grad():
            scored = score(
                model, QUESTION, [one.tokens for one in answers], [None, None]
            ).logprobs.cpu()
    except (RuntimeError, ValueError, AttributeError, TypeError, IndexError, ImportError) as error:
        why = " ".join(str(error).split())[:200]
        raise IbridError(
            f"{name}: cannot be sampled as a causal language model ({why}); train another"
        ) from None
    said = torch.tensor([one.logprobs for one in answers])
    if (
        not (said - scored).abs().max()
        <= torch.finfo(next(model.parameters()).dtype).eps ** 0.5 * said.abs().max()
    ):
        raise IbridError(
            f"{name}: what it says of a token changes with those behind it, so its answers have no "
            "likelihood; train a causal "
            "language model"
        )


def _side_by_side(
    model: Any, prompt: Sequence[int], chances: np.ndarray, end: Sequence[int], guide: Guide | None
) -> list[Sampled]:
    """All answers at once; chances (longest, number)."""
    device = next(model.parameters()).device
    longest, number = chances.shape
    answers: list[list[int]] = [[] for _ in range(number)]
    logprobs: list[list[float]] = [[] for _ in range(number)]
    going = list(range(number))
    owners = torch.full((len(prompt),), EVERYBODY)
    with torch.inference_mode():
        read = model(
            input_ids=torch.tensor([list(prompt)], device=device), use_cache=True, logits_to_keep=1
        )
        kept = read_so_far(read)
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
            logits = (
                model(
                    input_ids=chosen[None],
                    position_ids=torch.full((1, len(going)), len(prompt) + place, device=device),
                    attention_mask=seen[None, None].to(device),
                    use_cache=True,
                    **kept,
                )
                .logits[0]
                .float()
            )
    return [Sampled(tuple(some), tuple(said)) for some, said in zip(answers, logprobs, strict=True)]


def _alone(
    model: Any, prompt: Sequence[int], chances: np.ndarray, end: Sequence[int], guide: Guide | None
) -> Sampled:
    """One answer, generated by transformers, which knows the cache of every model; chances
    (longest,).
    """
    tokens: list[int] = []
    logprobs: list[float] = []

    def choose(_: torch.Tensor, logits: torch.Tensor) -> torch.Tensor:
        """Leave the token that was drawn alone."""
        distribution = _distribution(logits, [tuple(tokens)], guide)
        chosen = _drawn(
            distribution, torch.tensor(chances[len(tokens)][None], device=logits.device)
        )
        tokens.append(int(chosen))
        logprobs.append(float(distribution[0, chosen]))
        return torch.full_like(logits, -torch.inf).index_fill(1, chosen, 0.0)

    # the weights are shared; what the folder says of generation, such as a penalty, is left out
    plain = copy.copy(model)
    plain.generation_config = GenerationConfig()
    row = torch.tensor([list(prompt)], device=next(model.parameters()).device)
    plain.generate(
        input_ids=row,
        attention_mask=torch.ones_like(row),
        generation_config=GenerationConfig(
            max_new_tokens=len(chances),
            do_sample=False,
            eos_token_id=list(end) or None,
            pad_token_id=0,
        ),
        logits_processor=[choose],
    )
    return Sampled(tuple(tokens), tuple(logprobs))


def _distribution(
    logits: torch.Tensor, before: Sequence[tuple[int, ...]], guide: Guide | None
) -> torch.Tensor:
    """Log-probabilities, (rows, V), of what may come next."""
    if guide is not None:
        masks = [guide(one) for one in before]
        if any(mask is not None for mask in masks):
            allowed = np.zeros(tuple(logits.shape), dtype=bool)
            for row, mask in zip(allowed, masks, strict=True):
                row[:] = (
                    True
                    if mask is None
                    else np.concatenate([mask, np.zeros(len(row) - len(mask), dtype=bool)])
                )
            logits = logits.masked_fill(~torch.from_numpy(allowed).to(logits.device), -torch.inf)
    return torch.log_softmax(logits, dim=-1)


def _drawn(distribution: torch.Tensor, chances: torch.Tensor) -> torch.Tensor:
    """The tokens at which the cumulated probability passes `chances`; never one of probability
    zero.
    """
    cumulated = distribution.double().exp().cumsum(-1)
    wanted = chances[:, None] * cumulated[:, -1:]
    chosen = torch.searchsorted(cumulated, wanted, right=True)[:, 0]
    return torch.where(
        chosen < distribution.shape[1], chosen, distribution.argmax(-1)
    )  # rounding at the very end
