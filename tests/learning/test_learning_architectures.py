"""Sampling and scoring with every kind of causal language model: each answer as a pass over
question and answer alone has it.
"""

import importlib.util

import numpy as np
import pytest

if any(importlib.util.find_spec(one) is None for one in ("torch", "transformers")):
    pytest.skip("learning needs torch and transformers; make setup-llm", allow_module_level=True)

import torch  # pyright: ignore[reportMissingImports]
import transformers  # pyright: ignore[reportMissingImports]
from ibrid_policy.learning.sampling import require_causal, sample_answers
from ibrid_policy.learning.scoring import score, side_by_side
from many_models import KINDS, TOKENS, made

from ibrid.errors import IbridError

pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own

PROMPT = [4, 5, 6, 7, 8, 3, 9]
END = 0
#: Sums in another order, in float32; log-probabilities are some units.
TOLERANCE = 1e-5


def alone(model, answer) -> torch.Tensor:
    """Log-probabilities of an answer's tokens by one pass over question and answer."""
    said = torch.log_softmax(
        model(input_ids=torch.tensor([[*PROMPT, *answer]])).logits[0].float(), -1
    )
    return said[len(PROMPT) - 1 : -1].gather(1, torch.tensor([list(answer)]).T)[:, 0]


@pytest.mark.parametrize("name", KINDS)
def test_answers_of_every_kind_of_model_have_the_log_probabilities_and_the_gradient_of_each_alone(
    name,
):
    model = made(name)
    answers = sample_answers(model, PROMPT, 5, end=[END], longest=8, seed=1)
    assert any(len(one.tokens) > 4 for one in answers)  # beyond the window of those that have one
    scored = score(model, PROMPT, [one.tokens for one in answers], [None] * 5)
    scored.logprobs.sum().backward()
    gradient = {
        key: one.grad.clone() for key, one in model.named_parameters() if one.grad is not None
    }
    model.zero_grad()
    plain = [alone(model, one.tokens) for one in answers]
    torch.cat(plain).sum().backward()
    for one, row, expected in zip(answers, scored.logprobs, plain, strict=True):
        np.testing.assert_allclose(one.logprobs, expected.detach(), rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(
            row[: len(expected)].detach(), expected.detach(), rtol=0, atol=TOLERANCE
        )
    expected = {key: one.grad for key, one in model.named_parameters() if one.grad is not None}
    largest = max(float(one.abs().max()) for one in expected.values())
    assert largest > 0.1
    for key, one in expected.items():
        np.testing.assert_allclose(gradient[key], one, rtol=1e-3, atol=TOLERANCE * largest)


@pytest.mark.parametrize("name", KINDS)
def test_answers_stand_side_by_side_where_the_model_reads_them_so(name):
    assert side_by_side(made(name)) == KINDS[name][2]


def test_both_ways_of_sampling_draw_the_same_answers(monkeypatch):
    model = made("llama")
    together = sample_answers(model, PROMPT, 6, end=[END], longest=8, seed=2)
    monkeypatch.setattr("ibrid_policy.learning.sampling.side_by_side", lambda model: False)
    apart = sample_answers(model, PROMPT, 6, end=[END], longest=8, seed=2)
    assert [one.tokens for one in apart] == [one.tokens for one in together]
    for one, other in zip(apart, together, strict=True):
        np.testing.assert_allclose(one.logprobs, other.logprobs, rtol=0, atol=TOLERANCE)


def test_a_window_that_is_longer_than_any_short_question_is_seen_too():
    config = transformers.MistralConfig(
        vocab_size=TOKENS,
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        num_key_value_heads=2,
        sliding_window=4096,
    )
    assert not side_by_side(transformers.MistralForCausalLM(config).eval())


def test_what_a_folder_says_of_generation_changes_no_answer():
    model = made("mistral")
    before = sample_answers(model, PROMPT, 3, end=[END], longest=8, seed=0)
    model.generation_config.repetition_penalty = 50.0
    model.generation_config.suppress_tokens = list(before[0].tokens)
    assert sample_answers(model, PROMPT, 3, end=[END], longest=8, seed=0) == before
    assert model.generation_config.repetition_penalty == 50.0


def test_a_guide_is_obeyed_where_answers_are_generated_alone():
    model, allowed = made("mistral"), np.isin(np.arange(TOKENS), (END, 4, 5))
    asked: list[tuple[int, ...]] = []

    def guide(before: tuple[int, ...]) -> np.ndarray:
        asked.append(before)
        return allowed

    answers = sample_answers(model, PROMPT, 6, end=[END], longest=8, seed=0, guide=guide)
    assert {token for one in answers for token in one.tokens} == {END, 4, 5}
    assert not any(END in before for before in asked)
    masks = [np.tile(allowed, (len(one.tokens), 1)) for one in answers]
    scored = score(model, PROMPT, [one.tokens for one in answers], masks)
    for one, row in zip(answers, scored.logprobs, strict=True):
        np.testing.assert_allclose(
            one.logprobs, row[: len(one.tokens)].detach(), rtol=0, atol=TOLERANCE
        )


def test_a_model_that_is_not_causal_is_one_sentence():
    config = transformers.BertConfig(
        vocab_size=TOKENS,
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=2,
        num_attention_heads=2,
        initializer_range=0.3,
    )
    with pytest.raises(
        IbridError, match=r"^bert: (what it says of a token changes|cannot be sampled)"
    ):
        require_causal(transformers.BertLMHeadModel(config).eval(), "bert")
    for name in ("llama", "mistral", "mamba"):
        require_causal(made(name), name)
