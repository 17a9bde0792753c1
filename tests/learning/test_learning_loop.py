"""A search that learns: groups share a question, nothing of a batch is seen in it, and a killed run
ends as it would have.
"""

import copy
import importlib.util
import math
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import count, groupby
from pathlib import Path

import numpy as np
import pytest

if any(importlib.util.find_spec(one) is None for one in ("torch", "transformers")):
    pytest.skip("learning needs torch and transformers; make setup-llm", allow_module_level=True)

import torch  # pyright: ignore[reportMissingImports]
from ibrid_policy.interface import Policy
from ibrid_policy.learning.advantages import entropic_advantages
from ibrid_policy.learning.learner import Learner
from ibrid_policy.learning.settings import PROFILES, LearningSettings
from ibrid_policy.learning.trainer import Group, fingerprint
from ibrid_policy.learning.updates import META, Update, read_updates
from ibrid_search.proposers.first_look import LOOKED_AT, Look
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion.loop import BUDGET, TARGET, Loop
from ibrid_search.run.store import Store
from ibrid_search.settings import SearchSettings
from ibrid_search.step import Status, Step
from scripted_search import NAIVE, ScriptedEvaluator, scripted, steps_of
from toy_policy import ASK, FIRST, Change, ToyPolicy

from ibrid.errors import IbridError
from ibrid.structure.diagrams.program import program_text

pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own

PLAIN = SearchSettings(pruning=0.0, final_pruning=0.0, patience=1000)
SMALL = LearningSettings(contexts=2, group=4, rate=0.03)
SINGLE = LearningSettings(contexts=8, group=1, rate=0.03, baseline="parent")
BY_LOOKS = replace(PROFILES["small"], contexts=8, rate=0.03)


def more_gain(program: str, number: int) -> str:
    """Edit `number` adds (number + 1)/1000 to the fixed gain; edit 0 is one that is illegal."""
    gain = float(found[1]) if (found := re.search(r'"gain", k=([\d.]+)\)', program)) else 0.0
    if number == 0:
        return program.replace('    g.connect("gain.out", "plant.u_r")\n', "")
    return re.sub(r'"gain"(, k=[\d.]+)?\)', f'"gain", k={gain + number / 1000:.4g})', program)


def by_gain(program: str) -> float:
    """The larger the gain the better."""
    found = re.search(r'"gain", k=([\d.]+)\)', program)
    return math.exp(-20 * float(found[1])) if found else 1.0


def own_gain(program: str, number: int) -> str:
    """Edit `number` puts a gain of about number/100 in place of any other, for every parent one of
    its own.
    """
    own = zlib.crc32(program.encode()) % 1000
    return re.sub(
        r'"gain"(, k=[\d.]+)?\)', f'"gain", k={(number + own / 2000) / 100:.7f})', program
    )


def never_known() -> Change:
    """Edit `number` adds about number/1000 to the gain, every time a little more, so that nothing
    is met twice.
    """
    calls = count()

    def change(program: str, number: int) -> str:
        gain = float(found[1]) if (found := re.search(r'"gain", k=([\d.]+)\)', program)) else 0.0
        gain += number / 1000 + next(calls) / 1e7
        return re.sub(r'"gain"(, k=[\d.]+)?\)', f'"gain", k={gain:.7f})', program)

    return change


class Reversed(ScriptedEvaluator):
    """A pool whose last job ends first."""

    def first_ended(self) -> int:
        return list(self.open)[-1]


@contextmanager
def learning(
    folder: Path, policy: Policy | None = None, learn: LearningSettings = SMALL, **options
) -> Iterator[Loop]:
    """A loop with a learner, opened as `ibrid.search` does."""
    search = options.setdefault("settings", PLAIN)
    folder.mkdir(exist_ok=True)
    learner = Learner(
        policy or ToyPolicy(more_gain, 6), learn, seed=options.get("seed", 0), window=search.window
    )
    more = options.pop("beside", ())
    evaluator = options.pop("evaluator", None) or ScriptedEvaluator(by_gain, stable=lambda _: True)
    with scripted(
        folder / "archive.sqlite", proposers=((learner, 1.0), *more), evaluator=evaluator, **options
    ) as loop:
        loop.panel.begin(loop.store, folder)
        yield loop


def learner_of(loop: Loop) -> Learner:
    (learner,) = (one for one, _ in loop.panel.proposers if isinstance(one, Learner))
    return learner


def ended(folder: Path, policy: Policy | None = None, **options) -> tuple[list[Step], Learner]:
    with learning(folder, policy, **options) as loop:
        loop.run(NAIVE)
        return steps_of(folder / "archive.sqlite"), learner_of(loop)


def told(folder: Path) -> tuple[Update, ...]:
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        return read_updates(store.meta.get(META, ""))


def timeless(updates: tuple[Update, ...]) -> list[Update]:
    return [replace(one, seconds_sampling=0.0, seconds_update=0.0) for one in updates]


def groups_of(steps: list[Step]) -> list[list[Step]]:
    mine = [step for step in steps if step.proposer == "toy"]
    return [
        list(some) for _, some in groupby(mine, key=lambda step: step.usage["learning"]["context"])
    ]


# groups and batches


def test_all_answers_of_a_group_edit_the_same_parent_at_the_same_scale(tmp_path):
    steps, _ = ended(tmp_path / "run", budget=60)
    found = groups_of(steps)
    assert len(found) > 6
    assert {len(one) for one in found[:-1]} == {4}
    for one in found:
        assert len({(step.parent, step.scale, step.island) for step in one}) == 1
        assert [step.usage["learning"]["member"] for step in one] == list(range(len(one)))
        assert ["prompt" in step.usage["learning"] for step in one] == [True] + [False] * (
            len(one) - 1
        )
    assert len({one[0].parent for one in found}) > 3
    assert len({one[0].scale for one in found}) == 3


def test_contexts_of_a_batch_go_round_the_islands(tmp_path):
    settings = replace(PLAIN, from_elites=0.0, from_island=1.0)
    steps, _ = ended(
        tmp_path / "run", budget=200, settings=settings, policy=ToyPolicy(more_gain, 40)
    )
    assert {one[0].island for one in groups_of(steps)} == set(range(settings.islands))


def test_parents_come_from_the_batches_before(tmp_path):
    evaluator, seen = ScriptedEvaluator(by_gain, stable=lambda _: True), []

    class Watching(ToyPolicy):
        def prompt(self, context):
            seen.append(max(evaluator.collected))
            return super().prompt(context)

    steps, _ = ended(tmp_path / "run", Watching(more_gain, 6), budget=60, evaluator=evaluator)
    mine = [step for step in steps if step.proposer == "toy"]
    for place, step in enumerate(mine):
        batch = place // SMALL.batch
        assert step.parent is not None
        assert step.parent <= (mine[batch * SMALL.batch].number - 1 if batch else 0)
    begins = [
        0,
        0,
        *(
            mine[batch * SMALL.batch].number - 1
            for batch in range(1, 20)
            for _ in range(2)
            if batch * SMALL.batch < len(mine)
        ),
    ]
    assert all(newest <= begin for newest, begin in zip(seen, begins, strict=False))


def test_there_is_one_update_for_each_whole_batch_and_it_is_told_in_the_store(tmp_path):
    steps, learner = ended(tmp_path / "run", budget=60)
    answers = sum(step.proposer == "toy" for step in steps)
    updates = told(tmp_path / "run")
    assert len(updates) == answers // 8 == len(learner.updates)
    mine = [step for step in steps if step.proposer == "toy"]
    for place, one in enumerate(updates):
        batch = mine[8 * place : 8 * place + 8]
        assert (one.first, one.last) == (batch[0].number, batch[-1].number)
        ends = [step.status for step in batch]
        assert one.refused == ends.count(Status.ILLEGAL) / 8
        twins = [step for step in batch if step.same_as is not None and step.same_as >= one.first]
        assert one.siblings == len(twins) / 8
        assert one.duplicates == (ends.count(Status.DUPLICATE) - len(twins)) / 8
        assert one.valid == (ends.count(Status.OK) + len(twins)) / 8
        assert one.updated == (one.dropped < 2)
        assert one.tokens == 2
        assert not one.updated or (one.probe is not None and one.probe < 1e-5)
    assert updates[0].divergence == pytest.approx(0.0, abs=1e-6)


def test_a_policy_learns_during_a_search_which_edit_pays(tmp_path):
    policy = ToyPolicy(own_gain, 6)
    settings = replace(PLAIN, from_elites=0.0, from_island=0.0)  # parents are drawn from everything
    learn = LearningSettings(contexts=4, group=8, rate=0.03)
    steps, learner = ended(tmp_path / "run", policy, budget=110, settings=settings, learn=learn)
    mine = [step for step in steps if step.proposer == "toy"]

    def share(some: list[Step], edit: int) -> float:
        return sum(step.usage["learning"]["tokens"][0] - FIRST == edit for step in some) / len(some)

    assert share(mine[:64], 5) < 0.35
    assert share(mine[-64:], 5) > 0.6
    assert share(mine[-64:], 0) < 0.1  # the worst one
    assert (learner.updates[-1].reward or 0.0) > (learner.updates[0].reward or 0.0)
    assert (learner.updates[-1].divergence or 0.0) > 0.1


class Asked(ToyPolicy):
    """Its question depends on the parent."""

    def prompt(self, context):
        return question(context.parent.step)


def question(parent: int | None) -> list[int]:
    return [ASK, FIRST + (parent or 0) % 6]


def taught_by(
    folder: Path, learn: LearningSettings
) -> tuple[list[Step], list[Step], tuple[Update, ...], list[Sequence[Group]]]:
    """A search that learns: all its steps, those of the policy, the updates, and the groups that
    each was made from.
    """
    batches: list[Sequence[Group]] = []
    with learning(folder, Asked(more_gain, 6), learn, budget=60) as loop:
        trainer = learner_of(loop).progress.trainer
        update = trainer.update
        trainer.update = lambda groups: (batches.append(groups), update(groups))[1]
        loop.run(NAIVE)
    steps = steps_of(folder / "archive.sqlite")
    return steps, [step for step in steps if step.proposer == "toy"], told(folder), batches


def test_one_answer_to_a_question_is_compared_with_its_batch_by_what_it_gains_on_its_parent(
    tmp_path,
):
    steps, mine, updates, batches = taught_by(tmp_path / "run", SINGLE)
    assert len(batches) == len(updates) == len(mine) // 8 > 4
    for number, groups in enumerate(batches):
        batch = mine[8 * number : 8 * number + 8]
        found = []
        for step in batch:
            twin = (
                steps[step.same_as]
                if step.same_as is not None and step.same_as >= batch[0].number
                else step
            )
            error, before = twin.nrmse, steps[step.parent or 0].nrmse
            valid = -0.25 if twin.status is Status.ILLEGAL else -0.3
            if error is not None and twin.status is Status.OK:
                assert before is not None
                valid = min(max(math.log(before / error), 0.0), 1.0)
            found.append(valid)
        assert updates[number].gain == pytest.approx(sum(found) / 8, abs=1e-6)
        expected = (np.array(found) - np.mean(found)) / np.std(found)
        np.testing.assert_allclose(
            [float(one.advantages[0]) for one in groups], expected, rtol=1e-3, atol=1e-6
        )
        assert [list(one.prompt) for one in groups] == [question(step.parent) for step in batch]
    assert len({step.parent for step in mine[16:24]}) > 1


@pytest.fixture
def sighted(monkeypatch) -> list[str]:
    """First looks that see what the evaluator sees; the programs that were looked at."""
    looked: list[str] = []

    def look(diagram, context, rng):
        looked.append(program_text(diagram))
        return Look(math.log(by_gain(looked[-1])))

    monkeypatch.setattr("ibrid_policy.asking.first_look", look)
    return looked


def test_where_first_looks_judge_all_answers_to_a_question_are_learnt_from_and_one_is_evaluated(
    tmp_path, sighted
):
    steps, mine, updates, batches = taught_by(tmp_path / "run", BY_LOOKS)
    assert len(updates) == len(mine) // 8 > 4
    assert len(sighted) == sum(step.usage.get("first_looks", 0) for step in mine) > len(mine)
    taught = iter(group for groups in batches for group in groups)
    for number, one in enumerate(updates):
        worths, ends = [], []
        for step in mine[8 * number : 8 * number + 8]:
            before, kept = steps[step.parent or 0].nrmse, step.usage["learning"]
            assert before is not None
            assert len(kept["answers"]) == 8
            own = []
            for answer in kept["answers"]:
                ends.append(answer["status"])
                error = by_gain(
                    more_gain(_program(steps, step.parent), answer["tokens"][0] - FIRST)
                )
                gained = min(max(math.log(min(before, 1.0) / min(error, 1.0)), 0.0), 1.0)
                own.append(gained if ends[-1] == "ok" else -0.25 if ends[-1] == "illegal" else -0.3)
            worths += own
            if max(own) > 0 and len(set(own)) > 1:
                group = next(taught)
                assert list(group.prompt) == question(step.parent) == kept["prompt"]
                np.testing.assert_allclose(
                    group.advantages, entropic_advantages(own, BY_LOOKS.floor), atol=1e-6
                )
        assert one.gain == pytest.approx(np.mean(worths))
        assert one.valid == ends.count("ok") / 64
        assert one.refused == ends.count("illegal") / 64
    assert {step.status for step in mine} <= {
        Status.OK,
        Status.ILLEGAL,
        Status.DUPLICATE,
        Status.UNCHANGED,
    }


def test_every_other_time_the_look_chooses_what_is_evaluated_and_else_it_is_the_first_that_is_new(
    tmp_path, sighted
):
    steps, mine, _, _ = taught_by(tmp_path / "run", BY_LOOKS)
    by_look = by_place = 0
    for step in mine:
        told = step.usage["learning"]["answers"]
        found = [
            more_gain(_program(steps, step.parent), one["tokens"][0] - FIRST)
            for one in told
            if one["status"] == "ok"
        ]
        first = next(
            (one["status"] for one in told if one["status"] not in ("duplicate", "unchanged")), ""
        )
        if first == "ok" and by_gain(found[0]) > min(map(by_gain, found)):  # the two ways differ
            by_look += by_gain(step.program or "") == min(map(by_gain, found))
            by_place += step.program == found[0]
    assert by_look + by_place > 10
    assert by_look / (by_look + by_place) == pytest.approx(LOOKED_AT, abs=0.3)


def _program(steps: list[Step], number: int | None) -> str:
    return steps[number or 0].program or ""


def test_a_policy_learns_from_looks_what_pays(tmp_path, sighted):
    settings = replace(PLAIN, from_elites=0.0, from_island=0.0)  # parents are drawn from everything
    steps, learner = ended(
        tmp_path / "run",
        ToyPolicy(never_known(), 6),
        budget=110,
        settings=settings,
        learn=replace(BY_LOOKS, rate=0.1, divergence=0.0),
    )
    mine = [step for step in steps if step.proposer == "toy"]

    def share(some: list[Step], edit: int) -> float:
        answers = [answer for step in some for answer in step.usage["learning"]["answers"]]
        return sum(answer["tokens"][0] - FIRST == edit for answer in answers) / len(answers)

    assert share(mine[:16], 5) < 0.35
    assert share(mine[-16:], 5) > 0.6
    assert share(mine[-16:], 0) < 0.1  # the worst one
    assert (learner.updates[-1].divergence or 0.0) > 0.1
    assert [step.usage["learning"]["context"] for step in mine] == list(range(len(mine)))


def test_an_answer_whose_look_finds_no_response_has_failed(tmp_path, monkeypatch):
    def look(diagram, context, rng):
        gain = float(re.search(r'"gain", k=([\d.]+)\)', program_text(diagram))[1])  # type: ignore[index]
        return Look(math.inf if gain > 0.004 else -gain)

    monkeypatch.setattr("ibrid_policy.asking.first_look", look)
    steps, learner = ended(tmp_path / "run", budget=12, learn=replace(BY_LOOKS, contexts=1))
    first = next(step for step in steps if step.proposer == "toy").usage["learning"]["answers"]
    ends = [(one["tokens"][0] - FIRST, one["status"]) for one in first]
    assert {(number, end) for number, end in ends if number > 3} <= {(4, "failed"), (5, "failed")}
    failed = sum(end == "failed" for _, end in ends)
    assert failed > 0
    assert learner.updates[0].failed == failed / 8
    assert learner.updates[0].valid == sum(end == "ok" for _, end in ends) / 8


def test_answers_that_are_no_edit_are_learnt_from_too(tmp_path):
    steps, learner = ended(tmp_path / "run", ToyPolicy(more_gain, 6, masked=False), budget=12)
    assert Status.NO_EDIT in {step.status for step in steps}
    assert learner.updates[0].refused > 0


# the same run, whatever happens


def same(first: tuple[list[Step], Learner], second: tuple[list[Step], Learner]) -> None:
    assert first[0] == second[0]
    assert timeless(tuple(first[1].updates)) == timeless(tuple(second[1].updates))
    assert fingerprint(first[1].policy.model()) == fingerprint(second[1].policy.model())


def test_a_run_is_the_same_in_whatever_order_results_come(tmp_path):
    backwards = Reversed(by_gain, stable=lambda _: True)
    same(
        ended(tmp_path / "one", budget=40), ended(tmp_path / "two", budget=40, evaluator=backwards)
    )
    other = ended(tmp_path / "three", budget=40, seed=1)
    assert other[0] != steps_of(tmp_path / "one" / "archive.sqlite")


class Killed(Exception):
    pass


@pytest.mark.parametrize(
    ("beside", "learn"),
    [
        ((), SMALL),
        (((Rules(looks=1), 0.5),), SMALL),
        ((), SINGLE),
        ((), BY_LOOKS),
        ((), replace(BY_LOOKS, contexts=1)),
    ],
    ids=["alone", "mixed", "single answers", "looks", "a question each"],
)
def test_a_run_that_is_killed_again_and_again_ends_as_it_would_have(
    tmp_path, sighted, beside, learn
):
    options = {
        "budget": 40,
        "beside": beside,
        "learn": learn,
        "settings": replace(PLAIN, pruning=0.15, final_pruning=0.1),
    }
    whole = ended(tmp_path / "whole", **options)
    assert len(whole[1].updates) >= 3
    sitting = 0
    while sitting < 60:
        sitting += 1
        with learning(tmp_path / "killed", **options) as loop:
            calls, original, most = 0, loop.store.propose, 3 + 5 * (sitting % 3)

            def propose(step: Step, original=original, most=most) -> None:
                nonlocal calls
                calls += 1
                if calls > most:
                    raise Killed
                original(step)

            loop.store.propose = propose  # type: ignore[method-assign]
            try:
                loop.run(NAIVE)
            except Killed:
                continue
                same(whole, (steps_of(tmp_path / "killed" / "archive.sqlite"), learner_of(loop)))
            break
    assert 5 < sitting < 60


def test_a_run_killed_between_an_update_and_its_place_in_the_store_loses_nothing(tmp_path):
    whole = ended(tmp_path / "whole", budget=40)
    with learning(tmp_path / "killed", budget=40) as loop:

        def dies(name: str, text: str) -> None:
            raise Killed

        learner_of(loop).progress.keep = dies
        with pytest.raises(Killed):
            loop.run(NAIVE)
    assert told(tmp_path / "killed") == ()
    same(whole, ended(tmp_path / "killed", budget=40))
    assert timeless(told(tmp_path / "killed")) == timeless(told(tmp_path / "whole"))


def test_a_larger_budget_goes_on_in_the_middle_of_a_batch(tmp_path):
    whole = ended(tmp_path / "whole", budget=45)
    ended(tmp_path / "resumed", budget=19)
    same(whole, ended(tmp_path / "resumed", budget=45))


def test_a_search_with_a_target_ends_though_a_batch_is_under_way(tmp_path):
    with learning(tmp_path / "run", budget=300, target=0.9, settings=SearchSettings()) as loop:
        assert loop.run(NAIVE) == TARGET
    with learning(tmp_path / "other", budget=30, settings=SearchSettings()) as loop:
        assert loop.run(NAIVE) == BUDGET


# what goes wrong


def test_a_policy_that_serves_other_weights_is_not_trained_and_the_search_goes_on(tmp_path):
    policy, strange = ToyPolicy(more_gain, 6), ToyPolicy(more_gain, 6, seed=5)
    with torch.no_grad():
        strange.model().lm_head.weight.mul_(40)
    policy.stale = strange.model()
    before = fingerprint(policy.model())
    _, learner = ended(tmp_path / "run", policy, budget=40)
    assert fingerprint(policy.model()) == before
    taught = [one for one in learner.updates if one.dropped < 2]
    assert "served by other weights" in taught[0].remark
    assert "nothing is trained any more" in taught[0].remark
    assert not any(one.updated for one in learner.updates)


@pytest.mark.parametrize("rate", [0.1, 1e-3, 1e-5])
def test_a_policy_that_is_not_handed_the_new_weights_is_found_out_by_the_first_probe(
    tmp_path, rate
):
    policy = ToyPolicy(more_gain, 6)
    policy.stale = copy.deepcopy(policy.model())
    _, learner = ended(tmp_path / "run", policy, budget=60, learn=replace(SMALL, rate=rate))
    first = next(one for one in learner.updates if one.updated)
    assert first.handed == pytest.approx(0.0, abs=0.2)
    assert "after this update other weights are served" in first.remark
    assert not learner.updates[-1].updated


def test_a_policy_that_is_handed_the_new_weights_says_so_at_every_update(tmp_path):
    _, learner = ended(tmp_path / "run", budget=60, learn=replace(SMALL, rate=1e-4))
    shares = [one.handed or 0.0 for one in learner.updates if one.updated]
    assert len(shares) > 3
    np.testing.assert_allclose(shares, 1.0, atol=0.05)


def test_an_update_too_small_for_the_probe_says_that_nothing_is_proven(tmp_path):
    _, learner = ended(tmp_path / "run", budget=30, learn=replace(SMALL, rate=1e-7))
    updated = [one for one in learner.updates if one.updated]
    assert updated
    assert all(one.handed is None and "too small for the probe" in one.remark for one in updated)


def test_answers_that_repeat_each_other_from_the_start_are_no_narrowing(tmp_path):
    policy = ToyPolicy(
        lambda program, number: more_gain(program, 5 if number == 5 else 1), 6
    )  # five ways to say the same
    _, learner = ended(tmp_path / "run", policy, budget=40, learn=replace(SMALL, rate=1e-4))
    assert any(one.siblings > 0.5 and one.entropy is not None for one in learner.updates)
    assert not any("narrows down" in one.remark for one in learner.updates)


def test_a_policy_that_repeats_itself_and_has_lost_its_entropy_narrows_down(tmp_path):
    _, learner = ended(tmp_path / "run", budget=150, learn=replace(SMALL, rate=0.1))
    first = learner.updates[0].entropy
    assert first is not None
    narrow = [
        one.siblings > 0.5 and one.entropy is not None and one.entropy <= 0.5 * first
        for one in learner.updates
    ]
    assert any(narrow)
    assert [("narrows down" in one.remark) for one in learner.updates] == narrow


class Failing(ToyPolicy):
    """A server that is away at first."""

    def sample(self, prompts, contexts, number, seed):
        if self.sampled == 0:
            self.sampled = 1
            raise IbridError("the server is away")
        return super().sample(prompts, contexts, number, seed)


def test_an_answer_that_was_never_given_is_left_out(tmp_path):
    steps, learner = ended(tmp_path / "run", Failing(more_gain, 6), budget=30)
    assert (steps[1].status, steps[1].reason) == (Status.NO_ANSWER, "the server is away")
    assert "prompt" in steps[2].usage["learning"]
    assert learner.updates[0].updated


def test_lost_workers_are_left_out_and_counted(tmp_path):
    def law(program: str):
        return Status.LOST if "k=0.003)" in program else by_gain(program)

    _, learner = ended(
        tmp_path / "run", evaluator=ScriptedEvaluator(law, stable=lambda _: True), budget=30
    )
    assert sum(one.lost for one in learner.updates) > 0


def test_weights_of_another_model_or_moment_are_refused_in_a_sentence(tmp_path):
    ended(tmp_path / "run", budget=30)
    with pytest.raises(IbridError, match=r"learning.pt: belongs to a model with other weights"):
        ended(tmp_path / "run", ToyPolicy(more_gain, 6, seed=3), budget=40)
    (tmp_path / "run" / "learning.pt").unlink()
    with pytest.raises(IbridError, match=r"the weights have seen 0 batches, but the steps hold \d"):
        ended(tmp_path / "run", budget=60)
