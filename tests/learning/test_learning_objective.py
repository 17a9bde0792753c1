"""The objective of learning against closed forms: advantages, ratios, clips, importance weights,
gradients of a toy policy.
"""

import importlib.util
import math

import numpy as np
import pytest
from collecting import each_of
from ibrid_policy.learning.advantages import (
    DIVERGENCE,
    EPSILON,
    WAYS,
    batch_advantages,
    entropic_advantages,
    gain,
    mean_advantages,
    rewarded,
)
from ibrid_policy.learning.settings import (
    RATE_LARGE,
    RATE_LORA,
    RATE_SGD,
    RATE_SMALL,
    LearningSettings,
)
from ibrid_search.step import Status, Step

from ibrid.errors import IbridError

needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="learning needs torch; make setup-llm"
)


# advantages and rewards


def test_advantages_are_the_distances_from_the_mean_in_standard_deviations():
    found = mean_advantages([0.0, 1.0, 2.0, 3.0])
    assert found is not None
    np.testing.assert_allclose(
        found, np.array([-1.5, -0.5, 0.5, 1.5]) / (math.sqrt(1.25) + EPSILON), rtol=1e-15
    )


def test_below_the_noise_floor_differences_are_not_blown_up():
    rewards = [2.3000, 2.3001, 2.3002, 2.3003]
    without, bounded = mean_advantages(rewards), mean_advantages(rewards, floor=0.02)
    assert without is not None
    assert bounded is not None
    assert np.abs(without).max() > 1.3
    np.testing.assert_allclose(
        bounded, (np.array(rewards) - 2.30015) / (0.02 + EPSILON), rtol=1e-12
    )


def entropic(rewards: list[float | None], floor: float = 0.0) -> np.ndarray:
    found = entropic_advantages(rewards, floor)
    assert found is not None
    return found


def test_entropic_weights_lie_ln_2_from_equal_ones():
    for rewards in ([0.0, 1.0, 2.0, 3.0], [-0.3, -0.3, 0.9, 0.9, 0.9, 1.3], [0.5, 0.2, 0.9]):
        q = (entropic(list(rewards)) + 1) / len(rewards)
        assert q.sum() == pytest.approx(1)
        assert (q * np.log(q * len(rewards))).sum() == pytest.approx(DIVERGENCE, rel=1e-9)
        slopes = np.diff(np.log(q)) / np.where(np.diff(rewards) == 0, 1, np.diff(rewards))
        assert np.ptp(slopes[np.diff(rewards) != 0]) < 1e-6  # one beta


def test_entropic_advantages_are_after_the_best_answer_where_others_reward_the_usual_one():
    usual, best = 3, 5
    rewards = [-0.3, -0.3, 0.9, 0.9, 0.9, 1.3]
    by_group = mean_advantages(rewards)
    assert by_group is not None
    assert by_group[usual] > 0 > entropic(list(rewards))[usual]
    assert entropic(list(rewards))[best] > by_group[best] > 0


def test_entropic_advantages_do_not_depend_on_the_scale_of_rewards_but_noise_is_not_blown_up():
    rewards = np.array([0.1, 0.4, 0.2, 0.8])
    np.testing.assert_allclose(entropic(list(3 * rewards + 1)), entropic(list(rewards)), rtol=1e-6)
    close = [2.3000, 2.3001, 2.3002, 2.3003]
    assert np.abs(entropic(list(close))).max() > 1
    expected = (
        4 * np.exp(np.array(close) / 0.02) / np.exp(np.array(close) / 0.02).sum() - 1
    )  # beta is 1 / floor
    np.testing.assert_allclose(entropic(list(close), 0.02), expected, rtol=1e-9)
    two = entropic([0.0, 1.0], 0.1)  # of two, none lies ln 2 from equal weights
    np.testing.assert_allclose(two, [-np.tanh(5.0), np.tanh(5.0)], rtol=1e-12)


@each_of("advantages", WAYS.values())
@each_of("rewards", [[0.5] * 4, [None, None], [None, 0.3, None], []])
def test_a_group_that_teaches_nothing_is_dropped(advantages, rewards):
    assert advantages(rewards, 0.02) is None


@pytest.mark.parametrize("advantages", WAYS.values())
def test_a_lost_worker_is_left_out_of_mean_and_deviation(advantages):
    with_loss, without = advantages([1.0, None, 3.0, -0.4], 0.0), advantages([1.0, 3.0, -0.4], 0.0)
    assert with_loss is not None
    assert without is not None
    assert math.isnan(with_loss[1])
    np.testing.assert_array_equal(with_loss[[0, 2, 3]], without)


def steps(*ends: tuple[Status, float | None, int | None]) -> list[Step]:
    return [
        Step(number, status=status, reward=reward, same_as=same_as)
        for number, (status, reward, same_as) in enumerate(ends)
    ]


def test_a_structure_known_before_the_batch_counts_as_unchanged_and_a_siblings_as_its_twin():
    run = steps(
        (Status.OK, 0.1, None),
        (Status.OK, 2.5, None),
        (Status.DUPLICATE, None, 0),
        (Status.DUPLICATE, None, 1),
        (Status.FAILED, None, None),
        (Status.DUPLICATE, None, 4),
        (Status.LOST, None, None),
        (Status.ILLEGAL, None, None),
        (Status.OK, -3.0, None),
    )
    found = [rewarded(step, run, first=1) for step in run[1:]]
    assert [one.reward for one in found] == [2.5, -0.3, 2.5, -0.2, -0.2, None, -0.25, 0.0]
    assert [one.sibling for one in found] == [False, False, True, False, True, False, False, False]


def test_a_valid_answer_gains_the_logarithm_of_how_much_smaller_its_error_is_than_its_parents():
    run = steps((Status.REQUIRED, -0.5, None), (Status.OK, 2.0, None), (Status.LOST, None, None))
    ends = [
        (0, Status.OK, 0.7, None),
        (1, Status.OK, 2.4, None),
        (1, Status.OK, 1.9, None),
        (1, Status.OK, 9.0, None),
        (1, Status.ILLEGAL, None, None),
        (1, Status.DUPLICATE, None, 0),
        (0, Status.DUPLICATE, None, 4),
        (1, Status.LOST, None, None),
        (2, Status.OK, 5.0, None),
    ]
    run += [
        Step(3 + place, parent, status=end, reward=reward, same_as=same_as)
        for place, (parent, end, reward, same_as) in enumerate(ends)
    ]
    found = [gain(rewarded(step, run, first=3), run[step.parent or 0], 1.5) for step in run[3:]]
    # worse than its parent is not worse than nothing; the twin of step 4 has a parent of its own
    assert found == pytest.approx([0.7, 0.4, 0.0, 1.5, -0.25, -0.3, 1.5, None, None])


def split(rewards: list[float | None], group: int, baseline: str) -> list[list[float] | None]:
    found = batch_advantages(rewards, group, advantages="mean", baseline=baseline, floor=0.02)
    return [None if one is None else list(one) for one in found]


def test_where_no_answer_is_good_enough_nothing_is_taught():
    def taught(baseline: str, least: float) -> list[bool]:
        rewards = [-0.3, 0.0, 0.2, None]
        found = batch_advantages(
            rewards, 2, advantages="entropic", baseline=baseline, floor=0.02, least=least
        )
        return [one is not None for one in found]

    assert taught("group", -math.inf) == [
        True,
        False,
    ]  # one that is known has nothing to be compared with
    assert taught("group", 0.0) == [False, False]
    assert taught("parent", 0.0) == [True, True]
    assert taught("parent", 0.2) == [False, False]
    # rewards, which are no gains, may be good below zero
    assert LearningSettings(only_gains=True).least == -math.inf
    assert LearningSettings(only_gains=True, judge="look").least == 0.0


def test_answers_are_compared_within_their_group_or_with_the_whole_batch():
    rewards = [0.0, 1.0, 0.5, 0.5]
    root = math.sqrt(0.125)
    assert split(rewards, 2, "group") == [pytest.approx([-1.0, 1.0], abs=1e-5), None]
    assert split(rewards, 2, "parent") == [
        pytest.approx([-0.5 / root, 0.5 / root], rel=1e-5),
        [0.0, 0.0],
    ]
    assert split([None, 0.0, 1.0, None], 1, "parent") == [
        None,
        pytest.approx([-1.0], abs=1e-5),
        pytest.approx([1.0], abs=1e-5),
        None,
    ]
    assert split([0.3, 0.3, None, 0.3], 2, "parent") == [None, None]


# ratios, clips and weights


@needs_torch
def test_the_surrogate_is_flat_where_the_clip_holds_and_linear_elsewhere():
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.objective import surrogate

    ratio = torch.tensor(
        [[0.5, 0.9, 1.2, 1.5], [0.5, 0.9, 1.2, 1.5]], dtype=torch.float64, requires_grad=True
    )
    advantage = torch.tensor([[2.0], [-2.0]], dtype=torch.float64)
    found = surrogate(ratio, advantage)
    expected = [[1.0, 1.8, 2.4, 2.56], [-1.6, -1.8, -2.4, -3.0]]
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-15)
    found.sum().backward()
    assert ratio.grad is not None
    np.testing.assert_allclose(ratio.grad.numpy(), [[2.0, 2.0, 2.0, 0.0], [0.0, -2.0, -2.0, -2.0]])


@needs_torch
def test_importance_weights_are_truncated_and_have_no_gradient():
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.objective import importance_weights

    train = torch.log(torch.tensor([[0.1, 0.4, 0.9]], dtype=torch.float64)).requires_grad_()
    serve = torch.log(torch.tensor([[0.2, 0.4, 0.3]], dtype=torch.float64))
    found = importance_weights(train, serve, most=2.0)
    assert not found.requires_grad
    np.testing.assert_allclose(found.numpy(), [[0.5, 1.0, 2.0]], rtol=1e-15)


@needs_torch
def test_each_answer_counts_alike_however_long_it_is():
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.objective import over_answers

    tokens = torch.tensor([[1.0, 2.0, 3.0], [8.0, 99.0, 99.0]])
    real = torch.tensor([[True, True, True], [True, False, False]])
    assert over_answers(tokens, real).item() == 5.0  # (2 + 8)/2


@needs_torch
def test_the_divergence_is_zero_for_equal_policies_and_the_textbooks_in_the_mean():
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.objective import divergence

    new = torch.tensor([0.5, 0.3, 0.2], dtype=torch.float64)
    start = torch.tensor([0.25, 0.25, 0.5], dtype=torch.float64)
    estimate = divergence(new.log(), start.log())
    assert (estimate >= 0).all()
    kl = (new * (new / start).log()).sum()
    assert (new * estimate).sum().item() == pytest.approx(kl.item(), rel=1e-14)
    assert divergence(new.log(), new.log()).abs().max().item() == 0.0


# the gradient of a policy of two tokens: p(1) = 1/(1 + exp(-x)), answers of one token


def of_two(
    x: float,
    answers: list[int],
    served: list[float],
    rewards: list[float],
    old: float | None = None,
    **options,
):
    """Objective and its derivative by x.

    served : log-probabilities. old : logit of the policy before.
    """
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.objective import group_objective

    logit = torch.tensor(x, dtype=torch.float64, requires_grad=True)
    signs = torch.tensor([1.0 if one else -1.0 for one in answers], dtype=torch.float64)[:, None]
    new = torch.nn.functional.logsigmoid(signs * logit)
    before = new.detach() if old is None else torch.nn.functional.logsigmoid(signs * old)
    advantages = mean_advantages(rewards)
    assert advantages is not None
    found = group_objective(
        new,
        before,
        torch.tensor(served, dtype=torch.float64)[:, None],
        torch.tensor(advantages),
        torch.ones(len(answers), 1, dtype=torch.bool),
        **options,
    )
    found.value.backward()
    assert logit.grad is not None
    return found, logit.grad.item()


@needs_torch
@pytest.mark.parametrize("x", [-1.3, 0.0, 0.7])
def test_the_gradient_of_a_two_token_policy_is_that_of_the_closed_form(x):
    p = 1 / (1 + math.exp(-x))
    answers, rewards = [1, 0, 0, 1], [2.0, 0.0, 0.5, 1.0]
    served = [math.log(p if one else 1 - p) for one in answers]
    advantage = mean_advantages(rewards)
    assert advantage is not None
    # d ln p(1)/dx = 1 - p, d ln p(0)/dx = -p
    expected = np.mean(
        [a * ((1 - p) if one else -p) for a, one in zip(advantage, answers, strict=True)]
    )
    found, slope = of_two(x, answers, served, rewards)
    assert slope == pytest.approx(expected, rel=1e-12)
    assert (found.clipped, found.weight) == (0.0, pytest.approx(1.0))


@needs_torch
def test_answers_of_a_stale_sampler_are_weighed_by_what_the_trainer_thinks_of_them():
    x, stale = 0.7, -0.4
    p, q = 1 / (1 + math.exp(-x)), 1 / (1 + math.exp(-stale))
    answers, rewards = [1, 0, 0, 1], [2.0, 0.0, 0.5, 1.0]
    served = [math.log(q if one else 1 - q) for one in answers]
    weights = [min(p / q, 1.5) if one else min((1 - p) / (1 - q), 1.5) for one in answers]
    assert weights[0] == 1.5  # truncated, from 1.67
    assert weights[1] < 1
    advantage = mean_advantages(rewards)
    assert advantage is not None
    terms = zip(weights, advantage, answers, strict=True)
    expected = np.mean([w * a * ((1 - p) if one else -p) for w, a, one in terms])
    found, slope = of_two(x, answers, served, rewards, most=1.5)
    assert slope == pytest.approx(expected, rel=1e-12)
    assert found.weight == pytest.approx(np.mean(weights), rel=1e-6)
    assert found.largest_weight == pytest.approx(1.5)


@needs_torch
def test_a_token_whose_ratio_has_left_the_clip_pulls_no_further():
    x, old = 1.5, 0.0
    answers, rewards = [1, 0], [1.0, -1.0]
    served = [math.log(0.5), math.log(0.5)]
    found, slope = of_two(
        x, answers, served, rewards, old=old
    )  # ratios 1.64 and 0.36: both beyond, both good as they are
    assert (slope, found.clipped) == (0.0, 1.0)
    found, slope = of_two(
        x, answers, served, rewards[::-1], old=old
    )  # both the wrong way: nothing holds them
    assert slope < 0
    assert found.clipped == 0.0


# settings


def test_the_learning_rate_follows_from_optimizer_and_size_unless_it_is_given():
    assert LearningSettings().rate_of(2_000_000) == RATE_SMALL
    assert LearningSettings().rate_of(135_000_000) == RATE_LARGE == 1e-6
    assert LearningSettings(lora=8).rate_of(135_000_000) == RATE_LORA
    assert LearningSettings(optimizer="sgd").rate_of(135_000_000) == RATE_SGD
    assert (
        LearningSettings(rate=0.5).rate_of(1)
        == LearningSettings(rate=0.5, optimizer="sgd").rate_of(1)
        == 0.5
    )


def test_the_default_profile_is_the_papers():
    one = LearningSettings()
    assert (one.contexts, one.group, one.batch, one.epochs) == (32, 16, 512, 1)
    assert (one.clip_low, one.clip_high, one.most_weight, one.divergence) == (0.2, 0.28, 2.0, 0.0)
    assert (one.optimizer, one.decay1, one.decay2) == ("adam", 0.9, 0.98)


@each_of(
    ("wrong", "sentence"),
    [
        ({"group": 1}, "a group needs 2 answers or more.*found 1"),
        (
            {"contexts": 1, "group": 1, "baseline": "parent"},
            "a batch needs 2 answers or more.*found 1",
        ),
        ({"group": 0, "baseline": "parent"}, "a group needs 1 answer or more, found 0"),
        ({"baseline": "best"}, "baseline must be group or parent, found best"),
        ({"advantages": "most"}, "advantages must be mean or entropic, found most"),
        ({"optimizer": "newton"}, "optimizer must be adam or sgd, found newton"),
        ({"most_gain": 0.0}, "most_gain must be above zero, found 0"),
        ({"contexts": 0}, "a batch needs 1 context or more, found 0"),
        ({"rate": -1.0}, "the learning rate must be above zero, found -1"),
        ({"rate": math.nan}, "the learning rate must be above zero, found nan"),
        ({"clip_low": 1.5}, "clip_low must be between 0 and 1"),
        ({"decay2": 1.0}, "decay2 must be from 0 to below 1"),
        ({"floor": -0.1}, "floor must not be negative"),
        ({"lora": -1}, "rank of adapters"),
        ({"threads": 0}, "1 thread or more"),
    ],
)
def test_settings_that_mean_nothing_are_refused_in_a_sentence(wrong, sentence):
    with pytest.raises(IbridError, match=sentence):
        LearningSettings(**wrong)
