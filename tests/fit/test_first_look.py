"""A first look tells which of several edits the data ask for, before any of them is fitted."""

from dataclasses import replace
from math import inf, log

import numpy as np
import pytest
from ibrid_search.edits import apply_edit
from ibrid_search.proposal import Context
from ibrid_search.proposers.first_look import LOOKED_AT, first_look
from ibrid_search.proposers.rules import Rules
from ibrid_search.screening.candidate_problems import PARAMETER_COST
from ibrid_search.screening.settings import SCREENING
from scripted_search import context_of, study

import ibrid
from ibrid.errors import ModuleError
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.parts import Family, Move
from ibrid.structure.editing.drafting import Draft

TRUTH = ibrid.textbook("gfl_pll_filter_exact")


@pytest.fixture(scope="module", params=["shared", "per-op"])
def one_edit_away(request) -> Context:
    """The question about the benchmark's structure without its PLL filter, fitted to the
    benchmark.
    """
    parent = ibrid.textbook("gfl_exact")
    record = ibrid.evaluate(parent, study().sweep, parameters=request.param)
    return context_of(parent, record=record, study=replace(study(), parameters=request.param))


def look(diagram: ibrid.Diagram, context: Context, seed: int = 0) -> float:
    return first_look(diagram, context, np.random.default_rng(seed)).worth


@pytest.mark.slow
def test_the_missing_block_stands_out(one_edit_away):
    parent, kinds = one_edit_away.parent, one_edit_away.study.kinds
    free = parent.record.free_parameters // len(
        parent.record.parameters if one_edit_away.study.parameters == "per-op" else [1]
    )
    before = log(parent.record.nrmse) + PARAMETER_COST * free
    idle = Draft(parent.diagram, kinds)
    idle.insert_before("current.in_", "LPF1_dq", "current_filter")
    assert look(parent.diagram, one_edit_away) == pytest.approx(before, abs=0.05)
    assert look(idle.diagram(), one_edit_away) > before - 1
    assert look(TRUTH, one_edit_away) < before - 2


@pytest.mark.slow
def test_a_look_repeats_exactly(one_edit_away):
    assert look(TRUTH, one_edit_away, 3) == look(TRUTH, one_edit_away, 3)


@pytest.mark.slow
def test_what_has_no_response_is_worth_nothing(one_edit_away, monkeypatch):
    def broken(*_, **__):
        raise ModuleError("the law of a kind of somebody's own broke off")

    monkeypatch.setattr("ibrid_search.screening.candidate_problems.symbolic_model", broken)
    assert look(TRUTH, one_edit_away) == inf


@pytest.mark.nightly
def test_among_many_edits_the_looks_choose_the_missing_block(one_edit_away):
    text, found = ibrid.program_text(one_edit_away.parent.diagram), []
    for seed in range(12):
        proposal = Rules(looks=60).propose(one_edit_away, np.random.default_rng(seed))
        if "first_looks" in proposal.usage:
            assert proposal.usage["first_looks"] == 60
            found.append(
                ibrid.compare(ibrid.parse_program(apply_edit(proposal.edit, text)), TRUTH).same
            )
    assert len(found) >= 3
    assert sum(found) >= 0.8 * len(found)


@pytest.mark.nightly
def test_the_share_that_comes_as_it_is_drawn_has_no_looks(one_edit_away):
    filtered = Move("a filter", lambda draft: draft.insert_before("pll.e_q", "LPF1", "x"))
    delayed = Move("a delay", lambda draft: draft.insert_before("plant.u_r", "Delay", "x"))
    families = tuple(
        Family(name, "module", (1.0, 1.0, 1.0, 1.0), 1.0, lambda _, move=move: iter([move]))
        for name, move in (("one", filtered), ("other", delayed))
    )
    number = 60
    proposals = [
        Rules(families, looks=2).propose(one_edit_away, np.random.default_rng(seed))
        for seed in range(number)
    ]
    looked = [one for one in proposals if "first_looks" in one.usage]
    # sixty draws: four standard deviations are 0.26
    assert len(looked) / number == pytest.approx(LOOKED_AT, abs=0.26)
    assert {one.note for one in looked} == {"a filter"}
    assert {one.note for one in proposals} == {"a filter", "a delay"}


@pytest.mark.slow
def test_while_the_error_is_gross_nothing_is_looked_at(one_edit_away):
    record = replace(one_edit_away.parent.record, nrmse=1.1 * SCREENING.gross_error)
    context = replace(one_edit_away, parent=replace(one_edit_away.parent, record=record))
    proposals = [Rules().propose(context, np.random.default_rng(seed)) for seed in range(20)]
    assert all(one.edit and "first_looks" not in one.usage for one in proposals)


@pytest.mark.slow
def test_with_known_noise_a_free_number_must_gain_what_information_asks():
    exact = study().sweep
    noisy = add_noise(exact, 40.0, rng=np.random.default_rng(0))
    for sweep, price in ((exact, PARAMETER_COST), (noisy, log(8 * 32) / (2 * 8 * 32))):
        record = ibrid.evaluate(TRUTH, sweep)
        context = context_of(TRUTH, record=record, study=replace(study(), sweep=sweep))
        invisible = Draft(TRUTH, study().kinds)
        fitted = next(iter(record.parameters.values()))
        invisible.bind("plant", L_F=fitted["plant.L_F"])  # not visible beside the inner loop
        assert look(TRUTH, context) - look(invisible.diagram(), context) == pytest.approx(
            price, rel=0.02
        )
