"""From a move to a proposal: the parent's diagram edited, made whole, and written as SEARCH/REPLACE blocks."""

from ibrid.errors import DiagramError
from ibrid.structure.canonical import structure_hash
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.program import program_text
from search.edits import edit_between
from search.gates import implausible
from search.proposal import Context, Proposal
from search.proposers.moves.family import Move, View


def edited(view: View, move: Move) -> Diagram:
    """The parent after a move."""
    draft = Draft(view.diagram, view.kinds)
    move.change(draft)
    draft.tidy()
    return draft.diagram()


def new_structure(diagram: Diagram, context: Context) -> bool:
    """True for a legal, plausible structure that the run has not met."""
    task = context.task
    try:
        digest = structure_hash(diagram, task.kinds, equilibrium=task.equilibrium)
    except DiagramError:
        return False
    if context.seen(digest):
        return False
    violations, warnings = examine(diagram, task.kinds, equilibrium=task.equilibrium)
    return not violations and not implausible(warnings)


def proposal_of(view: View, move: Move, diagram: Diagram, family: str = "") -> Proposal:
    """The proposal whose edit turns the parent into `diagram`; `family` of the edit is kept for statistics."""
    edit = edit_between(program_text(view.diagram), program_text(diagram))
    return Proposal(edit, note=move.note, usage={"family": family} if family else {})
