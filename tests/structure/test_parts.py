"""Control practice sees what a block does: a copy of a kind under another name is edited like the kind."""

from dataclasses import replace

import pytest

from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.parts import FAMILIES, insertions, views_of
from ibrid.structure import Diagram, textbook
from ibrid.structure.diagram import Instance


def edits(diagram: Diagram, kinds: Vocabulary) -> tuple[int, int]:
    """Number of moves and of insertions."""
    moves = (move for view in views_of(diagram, kinds) for family in FAMILIES for move in family.moves(view))
    return len(list(moves)), len(insertions(diagram, kinds))


@pytest.mark.parametrize("name", ["gfl_pll_filter_exact", "gfm_vsm"])
def test_a_copy_of_a_kind_in_its_place_is_edited_as_often(name):
    given = textbook(name)
    usual = edits(given, VOCABULARY)
    for kind in {one.kind for one in given.instances}:
        copied = Diagram(given.name)
        copied.extend(
            [Instance("Mine", one.name, one.bindings) if one.kind == kind else one for one in given.instances],
            given.connections,
        )
        kinds = tuple(replace(one, name="Mine") if one.name == kind else one for one in VOCABULARY)
        assert edits(copied, kinds) == usual, kind
