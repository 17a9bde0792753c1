"""Answers drawn token by token: the question is read once, each draw keeps to the grammar,
temperature 1.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid_policy.backend import read_so_far, require
from ibrid_policy.grammar import LONGEST, Grammar
from ibrid_policy.interface import Sampled
from ibrid_policy.tokens import END, TOKENS


def draw_answers(
    model: Any, prompt: Sequence[int], grammars: Sequence[Grammar], rng: np.random.Generator
) -> list[Sampled]:
    """One answer for each grammar, which is read along; an answer that finds no end is cut at
    `LONGEST` tokens.
    """
    torch = require("torch")
    number = len(grammars)
    tokens: list[list[int]] = [[] for _ in grammars]
    logprobs: list[list[float]] = [[] for _ in grammars]
    open_rows = list(range(number))
    with torch.inference_mode():
        question = torch.tensor([list(prompt)], device=model.device)
        read = model(input_ids=question, use_cache=True, logits_to_keep=1)
        (cache,) = (kept := read_so_far(read)).values()
        cache.batch_repeat_interleave(number)
        logits = read.logits[:, -1].expand(number, -1)
        for _ in range(LONGEST):
            drawn = _drawn(logits.double().cpu().numpy(), [grammars[row] for row in open_rows], rng)
            for row, (token, logprob) in zip(open_rows, drawn, strict=True):
                tokens[row].append(token)
                logprobs[row].append(logprob)
                grammars[row].take(TOKENS.words[token])
            going = [place for place, row in enumerate(open_rows) if not grammars[row].ended]
            if not going:
                break
            following = torch.tensor([[drawn[place][0]] for place in going], device=model.device)
            if len(going) < len(open_rows):
                cache.batch_select_indices(torch.tensor(going, device=model.device))
                open_rows = [open_rows[place] for place in going]
            read = model(input_ids=following, use_cache=True, **kept)
            logits = read.logits[:, -1]
    return [Sampled(tuple(one), tuple(other)) for one, other in zip(tokens, logprobs, strict=True)]


def _drawn(
    logits: np.ndarray, grammars: Sequence[Grammar], rng: np.random.Generator
) -> list[tuple[int, float]]:
    """A token and its log-probability for each row; logits (rows, V)."""
    found = []
    for row, grammar, uniform in zip(logits, grammars, rng.random(len(grammars)), strict=True):
        allowed = np.array(TOKENS.encode(grammar.allowed))
        score = row[allowed] - row[allowed].max()
        logprob = score - np.log(np.exp(score).sum())
        place = min(int(np.searchsorted(np.cumsum(np.exp(logprob)), uniform)), len(allowed) - 1)
        found.append((int(allowed[place]), float(logprob[place])))
    return found


def allowed_masks(tokens: Sequence[int], grammar: Grammar) -> np.ndarray:
    """(L, V) bool: what was allowed at each place of an answer that keeps to the grammar."""
    masks = np.zeros((len(tokens), len(TOKENS)), dtype=bool)
    for place, token in enumerate(tokens):
        masks[place, TOKENS.encode(grammar.allowed)] = True
        grammar.take(TOKENS.words[token])
    return masks


END_ID = TOKENS.ids[END]
