"""The proposer `llm` with a real language model: in this process, and behind a server on
loopback.
"""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_bench.language_model.answering import served
from ibrid_bench.language_model.schema_server import serving
from ibrid_policy.learning.updates import META, read_updates
from ibrid_policy.smollm2 import missing, smollm2
from ibrid_search.chat.chat import ChatError, estimated_tokens
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.language_models.context import prompt
from ibrid_search.language_models.engineer_question import engineer_question
from ibrid_search.proposal import Complaint, Context, Evaluated, Proposal
from ibrid_search.proposers.language_model import LanguageModel
from ibrid_search.proposers.local_model import LocalModel
from ibrid_search.run.store import Store
from ibrid_search.step import Status
from jsonschema import validate

import ibrid
from ibrid import cli
from ibrid.study import Study

pytestmark = [
    pytest.mark.skipif(bool(missing()), reason=missing()),
    pytest.mark.filterwarnings("default"),  # torch and transformers have warnings of their own
]

HELLO = [
    {"role": "system", "content": "You are brief."},
    {"role": "user", "content": "Name a fruit."},
]


@pytest.fixture(scope="module")
def folder() -> Path:
    return smollm2()


@pytest.fixture(scope="module")
def local(folder) -> LocalModel:
    return LocalModel(folder, max_tokens=16, threads=1)


@pytest.fixture
def context() -> Context:
    parent = Evaluated(0, ibrid.textbook("naive"), evaluated("naive", restarts=0))
    return Context(Study(benchmark()), parent, complaint=Complaint("", "no block"))


def check(proposal: Proposal) -> None:
    """What must hold of any answer: text, counts, and an edit or nothing."""
    assert proposal.failure == ""
    assert proposal.reply.strip()
    assert proposal.edit.strip()
    usage = proposal.usage
    assert 1500 < usage["prompt_tokens"] < 6500  # the vocabulary is the larger part
    assert 0 < usage["completion_tokens"] <= 16
    assert usage["seconds"] > 0


def test_a_local_model_answers_the_question(local, context):
    proposal = LanguageModel([(local, 1.0)]).propose(context, np.random.default_rng(0))
    check(proposal)
    assert proposal.usage["model"] == "smollm2-135m-instruct"


def test_an_answer_held_to_a_schema_follows_it_and_repeats(folder):
    pytest.importorskip("llguidance", reason="a schema needs llguidance; make setup-llm")
    schema = {
        "type": "object",
        "properties": {
            "change": {"type": "string", "maxLength": 20},
            "take": {"type": "integer", "enum": [0, 1, 2]},
            "remove": {
                "type": "array",
                "items": {"type": "string", "enum": ["a", "b"]},
                "maxItems": 3,
            },
        },
        "required": ["change", "take", "remove"],
        "additionalProperties": False,
    }
    model = LocalModel(folder, max_tokens=120, threads=1)
    assert model.asked_form == "schema"
    found = [model.fill(HELLO, schema, "schema", seed) for seed in (0, 1, 2, 2)]
    for one in found:
        assert not one.cut
        validate(json.loads(one.text), schema)
    assert found[2].text == found[3].text
    assert len({one.text for one in found}) == 3
    with pytest.raises(ChatError, match="broke off"):
        model.fill(HELLO, {"type": "no such type"}, "schema")


def test_four_of_five_answers_that_a_server_holds_to_the_schema_are_edits(
    folder, context, monkeypatch
):
    pytest.importorskip("llguidance", reason="a schema needs llguidance; make setup-llm")
    asked = "ibrid_search.proposers.language_model.engineer_question"
    monkeypatch.setattr(
        asked, lambda *_, **__: [{"role": "user", "content": "Which edit does this program need?"}]
    )
    context = replace(context, complaint=None)
    with serving(folder, longest=400) as address:
        proposer = served("smollm2", address)
        found = [proposer.propose(context, np.random.default_rng(seed)) for seed in range(20)]
    valid = [verdict_of(one, context).status is Status.PENDING for one in found]
    assert np.mean(valid) >= 0.8


def test_a_local_model_counts_its_tokens_and_the_estimate_is_not_far_from_it(local, context):
    for question in (prompt(context, limit_tokens=10_000), engineer_question(context)):
        text = "\n".join(str(one["content"]) for one in question)
        assert local.tokens(text) < 1.02 * estimated_tokens(text) < 1.3 * local.tokens(text)


def test_the_seed_decides_what_a_local_model_says(local):
    first, again, other = (local.complete(HELLO, rng_seed=seed) for seed in (1, 1, 2))
    assert first.text == again.text
    assert first.text != other.text
    assert first.usage["prompt_tokens"] > 10


def test_a_local_model_leaves_the_random_state_and_the_threads_as_they_were(local):
    import torch  # pyright: ignore[reportMissingImports]

    before, threads = torch.get_rng_state(), torch.get_num_threads()
    local.complete(HELLO)
    assert torch.equal(before, torch.get_rng_state())
    assert torch.get_num_threads() == threads


def test_a_local_model_stops_at_its_limits(folder):
    model = LocalModel(folder, max_tokens=2_000, seconds=1.0, threads=1)
    answer = model.complete([{"role": "user", "content": "Write a long story."}])
    assert answer.cut
    assert 0 < answer.usage["completion_tokens"] < 500
    assert answer.usage["seconds"] < 30


def test_a_prompt_that_a_local_model_cannot_read_is_one_sentence(local):
    with pytest.raises(
        ChatError, match=r"the prompt has \d+ tokens, but smollm2-135m-instruct reads 8192"
    ):
        local.complete([{"role": "user", "content": "one two " * 8_000}])


def test_a_damaged_folder_is_one_sentence(folder, tmp_path):
    for name in ("config.json", "tokenizer.json", "tokenizer_config.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "model.safetensors").write_bytes(b"garbage")
    with pytest.raises(ChatError, match="cannot be loaded"):
        LocalModel(tmp_path).complete(HELLO)


def test_a_language_model_learns_during_a_search_within_the_grammar_of_edits(
    folder, tmp_path, monkeypatch, capsys
):
    def program_alone(context: Context, **_: Any) -> list[dict[str, str]]:
        return [{"role": "user", "content": ibrid.program_text(context.parent.diagram)}]

    # the whole question is read in the test above; with its 2600 tokens an update takes a core two
    # minutes
    monkeypatch.setattr("ibrid_policy.learning.text_policy.prompt", program_alone)
    run = tmp_path / "run"
    learn = (
        "--learn --learn-constrained --learn-contexts 1 --learn-group 2 --learn-judge look "
        "--learn-optimizer sgd"
    )
    asked = (
        f"--proposer llm --model {folder} --start naive --budget 3 --workers 1 {learn} "
        "--learn-longest 150"
    )
    assert cli.main(["search", "paper_like", "--out", str(run), *asked.split()]) == 0
    assert "3 evaluations" in capsys.readouterr().out
    with Store.open(run / "archive.sqlite", read_only=True) as store:
        updates = read_updates(store.meta[META])
        steps = [one for one in store.steps() if one.proposer == "llm"]
    assert [one.number for one in updates] == list(range(1, len(steps) + 1))
    for update, step in zip(updates, steps, strict=True):
        answers = step.usage["learning"]["answers"]
        assert all(len(one["tokens"]) <= 150 for one in answers)
        assert {one["status"] for one in answers}.isdisjoint(
            {"no edit", "no match", "ambiguous", "unreadable"}
        )
        assert update.updated == (
            update.dropped == 0
        )  # two answers of the same worth teach nothing
    assert updates[-1].valid > 0
    for update in updates:
        if update.updated:
            assert update.drift is not None
            assert update.drift < 1e-3
            assert update.probe is not None
            assert update.probe < 1e-3


@pytest.fixture(scope="module")
def server(folder, tmp_path_factory) -> Iterator[str]:
    """`transformers serve` on a free port of 127.0.0.1, without the network; its base URL."""
    program = Path(sys.executable).parent / "transformers"
    if not program.exists() or find_spec("uvicorn") is None or find_spec("openai") is None:
        pytest.skip("a real server needs transformers[serving] and openai; make setup-llm")
    home = tmp_path_factory.mktemp("home")
    (home / "hub").mkdir()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        str(program),
        "serve",
        str(folder),
        "--host",
        "127.0.0.1",
        "--port",
        str(port),
        "--device",
        "cpu",
    ]
    environment = {
        **os.environ,
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(home),
        "OMP_NUM_THREADS": "1",
    }
    with (
        (home / "log").open("wb") as log,
        subprocess.Popen(command, env=environment, stdout=log, stderr=log) as process,
    ):
        try:
            _wait(port, process, home / "log")
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def _wait(port: int, process: subprocess.Popen, log: Path) -> None:
    for _ in range(240):
        assert process.poll() is None, log.read_text()[-2_000:]
        try:
            with urlopen(f"http://127.0.0.1:{port}/health", timeout=5):
                return
        except (URLError, OSError):
            time.sleep(0.5)
    raise AssertionError(log.read_text()[-2_000:])


def test_a_model_on_a_real_server_answers_the_question(server, folder, context, monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    proposer = LanguageModel.from_options(
        [f"{folder}@{server}"], max_tokens=16, timeout=300.0, retries=0
    )
    check(proposer.propose(context, np.random.default_rng(0)))
    assert proposer.spending.spent["tokens"] > 1500


def test_a_model_that_a_real_server_lacks_is_one_sentence(server, context):
    proposer = LanguageModel.from_options([f"no-such-model@{server}"], timeout=60.0, retries=0)
    failure = proposer.propose(context, np.random.default_rng(0)).failure
    assert failure.startswith("the model no-such-model at http://127.0.0.1:")
    assert "\n" not in failure
