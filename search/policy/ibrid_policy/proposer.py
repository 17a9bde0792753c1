"""The learned proposer: the small policy answers, offline and on one core."""

from pathlib import Path

import numpy as np
from ibrid_search.first_look import LOOKED_AT
from ibrid_search.proposal import Context, Proposal

from ibrid_policy.asking import ANSWERS, asked
from ibrid_policy.interface import Policy
from ibrid_policy.small_policy import SmallPolicy
from ibrid_policy.tokens import LanguageError


class PolicyProposer:
    """Asks a policy for several answers. Every other time a first look at the data chooses among them; else the first is taken,
    also an illegal one, unless it leads to a known structure or to its parent's.

    folder : the policy's weights; None: those that ship. policy : in place of a folder. answers : to one question.
    looked_at : how often a first look chooses. `usage` of a proposal counts the answers, see `ibrid_policy.asking.Asked`.
    Raises IbridError where torch is missing.
    """

    name = "policy"
    attempts = 1
    window: int | None = None

    def __init__(
        self,
        folder: str | Path | None = None,
        *,
        policy: Policy | None = None,
        answers: int = ANSWERS,
        looked_at: float = LOOKED_AT,
    ) -> None:
        self.policy: Policy = SmallPolicy(folder) if policy is None else policy
        self.answers, self.looked_at = answers, looked_at

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The edit of one of the answers."""
        try:
            prompt = self.policy.prompt(context)
        except LanguageError as error:
            return Proposal("", failure=str(error))
        drawn = self.policy.sample([prompt], [context], self.answers, int(rng.integers(2**31)))[0]
        look = bool(rng.random() < self.looked_at)
        return asked(self.policy, drawn, context, rng, look=look, best=look).proposal
