"""From a proposal to a candidate that is worth a fit, or to the reason why not; cheap questions
first.
"""

from collections.abc import Callable
from dataclasses import dataclass

from ibrid.errors import ProgramError
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid_search.edits import EditError, apply_edit
from ibrid_search.proposal import Context, Proposal
from ibrid_search.run.parsed import parsed
from ibrid_search.screening.plausibility import refusal_reason
from ibrid_search.step import Status


@dataclass(frozen=True)
class Judgement:
    """`status` : PENDING for a candidate to be fitted.

    `reason` : a sentence for the proposer. `same_as` : the step with this structure. `program` :
    what the edit made of the parent, in the canonical print when it is a program.
    """

    status: Status
    reason: str = ""
    program: str = ""
    hash: str = ""
    same_as: int | None = None


def judge(
    proposal: Proposal,
    parent: str,
    parent_hash: str,
    study: Study,
    known: Callable[[str], int | None],
) -> Judgement:
    """Apply the edit, parse, hash, ask the grammar, compare with what is known, ask the gates, in
    this order.

    parent, parent_hash : program and structure of the parent. known : structure hash -> step that
    has it, or None.
    """
    if proposal.failure:
        return Judgement(Status.NO_ANSWER, proposal.failure)
    try:
        text = apply_edit(proposal.edit, parent)
    except EditError as error:
        return Judgement(error.status, error.reason)
    return judge_program(text, study, known, parent_hash)


def verdict_of(proposal: Proposal, context: Context) -> Judgement:
    """What a proposal would end as if it were handed in now."""
    edited = next((one for one in context.best if one.step == proposal.parent), context.parent)
    study, parent = context.study, edited.diagram
    own = study.hash_of(parent)
    return judge(
        proposal,
        program_text(parent),
        own,
        study,
        lambda digest: 0 if context.seen(digest) else None,
    )


def judge_program(
    text: str,
    study: Study,
    known: Callable[[str], int | None] = lambda _: None,
    parent_hash: str = "",
) -> Judgement:
    """The same questions about a whole program: parse, hash, grammar, compare with what is known,
    gates.

    The grammar comes first, at a millisecond, since the hash of an illegal diagram does not see all
    of it (a binding that its kind does not have, say), and "unchanged" would not help whoever wrote
    that.
    """
    try:
        diagram = parsed(text)
    except ProgramError as error:
        return Judgement(Status.UNREADABLE, str(error), text)
    text = program_text(diagram)
    examined = study.examined(diagram, text)
    digest = examined.hash
    if examined.violations:
        return Judgement(Status.ILLEGAL, "; ".join(map(str, examined.violations)), text, digest)
    if digest and digest == parent_hash:
        return Judgement(
            Status.UNCHANGED, "the edit changes names or the order of lines alone", text, digest
        )
    if digest and (same := known(digest)) is not None:
        return Judgement(
            Status.DUPLICATE, f"step {same} has this structure already", text, digest, same
        )
    if reason := refusal_reason(examined.warnings):
        return Judgement(Status.IMPLAUSIBLE, reason, text, digest)
    return Judgement(Status.PENDING, "", text, digest)
