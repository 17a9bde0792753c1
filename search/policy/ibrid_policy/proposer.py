"""The learned proposer: the small policy answers, offline and on one core."""

from pathlib import Path

import numpy as np
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.diagnosis import handed_in
from ibrid_search.proposers.first_look import LOOKED_AT

from ibrid_policy.asking import ANSWERS, asked
from ibrid_policy.interface import Policy
from ibrid_policy.small_policy import SmallPolicy
from ibrid_policy.tokens import LanguageError


class PolicyProposer:
    """Asks a policy for several answers. Every other time first looks at the data choose among them
    and what the diagnosis of the parent says (`Context.lacks`); else the first is taken, also an
    illegal one, unless it leads to a known structure or to its parent's.

    folder : the policy's weights; None: those that ship. policy : in place of a folder. answers :
    to one question.
    looked_at : how often looks choose. informed : False to leave the diagnosis out. `usage` of a
    proposal counts the answers, see `ibrid_policy.asking.JudgedAnswers`. Raises IbridError where
    torch is missing.
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
        informed: bool = True,
    ) -> None:
        self.policy: Policy = SmallPolicy(folder) if policy is None else policy
        self.answers, self.looked_at, self.informed = answers, looked_at, informed

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The edit of one of the answers."""
        try:
            prompt = self.policy.prompt(context)
        except LanguageError as error:
            return Proposal("", failure=str(error))
        drawn = self.policy.sample([prompt], [context], self.answers, int(rng.integers(2**31)))[0]
        look = bool(rng.random() < self.looked_at)
        answers = asked(self.policy, drawn, context, rng, look=look, best=look)
        own, known = answers.chosen.look, context.lacks() if look and self.informed else []
        if known and (own is None or known[0].score < own.worth):
            return handed_in(known[0], context, **answers.proposal.usage)
        return answers.proposal
