"""The learned proposer: the small policy answers, offline and on one core."""

from pathlib import Path

import numpy as np

from ibrid.structure.canonical import structure_hash
from ibrid.structure.program import program_text
from search.judging import judge
from search.policy.interface import Policy
from search.policy.small_policy import SmallPolicy
from search.policy.tokens import LanguageError
from search.proposal import Context, Proposal
from search.step import Status

#: Answers to one question at most.
TRIES = 4
#: Ends after which a question is asked again: nothing is wrong with the answer, but it leads to nothing new.
_NOTHING_NEW = (Status.UNCHANGED, Status.DUPLICATE)


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
        task, program = context.task, program_text(context.parent.diagram)
        own = structure_hash(context.parent.diagram, task.kinds, equilibrium=task.equilibrium)
        try:
            prompt = self.policy.prompt(context)
        except LanguageError as error:
            return Proposal("", failure=str(error))
        seed, known = int(rng.integers(2**31)), 0
        proposal, status = Proposal(""), Status.UNCHANGED
        for answer in self.policy.sample([prompt], [context], self.tries, seed)[0]:
            proposal = self.policy.proposal(answer, context)
            status = judge(proposal, program, own, task, lambda digest: 0 if context.seen(digest) else None).status
            if status not in _NOTHING_NEW:
                break
            known += 1
        refused = int(status not in (*_NOTHING_NEW, Status.PENDING))
        usage = {"samples": known + (status not in _NOTHING_NEW), "known": known, "refused": refused}
        return Proposal(proposal.edit, proposal.note, usage=usage, failure=proposal.failure)
