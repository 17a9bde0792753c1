"""Diagnosis: a few warm steps of every edit rank first what the data hide, and a search by it needs
a handful of evaluations.
"""

from dataclasses import replace
from math import log

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.search.inverters import inverter
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.proposers.diagnosis import Diagnosis
from ibrid_search.proposers.pruning import AFFORDABLE, Pruning, removal_moves
from ibrid_search.screening.candidate_edits import (
    CandidateEdit,
    list_arbitrary_edits,
    list_effect_edits,
    list_exchange_edits,
    list_family_edits,
)
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.edit_screening import EditScreener
from ibrid_search.screening.selection_criterion import build_criterion
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings
from scripted_search import steps_of
from sharing import shared

import ibrid
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.parts.editing.view import views_of
from ibrid.structure.comparison.compare import compare
from ibrid.study import Study


def screener_of(sweep: Sweep) -> EditScreener:
    study = Study(sweep)
    return EditScreener(study, build_criterion(study, SearchSettings()))


@shared
def fitted(name: str, parent: str) -> tuple[Study, Evaluated]:
    """A hidden inverter's study, and a shipped diagram fitted to it."""
    study = Study(inverter(name).sweep)
    return study, Evaluated(
        0, ibrid.textbook(parent), ibrid.evaluate(ibrid.textbook(parent), study)
    )


@pytest.mark.slow
def test_a_part_is_exchanged_for_each_effect_that_it_is_confused_with():
    study = Study(ibrid.read_sweep(ibrid.benchmarks()["paper_like"]))
    given = ibrid.textbook("gfl_sogi_feedforward")
    exchanges = list_exchange_edits(given, study)
    (exchanged,) = (
        edit.diagram
        for edit in exchanges
        if edit.source == "feedforward_band_pass + negative_sequence_control"
        and "the way through band_pass" in edit.description
        and "with its gains" in edit.description
    )
    kinds = {instance.kind for instance in exchanged.instances}
    assert "PI_negative_dq" in kinds
    assert "SOGI_dq" not in kinds
    single = {study.hash_of(edit.diagram) for edit in list_effect_edits(given, study)}
    hashes = [study.hash_of(edit.diagram) for edit in exchanges]
    assert len({*hashes, *single}) == len(hashes) + len(single)


@pytest.mark.nightly
@each_of("name", ("gfl_l_filter", "gfl_dc_link", "gfm_dvoc"))
def test_the_first_look_finds_the_family_of_a_shipped_inverter(name: str):
    looks = screener_of(ibrid.read_sweep(ibrid.benchmarks()[name])).screen_library()
    assert looks[0].edit.source == name
    assert [look.score for look in looks] == sorted(look.score for look in looks)
    assert "parallel_gfl_gfm" not in {look.edit.source for look in looks}


@pytest.mark.slow
def test_a_shipped_diagram_of_kinds_that_the_vocabulary_lacks_gets_no_look():
    study = Study(ibrid.read_sweep(ibrid.benchmarks()["gfl_l_filter"]), vocabulary="paper")
    looks = EditScreener(study, build_criterion(study, SearchSettings())).screen_library()
    assert "gfl_dc_link" not in {look.edit.source for look in looks}
    assert "gfl" in {look.edit.source for look in looks}


@pytest.mark.slow
def test_two_inverters_are_looked_for_where_two_are_said_to_be_there():
    looks = screener_of(ibrid.read_sweep(ibrid.benchmarks()["parallel_gfl_gfm"])).screen_library(2)
    assert [look.edit.source for look in looks] == ["parallel_gfl_gfm"]


@pytest.mark.slow
def test_a_look_is_the_same_twice_and_never_better_than_nothing_measured():
    study, parent = fitted("no_decoupling", "gfl_pll_filter_exact")
    values = [parent.record.parameters[name] for name in study.fitted.names]
    edit = next(
        one for one in list_effect_edits(parent.diagram, study) if one.source == "decoupling"
    )
    one, other = (
        EditScreener(study, build_criterion(study, SearchSettings())).screen_from_parent(
            edit, values
        )
        for _ in range(2)
    )
    assert one.error == other.error
    assert one.values == other.values
    assert 0.0 <= one.error < np.inf


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("hidden", "parent", "part"),
    [
        ("no_decoupling", "gfl_pll_filter_exact", "decoupling"),
        ("pll_and_power_filters", "gfl_pll_filter_exact", "power_filter"),
    ],
)
def test_what_the_device_has_otherwise_ranks_first_though_the_parent_is_bent_to_fit(
    hidden: str, parent: str, part: str
):
    study, given = fitted(hidden, parent)
    values = [given.record.parameters[name] for name in study.fitted.names]
    looks = EditScreener(study, build_criterion(study, SearchSettings())).rank_edits(
        list_effect_edits(given.diagram, study), values
    )
    assert looks[0].edit.source == part
    assert looks[0].error < 0.01 * given.record.nrmse


@pytest.mark.slow
def test_every_edit_is_a_structure_of_its_own_and_says_how_strong_it_usually_is():
    study, given = fitted("no_decoupling", "gfl_pll_filter_exact")
    stages = [
        edits(given.diagram, study)
        for edits in (list_effect_edits, list_family_edits, list_arbitrary_edits)
    ]
    edits = [one for stage in stages for one in stage]
    hashes = [study.hash_of(one.diagram) for one in edits]
    assert len(set(hashes) | {study.hash_of(given.diagram)}) == len(hashes) + 1
    assert all(one.usual for one in (*stages[0], *stages[1]))
    assert not any(one.usual for one in stages[2])
    assert all(values for edit in edits for values in edit.initial_values.values())


@pytest.mark.nightly
def test_a_proposal_is_the_best_edit_that_the_run_has_not_met():
    study, given = fitted("no_decoupling", "gfl_pll_filter_exact")
    proposer, context = Diagnosis(), Context(study, given)
    first = proposer.propose(context, np.random.default_rng(0))
    assert first.note.startswith("decoupling: remove")
    truth = inverter("no_decoupling").truth
    assert truth is not None
    met = study.hash_of(truth)
    second = proposer.propose(replace(context, seen={met}.__contains__), np.random.default_rng(0))
    assert second.edit
    assert second.edit != first.edit


@pytest.mark.slow
def test_while_a_layer_of_control_is_missing_what_puts_it_in_comes_before_what_refines():
    study = Study(inverter("no_decoupling").sweep)
    bare = ibrid.textbook("gfl_pll_filter_exact")
    view = views_of(bare, study.kinds)[0]
    cut = next(
        one
        for one in list_effect_edits(bare, study)
        if one.description.startswith("pll_missing: remove")
    ).diagram
    given = Evaluated(0, cut, ibrid.evaluate(cut, study))
    assert view.roles.missing_layers == 0
    assert given.record.nrmse > SCREENING.gross_error
    best = rankings_for(study).best_edits(given, lambda diagram: True, number=30)
    assert best
    assert {views_of(look.edit.diagram, study.kinds)[0].roles.missing_layers for look in best} == {
        0
    }


@pytest.mark.slow
def test_a_current_loop_may_take_the_outer_loops_as_its_reference_and_leave_the_feedforward():
    study = Study(inverter("no_decoupling").sweep)
    whole = ibrid.textbook("gfl_pll_filter_exact")
    without = next(
        one
        for one in list_effect_edits(whole, study)
        if one.description.startswith("current_loop_missing: remove")
    )
    back = [
        one.description
        for one in list_effect_edits(without.diagram, study)
        if study.hash_of(one.diagram) == study.hash_of(whole)
    ]
    assert len(back) == 1
    assert "with the outer loops as its reference" in back[0]


@pytest.mark.slow
def test_what_a_look_cannot_do_without_is_not_taken_away():
    truth = inverter("no_decoupling").truth
    assert truth is not None
    study = Study(inverter("no_decoupling").sweep)
    context = Context(study, Evaluated(1, truth, ibrid.evaluate(truth, study)))
    assert Pruning().propose(context, np.random.default_rng(0)).edit
    assert not Diagnosis().remover(thorough=False).propose(context, np.random.default_rng(0)).edit


@pytest.mark.slow
def test_under_noise_a_look_says_in_free_numbers_what_a_removal_costs_as_a_fit_does():
    study = Study(inverter("no_decoupling").noisy(50.0, 0).sweep)
    diagram = ibrid.textbook("gfl_pll_filter_exact")
    parent = Evaluated(0, diagram, ibrid.evaluate(diagram, study))
    (view,) = views_of(diagram, study.kinds)
    costs = {}
    for name in ("decoupling", "pll_filter"):
        move = next(
            one
            for one in removal_moves(view)
            if one.note.startswith("without") and name in one.note
        )
        less = ibrid.evaluate(view.after(move), study)
        assert less.over_noise is not None
        assert parent.record.over_noise is not None
        saved = parent.record.free_parameters - less.free_parameters
        by_fit = (
            log(less.over_noise / parent.record.over_noise)
            / build_criterion(study, SearchSettings()).parameter_cost
            - saved
        )
        costs[name] = rankings_for(study).removal_loss(parent, view.after(move))
        assert costs[name] == pytest.approx(by_fit, abs=0.5, rel=0.1)
    assert costs["decoupling"] < 0 < AFFORDABLE < costs["pll_filter"]


@pytest.mark.slow
def test_where_the_candidate_itself_has_no_look_a_removal_is_held_against_its_fit(monkeypatch):
    study = Study(inverter("no_decoupling").noisy(50.0, 0).sweep)
    diagram = ibrid.textbook("gfl_exact")
    parent = Evaluated(0, diagram, ibrid.evaluate(diagram, study))
    rankings = rankings_for(study)
    ranked = rankings.screener.rank_edits

    def blind(edits, values, **options):
        looks = ranked(edits, values, **options)
        return [
            replace(look, error=np.inf) if look.edit.diagram is diagram else look for look in looks
        ]

    monkeypatch.setattr(rankings.screener, "rank_edits", blind)
    (view,) = views_of(diagram, study.kinds)
    losses = [
        rankings.removal_loss(parent, view.after(move))
        for move in removal_moves(view)
        if "decoupling" in move.note
    ]
    assert losses
    assert all(-1.0 < loss < AFFORDABLE for loss in losses)


@pytest.mark.slow
def test_a_block_without_which_no_record_has_an_answer_is_not_taken_away(monkeypatch):
    study, given = fitted("no_decoupling", "gfl_pll_filter_exact")
    rankings = rankings_for(study)
    # as a race of records in which none arrives
    monkeypatch.setattr(rankings.screener, "rank_edits", lambda edits, values: [])
    (view,) = views_of(given.diagram, study.kinds)
    assert {rankings.removal_loss(given, view.after(move)) for move in removal_moves(view)} == {
        np.inf
    }


@pytest.mark.slow
def test_an_edit_that_cannot_be_fitted_is_worth_nothing():
    study, given = fitted("no_decoupling", "gfl_pll_filter_exact")
    values = [given.record.parameters[name] for name in study.fitted.names]
    unfit = CandidateEdit(
        ibrid.parse_program('def build(g):\n    g.add("PI", "alone")\n'), "", "", {}
    )
    look = EditScreener(study, build_criterion(study, SearchSettings())).screen_from_parent(
        unfit, values
    )
    assert look.score == np.inf


def test_much_data_is_thinned_for_looks_with_its_ends_kept():
    point = ibrid.read_sweep(ibrid.benchmarks()["paper_like"]).points[0]
    many = replace(
        point,
        frequency=np.geomspace(1.0, 2000.0, 200),
        admittance=np.ones((200, 2, 2), dtype=complex),
        sigma=None,
    )
    chosen = coarse([many] * 10, SCREENING.max_operating_points, SCREENING.max_frequencies)
    assert len(chosen) == SCREENING.max_operating_points
    assert [len(one.frequency) for one in chosen] == [
        SCREENING.max_frequencies
    ] * SCREENING.max_operating_points
    assert (chosen[0].frequency[0], chosen[0].frequency[-1]) == (1.0, 2000.0)


@pytest.mark.nightly
def test_a_search_from_the_data_alone_ends_at_the_hidden_diagram_and_goes_on_as_if_never_stopped(
    tmp_path,
):
    hidden = inverter("no_decoupling")
    assert hidden.truth is not None
    whole = ibrid.search(hidden.sweep, tmp_path / "whole", budget=40)
    assert whole.ending == "the fit is exact"
    assert whole.evaluations <= 15
    assert whole.best is not None
    assert compare(whole.best.diagram, hidden.truth).same
    ibrid.search(hidden.sweep, tmp_path / "again", budget=3)
    again = ibrid.search(hidden.sweep, tmp_path / "again", budget=40, resume=True)
    assert again.trajectory == whole.trajectory
    shown = [step.proposer for step in steps_of(tmp_path / "whole" / "archive.sqlite")]
    assert shown[1:5] == ["shipped"] * 4
