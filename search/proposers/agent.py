"""The paper's richer form of recursion in context space: a model that looks with tools, edits, and reflects, turn by turn.

A turn begins with the outcome of the last one. The model may read records, list the best and check grammar; it ends the
turn with an edit and a paragraph of diagnosis. What it remembers is made from the stored steps, so a resumed run goes on.
"""

import numpy as np

from search.proposal import Context, Proposal
from search.proposers.agent_question import AgentSettings, question
from search.proposers.agent_turn import Turn
from search.proposers.agent_view import History, View
from search.proposers.chat import Chat
from search.step import Step


class Agent:
    """A proposer that keeps a conversation; see the module.

    `chat` : a model with or without calls of tools. `history` : the store of the run, for records and diagnoses of all
    steps; it may be set once there is one. Without it the agent knows what its contexts have shown.
    """

    name = "agent"
    attempts = 1
    window: int | None = 1

    def __init__(self, chat: Chat, settings: AgentSettings | None = None, *, history: History | None = None) -> None:
        self.chat, self.settings, self.history = chat, settings or AgentSettings(), history
        self._seen: dict[int, Step] = {}

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """One turn; a dead server is a sentence in `failure`, everything else that goes wrong is answered and counted."""
        for step in (*context.failures, *(() if context.last is None else (context.last,))):
            self._seen[step.number] = step
        view = View(context, self.history, tuple(self._seen.values()))
        messages = question(context, view, self.settings, author=self.name)
        return Turn(self.chat, self.settings, context, view, messages, rng).proposal()
