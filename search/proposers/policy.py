"""The learned proposer: the small policy answers, offline and on one core."""

from pathlib import Path

import numpy as np

from search.judging import NOTHING_NEW, status_of
from search.policy.interface import Policy
from search.policy.small_policy import SmallPolicy
from search.policy.tokens import LanguageError
from search.proposal import Context, Proposal
from search.step import Status

#: Answers to one question at most.
TRIES = 4


class PolicyProposer:
    """Asks a policy and takes its answer as it comes, also an illegal one; only one that leads to a known structure, or to
    its parent's, is followed by another.

    folder : the policy's weights; None: those that ship. policy : in place of a folder. tries : answers to one question at
    most. `usage` of a proposal counts them: `samples`, those of them that are `known` or unchanged, and the `refused` one.
    Raises IbridError where torch is missing.
    """

    name = "policy"
    attempts = 1
    window: int | None = None

    def __init__(self, folder: str | Path | None = None, *, policy: Policy | None = None, tries: int = TRIES) -> None:
        self.policy: Policy = SmallPolicy(folder) if policy is None else policy
        self.tries = tries

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The first answer that does not lead to a known structure; else the last one."""
        try:
            prompt = self.policy.prompt(context)
        except LanguageError as error:
            return Proposal("", failure=str(error))
        seed, known = int(rng.integers(2**31)), 0
        proposal, status = Proposal(""), Status.UNCHANGED
        for answer in self.policy.sample([prompt], [context], self.tries, seed)[0]:
            proposal = self.policy.proposal(answer, context)
            status = status_of(proposal, context)
            if status not in NOTHING_NEW:
                break
            known += 1
        refused = int(status not in (*NOTHING_NEW, Status.PENDING))
        usage = {"samples": known + (status not in NOTHING_NEW), "known": known, "refused": refused}
        return Proposal(proposal.edit, proposal.note, usage=usage, failure=proposal.failure)
