"""Sampling, scoring and updating a small model: the same numbers two ways, and a known edit that is
learnt.
"""

import importlib.util

import numpy as np
import pytest

if any(importlib.util.find_spec(one) is None for one in ("torch", "transformers")):
    pytest.skip("learning needs torch and transformers; make setup-llm", allow_module_level=True)

import torch  # pyright: ignore[reportMissingImports]
import transformers  # pyright: ignore[reportMissingImports]
from ibrid_policy.backend import threads
from ibrid_policy.learning.adapters import merged
from ibrid_policy.learning.advantages import mean_advantages
from ibrid_policy.learning.checkpoint import read_checkpoint, write_checkpoint
from ibrid_policy.learning.sampling import sample_answers
from ibrid_policy.learning.scoring import score
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.trainer import Group, RewardTrainer, Trained, fingerprint
from many_models import made
from toy_policy import ASK, END, FIRST, tiny_model

from ibrid.errors import IbridError

pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own

PROMPT = [ASK, 3, 4, 3]


@pytest.fixture(autouse=True)
def one_thread():
    with threads(1):
        yield


def plain_logprobs(model, prompt, answer) -> torch.Tensor:
    """Of an answer's tokens, by one pass over question and answer together."""
    logits = model(input_ids=torch.tensor([[*prompt, *answer]])).logits[0]
    told = torch.log_softmax(logits.float(), -1)[len(prompt) - 1 : -1]
    return told.gather(1, torch.tensor([list(answer)]).T)[:, 0]


# sampling and scoring


def test_scores_and_their_gradient_are_those_of_one_pass_over_question_and_answer():
    model, answers = tiny_model(7, layers=2), [(5, 2, 0), (6,), (2, 2)]
    scored = score(model, PROMPT, answers, [None] * 3)
    scored.logprobs.sum().backward()
    gradient = {
        name: one.grad.clone() for name, one in model.named_parameters() if one.grad is not None
    }
    model.zero_grad()
    plain = [plain_logprobs(model, PROMPT, one) for one in answers]
    torch.cat(plain).sum().backward()
    for row, expected in zip(scored.logprobs, plain, strict=True):
        np.testing.assert_allclose(
            row[: len(expected)].detach(), expected.detach(), rtol=0, atol=1e-6
        )  # float32
    assert scored.real.sum(1).tolist() == [3, 1, 2]
    for name, one in model.named_parameters():
        np.testing.assert_allclose(gradient[name], one.grad, rtol=1e-4, atol=1e-6)


def test_sampled_log_probabilities_are_those_that_the_trainer_finds():
    model = tiny_model(7, layers=2)
    answers = sample_answers(model, PROMPT, 24, end=[END], longest=9, seed=3)
    assert len({len(one.tokens) for one in answers}) > 3  # so answers do leave the batch
    scored = score(model, PROMPT, [one.tokens for one in answers], [None] * 24)
    for one, row in zip(answers, scored.logprobs, strict=True):
        np.testing.assert_allclose(one.logprobs, row[: len(one.tokens)].detach(), rtol=0, atol=1e-6)
        assert END not in one.tokens[:-1]


def test_answers_follow_the_models_distribution_and_the_seed():
    model = tiny_model(5, seed=1)
    with torch.no_grad():
        model.lm_head.weight.mul_(40)  # far from equal
        expected = torch.softmax(model(input_ids=torch.tensor([PROMPT])).logits[0, -1], -1).numpy()
    first = sample_answers(model, PROMPT, 2000, end=[END], longest=1, seed=0)
    found = np.bincount([one.tokens[0] for one in first], minlength=5) / 2000
    np.testing.assert_allclose(
        found, expected, atol=0.045
    )  # four standard deviations of a share of 2000
    assert expected.max() > 2 * expected.min()
    assert sample_answers(model, PROMPT, 2000, end=[END], longest=1, seed=0) == first
    assert sample_answers(model, PROMPT, 2000, end=[END], longest=1, seed=1) != first


def test_an_answer_does_not_depend_on_how_many_others_are_drawn_with_it_in_one_place():
    model = tiny_model(7, layers=2)
    long = sample_answers(model, PROMPT, 8, end=[END], longest=9, seed=3)
    short = sample_answers(model, PROMPT, 8, end=[END], longest=2, seed=3)
    assert [one.tokens[:2] for one in long] == [one.tokens for one in short]


def test_a_guide_is_obeyed_and_its_probabilities_are_those_of_what_it_allows():
    model, allowed = tiny_model(7), np.array([True, False, False, False, True, True, False])
    answers = sample_answers(
        model, PROMPT, 40, end=[END], longest=5, seed=0, guide=lambda before: allowed
    )
    assert {token for one in answers for token in one.tokens} == {0, 4, 5}
    masks = [np.tile(allowed, (len(one.tokens), 1)) for one in answers]
    scored = score(model, PROMPT, [one.tokens for one in answers], masks)
    for one, row in zip(answers, scored.logprobs, strict=True):
        np.testing.assert_allclose(one.logprobs, row[: len(one.tokens)].detach(), rtol=0, atol=1e-6)
    assert (scored.entropy.max() <= np.log(3) + 1e-6).item()


# the update


def a_group(model, rewards, number=16, seed=0, served=None) -> Group:
    """Answers of one token; `rewards` : of an answer's token."""
    answers = sample_answers(served or model, [ASK], number, end=[], longest=1, seed=seed)
    advantages = mean_advantages([rewards(one.tokens[0]) for one in answers], 0.02)
    assert advantages is not None
    return Group((ASK,), tuple(answers), (None,) * number, advantages)


def chance(model, token: int) -> float:
    """That the answer to the question is this token."""
    with torch.no_grad():
        return torch.softmax(model(input_ids=torch.tensor([[ASK]])).logits[0, -1], -1)[token].item()


def taught(trainer: RewardTrainer, most: int) -> Trained:
    """Updates that reward token 4 until it is nearly always said, `most` at most; the last of
    them.
    """
    trained, seed = None, 0
    while trained is None or (chance(trainer.model, 4) < 0.8 and seed < most):
        trained, seed = (
            trainer.update([a_group(trainer.model, lambda token: float(token == 4), seed=seed)]),
            seed + 1,
        )
        assert trained.updated
    return trained


def test_a_policy_rewarded_for_a_known_edit_learns_to_make_it():
    model = tiny_model(FIRST + 6)
    assert chance(model, 4) < 0.3
    trained = taught(RewardTrainer(model, LearningSettings(rate=0.03)), most=16)
    assert chance(model, 4) >= 0.8
    assert trained.divergence > 0.5  # it has left the start


@pytest.mark.parametrize(
    ("optimizer", "rate", "direction"),
    [
        ("adam", 1e-3, torch.sign),
        ("sgd", 1.0, lambda slope: slope),
    ],  # Adam's first step is the rate, with its sign
)
def test_one_epoch_moves_weights_by_the_gradient_of_the_objective(optimizer, rate, direction):
    model = tiny_model(FIRST + 3)
    group = a_group(model, lambda token: float(token))
    before = {name: one.detach().clone() for name, one in model.named_parameters()}
    told = torch.cat([plain_logprobs(model, [ASK], one.tokens) for one in group.answers])
    objective = (
        told * torch.tensor(group.advantages).float()
    ).mean()  # ratio and weight are 1, its gradient the same
    gradient = torch.autograd.grad(objective, list(model.parameters()))
    trainer = RewardTrainer(
        model, LearningSettings(optimizer=optimizer, rate=rate, longest_gradient=1e9)
    )
    trained = trainer.update([group])
    norm = torch.sqrt(sum((one**2).sum() for one in gradient)).item()
    assert trained.gradient == pytest.approx(norm, rel=1e-4)
    for (name, one), slope in zip(model.named_parameters(), gradient, strict=True):
        moved, strong = one.detach() - before[name], slope.abs() > 1e-5
        np.testing.assert_allclose(moved[strong], rate * direction(slope[strong]), rtol=2e-2)


def test_a_step_along_the_gradient_is_no_longer_than_the_rate_times_the_longest_gradient():
    model = tiny_model(FIRST + 3)
    before = {name: one.detach().clone() for name, one in model.named_parameters()}
    settings = LearningSettings(optimizer="sgd", rate=0.05, longest_gradient=0.01)
    trained = RewardTrainer(model, settings).update([a_group(model, lambda token: float(token))])
    moved = torch.sqrt(
        sum(((one.detach() - before[name]) ** 2).sum() for name, one in model.named_parameters())
    ).item()
    assert trained.gradient > 0.01
    assert moved == pytest.approx(0.05 * 0.01, rel=1e-3)


def test_dropped_answers_and_other_epochs_count_as_they_should():
    model = tiny_model(FIRST + 3)
    group = a_group(model, lambda token: float(token))
    trained = RewardTrainer(model, LearningSettings(rate=0.05, epochs=6)).update([group])
    assert 0 < trained.clipped <= 1  # six large steps leave the clip
    assert trained.weight == pytest.approx(1.0, abs=1e-5)


def test_a_slightly_stale_sampler_is_weighed_and_a_very_stale_one_teaches_nothing():
    model, stale, strange = (
        tiny_model(FIRST + 3),
        tiny_model(FIRST + 3),
        tiny_model(FIRST + 3, seed=9),
    )
    with torch.no_grad():
        stale.lm_head.weight.mul_(1.3)
        strange.lm_head.weight.mul_(60)
    trainer = RewardTrainer(model, LearningSettings(rate=1e-3, stop=0.1))
    before = fingerprint(model)
    trained = trainer.update([a_group(model, float, served=strange)])
    assert not trained.updated
    assert trained.drift > 0.1
    assert fingerprint(model) == before
    trained = trainer.update([a_group(model, float, served=stale)])
    assert trained.updated
    assert 1e-4 < trained.drift < 0.1
    assert trained.largest_weight > 1 + 1e-4
    assert fingerprint(model) != before


def test_the_divergence_holds_a_policy_back():
    def course(weight: float) -> float:
        model = tiny_model(FIRST + 6)
        trainer = RewardTrainer(model, LearningSettings(rate=0.02, divergence=weight))
        for seed in range(8):
            trainer.update([a_group(model, lambda token: float(token == 4), seed=seed)])
        return chance(model, 4)

    assert course(2.0) < course(0.0) - 0.05


# what is kept


@pytest.mark.parametrize("optimizer", ["adam", "sgd"])
def test_a_trainer_that_is_restored_goes_on_as_if_nothing_had_been(tmp_path, optimizer):
    def go_on(trainer: RewardTrainer, seeds: range) -> str:
        for seed in seeds:
            trainer.update([a_group(trainer.model, float, seed=seed)])
        return fingerprint(trainer.model)

    settings = LearningSettings(optimizer=optimizer, rate=0.01)
    whole = go_on(RewardTrainer(tiny_model(6), settings), range(6))
    first = RewardTrainer(tiny_model(6), settings)
    go_on(first, range(3))
    write_checkpoint(tmp_path / "state", first.state())
    second = RewardTrainer(tiny_model(6), settings)
    state = read_checkpoint(tmp_path / "state")
    assert state is not None
    second.restore(state)
    assert go_on(second, range(3, 6)) == whole


def test_a_damaged_checkpoint_is_one_sentence(tmp_path):
    path = tmp_path / "state"
    assert read_checkpoint(path) is None
    for content in (b"", b"garbage", b"PK\x03\x04 not a zip"):
        path.write_bytes(content)
        with pytest.raises(IbridError, match=r"state: .*; restore it, or start a new run"):
            read_checkpoint(path)
    torch.save({"version": 99}, path)
    with pytest.raises(IbridError, match="must hold the state of learning"):
        read_checkpoint(path)


def test_a_checkpoint_of_other_shapes_is_refused_though_they_could_be_stretched():
    trainer = RewardTrainer(tiny_model(6), LearningSettings())
    state = trainer.state()
    name = "lm_head.weight"
    state["weights"][name] = state["weights"][name][:1]
    with pytest.raises(ValueError, match=r"lm_head.weight has other numbers of rows or columns"):
        trainer.restore(state)


def test_threads_and_the_random_state_are_left_as_they_were():
    before = torch.get_rng_state()
    model = tiny_model(6)
    with threads(2):
        RewardTrainer(model, LearningSettings(rate=0.01)).update([a_group(model, float)])
        assert torch.get_num_threads() == 2
    assert torch.equal(before, torch.get_rng_state())


def test_adapters_are_trained_alone_and_begin_as_nothing():
    pytest.importorskip("peft", reason="low-rank adapters need peft; pip install 'ibrid[lora]'")
    model = tiny_model(FIRST + 6, layers=2)
    with torch.no_grad():
        model.lm_head.weight.mul_(
            20
        )  # adapters leave it as it is, and so small it says next to nothing
    said = chance(model, 4)
    base = {name: one.detach().clone() for name, one in model.named_parameters()}
    trainer = RewardTrainer(model, LearningSettings(rate=0.02, lora=4))
    assert chance(model, 4) == pytest.approx(said, abs=1e-6)
    assert (
        0
        < sum(one.numel() for one in trainer.trained.values())
        < sum(one.numel() for one in base.values())
    )
    taught(trainer, most=24)
    assert chance(model, 4) > said + 0.2
    for name, one in model.named_parameters():
        if "lora_" not in name:
            assert torch.equal(one.detach(), base[name.replace(".base_layer", "")])


@pytest.mark.parametrize("lora", [0, 4])
def test_the_divergence_is_from_the_start_with_adapters_and_without(lora):
    pytest.importorskip("peft", reason="low-rank adapters need peft; pip install 'ibrid[lora]'")
    model = tiny_model(FIRST + 6, layers=2)
    group = a_group(model, float)
    trainer = RewardTrainer(model, LearningSettings(rate=0.02, lora=lora))
    first = trainer.update([group])
    assert first.divergence == pytest.approx(0.0, abs=1e-6)
    assert first.gradient > 0
    start, now = tiny_model(FIRST + 6, layers=2), model
    ratio = torch.cat(
        [
            plain_logprobs(start, [ASK], one.tokens) - plain_logprobs(now, [ASK], one.tokens)
            for one in group.answers
        ]
    ).detach()
    assert trainer.update([group]).divergence == pytest.approx(
        float((ratio.exp() - ratio - 1).mean()), rel=1e-2
    )
    assert all(one.requires_grad for one in trainer.trained.values())
    assert (trainer.reference is None) == bool(lora)


@pytest.mark.parametrize("name", ["llama", "gpt2", "gemma2"])
def test_merged_weights_are_those_of_a_plain_model_that_says_the_same(tmp_path, name):
    pytest.importorskip("peft", reason="low-rank adapters need peft; pip install 'ibrid[lora]'")
    model, question = made(name), torch.tensor([[4, 5, 6, 7]])
    names = {key for key, _ in model.named_parameters()}
    before = model(input_ids=question).logits.detach()
    trainer = RewardTrainer(model, LearningSettings(rate=0.05, lora=4))
    trainer.update([a_group(model, float)])
    said = model(input_ids=question).logits.detach()
    assert (said - before).abs().max() > 0.01
    merged(model).save_pretrained(tmp_path)
    loaded = transformers.AutoModelForCausalLM.from_pretrained(tmp_path)
    assert {key for key, _ in loaded.named_parameters()} == names
    torch.testing.assert_close(loaded(input_ids=question).logits, said, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(
        model(input_ids=question).logits, said
    )  # the model itself keeps its adapters


@pytest.mark.parametrize("name", ["llama", "gpt2", "mistral", "gemma2"])
def test_adapters_wider_than_every_layer_are_one_sentence(name):
    pytest.importorskip("peft", reason="low-rank adapters need peft; pip install 'ibrid[lora]'")
    with pytest.raises(
        IbridError, match=r"^adapters of rank 1000000 are wider .* a rank of 16 or less"
    ):
        RewardTrainer(made(name), LearningSettings(lora=1_000_000))
    trainer = RewardTrainer(made(name), LearningSettings(lora=16))
    assert (
        len(trainer.trained) >= 2 * 2 * 4
    )  # two matrices for each of four layers or more in both blocks
    assert not any("lm_head" in one or "embed" in one for one in trainer.trained)


def test_adapters_without_peft_are_one_sentence(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "peft", None)
    with pytest.raises(IbridError, match=r"need the package peft; pip install 'ibrid\[lora\]'"):
        RewardTrainer(tiny_model(6), LearningSettings(lora=4))
