"""The baseline: edits by chance, legal and new, without any idea of an inverter."""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_search.edits import apply_edit
from ibrid_search.evaluated import SCALES
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.random_edits import RandomEdits
from ibrid_search.screening.plausibility import refusal_reason
from scripted_search import NAIVE, context_of, study

import ibrid
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.structure.compiling.canonical import structure_hash

PARENTS = ("naive", "gfl_exact", "gfl_l_filter_delay")


def hash_of(text: str) -> str:
    return structure_hash(ibrid.parse_program(text), VOCABULARY)


def proposed(text: str, seed: int, **changes) -> Proposal:
    return RandomEdits().propose(
        context_of(ibrid.parse_program(text), **changes), np.random.default_rng(seed)
    )


def walked(seed: int, number: int, scale: str | None = None) -> list[str]:
    """Programs along a walk of random edits from the naive start, none visited twice."""
    rng, texts, seen = np.random.default_rng(seed), [NAIVE], {hash_of(NAIVE)}
    for count in range(number):
        context = context_of(
            ibrid.parse_program(texts[-1]), scale=scale or SCALES[count % 3], seen=seen.__contains__
        )
        proposal = RandomEdits().propose(context, rng)
        assert proposal.failure == ""
        texts.append(apply_edit(proposal.edit, texts[-1]))
        assert hash_of(texts[-1]) not in seen
        seen.add(hash_of(texts[-1]))
    return texts


@pytest.mark.slow
@each_of("scale", SCALES)
@each_of("name", PARENTS)
def test_an_edit_by_chance_leads_to_a_legal_plausible_new_structure(name, scale):
    text = ibrid.program_text(ibrid.textbook(name))
    for seed in range(10):
        proposal = proposed(text, seed, scale=scale, seen={hash_of(text)}.__contains__)
        found = ibrid.parse_program(apply_edit(proposal.edit, text))
        assert ibrid.violations(found) == ()
        assert refusal_reason(ibrid.structure.compiling.check.warnings(found, VOCABULARY)) == ""
        assert hash_of(ibrid.program_text(found)) != hash_of(text)
        assert proposal.note


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_long_walk_stays_legal_and_meets_nothing_twice(seed):
    for text in walked(seed, 30):
        assert ibrid.violations(ibrid.parse_program(text)) == ()


def test_the_same_random_numbers_give_the_same_edit():
    assert [proposed(NAIVE, seed) for seed in range(5)] == [
        proposed(NAIVE, seed) for seed in range(5)
    ]
    assert len({proposed(NAIVE, seed, scale="structural").edit for seed in range(10)}) > 3


def test_chance_meets_many_kinds():
    kinds = {
        one.kind
        for seed in range(8)
        for text in walked(seed, 12)
        for one in ibrid.parse_program(text).instances
    }
    assert len(kinds) > 12
    assert {"LCL", "LFilter"} <= kinds


def test_a_local_edit_neither_brings_nor_exchanges_a_kind():
    text = ibrid.program_text(ibrid.textbook("gfl_exact"))
    kinds = {one.kind for one in ibrid.parse_program(text).instances}
    for seed in range(20):
        edit = proposed(text, seed, scale="local", seen={hash_of(text)}.__contains__).edit
        after = {one.kind for one in ibrid.parse_program(apply_edit(edit, text)).instances}
        assert after <= kinds | {
            "ConstZero"
        }  # what is left undriven is tidied away, an axis gets zero


def test_under_the_papers_vocabulary_chance_knows_no_other_kind():
    asked = replace(study(), vocabulary=PAPER_VOCABULARY)
    for seed in range(20):
        proposal = proposed(NAIVE, seed, scale="structural", study=asked)
        names = {
            one.kind for one in ibrid.parse_program(apply_edit(proposal.edit, NAIVE)).instances
        }
        assert names <= {kind.name for kind in PAPER_VOCABULARY}


def test_when_everything_is_known_chance_gives_up_in_a_sentence():
    proposal = proposed(NAIVE, 0, seen=lambda _: True)
    assert proposal.edit == ""
    assert "no new legal structure" in proposal.failure
