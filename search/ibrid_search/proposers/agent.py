"""The paper's richer form of recursion in context space: a model that looks with tools, edits, and
reflects, turn by turn.

A turn begins with the outcome of the last one. The model may read records, list the best and check
grammar; it ends the turn with an edit and a paragraph of diagnosis. What it remembers is made from
the stored steps, so a resumed run goes on.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid_search.chat.chat import Chat
from ibrid_search.chat.spending import Limits, Prices, Spender, Spending
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.agent_turn import Turn
from ibrid_search.proposers.agent_view import AgentSettings, RunView, question
from ibrid_search.proposers.model_names import models_of
from ibrid_search.run.store import Store
from ibrid_search.step import Step


class Agent(Spender):
    """A proposer that keeps a conversation; see the module.

    `chat` : a model with or without calls of tools. `limits` : of the run. `history` : the store of
    the run, for records and diagnoses of all steps, which a search tells. Without it the agent
    knows what its contexts have shown.
    """

    name = "agent"
    attempts = 1
    window: int | None = 1
    undisturbed = True  # it sees the results of its own steps alone

    def __init__(
        self,
        chat: Chat,
        settings: AgentSettings | None = None,
        *,
        limits: Limits | None = None,
        history: Store | None = None,
    ) -> None:
        self.chat, self.settings, self.history = chat, settings or AgentSettings(), history
        self.spending = Spending(limits)
        self._seen: dict[int, Step] = {}
        self._native = True

    @classmethod
    def from_options(
        cls,
        models: Sequence[str],
        *,
        limits: Limits | None = None,
        prices: Prices = (),
        **server: Any,
    ) -> "Agent":
        """The agent of one model by name, see `ibrid_search.proposers.model_names`; `server` goes
        to ChatServer.

        Raises IbridError for none or several models, and what `models_of` raises.
        """
        if len(models) != 1:
            raise IbridError(
                f"an agent is one model, found {len(models)}; name one, or mix with the proposer "
                "llm"
            )
        ((chat, _),) = models_of(models, prices, **server)
        return cls(chat, limits=limits)

    @property
    def tokens_of_a_question(self) -> int:
        """Of the longest question and the longest answer; 0 where the model says no limit of its
        answers.
        """
        answer = getattr(self.chat, "max_tokens", 0)
        return self.settings.tokens + answer if answer else 0

    def begin(self, store: Store, folder: Path) -> None:
        """Look back at the store of the run from now on."""
        super().begin(store, folder)
        self.history = store

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """One turn; a failure in one sentence when the model gives no answer; the rest that goes
        wrong is talked over.
        """
        for step in (*context.failures, *(() if context.last is None else (context.last,))):
            self._seen[step.number] = step
        view = RunView(context, self.history, tuple(self._seen.values()))
        try:
            messages = question(context, view, self.settings, author=self.name)
        except IbridError as error:  # the token limit is too small for this program
            return Proposal("", failure=str(error))
        turn = Turn(self.chat, self.settings, self, context, view, messages, rng, self._native)
        proposal = turn.proposal()
        if not proposal.failure:
            self.complain(
                ""
                if proposal.edit
                else f"the model {self.chat.name} ended its turn without an edit"
            )
        self._native = turn.native
        return proposal
