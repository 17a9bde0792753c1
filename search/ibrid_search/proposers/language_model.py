"""The proposer `llm`: one question to a language model, one edit; several models with weights, limits for the whole run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid_search.blocks import LONGEST_EDIT, EditError, read_blocks, shown, strip_thinking, write_block
from ibrid_search.context import prompt
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.chat import LONGEST_ANSWER, Chat, ChatError, estimated_tokens
from ibrid_search.proposers.local_model import LocalModel
from ibrid_search.proposers.model_names import models_of
from ibrid_search.spending import Limits, Prices, Spender, Spending

_CHANGE = "change:"
#: With the diagnosis of the parent; as in the paper, without it.
QUESTIONS = ("engineer", "paper")


class LanguageModel(Spender):
    """Asks a model for an edit of the parent; a proposer in the sense of `ibrid_search.proposal`.

    `models` : each with its weight; one is drawn for every question. `limits` : of the run. `prompt_tokens` : of one
    question, see `ibrid_search.context.prompt`. `asked` : of `QUESTIONS`. `spending` : tokens, cost and seconds so far.
    """

    name = "llm"
    attempts = 2
    window: int | None = None

    def __init__(
        self,
        models: Sequence[tuple[Chat, float]],
        *,
        limits: Limits | None = None,
        prompt_tokens: int = 16_000,
        asked: str = "engineer",
    ) -> None:
        weights = np.array([weight for _, weight in models], dtype=float)
        if not len(models) or not np.isfinite(weights).all() or (weights < 0).any() or not weights.sum() > 0:
            raise IbridError(
                "the proposer llm needs at least one model and weights that are not negative; name a model"
            )
        self.models = tuple(chat for chat, _ in models)
        self.weights = weights / weights.sum()
        if asked not in QUESTIONS:
            raise IbridError(
                f"a language model is asked as {' or '.join(QUESTIONS)}, found {asked!r}; choose one of them"
            )
        self.prompt_tokens, self.asked = prompt_tokens, asked
        self.spending = Spending(limits)

    @classmethod
    def from_options(
        cls,
        models: Sequence[str],
        *,
        limits: Limits | None = None,
        prices: Prices = (),
        prompt_tokens: int = 16_000,
        asked: str = "engineer",
        **settings: Any,
    ) -> "LanguageModel":
        """Models by name: see `ibrid_search.proposers.model_names`; `settings` go to every ChatServer.

        Raises IbridError for a name that says nothing, a folder without a model or a package that is not installed.
        """
        return cls(models_of(models, prices, **settings), limits=limits, prompt_tokens=prompt_tokens, asked=asked)

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of `context.parent`; a failure in one sentence for whatever a server or a model does wrong."""
        chat = self.models[int(rng.choice(len(self.models), p=self.weights))]
        seed = int(rng.integers(2**31))
        if self.spending.over:
            return Proposal("", failure=self.spending.over)
        try:
            count = chat.tokens if isinstance(chat, LocalModel) else estimated_tokens
            diagnosed = self.asked == "engineer"
            question = prompt(context, limit_tokens=self.prompt_tokens, count=count, diagnosed=diagnosed)
            answer = chat.complete(question, rng_seed=seed)
        except IbridError as error:
            usage = error.usage if isinstance(error, ChatError) else {}
            self.spending.count(usage)
            return Proposal("", usage=usage, failure=str(error))
        self.spending.count(answer.usage)
        return read_answer(answer.text, {**answer.usage, **({"cut": True} if answer.cut else {})}, chat.name)


def read_answer(text: str, usage: Mapping[str, Any], name: str) -> Proposal:
    """The edit in an answer of model `name`. The thinking is kept, counted, and never read for edits."""
    thinking, rest = strip_thinking(text)
    if thinking and "thinking_tokens" not in usage:
        usage = {**usage, "thinking_tokens": estimated_tokens(thinking)}
    reply = text[:LONGEST_ANSWER]
    if not rest.strip():
        why = "thought until it was cut off and gave no answer" if thinking else "answered nothing"
        return Proposal("", reply=reply, usage=usage, failure=f"the model {name} {why}")
    if len(rest) > LONGEST_EDIT:
        failure = f"the model {name} answered with {len(rest)} characters; an answer has at most {LONGEST_EDIT}"
        return Proposal("", reply=reply, usage=usage, failure=failure)
    try:
        edit = "\n".join(write_block(one.search, one.replace) for one in read_blocks(rest))
    except EditError:
        edit = rest
    return Proposal(edit, note=_note(rest), reply=reply, usage=usage)


def _note(answer: str) -> str:
    """The line that says what changes; otherwise the last line before the first block."""
    before = [line for line in answer.partition("<<<<<")[0].splitlines() if line.strip(" `#*\t")]
    said = next((line for line in before if line.strip(" #*").lower().startswith(_CHANGE)), None)
    if said is not None:
        return shown(said.strip(" #*")[len(_CHANGE) :].strip(" *"))
    return shown(before[-1].strip(" #*")) if before else ""
