"""The contract tests for authors: what ships passes them, and what breaks them is told everything
at once.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.random_edits import RandomEdits
from ibrid_search.proposers.rules import Rules

import ibrid
from ibrid.modules import VOCABULARY, find_kind
from ibrid.parts.catalogue import CATALOGUE
from ibrid.parts.editing.practice import Effect
from ibrid.parts.editing.view import Strength
from ibrid.structure import textbook
from ibrid.testing import check_effect, check_kind, check_proposer

FEW = (textbook("gfl_pll_filter_exact"), textbook("gfl_l_filter_delay"), textbook("gfm_droop"))


@pytest.mark.slow
def test_every_shipped_kind_keeps_the_contract():
    for kind in VOCABULARY:
        check_kind(kind, points=3)


@pytest.mark.nightly
def test_every_shipped_effect_keeps_the_contract():
    for effect in CATALOGUE:
        check_effect(effect, FEW)


@pytest.mark.slow
@pytest.mark.parametrize("make", [pytest.param(Rules, marks=pytest.mark.nightly), RandomEdits])
def test_every_shipped_offline_proposer_keeps_the_contract(make):
    check_proposer(make)


def test_a_kind_that_breaks_the_contract_is_told_everything_at_once():
    def idle(omega_c, spare):
        return [[-omega_c]], [[omega_c]], [[1.0]], [[0]]

    low_pass = find_kind("LPF1", VOCABULARY)
    boxes = {"omega_c": low_pass.parameters["omega_c"], "spare": low_pass.parameters["omega_c"]}
    with pytest.raises(AssertionError, match="LPF1: spare must change the response") as told:
        check_kind(replace(low_pass, state_space=idle, parameters=boxes))
    assert "must travel to another process" in str(told.value)
    assert str(told.value).count("\n- ") == 2


def with_strengths(effect: Effect, change: Callable[[Strength], Strength]) -> Effect:
    """An effect whose moves have other strengths, by functions that no other process knows."""

    def moves(view):
        for move in effect.moves(view):

            def draw(draft, move=move):
                move.draw(draft)
                draft.strengths = {
                    name: change(strength) for name, strength in draft.strengths.items()
                }

            yield replace(move, draw=draw)

    return replace(effect, moves=moves)


def test_an_effect_that_breaks_the_contract_is_told_everything_at_once():
    delay = with_strengths(CATALOGUE[0], lambda strength: replace(strength, bank=(1.0, 2.0)))
    with pytest.raises(AssertionError) as told:
        check_effect(replace(delay, law=" ", confused_with=(delay.id,)), FEW[:1])
    for words in (
        "law must say",
        "found control_delay itself",
        "must have values within [1e-06, 0.0005]",
        "no lambda",
    ):
        assert words in str(told.value)


def test_an_effect_that_is_not_nothing_at_nothing_is_told_how_far_it_is():
    delay = with_strengths(CATALOGUE[0], lambda strength: replace(strength, nothing=1e-4))
    with pytest.raises(
        AssertionError, match="at `nothing` the model must be the given one, it differs by"
    ):
        check_effect(delay, FEW[:1])


class Careless:
    """Breaks what a proposer keeps to."""

    name, attempts, window = "careless", 0, None

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        if context.complaint is not None:
            raise ValueError("no")
        if context.scale == "structural":
            return Proposal("")
        if context.scale == "module":
            return Proposal(b"bytes")  # type: ignore[arg-type]
        return Proposal(f"no blocks {np.random.default_rng().random()}")


@pytest.mark.slow
def test_a_proposer_that_breaks_the_contract_is_told_everything_at_once():
    with pytest.raises(AssertionError) as told:
        check_proposer(Careless, [ibrid.textbook("naive")])
    for words in (
        "attempts must be 1",
        "must not raise, found ValueError (no)",
        "must not raise, found TypeError (edit of a Proposal must be text, found bytes)",
        "why in `failure`",
        "the same rng",
        "must apply",
    ):
        assert words in str(told.value)
    with pytest.raises(AssertionError, match="must have name, attempts, window and propose"):
        check_proposer(dict)  # type: ignore[arg-type]
