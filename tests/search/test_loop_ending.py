"""What ends a search: a target, the noise, the fit of clean data, the money, the budget; and what
it does last.
"""

from collections import Counter
from dataclasses import replace
from math import exp
from pathlib import Path

import pytest
from ibrid_search.chat.spending import Limits, Spender, Spending
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion.loop import BUDGET, EXACT_FIT, FLOOR, SPENT, TARGET, Loop
from ibrid_search.screening.selection_criterion import build_criterion, estimate_noise_floor
from ibrid_search.settings import SearchSettings
from ibrid_search.step import EVALUATED, Status, Step
from scripted_search import (
    PLAIN,
    ScriptedEvaluator,
    ScriptedProposer,
    ended,
    noisy,
    numbered,
    scripted,
    steps_of,
    study,
)

import ibrid
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.roles import roles


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "archive.sqlite"


@pytest.mark.slow
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


def test_a_target_that_is_reached_is_told_also_where_the_budget_ends_with_it(path):
    ending, loop = ended(path, target=1e9, budget=2)
    assert (ending, loop.evaluations) == (TARGET, 2)


@pytest.mark.slow
def test_the_noise_floor_ends_the_run_where_the_structure_is_a_usual_one(path):
    gfl = ibrid.program_text(ibrid.textbook("gfl"))
    jump = ScriptedProposer(
        lambda context, _: Proposal(edit_between(context.parent.record.program, gfl))
    )

    def law(program: str) -> float:
        found = roles(ibrid.parse_program(program), study().kinds)
        assert found is not None
        return 1e-9 if found.missing_layers == 0 else 0.5

    evaluator = ScriptedEvaluator(law, stable=lambda _: True)
    ending, loop = ended(path, proposers=((jump, 1.0),), evaluator=evaluator, budget=300)
    assert ending == EXACT_FIT
    assert loop.best is not None
    assert loop.best.nrmse == 1e-9


GFL = ibrid.program_text(ibrid.textbook("gfl"))
BETTER = GFL.replace('"PI_dq", "current"', '"PI_dq", "current", kP=0.5')


def settling(
    path: Path, wait: int, *, clean: bool = False, later: int | None = None
) -> tuple[str, Loop, list[Step]]:
    """A run that reaches the floor with its first proposal, and another structure, a little better,
    with proposal `later`; nothing else is any good.
    """
    found = {
        ibrid.structure_hash(ibrid.parse_program(text)): error
        for text, error in ((GFL, 0.5), (BETTER, 0.4))
    }
    data = study().sweep if clean else noisy()
    level = estimate_noise_floor(data).level

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
        path,
        sweep=data,
        proposers=((ScriptedProposer(answer), 1.0),),
        evaluator=evaluator,
        settings=settings,
        budget=900,
    )
    return ending, loop, steps_of(path)


def searched(steps: list[Step], loop: Loop) -> int:
    """Ordinary proposals made with the best at hand."""
    assert loop.best is not None
    return sum(step.proposer == "scripted" for step in steps[loop.best.number + loop.window :])


@pytest.mark.slow
def test_a_noise_floor_ends_the_search_only_with_a_best_that_stays(path):
    ending, loop, steps = settling(path, 200)
    assert ending == FLOOR
    assert loop.best is not None
    assert loop.best.number == 1
    assert 200 <= len(steps) - 1 <= 200 + loop.window
    assert searched(steps, loop) > 50


@pytest.mark.nightly
def test_a_better_best_must_stay_as_long_again(path):
    ending, loop, steps = settling(path, 200, later=60)
    assert ending == FLOOR
    assert loop.best is not None
    assert loop.best.number > 60
    assert 200 <= len(steps) - loop.best.number <= 200 + loop.window


@pytest.mark.slow
def test_clean_data_end_the_search_at_once(path):
    ending, loop, steps = settling(path, 200, clean=True)
    assert ending == EXACT_FIT
    assert searched(steps, loop) == 0


class Paid(Spender, ScriptedProposer):
    """Whose answers cost 1 each."""

    def __init__(self, limit: float) -> None:
        super().__init__(self.told)
        self.spending = Spending(Limits(cost=limit))

    def told(self, context: Context, number: int) -> Proposal:
        if self.spending.over:
            return Proposal("", failure=self.spending.over)
        self.spending.count({"cost": 1.0})
        return replace(numbered(context, number), usage={"cost": 1.0})


@pytest.mark.slow
def test_three_things_that_gain_little_each_go_though_what_has_them_is_published(path):
    draft = Draft(ibrid.textbook("gfl_exact"), study().kinds)
    draft.insert("plant.i_ti", draft.targets("plant.i_ti"), "LPF1_dq", "current_filter")
    draft.insert("plant.e_q", ["pll.e_q"], "Notch", "notch")
    draft.insert("pll.delta_omega", draft.targets("pll.delta_omega"), "LPF1", "slow")
    published, data = draft.diagram(), noisy()
    numbers = {("current_filter", "LPF1_dq"): 1, ("notch", "Notch"): 2, ("slow", "LPF1"): 1}
    level, price = (
        estimate_noise_floor(data).level,
        build_criterion(replace(study(), sweep=data), PLAIN).parameter_cost,
    )

    def lost(program: str) -> set[tuple[str, str]]:
        return modules_of(ibrid.program_text(published)) - modules_of(program)

    def law(
        program: str,
    ) -> float:  # without each of the three the criterion falls by 0.6 of the price of a number
        worse = sum(numbers.get(module, 99) - 0.6 for module in lost(program))
        return min(0.5 * level * exp(price * worse), 0.5)

    evaluator = ScriptedEvaluator(law, stable=lambda _: True, misfit=lambda nrmse: nrmse / level)
    useless = ((ScriptedProposer(numbered), 1.0),)
    with scripted(
        path, sweep=data, settings=PLAIN, proposers=useless, evaluator=evaluator, budget=60
    ) as loop:
        loop.appraisal.published = frozenset({ibrid.structure_hash(published)})
        loop.run(ibrid.program_text(published))
    assert loop.best is not None
    assert lost(loop.best.program) == set(numbers)


def modules_of(program: str) -> set[tuple[str, str]]:
    return {(one.name, one.kind) for one in ibrid.parse_program(program).instances}


@pytest.mark.parametrize("stable", [True, False])
def test_when_nobody_can_be_asked_any_more_the_run_tidies_up_and_ends(path, stable):
    paid = Paid(5)
    evaluator = ScriptedEvaluator(stable=lambda _: stable)
    ending, loop = ended(
        path, proposers=((paid, 1.0),), evaluator=evaluator, settings=PLAIN, budget=400
    )
    assert ending == SPENT
    assert paid.spending.spent["cost"] == 5
    assert loop.evaluations > 5
    found = Counter(
        step.proposer for step in steps_of(path) if step.status in EVALUATED and step.number
    )
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


@pytest.mark.slow
def test_beside_proposers_that_cost_nothing_a_limit_does_not_end_the_run(path):
    ending, _ = ended(
        path, proposers=((Paid(2), 0.5), (Rules(looks=1), 0.5)), settings=PLAIN, budget=20
    )
    assert ending == BUDGET


@pytest.mark.slow
def test_the_last_part_takes_away_from_the_best_and_leaves_the_rest_to_the_search(path):
    settings = SearchSettings(pruning=0.0, final_pruning=0.9)
    ending, loop = ended(path, settings=settings, budget=40)
    found = Counter(step.proposer for step in steps_of(path))
    assert ending == BUDGET
    assert loop.evaluations == 40
    assert found["pruning"] >= 1
    assert found["rules"] > 3


@pytest.mark.slow
def test_pruning_has_its_share_of_the_steps(path):
    settings = SearchSettings(pruning=0.5, final_pruning=0.0)
    ended(path, settings=settings, budget=80)
    found = Counter(step.proposer for step in steps_of(path))
    assert found["pruning"] > 10  # where nothing is left to take away the step is an ordinary one
    assert found["rules"] > 25
