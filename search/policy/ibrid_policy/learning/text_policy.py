"""A language model in a folder as a policy: the search's prompt, its own tokenizer, answers as
text; torch only when asked.
"""

import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_search.language_models.context import prompt, system_text
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.language_model import read_answer
from ibrid_search.proposers.local_model import LocalModel

from ibrid.errors import IbridError
from ibrid.study import Study
from ibrid_policy.interface import Sampled
from ibrid_policy.learning.constrained import TokenGuide, trie_of
from ibrid_policy.learning.edit_automaton import EditAutomaton

#: Tokens that a question has beside system turn and program: the shortest record, what is asked,
#: the marks of the turns.
BESIDE = 300


class TrainableModel(LocalModel):
    """A local model whose weights are at hand, in float32, with adapters too.

    In bfloat16 the log-probabilities of answers as they were drawn and as they are scored differ by
    0.05 in the mean (SmolLM2-135M-Instruct; 4e-6 in float32), beyond the alarm at 0.02.
    """

    @cached_property
    def weights(self) -> Any:
        """The torch module; IbridError when it cannot be loaded or is no causal language model."""
        from ibrid_policy.learning.sampling import require_causal

        model = self._loaded[1].float()
        require_causal(model, self.name)
        return model

    @property
    def tokenizer(self) -> Any:
        return self._loaded[2]

    @property
    def room(self) -> int:
        """Tokens of question and answer together at most."""
        return int(getattr(self._loaded[1].config, "max_position_embeddings", 1 << 30))

    def question(self, context: Context, most: int) -> list[int]:
        """Tokens of the search's prompt in the model's own form, `most` at most."""
        messages = prompt(
            context, limit_tokens=most - 64, count=self.tokens
        )  # room for the marks of the turns
        return self.tokenizer(self._templated(self.tokenizer, messages), add_special_tokens=False)[
            "input_ids"
        ]


class TextPolicy:
    """See `ibrid_policy.interface.Policy`.

    folder : of the model, as `save_pretrained` writes it. longest : tokens of an answer at most.
    prompt_tokens : of a question.
    constrained : answers can only be edits of `edit_automaton`; lines, legal_end : see there.
    `longest` must have room for the lines, each of which takes a small model 20 to 30 tokens, or
    the answers are cut.
    """

    name = "llm"

    def __init__(
        self,
        folder: str | Path,
        *,
        longest: int = 512,
        prompt_tokens: int = 16_000,
        constrained: bool = False,
        lines: int = 6,
        legal_end: bool = True,
    ) -> None:
        self.chat = TrainableModel(folder)
        self.ends = _ends(self.chat.folder)
        self.end = self.ends[0]
        self.longest, self.prompt_tokens = longest, prompt_tokens
        self.constrained, self.lines, self.legal_end = constrained, lines, legal_end

    def model(self) -> Any:
        """The transformer, float32, on a GPU where there is one."""
        return self.chat.weights

    def require_room(self, study: Study, program: str) -> None:
        """Raise IbridError unless the model has positions for the shortest question about this
        program, and an answer to it.
        """
        asked = (
            self.chat.tokens(system_text(study, short=True)) + self.chat.tokens(program) + BESIDE
        )
        if asked + self.longest > self.chat.room:
            raise IbridError(
                f"{self.chat.name} has {self.chat.room} positions (max_position_embeddings), but "
                "the shortest question of this "
                f"search takes about {asked} tokens and an answer up to {self.longest}; train a "
                "model with more, or shorten the "
                "answers by --learn-longest"
            )

    def prompt(self, context: Context) -> list[int]:
        """Tokens of a question."""
        return self.chat.question(context, min(self.prompt_tokens, self.chat.room - self.longest))

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        """`number` answers to each prompt."""
        from ibrid_policy.learning.sampling import sample_answers

        return [
            sample_answers(
                self.model(),
                one,
                number,
                end=self.ends,
                longest=self.longest,
                seed=seed + place,
                guide=self._guide(context),
            )
            for place, (one, context) in enumerate(zip(prompts, contexts, strict=True))
        ]

    def proposal(self, sampled: Sampled, context: Context) -> Proposal:
        """The blocks in the text."""
        text = self.chat.tokenizer.decode(sampled.tokens, skip_special_tokens=True)
        cut = {} if sampled.tokens[-1:] and sampled.tokens[-1] in self.ends else {"cut": True}
        return read_answer(text, {"completion_tokens": len(sampled.tokens), **cut}, self.chat.name)

    def masks(
        self, prompt: Sequence[int], tokens: Sequence[int], context: Context
    ) -> np.ndarray | None:
        """None, unless answers are constrained."""
        guide = self._guide(context)
        return None if guide is None else guide.masks(tokens)

    def _guide(self, context: Context) -> TokenGuide | None:
        if not self.constrained:
            return None
        trie, texts = self._texts
        size = int(self.model().config.vocab_size)
        return TokenGuide(
            EditAutomaton(context, lines=self.lines, legal_end=self.legal_end),
            trie,
            texts,
            self.end,
            size,
        )

    @cached_property
    def _texts(self) -> Any:
        return trie_of(self.chat.tokenizer)


def _ends(folder: Path) -> list[int]:
    """The tokens that end an answer; those of the generation config come first."""
    found: Any = None
    for name in ("config.json", "generation_config.json"):
        try:
            plain = json.loads((folder / name).read_text(encoding="utf-8"))
            found = found if (one := plain.get("eos_token_id")) is None else one
        except FileNotFoundError:
            continue
        except (OSError, ValueError, AttributeError, RecursionError):
            raise IbridError(
                f"{folder / name}: must be the JSON that save_pretrained writes; save the model "
                "again"
            ) from None
    if found is None or found == []:
        raise IbridError(
            f"{folder}: names no token that ends an answer; set eos_token_id in its config"
        )
    return list(found) if isinstance(found, list) else [found]
