"""The recursion: what a proposal may see, what it costs, who becomes a parent, and that a killed run ends as it would have."""

import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scripted_search
from scripted_search import (
    NAIVE,
    ScriptedEvaluator,
    Verdict,
    by_luck,
    luck,
    luckily_stable,
    naive_record,
    scripted,
    steps_of,
    task,
)

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.noise import add_noise
from ibrid.structure.roles import roles
from search.edits import edit_between
from search.evaluation.assess import PROMISING
from search.evaluation.job import Result
from search.keyboard import keyboard
from search.loop import BUDGET, EXACT_FIT, FLOOR, NOTHING_NEW, SPENT, STOPPED, TARGET, Loop
from search.merit import noise_floor
from search.progress import Progress
from search.proposal import Context, Proposal
from search.proposers.random_edits import RandomEdits
from search.proposers.rules import Rules
from search.proposers.spending import Limits, Spending
from search.requirements import Requirements
from search.settings import SearchSettings
from search.step import EVALUATED, REFUSED, Status, Step
from search.store import Store

#: No step is spent on taking away, so that what the proposer says is what happens.
PLAIN = SearchSettings(pruning=0.0, final_pruning=0.0)


class Scripted:
    """A proposer that remembers what it was asked, and answers by a function of the context and its number."""

    name = "scripted"

    def __init__(
        self, answer: Callable[[Context, int], Proposal], attempts: int = 1, window: int | None = None
    ) -> None:
        self.answer, self.attempts, self.window = answer, attempts, window
        self.asked: list[Context] = []

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        self.asked.append(context)
        return self.answer(context, len(self.asked))


def fixed(number: int) -> str:
    """The naive program with another fixed gain: a structure of its own for every number."""
    return NAIVE.replace('"gain")', f'"gain", k={number / 1000})')


def numbered(context: Context, number: int) -> Proposal:
    """A new structure every time."""
    return Proposal(edit_between(context.parent.record.program, fixed(number)), note=f"gain {number}")


def ended(path: Path, **options) -> tuple[str, Loop]:
    with scripted(path, **options) as loop:
        return loop.run(NAIVE), loop


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "archive.sqlite"


# what a proposal sees


@pytest.mark.parametrize(
    ("window", "own", "expected"), [(1, None, 1), (3, None, 3), (8, None, 8), (8, 1, 1), (2, 5, 2)]
)
def test_proposal_k_sees_the_results_up_to_k_minus_the_window(path, window, own, expected):
    evaluator, seen = ScriptedEvaluator(), []

    def answer(context: Context, number: int) -> Proposal:
        seen.append((number, sorted(evaluator.collected), context.last, context.parent.step))
        return numbered(context, number)

    settings = replace(PLAIN, window=window)
    proposers = ((Scripted(answer, window=own), 1.0),)
    ended(path, proposers=proposers, settings=settings, evaluator=evaluator, budget=14)
    assert len(seen) == 13
    for number, collected, last, parent in seen:
        newest = max(number - expected, 0)
        assert collected == list(range(newest + 1))
        assert parent <= newest
        assert (last is None and newest == 0) or last.number == newest


def test_with_history_the_best_and_the_last_failures_are_shown_best_and_latest_first(path):
    def law(program: str) -> Verdict:
        return Status.FAILED if "k=0.003" in program or "k=0.005" in program else 0.1 + luck(program)

    proposer = Scripted(numbered)
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, history=2, window=1), budget=10,
          evaluator=ScriptedEvaluator(law, stable=lambda _: True))  # fmt: skip
    last = proposer.asked[-1]
    assert [one.number for one in last.failures] == [5, 3]
    errors = {step.number: step.nrmse for step in steps_of(path) if step.nrmse is not None and step.number < 9}
    del errors[last.parent.step]
    shown = [one.record.nrmse for one in last.best]
    assert len(shown) == 2
    assert shown == sorted(shown)
    assert set(shown) <= set(errors.values())


def test_without_history_a_proposer_sees_the_parent_alone(path):
    proposer = Scripted(numbered)
    ended(path, proposers=((proposer, 1.0),), settings=PLAIN, budget=12)
    assert all((one.best, one.failures) == ((), ()) for one in proposer.asked)


def test_what_was_met_is_known_to_the_proposer(path):
    proposer = Scripted(numbered)
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
    floor = noise_floor(data)
    evaluator = ScriptedEvaluator(
        misfit=lambda nrmse: 3 * nrmse / floor.level
    )  # weights make the error three times the NRMSE
    ended(path, sweep=data, evaluator=evaluator, budget=10)
    steps = steps_of(path)
    for job in evaluator.jobs[1:]:
        parent = steps[steps[job.number].parent or 0]
        assert job.promising == pytest.approx(PROMISING * 3 * parent.nrmse)


# what it costs


@pytest.mark.parametrize("budget", [1, 2, 7, 25])
@pytest.mark.parametrize("window", [1, 8])
def test_the_budget_is_spent_to_the_last_evaluation_and_no_further(path, budget, window):
    evaluator = ScriptedEvaluator()
    ending, loop = ended(path, evaluator=evaluator, budget=budget, settings=SearchSettings(window=window))
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
    ending, _ = ended(path, proposers=((Scripted(answer), 1.0),), evaluator=evaluator, budget=8, settings=PLAIN)
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
    same = Scripted(lambda context, _: Proposal(edit_between(context.parent.record.program, fixed(1))))
    evaluator = ScriptedEvaluator(lambda _: 0.5)
    settings = replace(PLAIN, patience=5)
    ended(path, proposers=((same, 1.0),), evaluator=evaluator, settings=settings)
    steps = steps_of(path)
    assert [step.status for step in steps[:4]] == [Status.OK, Status.OK, Status.DUPLICATE, Status.DUPLICATE]
    assert len(evaluator.jobs) == 2


def test_a_run_without_new_structures_ends_by_patience(path):
    silent = Scripted(lambda *_: Proposal("", failure="no idea"))
    ending, _ = ended(path, proposers=((silent, 1.0),), settings=replace(PLAIN, patience=6))
    assert ending == NOTHING_NEW
    assert len(silent.asked) == 6


# one more attempt


def stubborn(context: Context, number: int) -> Proposal:
    """Nonsense at first, something new once there is a complaint."""
    return Proposal("nonsense") if context.complaint is None else numbered(context, number)


def test_an_answer_that_cannot_be_used_is_asked_for_once_more_with_the_complaint(path):
    proposer = Scripted(stubborn, attempts=2)
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
        used = {"prompt_tokens": 100 * number, "cost": 0.25, "model": f"model {number}", "cut": True}
        return replace(stubborn(context, number), usage=used if context.complaint is None else {**used, "cut": False})

    ended(path, proposers=((Scripted(answer, attempts=2), 1.0),), settings=PLAIN, budget=2)
    assert steps_of(path)[1].usage == {"prompt_tokens": 300, "cost": 0.5, "model": "model 2", "cut": False}


def test_the_last_attempt_counts_as_it_is(path):
    proposer = Scripted(lambda *_: Proposal("nonsense"), attempts=2)
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, patience=3))
    assert [step.status for step in steps_of(path)[1:]] == [Status.NO_EDIT] * 3
    assert len(proposer.asked) == 6


@pytest.mark.parametrize(
    "answer", [Proposal("", failure="dead"), Proposal(edit_between(NAIVE, NAIVE.replace("gain", "k")))]
)
def test_a_dead_server_and_an_unchanged_program_are_not_asked_again(path, answer):
    proposer = Scripted(lambda *_: answer, attempts=2)
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, patience=3))
    assert len(proposer.asked) == 3


# who becomes a parent, and the best


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
    assert {entry.step for entry in loop.archive.entries} >= {step.number for step in wild}  # kept and shown
    assert not {entry.step for entry in loop.archive.elites} & {step.number for step in wild}


def test_what_is_not_as_required_is_told_and_no_parent(path):
    _, loop = ended(path, requirements=Requirements(stable=True), budget=40)
    steps = steps_of(path)
    refused = [step for step in steps if step.status is Status.REQUIRED]
    assert refused
    assert all("right half plane" in step.reason for step in refused)
    assert all(step.nrmse is not None for step in refused)
    assert not {step.parent for step in steps} & {step.number for step in refused}
    assert not {entry.step for entry in loop.archive.entries} & {step.number for step in refused}


def test_a_start_that_is_not_as_required_is_searched_from_but_never_the_best(path):
    evaluator = ScriptedEvaluator(stable=lambda program: program != NAIVE)
    _, loop = ended(path, evaluator=evaluator, requirements=Requirements(stable=True), budget=12)
    steps = steps_of(path)
    assert steps[0].status is Status.REQUIRED
    assert steps[1].parent == 0
    assert loop.best is not None
    assert loop.best.number > 0


def test_the_search_does_not_stop_when_nothing_is_stable(path):
    ending, loop = ended(path, evaluator=ScriptedEvaluator(stable=lambda _: False), budget=15)
    assert (ending, loop.best, loop.evaluations) == (BUDGET, None, 15)


@pytest.mark.parametrize("status", [Status.FAILED, Status.TIMEOUT, Status.LOST])
def test_a_start_without_a_fit_ends_the_run_in_a_sentence(path, status):
    with pytest.raises(IbridError, match=rf"the start must have a fit, found {status}.*--start"):
        ended(path, evaluator=ScriptedEvaluator(lambda _: status))


def test_an_illegal_start_ends_the_run_in_a_sentence(path):
    with scripted(path) as loop, pytest.raises(IbridError, match="the start must be a legal diagram"):
        loop.run(NAIVE.replace('    g.connect("gain.out", "plant.u_r")\n', ""))
    assert steps_of(path) == []


def test_proposers_are_asked_by_their_weights(path):
    often, seldom = Scripted(numbered), Scripted(lambda context, number: numbered(context, 500 + number))
    ended(path, proposers=((often, 3.0), (seldom, 1.0)), settings=PLAIN, budget=81)
    # of 80 steps a quarter, 20 +- 4
    assert 8 <= len(seldom.asked) <= 32
    assert len(often.asked) + len(seldom.asked) == 80


# the end of a run


def test_a_target_ends_the_run_once_nothing_can_be_taken_away_any_more(path):
    ending, loop = ended(path, target=0.45, budget=200)
    steps = steps_of(path)
    assert ending == TARGET
    assert loop.best is not None
    assert loop.best.nrmse is not None
    assert loop.best.nrmse <= 0.45
    reached = next(step.number for step in steps if step.stable and (step.nrmse or 1.0) <= 0.45)
    later = [step for step in steps if step.number >= reached + loop.window]
    assert later
    assert {step.proposer for step in later} == {"pruning"}
    assert steps[-1].status is Status.NO_ANSWER or steps[-1].number == loop.best.number


def test_the_noise_floor_ends_the_run_where_the_structure_is_a_usual_one(path):
    gfl = ibrid.program_text(ibrid.textbook("gfl"))
    jump = Scripted(lambda context, _: Proposal(edit_between(context.parent.record.program, gfl)))

    def law(program: str) -> float:
        found = roles(ibrid.parse_program(program), task().kinds)
        assert found is not None
        return 1e-9 if found.missing_layers == 0 else 0.5

    evaluator = ScriptedEvaluator(law, stable=lambda _: True)
    ending, loop = ended(path, proposers=((jump, 1.0),), evaluator=evaluator, budget=300)
    assert ending == EXACT_FIT
    assert loop.best is not None
    assert loop.best.nrmse == 1e-9


def noisy():
    """The benchmark with noise of 1 % that it tells."""
    return add_noise(task().sweep, 40, rng=np.random.default_rng(0))


GFL = ibrid.program_text(ibrid.textbook("gfl"))
BETTER = GFL.replace('"PI_dq", "current"', '"PI_dq", "current", kP=0.5')


def settling(path: Path, wait: int, *, clean: bool = False, later: int | None = None) -> tuple[str, Loop, list[Step]]:
    """A run that reaches the floor with its first proposal, and another structure, a little better, with proposal `later`;
    nothing else is any good."""
    found = {ibrid.structure_hash(ibrid.parse_program(text)): error for text, error in ((GFL, 0.5), (BETTER, 0.4))}
    data = task().sweep if clean else noisy()
    level = noise_floor(data).level

    def law(program: str) -> float:
        error = found.get(ibrid.structure_hash(ibrid.parse_program(program)))
        return 0.5 if error is None else error * level

    def answer(context: Context, number: int) -> Proposal:
        if number in (1, later):
            text = GFL if number == 1 else BETTER
            return Proposal(edit_between(context.parent.record.program, text))
        return numbered(context, number)

    evaluator = ScriptedEvaluator(law, stable=lambda _: True, misfit=lambda nrmse: nrmse / level)
    settings = replace(PLAIN, settled=wait)
    ending, loop = ended(
        path, sweep=data, proposers=((Scripted(answer), 1.0),), evaluator=evaluator, settings=settings, budget=900
    )
    return ending, loop, steps_of(path)


def searched(steps: list[Step], loop: Loop) -> int:
    """Ordinary proposals made with the best at hand."""
    assert loop.best is not None
    return sum(step.proposer == "scripted" for step in steps[loop.best.number + loop.window :])


def test_a_noise_floor_ends_the_search_only_with_a_best_that_stays(path):
    ending, loop, steps = settling(path, 200)
    assert ending == FLOOR
    assert loop.best is not None
    assert loop.best.number == 1
    assert 200 <= len(steps) - 1 <= 200 + loop.window
    assert searched(steps, loop) > 50


def test_a_better_best_must_stay_as_long_again(path):
    ending, loop, steps = settling(path, 200, later=60)
    assert ending == FLOOR
    assert loop.best is not None
    assert loop.best.number > 60
    assert 200 <= len(steps) - loop.best.number <= 200 + loop.window


def test_clean_data_end_the_search_at_once(path):
    ending, loop, steps = settling(path, 200, clean=True)
    assert ending == EXACT_FIT
    assert searched(steps, loop) == 0


class Paid(Scripted):
    """Whose answers cost 1 each."""

    def __init__(self, limit: float) -> None:
        super().__init__(self.told)
        self.spending = Spending(Limits(cost=limit))

    def told(self, context: Context, number: int) -> Proposal:
        if self.spending.over:
            return Proposal("", failure=self.spending.over)
        self.spending.count({"cost": 1.0})
        return replace(numbered(context, number), usage={"cost": 1.0})


@pytest.mark.parametrize("stable", [True, False])
def test_when_nobody_can_be_asked_any_more_the_run_tidies_up_and_ends(path, stable):
    paid = Paid(5)
    evaluator = ScriptedEvaluator(stable=lambda _: stable)
    ending, loop = ended(path, proposers=((paid, 1.0),), evaluator=evaluator, settings=PLAIN, budget=400)
    assert ending == SPENT
    assert paid.spending.spent["cost"] == 5
    assert loop.evaluations > 5
    found = Counter(step.proposer for step in steps_of(path) if step.status in EVALUATED and step.number)
    assert found["scripted"] == 5
    assert (found["pruning"] > 0) == stable  # there is no best to take away from
    assert not any(map(evaluator.open.get, range(400)))


def test_a_spent_run_goes_on_with_a_higher_limit(path):
    ended(path, proposers=((Paid(3), 1.0),), settings=PLAIN, budget=400)
    before = steps_of(path)
    more = Paid(6)
    more.spending.count({"cost": 3.0})  # as the run counts what is in its store
    more.asked = [None] * 100  # other structures than before
    assert ended(path, proposers=((more, 1.0),), settings=PLAIN, budget=400)[0] == SPENT
    steps = steps_of(path)
    assert steps[: len(before)] == before
    assert sum(step.proposer == "scripted" and step.status in EVALUATED for step in steps) == 6


def test_beside_proposers_that_cost_nothing_a_limit_does_not_end_the_run(path):
    ending, _ = ended(path, proposers=((Paid(2), 0.5), (Rules(looks=1), 0.5)), settings=PLAIN, budget=20)
    assert ending == BUDGET


def test_the_last_part_takes_away_from_the_best_and_leaves_the_rest_to_the_search(path):
    settings = SearchSettings(pruning=0.0, final_pruning=0.9)
    ending, loop = ended(path, settings=settings, budget=40)
    found = Counter(step.proposer for step in steps_of(path))
    assert ending == BUDGET
    assert loop.evaluations == 40
    assert found["pruning"] >= 1
    assert found["rules"] > 3


def test_pruning_has_its_share_of_the_steps(path):
    settings = SearchSettings(pruning=0.5, final_pruning=0.0)
    ended(path, settings=settings, budget=80)
    found = Counter(step.proposer for step in steps_of(path))
    assert found["pruning"] > 10  # where nothing is left to take away the step is an ordinary one
    assert found["rules"] > 25


# the same run again


def test_the_same_seed_gives_the_same_archive_and_another_seed_another(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        ended(tmp_path / f"{name}.sqlite", seed=seed, budget=20)
    first, again, other = (steps_of(tmp_path / f"{name}.sqlite") for name in "abc")
    assert first == again
    assert [step.hash for step in first] != [step.hash for step in other]


#: Courses of a run: to the end of the budget, to a target with its tidying, mostly tidying, other windows, chance.
COURSES = {
    "budget": {"budget": 20},
    "target": {"budget": 40, "target": 0.45},
    "tidying": {"budget": 30, "settings": SearchSettings(final_pruning=0.8), "seed": 2},
    "one by one": {"budget": 14, "settings": SearchSettings(window=1)},
    "history": {"budget": 16, "settings": SearchSettings(history=3), "seed": 5},
    "required": {"budget": 16, "requirements": Requirements(stable=True)},
}


class Backwards(ScriptedEvaluator):
    """Workers of which the last to begin ends first."""

    def first_ended(self) -> int:
        return max(self.open)


@pytest.mark.parametrize("course", ["budget", "tidying"])
def test_the_archive_does_not_depend_on_the_order_in_which_results_come(tmp_path, course):
    paths = [tmp_path / f"{name}.sqlite" for name in ("forwards", "backwards")]
    for path, evaluator in zip(paths, (ScriptedEvaluator(), Backwards()), strict=True):
        ended(path, evaluator=evaluator, **COURSES[course])
    assert steps_of(paths[0]) == steps_of(paths[1])


class Killed(Exception):
    """What a test does to a run in place of SIGKILL."""


class Mortal(Store):
    """A store whose process dies after so many writes."""

    writes = 0

    def propose(self, step: Step) -> None:
        super().propose(step)
        self._lived()

    def conclude(self, *args, **options) -> None:
        super().conclude(*args, **options)
        self._lived()

    def _lived(self) -> None:
        Mortal.writes -= 1
        if Mortal.writes < 0:
            raise Killed


@pytest.mark.parametrize(
    ("course", "evaluator"),
    [
        *((course, ScriptedEvaluator) for course in COURSES if course not in ("budget", "target")),
        *((course, Backwards) for course in ("budget", "target")),
    ],
)
def test_a_run_that_is_killed_after_every_single_write_ends_as_if_it_had_not_been(
    tmp_path, monkeypatch, course, evaluator
):
    whole, pieces, options = tmp_path / "whole.sqlite", tmp_path / "pieces.sqlite", COURSES[course]
    ending, _ = ended(whole, **options)
    monkeypatch.setattr(scripted_search, "Store", Mortal)
    kills = 0
    while True:
        Mortal.writes = 0
        try:
            assert ended(pieces, evaluator=evaluator(), **options)[0] == ending
            break
        except Killed:
            kills += 1
    assert kills >= len(steps_of(whole))
    assert steps_of(pieces) == steps_of(whole)


@pytest.mark.parametrize("writes", [2, 17])
def test_a_run_that_is_killed_once_ends_as_if_it_had_not_been(tmp_path, monkeypatch, writes):
    whole, pieces, options = tmp_path / "whole.sqlite", tmp_path / "pieces.sqlite", COURSES["tidying"]
    ended(whole, **options)
    Mortal.writes = writes
    with monkeypatch.context() as patched:
        patched.setattr(scripted_search, "Store", Mortal)
        with pytest.raises(Killed):
            ended(pieces, **options)
    assert len(steps_of(pieces)) < len(steps_of(whole))
    ended(pieces, **options)
    assert steps_of(pieces) == steps_of(whole)


class Losing(ScriptedEvaluator):
    """Workers that die on the candidate of some step."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def collect(self, number: int) -> Result:
        found = super().collect(number)
        return replace(found, outcome=Status.LOST, record=None, reason="3 workers died on it", attempts=3) if (
            number == self.number
        ) else found  # fmt: skip


def test_a_lost_candidate_is_evaluated_again_when_the_run_goes_on_and_ends_as_if_no_worker_had_died(tmp_path):
    whole, path = tmp_path / "whole.sqlite", tmp_path / "lost.sqlite"
    ended(whole, budget=24)
    lost = next(step.number for step in steps_of(whole) if step.number > 4 and step.status is Status.OK)

    def stop(loop: Loop, step: Step) -> None:
        loop.stop_asked = step.number == lost

    assert ended(path, evaluator=Losing(lost), budget=24, watch=stop)[0] == STOPPED
    assert steps_of(path)[lost].status is Status.LOST
    ending, loop = ended(path, budget=24)
    assert (ending, loop.evaluations) == (BUDGET, 24)
    assert steps_of(path) == steps_of(whole)


def test_a_candidate_that_was_lost_long_ago_takes_its_place_in_the_archive(path):
    _, before = ended(path, evaluator=Losing(3), budget=30)
    steps = steps_of(path)
    assert steps[3].status is Status.LOST
    _, after = ended(path, budget=30)
    again = steps_of(path)
    assert again[3].status in (Status.OK, Status.FAILED)
    assert [*again[:3], *again[4:]] == [*steps[:3], *steps[4:]]
    assert after.evaluations == before.evaluations  # it was paid for already
    assert (3 in {entry.step for entry in after.archive.entries}) == (again[3].status is Status.OK)


@pytest.mark.parametrize("writes", [9, 30])
def test_a_candidate_that_always_kills_its_workers_ends_a_killed_run_no_differently(tmp_path, monkeypatch, writes):
    whole, pieces = tmp_path / "whole.sqlite", tmp_path / "pieces.sqlite"
    ended(whole, evaluator=Losing(3), budget=24)
    Mortal.writes = writes
    with monkeypatch.context() as patched:
        patched.setattr(scripted_search, "Store", Mortal)
        with pytest.raises(Killed):
            ended(pieces, evaluator=Losing(3), budget=24)
    ended(pieces, evaluator=Losing(3), budget=24)
    assert steps_of(pieces) == steps_of(whole)


#: A run in a process of its own, which forks once for each moment at which it is to die.
CHILD = """
import os, signal, sys
from pathlib import Path
import scripted_search
from scripted_search import NAIVE, ScriptedEvaluator, naive_record, scripted
folder, moments = Path(sys.argv[1]), [int(word) for word in sys.argv[2:]]
naive_record()

class Dying(ScriptedEvaluator):
    left = 0
    def collect(self, number):
        self.left -= 1
        if self.left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().collect(number)

for moment in moments:
    child = os.fork()
    if child == 0:
        evaluator = Dying()
        evaluator.left = moment
        with scripted(folder / f"{moment}.sqlite", evaluator=evaluator, budget=24) as loop:
            loop.run(NAIVE)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL, status
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork, which the child process uses")
def test_a_process_that_sigkill_ended_loses_nothing_and_its_run_ends_as_it_would_have(tmp_path):
    moments = (0, 1, 8, 20)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(tmp_path), *map(str, moments)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent), "OMP_NUM_THREADS": "1"},
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    ended(tmp_path / "whole.sqlite", budget=24)
    whole = steps_of(tmp_path / "whole.sqlite")
    for moment in moments:
        path = tmp_path / f"{moment}.sqlite"
        assert sum(step.status in EVALUATED for step in steps_of(path)) == moment
        ended(path, budget=24)
        assert steps_of(path) == whole


def test_a_finished_run_has_nothing_left_to_do_and_goes_on_with_a_larger_budget(path):
    ended(path, budget=10)
    before = steps_of(path)
    assert ended(path, budget=10)[0] == BUDGET
    assert steps_of(path) == before
    _, loop = ended(path, budget=20)
    assert loop.evaluations == 20
    assert steps_of(path)[: len(before)] == before


# the keyboard


def test_asked_to_stop_the_loop_finishes_what_is_under_way_and_goes_on_later(tmp_path):
    def stop(loop: Loop, step: Step) -> None:
        loop.stop_asked = step.number == 6

    whole, path = tmp_path / "whole.sqlite", tmp_path / "stopped.sqlite"
    ended(whole, budget=24)
    ending, loop = ended(path, budget=24, watch=stop)
    steps = steps_of(path)
    assert ending == STOPPED
    assert not any(step.status is Status.PENDING for step in steps)
    assert loop.absorbed == len(steps) < 24
    ended(path, budget=24)
    assert steps_of(path) == steps_of(whole)


def test_asked_to_halt_the_loop_records_no_result_of_what_was_interrupted(path):
    class Interrupted(ScriptedEvaluator):
        def collect(self, number: int) -> Result:
            if number == 5:
                loop.halt_asked = True  # as by the second Ctrl-C, which compiled code made a failure of
                return Result(number, Status.FAILED, None, "the evaluation broke off", 0.0, 1)
            return super().collect(number)

    with scripted(path, evaluator=Interrupted(), budget=24) as loop, pytest.raises(KeyboardInterrupt):
        loop.run(NAIVE)
    assert steps_of(path)[5].status is Status.PENDING


def test_what_breaks_off_at_the_second_ctrl_c_is_the_keyboards_doing(path):
    def broken(times: int) -> None:
        with scripted(path, budget=24) as loop, keyboard(loop, Progress("silent")):
            for _ in range(times):
                with suppress(KeyboardInterrupt):  # as compiled code does, before an error of its own
                    signal.raise_signal(signal.SIGINT)
            raise IbridError("the evaluation broke off")

    with pytest.raises(IbridError):
        broken(1)
    with pytest.raises(KeyboardInterrupt):
        broken(2)


# everything else


def test_every_step_is_watched_once_and_in_order(path):
    watched: list[int] = []
    ended(path, budget=15, watch=lambda loop, step: watched.append(step.number))
    assert watched == list(range(len(steps_of(path))))


def test_every_refusal_has_its_own_reason(path):
    ended(path, proposers=((RandomEdits(), 1.0), (Scripted(lambda *_: Proposal("?")), 1.0)), budget=20)
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
    ],
)
def test_settings_that_mean_nothing_are_refused_in_a_sentence(path, change, told):
    with pytest.raises(IbridError, match=told), scripted(path, settings=SearchSettings(**change)):
        pass


def test_scales_are_drawn_by_their_shares(path):
    proposer = Scripted(numbered)
    scales = {"local": 0.0, "module": 0.25, "structural": 0.75}
    ended(path, proposers=((proposer, 1.0),), settings=replace(PLAIN, scales=scales), budget=81)
    found = Counter(one.scale for one in proposer.asked)
    assert found["local"] == 0
    assert 8 <= found["module"] <= 32  # of 80 a quarter, 20 +- 4


def test_the_rules_improve_on_the_start(path):
    _, loop = ended(path, proposers=((Rules(looks=1), 1.0),), budget=30)
    assert loop.best is not None
    assert loop.best.nrmse is not None
    assert loop.best.nrmse < (steps_of(path)[0].nrmse or 0.0)
    assert task().parameters == "shared"
