"""Learning with a server that answers: a search from end to end, which token is meant, and weights
that are not loaded.
"""

import importlib.util
import json
import threading
import time

import pytest

if any(
    importlib.util.find_spec(one) is None
    for one in ("torch", "transformers", "tokenizers", "openai")
):
    pytest.skip(
        "learning with a server needs torch, transformers and openai; make setup-llm",
        allow_module_level=True,
    )

import scripted_server
import torch  # pyright: ignore[reportMissingImports]
from ibrid_policy.learning.adapters import add_adapters
from ibrid_policy.learning.reported_tokens import ReportedTokens
from ibrid_policy.learning.served_policy import TOGETHER, ServedPolicy, Server
from ibrid_policy.learning.updates import META, read_updates
from ibrid_policy.learning.weights_reload import reload_from_disk
from ibrid_search.chat.chat import ChatError
from ibrid_search.run.store import Store
from scripted_search import context_of
from served_model import EDITS, END, serving, write_model
from transformers import AutoModelForCausalLM, AutoTokenizer  # pyright: ignore[reportMissingImports]

import ibrid
from ibrid import cli

pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("models") / "edits"
    write_model(place)
    return place


# a search


def test_a_search_trains_a_folder_while_a_server_answers_and_loads_every_update(
    folder, tmp_path, capsys
):
    run = tmp_path / "run"
    with serving(folder) as served:
        given = [
            "--proposer",
            "llm",
            "--model",
            f"{folder}@{served.url}",
            "--learn",
            "--learn-profile",
            "small",
        ]
        given += [
            "--learn-longest",
            "90",
            "--learn-group",
            "4",
            "--budget",
            "5",
            "--workers",
            "1",
            "--start",
            "naive",
        ]
        assert cli.main(["search", "paper_like", "--out", str(run), *given]) == 0
    with Store.open(run / "archive.sqlite", read_only=True) as store:
        updates = [one for one in read_updates(store.meta[META]) if one.updated]
    assert updates
    for one in updates:
        assert one.drift is not None
        assert one.probe is not None
        assert (
            max(one.drift, one.probe) < 1e-4
        )  # in float32, with and without a cache; the alarm is at 0.02
    assert served.loaded == [str(folder)] + [str(run / "served")] * len(updates)
    learnt = torch.load(run / "learning.pt", weights_only=True)["weights"]
    begun = dict(AutoModelForCausalLM.from_pretrained(folder).named_parameters())
    for name, one in served.model.named_parameters():
        assert torch.equal(one, learnt[name])
    assert not all(torch.equal(one, begun[name]) for name, one in learnt.items())
    for asked in served.questions:
        assert (asked["top_k"], asked["return_tokens_as_token_ids"], asked["temperature"]) == (
            -1,
            True,
            1.0,
        )


def test_a_server_that_loads_nothing_is_told_with_what_helps(tmp_path):
    refusals = {
        scripted_server.refuses(404): "HTTP 404",
        scripted_server.sends(
            b'{"success": false, "message": "no\\nsuch folder"}'
        ): "no such folder",
        scripted_server.sends(b"<html>"): "Expecting value",
        scripted_server.sends(b"[]"): "no attribute",
        scripted_server.closes: "Expecting value",
    }
    for turn, why in refusals.items():
        with scripted_server.scripted(turn) as script, pytest.raises(ChatError) as told:
            reload_from_disk(script.url, "sk-secret-key")(tmp_path)
        assert script.requests == [{"model_path": str(tmp_path)}]
        assert script.headers[0]["authorization"] == "Bearer sk-secret-key"
        for part in (f"did not load the weights of {tmp_path}", why, "--learn needs SGLang"):
            assert part in str(told.value)
        assert "\n" not in str(told.value)
    with pytest.raises(ChatError, match="did not load the weights"):
        reload_from_disk(script.url)(tmp_path)  # the server has ended


# answers


def reply(*entries: tuple[int, float], finish: str = "stop") -> bytes:
    said = [{"token": f"token_id:{token}", "logprob": logprob} for token, logprob in entries]
    return json.dumps(
        {"choices": [{"logprobs": {"content": said}, "finish_reason": finish}]}
    ).encode()


def sampled(folder, url: str, number: int = 1, **options):
    policy = ServedPolicy(folder, Server("edits", url), folder, longest=4, **options)
    return policy, policy.sample([[1]], [context_of(ibrid.textbook("naive"))], number, seed=5)[0]


def test_what_a_server_does_not_know_is_left_out_once_it_refuses_it(folder):
    def picky(handler) -> None:
        known = "top_k" not in handler.server.script.requests[-1]
        turn = (
            scripted_server.sends(reply((9, -1.0)))
            if known
            else scripted_server.refuses(400, "no top_k here")
        )
        turn(handler)

    with scripted_server.scripted(picky) as script:
        policy, answers = sampled(folder, script.url, 3)
        assert [one.tokens for one in answers] == [(9,)] * 3
        assert sum("top_k" in one for one in script.requests) == 1
        assert len(script.requests) == 4
        policy.sample([[1]], [context_of(ibrid.textbook("naive"))], 2, seed=0)
        assert sum("top_k" in one for one in script.requests) == 1


def test_answers_that_are_asked_for_together_come_in_the_order_of_their_seeds(folder):
    together, most, lock = 0, 0, threading.Lock()

    def slow(handler) -> None:
        nonlocal together, most
        seed = json.loads(handler.body)["seed"]
        with lock:
            together += 1
            most = max(most, together)
        time.sleep(0.02 * (12 - seed % 12))  # the later ones are the faster ones
        with lock:
            together -= 1
        scripted_server.sends(reply((seed, -1.0)))(handler)

    with scripted_server.scripted(slow) as script:
        answers = sampled(folder, script.url, 8)[1]
    assert [one.tokens for one in answers] == [(seed,) for seed in range(5, 13)]
    assert 2 <= most <= TOGETHER


def test_an_end_that_is_not_reported_is_no_token_of_the_answer_and_does_not_make_it_cut(folder):
    context = context_of(ibrid.textbook("naive"))
    for entries, cut in (
        (((9, -1.0),), False),
        (((9, -1.0), (END, -0.5)), False),
        (((9, -1.0),) * 4, True),
    ):
        with scripted_server.scripted(scripted_server.sends(reply(*entries))) as script:
            policy, (answer,) = sampled(folder, script.url)
        assert answer.tokens == tuple(token for token, _ in entries)
        assert answer.logprobs == tuple(logprob for _, logprob in entries)
        assert ("cut" in policy.proposal(answer, context).usage) == cut
    with (
        scripted_server.scripted(scripted_server.sends(reply((END, -1.0), (9, -1.0)))) as script,
        pytest.raises(ChatError, match="goes on behind the end of an answer"),
    ):
        sampled(folder, script.url)


def test_a_key_that_a_server_repeats_is_told_to_nobody(folder):
    with scripted_server.scripted(
        scripted_server.refuses(403, "sk-very-secret is not welcome")
    ) as script:
        server = Server("edits", script.url, "sk-very-secret")
        policy = ServedPolicy(folder, server, folder, longest=4)
        with pytest.raises(ChatError, match=r"\(key\) is not welcome"):
            policy.sample([[1]], [context_of(ibrid.textbook("naive"))], 1, seed=0)
    assert "secret" not in repr(server)


def test_a_server_is_given_weights_with_the_adapters_in_them(folder, tmp_path):
    pytest.importorskip("peft", reason="low-rank adapters need peft; pip install 'ibrid[lora]'")
    loaded = []
    server = Server("edits", "http://127.0.0.1:9/v1", reload=loaded.append)
    policy = ServedPolicy(folder, server, tmp_path, longest=4)
    add_adapters(policy.model(), 4, seed=0)
    with torch.no_grad():
        for name, one in policy.model().named_parameters():
            if "lora_B" in name:
                one.add_(0.3)
        said = policy.model()(input_ids=torch.tensor([[4, 5, 6]])).logits
        policy.publish()
        served = AutoModelForCausalLM.from_pretrained(tmp_path)(
            input_ids=torch.tensor([[4, 5, 6]])
        ).logits
        begun = AutoModelForCausalLM.from_pretrained(folder)(
            input_ids=torch.tensor([[4, 5, 6]])
        ).logits
    assert loaded == [tmp_path]
    torch.testing.assert_close(served, said, atol=1e-5, rtol=1e-5)
    assert (begun - said).abs().max() > 0.01


# which token is meant


@pytest.fixture(scope="module")
def reported(folder):
    return ReportedTokens(AutoTokenizer.from_pretrained(folder), "edits")


def test_every_token_is_found_by_its_number_and_by_its_text_or_bytes(reported, folder):
    tokenizer = AutoTokenizer.from_pretrained(folder)
    for token in range(len(tokenizer)):
        assert reported.token({"token": f"token_id:{token}"}, "it") == token
        assert reported.token({"token": "anything", "id": token}, "it") == token
    for token in (END, *tokenizer(EDITS[0])["input_ids"], *tokenizer("g.add ")["input_ids"]):
        assert reported.token({"token": tokenizer.decode([token])}, "it") == token
    for byte, token in zip("é".encode(), tokenizer("é")["input_ids"], strict=True):
        assert reported.token({"token": "\ufffd", "bytes": [byte]}, "it") == token
    assert (
        reported.token({"token": "Ġ"}, "it") == tokenizer(" ")["input_ids"][0]
    )  # by its name in the vocabulary


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (
            {"token": "\ufffd"},
            r"^it says '.', which is the text of \d+ tokens of edits; use a server that gives their num",
        ),
        (
            {"token": "\ufffd", "bytes": [239, 191, 189]},
            "which is the text of",
        ),  # of the sign itself, so they say nothing
        ({"token": "token_id:99999"}, "a token 'token_id:99999' that edits lacks"),
        ({"token": "Ωmega"}, "that edits lacks"),
        ({"token": None}, "that edits lacks"),
        ("on", "that edits lacks"),
    ],
)
def test_a_token_that_is_not_known_for_sure_is_refused(reported, entry, sentence):
    with pytest.raises(ChatError, match=sentence):
        reported.token(entry, "it")
