"""The client of OpenAI-compatible servers: whatever a server sends is an answer or one sentence."""

import contextlib
import gzip
import json
import math
import pickle
import re
import sys
import time
import tracemalloc
from threading import Event
from types import SimpleNamespace

import pytest
from collecting import each_of
from ibrid_search.chat import chat_request, chat_server
from ibrid_search.chat.chat import Chat, ChatError
from ibrid_search.chat.chat_request import Refusal
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.proposers.model_names import model_of
from scripted_server import closes, completion, drips, hangs, refuses, says, scripted, sends

from ibrid.errors import IbridError

openai = pytest.importorskip(
    "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
)
httpx = pytest.importorskip(openai.DefaultHttpxClient.__mro__[1].__module__.partition(".")[0])

KEY = "sk-secret-0123456789"
ASK = [
    {"role": "system", "content": "You edit programs."},
    {"role": "user", "content": "Edit this."},
]


@pytest.fixture(autouse=True)
def _environment(monkeypatch):
    for name in ("OPENAI_BASE_URL", "OPENAI_API_BASE", "OPENAI_ORG_ID", "OPENAI_PROJECT_ID"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OPENAI_API_KEY", KEY)


def chat(script, **settings) -> ChatServer:
    return ChatServer(
        "small", script.url, **{"timeout": 300.0, "retries": 2, "pause": 0.01, **settings}
    )


def failure(script, **settings) -> ChatError:
    with pytest.raises(ChatError) as found:
        chat(script, **settings).complete(ASK)
    message = str(found.value)
    assert KEY not in message
    assert "\n" not in message
    assert len(message) < 600
    return found.value


def test_an_answer_comes_with_what_it_cost():
    with scripted(
        says("hello", {"prompt_tokens": 2_000_000, "completion_tokens": 500_000})
    ) as script:
        answer = chat(script, price=(1.0, 4.0)).complete(ASK, rng_seed=7)
    assert answer.text == "hello"
    assert answer.usage["cost"] == 4.0
    assert (answer.usage["prompt_tokens"], answer.usage["completion_tokens"]) == (
        2_000_000,
        500_000,
    )
    assert (answer.usage["model"], answer.usage["retries"]) == ("small", 0)
    request = script.requests[0]
    assert (request["model"], request["messages"], request["seed"]) == ("small", ASK, 7)


class Attempts:
    """Stands for the server and the clock: attempts are refused after so many seconds each, and
    nothing else takes any.
    """

    def __init__(self, monkeypatch, refusal: Refusal, seconds: float = math.inf):
        self.now, self.refusal, self.seconds = 0.0, refusal, seconds
        self.limits: list[float] = []  # of the attempts, s
        monkeypatch.setattr(chat_server, "post", self.post)
        monkeypatch.setattr(chat_server, "time", self)

    def post(self, url: str, key: str, body: dict, timeout: float) -> Refusal:
        self.limits.append(timeout)
        self.now += min(timeout, self.seconds)
        return self.refusal

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def ask(**settings) -> None:
    with pytest.raises(ChatError):
        ChatServer("small", "http://127.0.0.1:1/v1", **settings).complete(ASK)


LATE = Refusal("did not answer", again=True, late=True)


def test_a_question_takes_no_longer_than_it_may_in_all(monkeypatch):
    attempts = Attempts(monkeypatch, LATE)
    ask(timeout=60.0, within=0.3)
    assert attempts.limits == [0.3]
    # a server that asks for a year gets LONGEST_PAUSE, 60 s, where so much is left
    busy = Refusal("answered HTTP 429", again=True, pause=31_536_000.0, status=429)
    attempts = Attempts(monkeypatch, busy, seconds=1.0)
    ask(timeout=300.0, within=50.0)
    assert attempts.limits == [50.0]
    attempts = Attempts(monkeypatch, busy, seconds=1.0)
    ask(timeout=300.0, within=100.0)
    assert attempts.limits == [100.0, 39.0]


def test_a_long_wait_is_said_and_a_short_one_is_not(monkeypatch, capsys):
    for pause in (31_536_000.0, 1.0):
        busy = Refusal("answered HTTP 429", again=True, pause=pause, status=429)
        Attempts(monkeypatch, busy, seconds=1.0)
        ask(timeout=300.0, within=100.0, retries=1, pause=0.0)
        said = capsys.readouterr().err
        expected = "small at http://127.0.0.1:1/v1 answered HTTP 429; asking again in 60 s\n"
        assert said == (f"ibrid: the model {expected}" if pause > 60 else "")


def test_a_server_that_is_late_is_asked_once_more(monkeypatch):
    attempts = Attempts(monkeypatch, LATE)
    ask(timeout=60.0, retries=4, pause=1.0)
    assert attempts.limits == [60.0, 60.0]


def test_a_question_that_does_not_come_back_is_left_at_the_time_limit(monkeypatch):
    over = Event()
    monkeypatch.setattr(chat_request, "_post", lambda *_: over.wait(600.0))
    refusal = chat_request.post("http://127.0.0.1:1/v1", KEY, {}, 0.01)
    over.set()
    assert refusal == Refusal("did not end its answer within 0.01 s", again=True, late=True)


def test_a_model_by_litellm_is_asked_through_that_package_and_its_errors_are_sentences(monkeypatch):
    asked: list[dict] = []

    class Reply:
        def model_dump_json(self) -> str:
            return completion({"content": "hello"}).decode()

    def answered(**body):
        asked.append(body)
        if len(asked) == 1:
            return Reply()
        request = httpx.Request("POST", "http://elsewhere")
        raise openai.AuthenticationError(
            "no key", response=httpx.Response(401, request=request), body={"message": "no key"}
        )

    monkeypatch.setitem(sys.modules, "litellm", SimpleNamespace(completion=answered))
    server, _ = model_of("litellm:vendor/large", timeout=300.0, effort="high")
    assert server.complete(ASK).text == "hello"
    assert (asked[0]["model"], asked[0]["messages"], asked[0]["reasoning_effort"]) == (
        "vendor/large",
        ASK,
        "high",
    )
    with pytest.raises(ChatError, match=r"vendor/large at litellm answered HTTP 401 \(no key\)"):
        server.complete(ASK)
    monkeypatch.setitem(sys.modules, "litellm", None)
    with pytest.raises(ChatError, match=r"pip install 'ibrid\[litellm\]'"):
        server.complete(ASK)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")
def test_litellm_asks_with_schema_and_effort_and_its_refusals_and_delays_are_sentences(
    monkeypatch, capfd
):
    pytest.importorskip("litellm", reason="other servers need litellm; make setup-llm")
    schema = {
        "type": "object",
        "properties": {"change": {"type": "string"}},
        "required": ["change"],
    }
    with scripted(says("hello"), says('{"change": "x"}'), refuses(401, "no key"), hangs) as script:
        monkeypatch.setenv("OPENAI_BASE_URL", script.url)
        monkeypatch.setenv("OPENAI_API_BASE", script.url)
        server, _ = model_of("litellm:openai/large", timeout=300.0, retries=0, effort="high")
        assert server.complete(ASK).text == "hello"
        assert server.fill(ASK, schema, "schema").text == '{"change": "x"}'
        with pytest.raises(ChatError, match="openai/large at litellm answered HTTP 401"):
            server.complete(ASK)
        with pytest.raises(ChatError, match=r"did not (end its )?answer within 0\.5 s"):
            server.bounded(0.5).complete(ASK)
    first, second, *_ = script.requests
    assert (first["model"], first["messages"], first["reasoning_effort"]) == ("large", ASK, "high")
    assert second["response_format"]["json_schema"]["schema"]["properties"] == schema["properties"]
    assert "litellm" not in "".join(capfd.readouterr()).lower()


def test_a_question_is_asked_again_only_while_questions_are_left():
    with scripted(*[refuses(500, "busy")] * 3) as script:
        server = ChatServer("small", script.url, retries=4, pause=0.0).bounded(60.0, questions=2)
        with pytest.raises(ChatError, match="2 times") as refused:
            server.complete(ASK)
    assert len(script.requests) == refused.value.usage["questions"] == 2


def test_a_server_is_a_chat():
    assert isinstance(ChatServer("small"), Chat)


def test_the_address_comes_from_the_environment(monkeypatch):
    with scripted(says("hello")) as script:
        monkeypatch.setenv("OPENAI_API_BASE", script.url)
        assert ChatServer("small", timeout=300.0).complete(ASK).text == "hello"
        monkeypatch.setenv("OPENAI_BASE_URL", script.url.replace("/v1", "/other"))
        assert ChatServer("small").url.endswith("/other")


def test_a_server_without_keys_is_asked_without_one(monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY")
    with scripted(says("hello")) as script:
        assert chat(script).complete(ASK).text == "hello"
    assert script.headers[0]["authorization"] == "Bearer none"


def test_openai_itself_without_a_key_is_not_asked(monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY")
    with pytest.raises(
        ChatError, match=r"needs a key in OPENAI_API_KEY; set it, or set OPENAI_BASE_URL"
    ):
        ChatServer("gpt").complete(ASK)


def test_the_key_goes_to_the_server_and_nowhere_else():
    echo = {
        "content": f"your key is {KEY}",
        "tool_calls": [{"function": {"name": "f", "arguments": KEY}}],
    }
    with scripted(
        sends(completion(echo, {"note": KEY})), refuses(401, f"Incorrect API key provided: {KEY}")
    ) as script:
        server = chat(script)
        answer = server.complete(ASK)
        error = failure(script)
    assert script.headers[0]["authorization"] == f"Bearer {KEY}"
    assert KEY not in repr((answer, server, vars(server), error.usage)) + pickle.dumps(
        server
    ).decode("latin-1")
    assert answer.text == "your key is (key)"
    assert "check the key" in str(error)


@each_of(
    "written", [KEY, KEY.replace("c", r"\u0063"), KEY.replace("s", r"\U0073".lower()), rf"\{KEY}"]
)
def test_a_key_that_a_server_sends_back_is_kept_nowhere(written):
    message = {
        "content": json.dumps({"change": "it"}).replace("it", written),
        "tool_calls": [
            {"id": KEY, "function": {"name": KEY, "arguments": f'{{"edit": "{written}"}}'}}
        ],
    }
    with scripted(sends(completion(message))) as script:
        answer = chat(script).complete(ASK)
    assert answer.text == '{"change": "(key)"}'
    (call,) = answer.tool_calls
    assert (call.id, call.name, call.arguments) == ("(key)", "(key)", '{"edit": "(key)"}')


def test_the_key_does_not_follow_to_another_server():
    with scripted(says("hello")) as other, scripted() as first:
        first.turns.append(sends(b"", 307, location=f"{other.url}/chat/completions"))
        with pytest.raises(ChatError, match=r"sends on to .* where it is not followed"):
            chat(first).complete(ASK)
    assert "authorization" in first.headers[0]
    assert not other.headers


def test_a_key_of_another_variable_is_taken(monkeypatch):
    monkeypatch.setenv("MY_KEY", "sk-another-key")
    with scripted(says("hello")) as script:
        chat(script, key_from="MY_KEY").complete(ASK)
    assert script.headers[0]["authorization"] == "Bearer sk-another-key"


def test_a_key_that_no_header_can_hold_is_refused_without_showing_it(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-geheim-ä")
    with (
        scripted(says("hello")) as script,
        pytest.raises(ChatError, match="OPENAI_API_KEY holds characters") as found,
    ):
        chat(script).complete(ASK)
    assert "geheim" not in str(found.value)


def test_a_busy_server_is_asked_again():
    with scripted(refuses(429, "slow down"), refuses(503), closes, says("hello")) as script:
        answer = chat(script, retries=3).complete(ASK)
    assert answer.text == "hello"
    assert answer.usage["retries"] == 3


def test_a_pause_that_the_server_asks_for_is_kept():
    with scripted(refuses(429, retry_after="0.3"), says("hello")) as script:
        started = time.monotonic()
        chat(script).complete(ASK)
    assert time.monotonic() - started >= 0.3


@pytest.mark.slow
@each_of(
    ("turn", "says_why", "asked"),
    [
        (refuses(500, "out of memory"), "answered HTTP 500 (out of memory), 3 times", 3),
        (
            refuses(404, "no such model"),
            "HTTP 404 (no such model); check the model's name and the base URL",
            1,
        ),
        (sends(b"<html>gateway</html>", 502, "text/html"), "answered HTTP 502, 3 times", 3),
        (closes, "cannot be reached", 3),
        (sends(b""), "sent nothing in place of JSON", 1),
        (sends(b"{'choices': "), "sent something else in place of JSON", 1),
        (sends(b"\xff\xfe\x00garbage"), "sent something else in place of JSON", 1),
        (sends(b"<!DOCTYPE html><html>", 200, "text/html"), "sent a web page in place of JSON", 1),
        (sends(b"[" * 100_000), "in place of JSON", 1),
        (sends(b"null"), "JSON that is no chat completion", 1),
        (sends(b'{"choices": []}'), "JSON that is no chat completion", 1),
        (sends(b'{"choices": [{"message": "hello"}]}'), "JSON that is no chat completion", 1),
        (sends(b" " * 9_000_000), "sent more than 8000000 bytes", 1),
        (
            sends(gzip.compress(b" " * 50_000_000), content_encoding="gzip"),
            "sent more than 8000000 bytes",
            1,
        ),
        (sends(b"no gzip", content_encoding="gzip"), "cannot be reached", 3),
    ],
)
def test_what_a_server_does_wrong_is_one_sentence(turn, says_why, asked):
    with scripted(turn) as script:
        assert says_why in str(failure(script))
    assert len(script.requests) == asked


def never_ends(handler) -> None:
    """An error whose body goes on for ever."""
    handler.send_response(400)
    handler.end_headers()
    with contextlib.suppress(OSError):
        while True:
            handler.wfile.write(b" " * 65_536)
            handler.server.sent = getattr(handler.server, "sent", 0) + 65_536


@each_of(
    "turn", [never_ends, sends(gzip.compress(b" " * 200_000_000), 400, content_encoding="gzip")]
)
def test_of_an_error_no_more_is_read_than_its_beginning(turn):
    with scripted(turn) as script:
        tracemalloc.start()
        assert "answered HTTP 400" in str(failure(script))
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert most < 100_000_000


# a server that drips is too slow for its next byte on a busy machine, or for all of them
@pytest.mark.parametrize(
    ("turn", "says_why"), [(hangs, "did not answer"), (drips, "did not (end its )?answer")]
)
def test_a_server_that_never_ends_is_left_at_the_time_limit(turn, says_why, monkeypatch):
    monkeypatch.setattr(chat_request, "GRACE", 600.0)  # the client stops by itself, however late
    with scripted(turn) as script:
        error = failure(script, timeout=0.3, retries=1)
    assert re.search(f"{says_why} within 0.3 s, 2 times", str(error))
    assert error.usage["retries"] == 1


def test_no_server_is_one_sentence():
    with scripted() as script:
        pass
    assert "cannot be reached" in str(failure(script, retries=0))


def test_parameters_that_a_server_does_not_know_are_left_out():
    with scripted(
        refuses(400, "Unsupported parameter: 'max_tokens'; use 'max_completion_tokens'"),
        refuses(400, "temperature does not support 0.7"),
        says("hello"),
    ) as script:
        assert chat(script, max_tokens=55, temperature=0.7).complete(ASK).text == "hello"
    assert script.requests[-1]["max_completion_tokens"] == 55
    assert not {"max_tokens", "temperature"} & set(script.requests[-1])


def test_thinking_that_a_server_gives_apart_is_put_in_front():
    details = {
        "prompt_tokens": 9,
        "completion_tokens": 90,
        "completion_tokens_details": {"reasoning_tokens": 70},
    }
    with scripted(says("the edit", details, reasoning_content="why")) as script:
        answer = chat(script).complete(ASK)
    assert answer.text == "<think>why</think>the edit"
    assert answer.usage["thinking_tokens"] == 70


def test_an_answer_in_parts_is_joined_and_a_cut_one_is_marked():
    parts = [{"type": "text", "text": "a"}, {"type": "image"}, 3, {"text": "b"}]
    with scripted(says(parts, finish="length")) as script:
        answer = chat(script).complete(ASK)
    assert (answer.text, answer.cut) == ("ab", True)


@pytest.mark.parametrize(
    "usage",
    [
        "many",
        {"prompt_tokens": -5, "completion_tokens": 1e99},
        {"prompt_tokens": True, "completion_tokens": None},
        {"prompt_tokens": "10", "completion_tokens": 10**30},
    ],
)
def test_counts_that_make_no_sense_are_estimated(usage):
    with scripted(says("hello " * 70, usage)) as script:
        found = chat(script).complete(ASK).usage
    assert found["completion_tokens"] == 70
    assert 5 < found["prompt_tokens"] < 50


def test_tool_calls_are_read_and_nonsense_among_them_is_left_out():
    calls = [
        {
            "id": "1",
            "type": "function",
            "function": {"name": "check", "arguments": '{"program": "x"}'},
        },
        {"id": 2, "function": {"name": "check", "arguments": {"program": "y"}}},
        {"function": {"name": 5}},
        {"function": "check"},
        "check",
        None,
    ]
    tools = [
        {
            "type": "function",
            "function": {"name": "check", "description": "d", "parameters": {"type": "object"}},
        }
    ]
    with scripted(says(None, tool_calls=calls), says(None, tool_calls="all")) as script:
        first, second = (chat(script).complete(ASK, tools=tools) for _ in range(2))
    assert [(one.name, json.loads(one.arguments)) for one in first.tool_calls] == [
        ("check", {"program": "x"}),
        ("check", {"program": "y"}),
    ]
    assert (first.tool_calls[0].id, first.tool_calls[1].id) == ("1", "")
    assert (second.text, second.tool_calls) == ("", ())
    assert script.requests[0]["tools"] == tools


def test_text_that_no_file_could_hold_is_replaced():
    body = b'{"choices": [{"message": {"content": "a\\ud800b"}}]}'
    with scripted(sends(body)) as script:
        assert chat(script).complete(ASK).text == "a?b"


@each_of(
    ("model", "settings", "says_why"),
    [
        ("", {}, "a model has a name"),
        ("a\nb", {}, "a model has a name"),
        ("m", {"base_url": "localhost:8000"}, "a base URL looks like"),
        ("m", {"base_url": "file:///etc/passwd"}, "a base URL looks like"),
        ("m", {"base_url": "http://host:99999999/v1"}, "a base URL looks like"),
        ("m", {"base_url": "http://me:secret@host/v1"}, "must not hold a password"),
        ("m", {"base_url": "http://host/v1?key=secret"}, "must not hold a password or a key"),
        ("m", {"base_url": "http://host/v1?a=1&api-key=secret"}, "must not hold a password"),
        ("m", {"extra": {"api_key": "secret"}}, "a key must not be"),
        ("m", {"extra": {"extra_headers": [{"Authorization": "secret"}]}}, "a key must not be"),
        ("m", {"base_url": f"http://{'a' * 64}.org/v1"}, "a base URL looks like"),
        ("m", {"base_url": "http://models..org/v1"}, "a base URL looks like"),
        (
            "m",
            {"extra": {"top_p": float("nan")}},
            "'top_p' of a request must be what JSON can carry",
        ),
        (
            "m",
            {"extra": {"stop": {"a": ["\ud800"]}}},
            "'stop' of a request must be what JSON can carry",
        ),
        ("m", {"extra": {"top_p": object()}}, "'top_p' of a request must be what JSON can carry"),
        ("m", {"price": (1.0,)}, "give two numbers"),
        ("m", {"key_from": "sk-abc"}, "never the key"),
        ("m", {"timeout": 0}, "must be positive"),
        ("m", {"price": (-1.0, 0.0)}, "must be positive"),
        ("m", {"temperature": float("nan")}, "must be positive"),
    ],
)
def test_settings_without_a_meaning_are_refused(model, settings, says_why):
    with pytest.raises(IbridError, match=says_why) as found:
        ChatServer(model, **settings)
    assert "secret" not in str(found.value)


def test_a_bad_address_in_the_environment_is_one_sentence(monkeypatch):
    monkeypatch.setenv("OPENAI_BASE_URL", "nonsense")
    with pytest.raises(ChatError, match="a base URL looks like"):
        ChatServer("m").complete(ASK)


# --- a server that sends on


def sends_on(address: str, status: int):
    return lambda handler: handler.reply(b"", status, location=f"{address}/chat/completions")


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_is_not_followed_and_the_key_does_not_travel(status):
    with scripted(says("hello")) as other, scripted(sends_on(other.url, status)) as script:
        said = str(failure(script))
    assert not other.requests
    assert len(script.requests) == 1
    assert f"sends on to {other.url.split('/')[2]}, where it is not followed, since the key" in said


def test_a_redirect_to_what_is_no_address_is_a_sentence():
    with scripted(sends_on("http://[xxx", 301)) as script:
        assert "sends on to http://[xxx/chat/completions, where it is not followed" in str(
            failure(script)
        )


def test_every_request_counts_as_a_question():
    with scripted(refuses(503), says("hello")) as script:
        assert chat(script).complete(ASK).usage["questions"] == 2
    with scripted(refuses(503)) as script:
        assert failure(script).usage["questions"] == 3
