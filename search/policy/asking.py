"""A policy asked until its answer leads to something new; frozen and learning policies are asked in the same way."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from search.judging import status_of
from search.policy.interface import Policy, Sampled
from search.proposal import Context, Proposal
from search.step import Status

#: Answers to one question at most, where it is asked again.
TRIES = 4
#: Ends after which a question is asked again: nothing is wrong with the answer, but it leads to nothing new.
NOTHING_NEW = (Status.UNCHANGED, Status.DUPLICATE)


@dataclass(frozen=True)
class Asked:
    """`answer` : the one that counts, and its `proposal`. `usage` : `samples`, the answers that were drawn, how many of them
    were `known` (led to a known structure or to the parent's), and whether the last was `refused`."""

    answer: Sampled
    proposal: Proposal
    usage: Mapping[str, int]


def first_new(policy: Policy, answers: Iterable[Sampled], context: Context) -> Asked:
    """The first of the answers to a question that leads to something new, be it illegal; else the last one.

    answers : at least one; no more are drawn from it than are needed.
    """
    samples = known = 0
    for answer in answers:
        proposal = policy.proposal(answer, context)
        status = status_of(proposal, context)
        samples, known = samples + 1, known + (status in NOTHING_NEW)
        if status not in NOTHING_NEW:
            break
    refused = int(status not in (*NOTHING_NEW, Status.PENDING))
    return Asked(answer, proposal, {"samples": samples, "known": known, "refused": refused})
