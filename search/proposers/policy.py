"""The learned proposer: the small policy answers, offline and on one core."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.errors import ProgramError
from ibrid.structure.canonical import structure_hash
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program, program_text
from search.edits import EditError, apply_edit
from search.policy.interface import Policy
from search.policy.small_policy import SmallPolicy
from search.policy.tokens import LanguageError
from search.proposal import Context, Proposal
from search.proposers.edited import new_structure

#: Answers to one question at most: a further one only where those before led to no new structure.
TRIES = 4


class PolicyProposer:
    """Asks a policy; its answers are taken as they come, and only an illegal, unchanged or known structure is asked about again.

    folder : the policy's weights; None: those that ship. policy : in place of a folder. tries : answers to one question at most.
    `usage` of a proposal counts them: `samples`, and of those `legal` (a structure that may be fitted) and `new` ones.
    Raises IbridError where torch is missing.
    """

    name = "policy"
    attempts = 1
    window: int | None = None

    def __init__(self, folder: str | Path | None = None, *, policy: Policy | None = None, tries: int = TRIES) -> None:
        self.policy: Policy = SmallPolicy(folder) if policy is None else policy
        self.tries = tries

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The first answer that leads to a new structure; without one the last answer, whatever it is."""
        began, seed = time.monotonic(), int(rng.integers(2**31))
        try:
            prompt = self.policy.prompt(context)
        except LanguageError as error:
            return Proposal("", failure=str(error))
        answers = self.policy.sample([prompt], [context], self.tries, seed)[0]
        legal = 0
        for number, answer in enumerate(answers, 1):
            proposal = self.policy.proposal(answer, context)
            child = edited_diagram(proposal, context)
            new = child is not None and new_structure(child, context)
            legal += new or (child is not None and changed_and_legal(child, context))
            if new or number == len(answers):
                break
        seconds = time.monotonic() - began
        usage = {"samples": number, "legal": legal, "new": int(new), "policy_seconds": seconds}
        return Proposal(proposal.edit, proposal.note, usage=usage, failure=proposal.failure)


def edited_diagram(proposal: Proposal, context: Context) -> Diagram | None:
    """The child of a proposal; None where it has no edit that applies."""
    if proposal.failure:
        return None
    try:
        return parse_program(apply_edit(proposal.edit, program_text(context.parent.diagram)), "the edited program")
    except (EditError, ProgramError):
        return None


def changed_and_legal(child: Diagram, context: Context) -> bool:
    """True for a structure that may be fitted and differs from its parent's, known or not."""
    task = context.task
    parent = structure_hash(context.parent.diagram, task.kinds, equilibrium=task.equilibrium)
    return new_structure(child, replace(context, seen=parent.__eq__))
