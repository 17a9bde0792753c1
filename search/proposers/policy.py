"""The learned proposer: the small policy answers, offline and on one core."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from search.policy.asking import TRIES, first_new
from search.policy.interface import Policy
from search.policy.small_policy import SmallPolicy
from search.policy.tokens import LanguageError
from search.proposal import Context, Proposal


class PolicyProposer:
    """Asks a policy and takes its answer as it comes, also an illegal one; only one that leads to a known structure, or to
    its parent's, is followed by another.

    folder : the policy's weights; None: those that ship. policy : in place of a folder. tries : answers to one question at
    most. `usage` of a proposal counts them, see `search.policy.asking.Asked`.
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
        seed = int(rng.integers(2**31))
        found = first_new(self.policy, self.policy.sample([prompt], [context], self.tries, seed)[0], context)
        return replace(found.proposal, usage={**found.proposal.usage, **found.usage})
