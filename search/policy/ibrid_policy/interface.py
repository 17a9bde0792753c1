"""What the search and its learner ask of a policy; importing this needs no torch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from ibrid_search.proposal import Context, Proposal


@dataclass(frozen=True)
class Sampled:
    """An answer: its tokens, the end token included, and their log-probabilities under the
    distribution that they were drawn from (temperature 1, the mask applied).
    """

    tokens: tuple[int, ...]
    logprobs: tuple[float, ...]


@runtime_checkable
class Policy(Protocol):
    """A distribution over edits, given a parent with its record.

    `end` : id of the token that ends an answer.
    """

    name: str
    end: int

    def prompt(self, context: Context) -> list[int]:
        """Tokens of a question."""
        ...

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        """`number` independent answers to each prompt; the same seed gives the same answers."""
        ...

    def proposal(self, sampled: Sampled, context: Context) -> Proposal:
        """The edit as SEARCH/REPLACE blocks; a sentence in `failure` when the tokens are no edit of
        the parent.
        """
        ...

    def model(self) -> Any:
        """The torch module: a transformers causal language model in float32, trainable."""
        ...

    def masks(
        self, prompt: Sequence[int], tokens: Sequence[int], context: Context
    ) -> np.ndarray | None:
        """Which tokens were allowed at each place of an answer, (L, V) bool; None: all.

        Whoever recomputes log-probabilities applies the same mask, so that they agree.
        """
        ...
