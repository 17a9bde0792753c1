"""Control practice sees what a block does: a copy of a kind under another name is edited like the
kind.
"""

from dataclasses import replace

import pytest
from collecting import each_of

from ibrid.modules.vocabulary import VOCABULARY, Vocabulary, find_kind
from ibrid.parts import FAMILIES, Edit, Strength, insertions, views_of
from ibrid.structure import Diagram, textbook
from ibrid.structure.diagrams.diagram import Instance


def edits(diagram: Diagram, kinds: Vocabulary) -> tuple[int, int]:
    """Number of moves and of insertions."""
    moves = (
        move
        for view in views_of(diagram, kinds)
        for family in FAMILIES
        for move in family.moves(view)
    )
    return len(list(moves)), len(insertions(diagram, kinds))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gfl_pll_filter_exact", "gfm_vsm"])
def test_a_copy_of_a_kind_in_its_place_is_edited_as_often(name):
    given = textbook(name)
    usual = edits(given, VOCABULARY)
    for kind in {one.kind for one in given.instances}:
        copied = Diagram(given.name)
        copied.extend(
            [
                Instance("Mine", one.name, one.bindings) if one.kind == kind else one
                for one in given.instances
            ],
            given.connections,
        )
        kinds = tuple(replace(one, name="Mine") if one.name == kind else one for one in VOCABULARY)
        assert edits(copied, kinds) == usual, kind


#: Families without a place of their own: what the kind calls typical is all that can be said.
ANYTHING = ("exchange", "second device")


@pytest.mark.slow
@each_of(
    "name",
    ("naive", "gfl_pll_filter", "gfl_dc_link", "gfm_vsm", "hybrid_gfl_gfm", "parallel_gfl_gfm"),
)
def test_every_move_says_how_strong_what_it_puts_in_usually_is(name):
    for view in views_of(textbook(name), VOCABULARY):
        for family, move in ((one, move) for one in FAMILIES for move in one.moves(view)):
            drawn = view.drawn(move.draw)
            where = f"{family.name}: {move.note}"
            assert family.name in ANYTHING or {*drawn.told, *drawn.was} == {*drawn.boxes}, where
            assert len({len(strength.bank) for strength in drawn.told.values()}) <= 1, where
            for key, strength in drawn.strengths.items():
                low, high = drawn.boxes[key].low, drawn.boxes[key].high
                assert all(low <= value <= high for value in strength.bank), f"{where}, {key}"


def test_a_parameter_that_was_shared_is_told_with_the_name_that_it_had():
    (view,) = views_of(textbook("gfl"), VOCABULARY)
    drawn = view.drawn(lambda draft: draft.unbind("q_loop", "kP", "kI"))
    assert drawn.was == {"q_loop.kP": "power.kP", "q_loop.kI": "power.kI"}


def test_strengths_go_with_what_is_shared_and_where_nothing_is_told_the_kind_says_it():
    (view,) = views_of(textbook("gfl"), VOCABULARY)

    def draw(draft: Edit) -> None:
        names = [
            draft.insert_before(f"{loop}.in_", "LPF1", loop, omega_c=SLOW)
            for loop in ("p_loop", "q_loop")
        ]
        for name in names:
            draft.bind(name, omega_c="corner.omega_c")
        draft.insert_before("pll.e_q", "LPF1", "plain")

    strengths = view.drawn(draw).strengths
    box = find_kind("LPF1", VOCABULARY).parameters["omega_c"]
    assert strengths["corner.omega_c"] == SLOW
    assert strengths["plain.omega_c"].bank == pytest.approx(
        (box.typical / 3, box.typical, 3 * box.typical), rel=1e-12
    )


SLOW = Strength((60.0, 20.0), 1e12)
