"""The recursion: what a proposal may see, what it costs, who becomes a parent."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.random_edits import RandomEdits
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion.loop import BUDGET, NOTHING_NEW
from ibrid_search.screening.selection_criterion import estimate_noise_floor
from ibrid_search.settings import SearchSettings
from ibrid_search.step import EVALUATED, REFUSED, Status, Step
from scripted_search import (
    NAIVE,
    PLAIN,
    ScriptedEvaluator,
    ScriptedProposer,
    Verdict,
    by_luck,
    ended,
    fixed,
    luck,
    luckily_stable,
    naive_record,
    noisy,
    numbered,
    scripted,
    steps_of,
    study,
)

from ibrid.errors import IbridError
from ibrid.fit.adequacy import BETTER


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "archive.sqlite"


# what a proposal sees


@pytest.mark.slow
@pytest.mark.parametrize(
    ("window", "own", "expected"), [(1, None, 1), (3, None, 3), (8, None, 8), (8, 1, 1), (2, 5, 2)]
)
def test_proposal_k_sees_the_results_up_to_k_minus_the_window(path, window, own, expected):
    evaluator, seen = ScriptedEvaluator(), []

    def answer(context: Context, number: int) -> Proposal:
        seen.append((number, sorted(evaluator.collected), context.last, context.parent.step))
        return numbered(context, number)

    settings = replace(PLAIN, window=window)
    proposers = ((ScriptedProposer(answer, window=own), 1.0),)
    ended(path, proposers=proposers, settings=settings, evaluator=evaluator, budget=14)
    assert len(seen) == 13
    for number, collected, last, parent in seen:
        newest = max(number - expected, 0)
        assert collected == list(range(newest + 1))
        assert parent <= newest
        assert (last is None and newest == 0) or last.number == newest


def test_with_history_the_best_and_the_last_failures_are_shown_best_and_latest_first(path):
    def law(program: str) -> Verdict:
        return (
            Status.FAILED if "k=0.003" in program or "k=0.005" in program else 0.1 + luck(program)
        )

    proposer = ScriptedProposer(numbered)
    ended(
        path,
        proposers=((proposer, 1.0),),
        settings=replace(PLAIN, history=2, window=1),
        budget=10,
        evaluator=ScriptedEvaluator(law, stable=lambda _: True),
    )
    last = proposer.asked[-1]
    assert [one.number for one in last.failures] == [5, 3]
    errors = {
        step.number: step.nrmse
        for step in steps_of(path)
        if step.nrmse is not None and step.number < 9
    }
    del errors[last.parent.step]
    shown = [one.record.nrmse for one in last.best]
    assert len(shown) == 2
    assert shown == sorted(shown)
    assert set(shown) <= set(errors.values())


def test_without_history_a_proposer_sees_the_parent_alone(path):
    proposer = ScriptedProposer(numbered)
    ended(path, proposers=((proposer, 1.0),), settings=PLAIN, budget=12)
    assert all((one.best, one.failures) == ((), ()) for one in proposer.asked)


def test_what_was_met_is_known_to_the_proposer(path):
    proposer = ScriptedProposer(numbered)
    ended(path, proposers=((proposer, 1.0),), settings=PLAIN, budget=6)
    hashes = [step.hash for step in steps_of(path)]
    assert all(proposer.asked[-1].seen(one) for one in hashes)
    assert not proposer.asked[-1].seen("0" * 32)


def test_a_candidate_is_fitted_from_its_parents_values(path):
    evaluator = ScriptedEvaluator()
    ended(path, evaluator=evaluator, budget=10)
    steps = steps_of(path)
    assert evaluator.jobs[0].warm is None
    for job in evaluator.jobs[1:]:
        parent = steps[job.number].parent
        assert parent is not None
        assert job.warm == naive_record().parameters
        assert 0 < job.promising < steps[parent].nrmse
        assert job.free_before == naive_record().free_parameters > 0


def test_with_known_noise_what_promises_more_is_measured_against_the_noise(path):
    data = noisy()
    floor = estimate_noise_floor(data)
    evaluator = ScriptedEvaluator(
        misfit=lambda nrmse: 3 * nrmse / floor.level
    )  # weights make the error three times the NRMSE
    ended(path, sweep=data, evaluator=evaluator, budget=10)
    steps = steps_of(path)
    for job in evaluator.jobs[1:]:
        parent = steps[steps[job.number].parent or 0]
        assert job.promising == pytest.approx(BETTER.promising * 3 * parent.nrmse)


# what it costs


@pytest.mark.slow
@pytest.mark.parametrize("budget", [1, 2, 7, 25])
@pytest.mark.parametrize("window", [1, 8])
def test_the_budget_is_spent_to_the_last_evaluation_and_no_further(path, budget, window):
    evaluator = ScriptedEvaluator()
    ending, loop = ended(
        path, evaluator=evaluator, budget=budget, settings=SearchSettings(window=window)
    )
    steps = steps_of(path)
    assert ending == BUDGET
    assert loop.evaluations == len(evaluator.jobs) == budget
    assert sum(step.status in EVALUATED for step in steps) == budget
    assert not any(step.status is Status.PENDING for step in steps)


def test_duplicates_and_refusals_cost_nothing(path):
    def answer(context: Context, number: int) -> Proposal:
        program = context.parent.record.program
        if number % 4 == 0:
            return Proposal(edit_between(program, fixed(4)))  # the same structure every time
        if number % 4 == 1:
            return Proposal("no block at all")
        if number % 4 == 2:
            return Proposal("", failure="no server")
        return numbered(context, number)

    evaluator = ScriptedEvaluator()
    ending, _ = ended(
        path,
        proposers=((ScriptedProposer(answer), 1.0),),
        evaluator=evaluator,
        budget=8,
        settings=PLAIN,
    )
    steps = steps_of(path)
    assert ending == BUDGET
    assert len(evaluator.jobs) == 8
    found = Counter(step.status for step in steps)
    assert found[Status.NO_EDIT] >= 5
    assert found[Status.NO_ANSWER] >= 5
    assert found[Status.DUPLICATE] >= 3
    first = next(step.number for step in steps if step.hash == steps[first_duplicate(steps)].hash)
    assert all(step.same_as == first for step in steps if step.status is Status.DUPLICATE)


def first_duplicate(steps: list[Step]) -> int:
    return next(step.number for step in steps if step.status is Status.DUPLICATE)


def test_a_duplicate_of_what_is_still_under_way_is_one_too(path):
    same = ScriptedProposer(
        lambda context, _: Proposal(edit_between(context.parent.record.program, fixed(1)))
    )
    evaluator = ScriptedEvaluator(lambda _: 0.5)
    settings = replace(PLAIN, patience=5)
    ended(path, proposers=((same, 1.0),), evaluator=evaluator, settings=settings)
    steps = steps_of(path)
    assert [step.status for step in steps[:4]] == [
        Status.OK,
        Status.OK,
        Status.DUPLICATE,
        Status.DUPLICATE,
    ]
    assert len(evaluator.jobs) == 2


def test_a_run_without_new_structures_ends_by_patience(path):
    silent = ScriptedProposer(lambda *_: Proposal("", failure="no idea"))
    ending, _ = ended(path, proposers=((silent, 1.0),), settings=replace(PLAIN, patience=6))
    assert ending == NOTHING_NEW
    assert len(silent.asked) == 6


# one more attempt


def stubborn(context: Context, number: int) -> Proposal:
    """Nonsense at first, something new once there is a complaint."""
    return Proposal("nonsense") if context.complaint is None else numbered(context, number)


def test_an_answer_that_cannot_be_used_is_asked_for_once_more_with_the_complaint(path):
    proposer = ScriptedProposer(stubborn, attempts=2)
    ended(path, proposers=((proposer, 1.0),), settings=PLAIN, budget=4)
    complaints = [one.complaint for one in proposer.asked]
    assert len(complaints) == 6  # three steps of two attempts
    assert [one is None for one in complaints] == [True, False] * 3
    assert complaints[1] is not None
    assert complaints[1].edit == "nonsense"
    assert "SEARCH" in complaints[1].reason
    assert [step.status for step in steps_of(path)] == [Status.OK] * 4 or all(
        step.status in EVALUATED for step in steps_of(path)
    )


def test_what_both_attempts_have_taken_is_counted(path):
    def answer(context: Context, number: int) -> Proposal:
        used = {
            "prompt_tokens": 100 * number,
            "cost": 0.25,
            "model": f"model {number}",
            "cut": True,
        }
        return replace(
            stubborn(context, number),
            usage=used if context.complaint is None else {**used, "cut": False},
        )

    ended(path, proposers=((ScriptedProposer(answer, attempts=2), 1.0),), settings=PLAIN, budget=2)
    assert steps_of(path)[1].usage == {
        "prompt_tokens": 300,
        "cost": 0.5,
        "model": "model 2",
        "cut": False,
    }


def test_the_last_attempt_counts_as_it_is(path):
    proposer = ScriptedProposer(lambda *_: Proposal("nonsense"), attempts=2)
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, patience=3))
    assert [step.status for step in steps_of(path)[1:]] == [Status.NO_EDIT] * 3
    assert len(proposer.asked) == 6


@pytest.mark.parametrize(
    "answer",
    [Proposal("", failure="dead"), Proposal(edit_between(NAIVE, NAIVE.replace("gain", "k")))],
)
def test_a_dead_server_and_an_unchanged_program_are_not_asked_again(path, answer):
    proposer = ScriptedProposer(lambda *_: answer, attempts=2)
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, patience=3))
    assert len(proposer.asked) == 3


# who becomes a parent, and the best


@pytest.mark.slow
def test_what_failed_is_never_a_parent_and_never_the_best(path):
    def law(program: str) -> Verdict:
        return Status.FAILED if program != NAIVE and luck(program) < 0.5 else by_luck(program)

    _, loop = ended(path, evaluator=ScriptedEvaluator(law), budget=40)
    steps = steps_of(path)
    assert Counter(step.status for step in steps)[Status.FAILED] > 3
    parents = [steps[step.parent] for step in steps if step.parent is not None]
    assert {parent.status for parent in parents} == {Status.OK}
    assert loop.best is not None
    assert loop.best.status is Status.OK


@pytest.mark.slow
def test_an_unstable_candidate_is_never_the_best_however_well_it_fits(path):
    def law(program: str) -> float:
        found = by_luck(program)
        return 1e-9 if not luckily_stable(program) else found if isinstance(found, float) else 2.0

    _, loop = ended(path, evaluator=ScriptedEvaluator(law), budget=40)
    steps = steps_of(path)
    wild = [step for step in steps if step.stable is False]
    assert wild
    assert loop.best is not None
    assert loop.best.stable is True
    assert loop.best.nrmse is not None
    assert loop.best.nrmse > 1e-3
    assert {entry.step for entry in loop.archive.entries} >= {
        step.number for step in wild
    }  # kept and shown
    assert not {entry.step for entry in loop.archive.elites} & {step.number for step in wild}


@pytest.mark.slow
def test_what_is_not_as_required_is_told_and_no_parent(path):
    _, loop = ended(path, require="stable", budget=40)
    steps = steps_of(path)
    refused = [step for step in steps if step.status is Status.REQUIRED]
    assert refused
    assert all("right half plane" in step.reason for step in refused)
    assert all(step.nrmse is not None for step in refused)
    assert not {step.parent for step in steps} & {step.number for step in refused}
    assert not {entry.step for entry in loop.archive.entries} & {step.number for step in refused}


def test_a_start_that_is_not_as_required_is_searched_from_but_never_the_best(path):
    evaluator = ScriptedEvaluator(stable=lambda program: program != NAIVE)
    _, loop = ended(path, evaluator=evaluator, require="stable", budget=12)
    steps = steps_of(path)
    assert steps[0].status is Status.REQUIRED
    assert steps[1].parent == 0
    assert loop.best is not None
    assert loop.best.number > 0


def test_the_search_does_not_stop_when_nothing_is_stable(path):
    ending, loop = ended(path, evaluator=ScriptedEvaluator(stable=lambda _: False), budget=15)
    assert (ending, loop.best, loop.evaluations) == (BUDGET, None, 15)


@pytest.mark.parametrize("status", [Status.FAILED, Status.UNFINISHED, Status.LOST])
def test_a_start_without_a_fit_ends_the_run_in_a_sentence(path, status):
    with pytest.raises(IbridError, match=rf"the start must have a fit, found {status}.*--start"):
        ended(path, evaluator=ScriptedEvaluator(lambda _: status))


def test_an_illegal_start_ends_the_run_in_a_sentence(path):
    with (
        scripted(path) as loop,
        pytest.raises(IbridError, match="the start must be a legal diagram"),
    ):
        loop.run(NAIVE.replace('    g.connect("gain.out", "plant.u_r")\n', ""))
    assert steps_of(path) == []


@pytest.mark.slow
def test_proposers_are_asked_by_their_weights(path):
    often, seldom = (
        ScriptedProposer(numbered),
        ScriptedProposer(lambda context, number: numbered(context, 500 + number)),
    )
    ended(path, proposers=((often, 3.0), (seldom, 1.0)), settings=PLAIN, budget=81)
    # of 80 steps a quarter, 20 +- 4
    assert 8 <= len(seldom.asked) <= 32
    assert len(often.asked) + len(seldom.asked) == 80


# everything else


def test_every_step_is_watched_once_and_in_order(path):
    watched: list[int] = []
    ended(path, budget=15, watch=lambda loop, step: watched.append(step.number))
    assert watched == list(range(len(steps_of(path))))


def test_every_refusal_has_its_own_reason(path):
    ended(
        path,
        proposers=((RandomEdits(), 1.0), (ScriptedProposer(lambda *_: Proposal("?")), 1.0)),
        budget=20,
    )
    refused = [step for step in steps_of(path) if step.status in REFUSED]
    assert refused
    assert all(step.reason for step in refused)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"window": 0}, "window"),
        ({"patience": 0}, "patience"),
        ({"pruning": 1.5}, "pruning"),
        ({"final_pruning": -0.1}, "final_pruning"),
        ({"scales": {"local": 1.0}}, "scales must name local, module, structural"),
        ({"scales": {"local": 0.5, "module": 0.5, "structural": 0.5}}, "add up to 1"),
        ({"scales": {"local": -0.5, "module": 0.5, "structural": 1.0}}, "shares"),
        ({"islands": 0}, "islands"),
        ({"devices": 0}, "must be 1 or 2, found 0"),
        ({"devices": 3}, "must be 1 or 2, found 3"),
    ],
)
def test_settings_that_mean_nothing_are_refused_in_a_sentence(path, change, told):
    with pytest.raises(IbridError, match=told), scripted(path, settings=SearchSettings(**change)):
        pass


@pytest.mark.slow
def test_scales_are_drawn_by_their_shares(path):
    proposer = ScriptedProposer(numbered)
    scales = {"local": 0.0, "module": 0.25, "structural": 0.75}
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, scales=scales), budget=81)
    found = Counter(one.scale for one in proposer.asked)
    assert found["local"] == 0
    assert 8 <= found["module"] <= 32  # of 80 a quarter, 20 +- 4


@pytest.mark.slow
def test_the_rules_improve_on_the_start(path):
    _, loop = ended(path, proposers=((Rules(looks=1), 1.0),), budget=30)
    assert loop.best is not None
    assert loop.best.nrmse is not None
    assert loop.best.nrmse < (steps_of(path)[0].nrmse or 0.0)
    assert study().parameters == "shared"
