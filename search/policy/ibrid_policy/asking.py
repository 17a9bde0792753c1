"""A policy asked: several answers to a question, a first look at what is new among them, and the
one that is handed in.

Frozen and learning policies are asked in the same way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.first_look import LOOKS, Look, first_look
from ibrid_search.run.parsed import parsed
from ibrid_search.step import Status

from ibrid_policy.interface import Policy, Sampled

#: Answers to one question.
ANSWERS = 8
#: Ends of an answer with which nothing is wrong, but which leads to nothing new.
NOTHING_NEW = (Status.UNCHANGED, Status.DUPLICATE)


@dataclass(frozen=True)
class JudgedAnswer:
    """`status` : what the proposal would end as if it was handed in; PENDING for a candidate to be
    fitted. `program`, `hash` : of the child, where it is one. `look` : None where none was taken.
    """

    sampled: Sampled
    proposal: Proposal
    status: Status
    program: str = ""
    hash: str = ""
    look: Look | None = None


@dataclass(frozen=True)
class JudgedAnswers:
    """All answers to a question, and the one that is handed in."""

    answers: tuple[JudgedAnswer, ...]
    chosen: JudgedAnswer

    @property
    def proposal(self) -> Proposal:
        """What is handed in.

        Its usage counts the answers: `samples`, those of them that are `known` (lead to a known
        structure or to the parent's) or `refused` (no edit, no legal one), and the first looks.
        """
        ends = [one.status for one in self.answers]
        known = sum(end in NOTHING_NEW for end in ends)
        usage: dict[str, Any] = {
            "samples": len(ends),
            "known": known,
            "refused": len(ends) - known - ends.count(Status.PENDING),
        }
        looked = {one.hash for one in self.answers if one.look is not None}
        if looked:
            usage |= {LOOKS: len(looked)}
        return replace(self.chosen.proposal, usage={**self.chosen.proposal.usage, **usage})


def asked(
    policy: Policy,
    drawn: Sequence[Sampled],
    context: Context,
    rng: np.random.Generator,
    *,
    look: bool,
    best: bool,
) -> JudgedAnswers:
    """Judge the answers that a policy gave to a question, one at least, and choose among them.

    look : take a first look at each that leads to something new. best : hand in the one that these
    looks find best; else, and where there is none, the first that is not just known, be it illegal;
    else the last.
    """
    answers = _judged(policy, drawn, context)
    if look:
        answers = _looked_at(answers, context, rng)
    looked = [(one.look.worth, place) for place, one in enumerate(answers) if one.look is not None]
    if best and looked:
        return JudgedAnswers(answers, answers[min(looked)[1]])
    first = next((one for one in answers if one.status not in NOTHING_NEW), answers[-1])
    return JudgedAnswers(answers, first)


def _judged(policy: Policy, drawn: Sequence[Sampled], context: Context) -> tuple[JudgedAnswer, ...]:
    proposals = [(one, policy.proposal(one, context)) for one in drawn]
    found = ((one, proposal, verdict_of(proposal, context)) for one, proposal in proposals)
    return tuple(
        JudgedAnswer(one, proposal, end.status, end.program, end.hash)
        for one, proposal, end in found
    )


def _looked_at(
    answers: Sequence[JudgedAnswer], context: Context, rng: np.random.Generator
) -> tuple[JudgedAnswer, ...]:
    """Two answers with one structure share a look."""
    looks: dict[str, Look] = {}
    for one in answers:
        if one.status is Status.PENDING and one.hash not in looks:
            looks[one.hash] = first_look(parsed(one.program), context, rng)
    return tuple(
        replace(one, look=looks[one.hash]) if one.status is Status.PENDING else one
        for one in answers
    )
