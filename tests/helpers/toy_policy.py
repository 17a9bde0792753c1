"""A policy of a few hundred numbers that chooses among fixed edits: for tests of learning that take
seconds.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from ibrid_policy.interface import Sampled
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Context, Proposal

#: Makes of a parent's program and the number of an edit the program after it.
Change = Callable[[str, int], str]
END, ASK, FIRST = 0, 1, 2


def tiny_model(vocabulary: int, seed: int = 0, layers: int = 1) -> Any:
    """A causal model with 8 numbers per token and random weights."""
    import torch  # pyright: ignore[reportMissingImports]
    from transformers import LlamaConfig, LlamaForCausalLM  # pyright: ignore[reportMissingImports]

    config = LlamaConfig(
        vocab_size=vocabulary,
        hidden_size=8,
        intermediate_size=16,
        num_hidden_layers=layers,
        num_attention_heads=2,
        num_key_value_heads=1,
        max_position_embeddings=64,
        bos_token_id=None,
        eos_token_id=END,
        pad_token_id=END,
        tie_word_embeddings=False,
    )
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return LlamaForCausalLM(config).eval()


class ToyPolicy:
    """One token says which of `edits` edits, a second one ends the answer. `masked` : only such
    answers can be given.

    `stale` : sampled from in place of the model that is trained.
    """

    name = "toy"
    end = END

    def __init__(self, change: Change, edits: int, *, masked: bool = True, seed: int = 0) -> None:
        self.change, self.edits, self.masked = change, edits, masked
        self._model = tiny_model(FIRST + edits, seed)
        self.stale: Any = None
        self.sampled = 0

    def model(self) -> Any:
        return self._model

    def prompt(self, context: Context) -> list[int]:
        return [ASK, ASK]

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        from ibrid_policy.learning.sampling import sample_answers

        self.sampled += number * len(prompts)
        return [
            sample_answers(
                self.stale or self._model,
                prompt,
                number,
                end=[END],
                longest=4,
                seed=seed + place,
                guide=self.allowed if self.masked else None,
            )
            for place, prompt in enumerate(prompts)
        ]

    def allowed(self, before: tuple[int, ...]) -> np.ndarray:
        """An edit first, then the end."""
        found = np.zeros(FIRST + self.edits, dtype=bool)
        found[FIRST:] = not before
        found[END] = bool(before)
        return found

    def proposal(self, sampled: Sampled, context: Context) -> Proposal:
        if len(sampled.tokens) != 2 or sampled.tokens[0] < FIRST or sampled.tokens[1] != END:
            return Proposal("nonsense")
        program = context.parent.record.program
        number = sampled.tokens[0] - FIRST
        return Proposal(edit_between(program, self.change(program, number)), note=f"edit {number}")

    def masks(
        self, prompt: Sequence[int], tokens: Sequence[int], context: Context
    ) -> np.ndarray | None:
        if not self.masked:
            return None
        return np.array([self.allowed(tuple(tokens[:place])) for place in range(len(tokens))])
