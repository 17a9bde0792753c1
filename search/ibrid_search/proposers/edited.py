"""From a move to a proposal: the parent's diagram edited, made whole, and written as SEARCH/REPLACE blocks."""

from ibrid.parts.view import Move, View
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Proposal


def edited(view: View, move: Move) -> Diagram:
    """The parent after a move, with all its devices."""
    return view.after(move)


def proposal_of(view: View, move: Move, diagram: Diagram, family: str = "") -> Proposal:
    """The proposal whose edit turns the parent into `diagram`; `family` of the edit is kept for statistics."""
    edit = edit_between(program_text(view.whole), program_text(diagram))
    return Proposal(edit, note=view.words(move), usage={"family": family} if family else {})
