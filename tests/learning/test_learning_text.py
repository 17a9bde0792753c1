"""Learning with language models: edits that a grammar allows, a text model in a folder, and a
server with log-probabilities.
"""

import importlib.util
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scripted_server
from ibrid_policy.learning.edit_automaton import EditAutomaton, Slot
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, read_updates
from ibrid_policy.proposer import PolicyProposer
from ibrid_search.evaluation.judging import judge, judge_program
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.first_look import LOOKS
from ibrid_search.run.store import Store
from ibrid_search.step import Status
from scripted_search import NAIVE, context_of, study

import ibrid
from ibrid.errors import IbridError

TORCH = all(
    importlib.util.find_spec(one) is not None for one in ("torch", "transformers", "tokenizers")
)
needs_torch = pytest.mark.skipif(
    not TORCH, reason="language models need torch and transformers; make setup-llm"
)
needs_openai = pytest.mark.skipif(
    importlib.util.find_spec("openai") is None,
    reason="servers need the package openai; make setup-llm",
)
pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own

PROGRAMS = ("naive", "gfl", "gfl_exact")


def drawn(automaton: EditAutomaton, rng: np.random.Generator) -> str:
    """An edit whose every choice is made by chance."""
    slot, text = Slot(), ""
    while alternatives := automaton.alternatives(slot):
        options = list(alternatives.items())
        more, slot = options[rng.integers(len(options))]
        text += more
    return text


# the grammar of edits


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_edit_of_the_grammar_applies_and_names_only_what_exists(name):
    context, rng = context_of(ibrid.textbook(name)), np.random.default_rng(0)
    automaton, parent = EditAutomaton(context), ibrid.program_text(context.parent.diagram)
    known = judge_program(parent, context.study).hash
    ends = []
    for _ in range(60):
        verdict = judge(
            Proposal(drawn(automaton, rng)), parent, known, context.study, lambda _: None
        )
        assert verdict.status not in (
            Status.NO_EDIT,
            Status.NO_MATCH,
            Status.AMBIGUOUS,
            Status.UNREADABLE,
        )
        for wrong in ("no kind", "no port", "no module", "nothing drives"):
            assert wrong not in verdict.reason
        ends.append(verdict.status)
    assert ends.count(Status.PENDING) >= 15  # a quarter at least; of free text next to none


@pytest.mark.parametrize("name", PROGRAMS)
def test_no_alternative_begins_another_so_that_text_says_which_was_meant(name):
    automaton, rng = EditAutomaton(context_of(ibrid.textbook(name))), np.random.default_rng(1)
    for _ in range(20):
        slot = Slot()
        while alternatives := list(automaton.alternatives(slot)):
            assert not any(
                one != other and one.startswith(other)
                for one in alternatives
                for other in alternatives
            )
            slot = automaton.alternatives(slot)[alternatives[rng.integers(len(alternatives))]]


def test_a_block_closes_only_on_a_legal_diagram_while_there_is_room():
    context = context_of(ibrid.textbook("naive"))
    automaton = EditAutomaton(context)
    parent = ibrid.program_text(context.parent.diagram)
    line = parent.splitlines().index('    g.connect("gain.out", "plant.u_r")')
    written = ('    g.connect("gain.out", "plant.u_r")',)
    unchanged = Slot("replace", line, line + 1, written)
    assert not any("REPLACE" in text for text in automaton.alternatives(unchanged))
    added = (
        '    g.add("PI_dq", "pi_dq_1")',
        '    g.connect("gain.out", "pi_dq_1.in_")',
        '    g.connect("pi_dq_1.out", "plant.u_r")',
    )
    assert any(
        "REPLACE" in text for text in automaton.alternatives(Slot("replace", line, line + 1, added))
    )
    assert not any(
        "REPLACE" in text
        for text in automaton.alternatives(Slot("replace", line, line + 1, added[:2]))
    )
    assert any(
        "REPLACE" in text for text in EditAutomaton(context, lines=1).alternatives(unchanged)
    )  # no more room


def test_wires_join_ports_of_one_signal():
    automaton = EditAutomaton(context_of(ibrid.textbook("naive")))
    kinds = {"plant": "LFilter", "gain": "Gain_dq", "no_frequency": "ConstZero"}
    slot = Slot("source", 1, 2, (), ())
    sources = automaton.alternatives(slot)
    assert any(text.startswith("plant.e_q") for text in sources) or any(
        text.startswith("gain.out") for text in sources
    )
    for text, after in sources.items():
        for target in automaton.alternatives(after):
            module, _, port = target.removesuffix('")\n').partition(".")
            scalar = text.startswith(("plant.e_q", "no_frequency"))
            if module in kinds:
                assert scalar == (port == "delta_omega")
            else:
                assert target == 'i_DQ")\n'
                assert not scalar


# a language model in a folder: random weights, a tokenizer of letters and a few words


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A model of random weights with a tokenizer of single characters and some longer pieces."""
    if not TORCH:
        pytest.skip("language models need torch and transformers; make setup-llm")
    import torch  # pyright: ignore[reportMissingImports]
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers  # pyright: ignore[reportMissingImports]
    from transformers import LlamaConfig, LlamaForCausalLM, PreTrainedTokenizerFast  # pyright: ignore[reportMissingImports]

    letters = pre_tokenizers.ByteLevel.alphabet()
    pieces = ["<s>", "</s>", *sorted(letters)]
    merges = [
        ("g", "."),
        ("Ġ", "Ġ"),
        ("ĠĠ", "ĠĠ"),
        ("<", "<"),
        ("=", "="),
        ("o", "n"),
        (")", "Ċ"),
        ('"', ")Ċ"),
    ]
    pieces += ["".join(one) for one in merges]
    tokenizer = Tokenizer(
        models.BPE({piece: number for number, piece in enumerate(pieces)}, merges)
    )
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    made = PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, bos_token="<s>", eos_token="</s>", pad_token="</s>"
    )
    config = LlamaConfig(
        vocab_size=len(pieces),
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        max_position_embeddings=40_000,
        bos_token_id=0,
        eos_token_id=1,
        pad_token_id=1,
    )
    place = tmp_path_factory.mktemp("models") / "letters"
    torch.manual_seed(0)
    LlamaForCausalLM(config).save_pretrained(place)
    made.save_pretrained(place)
    return place


@needs_torch
def test_constrained_answers_are_edits_and_their_probabilities_those_of_the_masks(folder):
    from ibrid_policy.learning.scoring import score
    from ibrid_policy.learning.text_policy import TextPolicy

    context = context_of(ibrid.textbook("naive"))
    policy = TextPolicy(folder, longest=1500, prompt_tokens=30_000, constrained=True)
    asked = [5, 6, 7]  # the question does not matter here, and the search's has 10,000 letters
    answers = policy.sample([asked], [context], 4, 0)[0]
    parent = ibrid.program_text(context.parent.diagram)
    for one in answers:
        verdict = judge(policy.proposal(one, context), parent, "", context.study, lambda _: None)
        assert verdict.status not in (
            Status.NO_EDIT,
            Status.NO_MATCH,
            Status.AMBIGUOUS,
            Status.UNREADABLE,
        )
        assert one.tokens[-1] == policy.end
    masks = [policy.masks(asked, one.tokens, context) for one in answers]
    scored = score(policy.model(), asked, [one.tokens for one in answers], masks)
    for one, row in zip(answers, scored.logprobs, strict=True):
        np.testing.assert_allclose(
            one.logprobs, row[: len(one.tokens)].detach(), rtol=0, atol=2e-5
        )  # float32


@needs_torch
def test_free_answers_come_as_text_with_their_log_probabilities(folder):
    from ibrid_policy.learning.text_policy import TextPolicy

    context = context_of(ibrid.textbook("naive"))
    policy = TextPolicy(folder, longest=12, prompt_tokens=30_000)
    prompt = policy.prompt(context)
    assert 3_000 < len(prompt) < 30_000
    (answers,) = policy.sample([prompt], [context], 3, 0)
    assert policy.masks(prompt, answers[0].tokens, context) is None
    proposal = policy.proposal(answers[0], context)
    assert proposal.reply
    assert proposal.usage["completion_tokens"] == len(answers[0].tokens)
    assert answers == policy.sample([prompt], [context], 3, 0)[0]


@needs_torch
@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{}", "names no token that ends an answer"),
        ("[1]", "must be the JSON"),
        ("{", "must be the JSON"),
    ],
)
def test_a_folder_that_cannot_be_sampled_from_is_one_sentence(tmp_path, content, sentence):
    from ibrid_policy.learning.text_policy import TextPolicy

    with pytest.raises(IbridError, match="holds no model"):
        TextPolicy(tmp_path)
    (tmp_path / "config.json").write_text(content)
    (tmp_path / "model.safetensors").write_bytes(b"")
    with pytest.raises(IbridError, match=sentence):
        TextPolicy(tmp_path)


# a server


def with_logprobs(*pieces: tuple[str, float], finish: str = "stop") -> bytes:
    said = [
        {"token": text, "logprob": value, "bytes": list(text.encode())} for text, value in pieces
    ]
    choice = {
        "index": 0,
        "message": {"role": "assistant", "content": "".join(text for text, _ in pieces)},
        "logprobs": {"content": said},
        "finish_reason": finish,
    }
    return json.dumps({"object": "chat.completion", "choices": [choice]}).encode()


@needs_torch
@needs_openai
def test_a_server_with_log_probabilities_gives_tokens_and_what_it_thinks_of_them(folder, tmp_path):
    from ibrid_policy.learning.served_policy import ServedPolicy, Server

    pieces = (("on", -0.5), (" ", -1.0), ("g.", -0.25), ("</s>", -2.0))
    with scripted_server.scripted(scripted_server.sends(with_logprobs(*pieces))) as script:
        policy = ServedPolicy(
            folder, Server("letters", script.url), tmp_path, prompt_tokens=30_000, longest=9
        )
        context = context_of(ibrid.textbook("naive"))
        (answers,) = policy.sample([[1]], [context], 2, seed=7)
    assert len(script.requests) == 2
    for number, request in enumerate(script.requests):
        assert request["logprobs"] is True
        assert (request["temperature"], request["top_p"], request["seed"]) == (1.0, 1.0, 7 + number)
        assert "gain" in request["messages"][-1]["content"]
    assert answers[0].logprobs == (-0.5, -1.0, -0.25, -2.0)
    assert policy.chat.tokenizer.decode(answers[0].tokens, skip_special_tokens=True) == "on g."
    assert answers[0].tokens[-1] == policy.end


@needs_torch
@needs_openai
@pytest.mark.parametrize(
    ("turn", "sentence"),
    [
        (
            scripted_server.says("hello"),
            "returns no log-probabilities, without which nothing can be learnt",
        ),
        (
            scripted_server.sends(with_logprobs(("Ωmega", -1.0))),
            "has a token 'Ωmega' that letters lacks",
        ),
        (scripted_server.sends(with_logprobs(("on", 3.0))), "gives a log-probability 3.0"),
        (scripted_server.sends(b"{}"), "sent no chat completion"),
        (scripted_server.refuses(404, "no such model"), "answered HTTP 404"),
    ],
)
def test_a_server_that_is_of_no_use_is_one_sentence(folder, tmp_path, turn, sentence):
    from ibrid_policy.learning.served_policy import ServedPolicy, Server

    with scripted_server.scripted(turn) as script:
        policy = ServedPolicy(
            folder, Server("letters", script.url), tmp_path, prompt_tokens=30_000, longest=9
        )
        with pytest.raises(IbridError, match=sentence):
            policy.sample([[1]], [context_of(ibrid.textbook("naive"))], 1, seed=0)


@needs_torch
def test_weights_are_handed_to_the_server_as_a_folder_it_can_load(folder, tmp_path):
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.served_policy import ServedPolicy, Server
    from ibrid_policy.learning.state import Publishes
    from transformers import AutoModelForCausalLM  # pyright: ignore[reportMissingImports]

    told: list[Path] = []
    policy = ServedPolicy(
        folder, Server("letters", "http://127.0.0.1:9/v1", reload=told.append), tmp_path / "now"
    )
    assert isinstance(policy, Publishes)
    with torch.no_grad():
        policy.model().lm_head.weight.add_(1.0)
    policy.publish()
    assert told == [tmp_path / "now"]
    served = AutoModelForCausalLM.from_pretrained(tmp_path / "now")
    assert torch.equal(served.lm_head.weight, policy.model().lm_head.weight)
    with pytest.raises(IbridError, match="cannot be constrained"):
        ServedPolicy(folder, Server("letters", "http://127.0.0.1:9/v1"), tmp_path, constrained=True)


@needs_torch
def test_a_language_model_in_a_folder_becomes_one_that_learns(folder, tmp_path):
    from ibrid_policy.learning.choose import learning
    from ibrid_policy.learning.learner import Learner
    from ibrid_policy.learning.text_policy import TextPolicy
    from ibrid_search.chat.spending import Limits
    from ibrid_search.proposal import Proposer

    settings = LearningSettings(contexts=2, group=3)
    both = Proposers("llm:0.5,rules:0.5", [str(folder)]).weighted()
    of_run: dict[str, Any] = {
        "seed": 0,
        "window": 8,
        "study": study(),
        "start": NAIVE,
        "folder": tmp_path,
    }
    (mine, weight), (other, _) = learning(both, settings, **of_run)
    assert isinstance(mine, Learner)
    assert isinstance(mine, Proposer)
    assert isinstance(mine.policy, TextPolicy)
    assert (mine.name, weight, mine.rounds.batch, other.name) == ("llm", 0.5, 6, "rules")
    assert mine.policy.longest == 512
    assert not mine.policy.constrained
    short = LearningSettings(constrained=True, longest=220, question=4000)
    ((mine, _),) = learning(Proposers("llm", [str(folder)]).weighted(), short, **of_run)
    assert isinstance(mine, Learner)
    assert isinstance(mine.policy, TextPolicy)
    assert (mine.policy.constrained, mine.policy.longest, mine.policy.prompt_tokens) == (
        True,
        220,
        4000,
    )
    assert (
        mine.policy.lines == 3
    )  # 30 tokens of marks, and of each line of SEARCH and REPLACE as many
    with pytest.raises(IbridError, match="limits of tokens and seconds do not hold"):
        learning(
            Proposers("llm", [str(folder)], Limits(tokens=1000)).weighted(), settings, **of_run
        )
    with pytest.raises(IbridError, match="one of several"):
        learning(Proposers("llm", [str(folder), str(folder)]).weighted(), settings, **of_run)


@needs_torch
@pytest.mark.parametrize(("positions", "longest"), [(300, 512), (2_000, 512), (40_000, 39_000)])
def test_a_model_without_room_for_question_and_answer_is_told_before_anything_is_fitted(
    folder, tmp_path, monkeypatch, positions, longest
):
    short = Path(shutil.copytree(folder, tmp_path / "short"))
    config = json.loads((short / "config.json").read_text(encoding="utf-8"))
    (short / "config.json").write_text(
        json.dumps({**config, "max_position_embeddings": positions}), encoding="utf-8"
    )
    monkeypatch.setattr(LocalEvaluator, "submit", lambda *_: pytest.fail("nothing is to be fitted"))
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    learn = LearningSettings(longest=longest)
    told = rf"^short has {positions} positions .* takes about \d+ tokens and an answer up to {longest}; train"
    with pytest.raises(IbridError, match=told):
        ibrid.search(sweep, tmp_path / "run", proposer=Proposers("llm", [str(short)], learn=learn))
    assert not (tmp_path / "run").exists()


@needs_torch
def test_the_room_that_is_asked_for_is_that_of_the_shortest_question(folder, monkeypatch):
    from ibrid_policy.learning.text_policy import TextPolicy, TrainableModel

    policy, context = TextPolicy(folder, longest=100), context_of(ibrid.textbook("naive"))
    with pytest.raises(
        IbridError, match=r"the shortest prompt for this program has about (\d+) tokens"
    ) as told:
        policy.chat.question(context, 64)
    needed = int(re.findall(r"\d+", str(told.value))[0]) + 64 + policy.longest
    monkeypatch.setattr(TrainableModel, "room", needed)
    policy.require_room(context.study, NAIVE)
    monkeypatch.setattr(
        TrainableModel, "room", needed - 1_000
    )  # letters of a short record, which here are its tokens
    with pytest.raises(IbridError, match="positions"):
        policy.require_room(context.study, NAIVE)


@needs_torch
def test_a_language_model_learns_from_first_looks_at_its_answers(folder, tmp_path):
    import torch  # pyright: ignore[reportMissingImports]
    from ibrid_policy.learning.text_policy import TextPolicy

    policy = TextPolicy(folder, longest=1500, prompt_tokens=30_000, constrained=True)
    begun = [one.clone() for one in policy.model().parameters()]
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    learn = LearningSettings(contexts=1, group=4, judge="look", rate=0.01)
    proposer = Proposers(PolicyProposer(policy=policy), learn=learn)
    ibrid.search(
        sweep, tmp_path / "run", start=ibrid.textbook("naive"), proposer=proposer, budget=4
    )
    with Store.open(tmp_path / "run" / "archive.sqlite", read_only=True) as store:
        updates = read_updates(store.meta[META])
        looks = sum(step.usage.get(LOOKS, 0) for step in store.steps())
    assert looks >= 1
    assert any(one.updated for one in updates)
    assert all(one.drift is None or one.drift < 1e-3 for one in updates)
    learnt = torch.load(tmp_path / "run" / "learning.pt", weights_only=True)["weights"]
    given = dict(policy.model().named_parameters())
    assert not all(torch.equal(one, given[name]) for name, one in learnt.items())
    assert all(
        torch.equal(one, other) for one, other in zip(begun, given.values(), strict=True)
    )  # a copy learns
