"""The proposer `llm`, asked through a real client and a server that answers well and badly."""

from contextlib import nullcontext
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, evaluated
from ibrid_search.chat import chat_request
from ibrid_search.chat.chat import Answer, estimated_tokens
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.chat.spending import Limits
from ibrid_search.edits import EditError, apply_edit
from ibrid_search.proposal import Complaint, Context, Evaluated, Proposal, Proposer
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.language_model import _EDIT_STEP, _TAKE, LanguageModel, read_answer
from ibrid_search.proposers.local_model import LocalModel
from ibrid_search.proposers.model_names import model_of
from ibrid_search.run.store import Store
from scripted_server import Handler, closes, hangs, refuses, says, scripted, sends

import ibrid
from ibrid.errors import IbridError, ProgramError
from ibrid.structure import program_text, violations
from ibrid.study import Study

pytest.importorskip(
    "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
)

KEY = "sk-secret-0123456789"
PROGRAM = program_text(ibrid.textbook("naive"))
EDIT = """\
<<<<<<< SEARCH
    g.connect("gain.out", "plant.u_r")
=======
    g.add("LPF1_dq", "smooth")
    g.connect("gain.out", "smooth.in_")
    g.connect("smooth.out", "plant.u_r")
>>>>>>> REPLACE
"""
GOOD = (
    "CHANGE: a low-pass behind the gain, for the error at high frequency\n\n```\n" + EDIT + "```\n"
)


@pytest.fixture(autouse=True)
def _environment(monkeypatch):
    for name in ("OPENAI_BASE_URL", "OPENAI_API_BASE", "OPENAI_ORG_ID", "OPENAI_PROJECT_ID"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OPENAI_API_KEY", KEY)


@pytest.fixture
def context() -> Context:
    return Context(
        Study(benchmark()), Evaluated(0, ibrid.textbook("naive"), evaluated("naive", restarts=0))
    )


def model(script, limits: Limits | None = None, **settings) -> LanguageModel:
    chat = ChatServer(
        "small", script.url, **{"timeout": 300.0, "retries": 1, "pause": 0.01, **settings}
    )
    return LanguageModel([(chat, 1.0)], limits=limits)


def asked(context: Context, *turns, **options) -> Proposal:
    with scripted(*turns) as script:
        proposal = model(script, **options).propose(context, np.random.default_rng(0))
    assert KEY not in repr(proposal)
    return proposal


def test_it_is_a_proposer():
    proposer = LanguageModel([(ChatServer("small"), 1.0)])
    assert isinstance(proposer, Proposer)
    assert (proposer.name, proposer.attempts, proposer.window) == ("llm", 2, 1)


@pytest.mark.slow
def test_a_good_answer_is_an_edit_that_applies(context):
    proposal = asked(context, says(GOOD))
    assert proposal.edit == EDIT
    assert proposal.note == "a low-pass behind the gain, for the error at high frequency"
    assert (proposal.reply, proposal.failure) == (GOOD, "")
    assert proposal.usage["prompt_tokens"] == 100
    assert proposal.usage["completion_tokens"] == 20
    assert not refused(proposal.edit)


@pytest.mark.slow
def test_the_question_holds_the_program_and_the_second_one_the_complaint(context):
    second = Context(
        context.study, context.parent, complaint=Complaint("half an edit", "the answer ends there")
    )
    with scripted(says(GOOD)) as script:
        proposer = model(script)
        for one in (context, second):
            proposer.propose(one, np.random.default_rng(0))
    first, again = (
        "\n".join(turn["content"] for turn in one["messages"]) for one in script.requests
    )
    assert PROGRAM in first
    assert "the answer ends there" not in first
    assert "half an edit" in again
    assert "Reason: the answer ends there" in again


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("turn", "failure"),
    [
        (says(""), "answered nothing"),
        (says(None), "answered nothing"),
        (says("  \n\t\n"), "answered nothing"),
        (
            says(None, tool_calls=[{"function": {"name": "run", "arguments": "rm -rf /"}}]),
            "answered nothing",
        ),
        (says("<think>" + EDIT), "thought until it was cut off"),
        (says("x" * 150_000), "answered with 150000 characters"),
        (refuses(500), "HTTP 500, 2 times"),
        (closes, "cannot be reached"),
        (sends(b"<html>"), "a web page in place of JSON"),
        (sends(b"{"), "in place of JSON"),
        (sends(b""), "nothing in place of JSON"),
    ],
)
def test_no_usable_answer_is_a_failure_in_one_sentence(context, turn, failure):
    proposal = asked(context, turn)
    assert failure in proposal.failure
    assert "\n" not in proposal.failure
    assert proposal.edit == ""
    assert proposal.usage["model"] == "small"
    assert proposal.usage["seconds"] > 0


@pytest.mark.slow
def test_a_server_that_hangs_is_a_failure(context, monkeypatch):
    monkeypatch.setattr(
        chat_request, "GRACE", 600.0
    )  # the client of the server stops by itself, however late
    assert "did not answer within 0.2 s" in asked(context, hangs, timeout=0.2, retries=0).failure


@pytest.mark.slow
def test_while_a_model_thinks_a_line_says_so_with_what_was_spent(context):
    told: list[str] = []
    heard = Event()

    def tell(line: str) -> None:
        told.append(line)
        heard.set()

    def thinks(handler: Handler) -> None:
        heard.wait(600.0)  # until the line is there
        says(GOOD)(handler)

    with scripted(says(GOOD), thinks) as script:
        proposer = model(script, timeout=600.0, retries=0, price=(1e4, 1e4))
        proposer.propose(context, np.random.default_rng(0))
        proposer.tell = tell
        proposer.propose(context, np.random.default_rng(0))
    assert told[0].startswith("small thinks, ")
    assert "120 tokens, cost 1.2 so far" in told[0]


@pytest.mark.slow
def test_equal_refusals_are_borne_three_times_and_any_answer_makes_good_for_them(context):
    with scripted(
        *[refuses(401, "no such key")] * 2, says(GOOD), refuses(401, "no such key")
    ) as script:
        proposer = model(script)
        broken = []
        for _ in range(6):
            proposer.propose(context, np.random.default_rng(0))
            broken.append(bool(proposer.broken))
    assert broken == [False] * 5 + [True]
    assert "no such key" in proposer.broken


@pytest.mark.slow
def test_a_busy_server_is_asked_again_and_the_retries_are_counted(context):
    proposal = asked(context, refuses(429), says(GOOD))
    assert proposal.edit == EDIT
    assert proposal.usage["retries"] == 1


@pytest.mark.nightly
@pytest.mark.parametrize(
    "text", ["I would add a filter.", EDIT[:60], "<<<<<<< SEARCH\n" * 50, "\x00\x1b[2J" * 100]
)
def test_garbage_is_kept_and_refused_as_an_edit(context, text):
    proposal = asked(context, says(text))
    assert (proposal.reply, proposal.edit, proposal.failure) == (text, text, "")
    with pytest.raises(EditError):
        apply_edit(proposal.edit, PROGRAM)


@pytest.mark.slow
def test_thinking_is_kept_and_counted_but_never_an_edit(context):
    wrong = EDIT.replace("LPF1_dq", "PI_dq")
    proposal = asked(context, says(f"Let me see.\n{wrong}\n</think>\n{GOOD}"))
    assert proposal.edit == EDIT
    assert wrong in proposal.reply
    assert proposal.usage["thinking_tokens"] == pytest.approx(estimated_tokens(wrong), abs=10)


@pytest.mark.slow
def test_an_answer_that_was_cut_says_so(context):
    assert asked(context, says(EDIT[:80], finish="length")).usage["cut"] is True
    assert "cut" not in asked(context, says(GOOD)).usage


MALICIOUS = [
    'import os\n    os.system("touch {0}")',
    '__import__("os").system("touch {0}")',
    'g.add(__import__("os").system("touch {0}"), "a")',
    'g.add("PI", "a", kP=open("{0}", "w"))',
    'g.add("__import__", "a")',
    'g.add("../../{0}", "a")',
    'g.add("PI", "../../etc/passwd")',
    'g.add("PI", "a", kP="/etc/passwd")',
    'g.add("PI", "a; drop table steps")',
    'g.add("PI", "a", **{{}})',
    'g.connect("/etc/passwd", "plant.u_r")',
    'g.__class__.__init__.__globals__["os"]',
    'getattr(g, "add")("PI", "a")',
    'exec(\'open("{0}", "w")\')',
    'g.add("PI", "a", line=1)',
    'g.add("PI", "a", kP=1e999)',
    'g.add("PI", "a", kP=9**9**9)',
    "while True: pass",
    'g.add("PI", "\\u0000")',
    'g.add("PI", "' + "a" * 60_000 + '")',
]


def refused(edit: str) -> bool:
    """True when an edit leads to no legal diagram."""
    try:
        return bool(violations(ibrid.parse_program(apply_edit(edit, PROGRAM))))
    except (EditError, ProgramError):
        return True


@pytest.mark.nightly
@pytest.mark.parametrize("line", MALICIOUS)
def test_a_malicious_answer_can_do_no_more_than_be_refused(context, line, tmp_path):
    line = line.format(tmp_path / "harm")
    edit = EDIT.replace('g.add("LPF1_dq", "smooth")', line)
    proposal = asked(context, says(edit))
    assert refused(proposal.edit)
    assert not list(tmp_path.iterdir())
    assert not Path("harm").exists()


class Told:
    """A model that answers from memory and notes what it is asked."""

    def __init__(self, name: str, usage: dict | None = None) -> None:
        self.name, self.usage = name, usage or {}
        self.seeds: list[int] = []

    def complete(self, messages, *, tools=None, rng_seed=0) -> Answer:
        self.seeds.append(rng_seed)
        return Answer(GOOD, usage={"model": self.name, **self.usage})


@pytest.mark.slow
def test_the_question_is_made_before_the_model_is_said_to_think(context, monkeypatch):
    with scripted(says(GOOD)) as script:
        for proposer in (
            model(script),
            LanguageModel([(Told("told"), 1.0)]),
        ):  # held to a schema, and in text
            course, build = [], proposer._question
            monkeypatch.setattr(
                proposer,
                "_question",
                lambda *a, b=build, c=course, **o: c.append("made") or b(*a, **o),
            )
            monkeypatch.setattr(
                proposer, "asking", lambda name, c=course: nullcontext(c.append("thinks"))
            )
            proposer.propose(context, np.random.default_rng(0))
            assert course == ["made", "thinks"]


@pytest.mark.nightly
def test_models_are_drawn_by_weight_and_the_draws_repeat(context):
    often, seldom, never = Told("often"), Told("seldom"), Told("never")
    proposer = LanguageModel([(often, 3.0), (seldom, 1.0), (never, 0.0)])
    first, again = (
        [proposer.propose(context, rng).usage["model"] for _ in range(60)]
        for rng in map(np.random.default_rng, (1, 1))
    )
    assert first == again
    assert often.seeds[: len(often.seeds) // 2] == often.seeds[len(often.seeds) // 2 :]
    assert len(set(often.seeds)) == len(often.seeds) // 2
    assert 30 < first.count("often") < 58
    assert not never.seeds


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("limits", "usage", "answers"),
    [
        (Limits(tokens=250), {"prompt_tokens": 60, "completion_tokens": 40}, 3),
        (Limits(cost=1.0), {"cost": 0.5}, 2),
        (Limits(seconds=3.0), {"seconds": 2.0}, 2),
        (Limits(questions=3), {}, 3),
        (Limits(questions=3), {"questions": 2, "retries": 1}, 2),
    ],
)
def test_a_limit_of_the_run_ends_the_questions(context, limits, usage, answers):
    told = Told("told", usage)
    proposer = LanguageModel([(told, 1.0)], limits=limits)
    rng = np.random.default_rng(0)
    found = [proposer.propose(context, rng) for _ in range(5)]
    assert [not one.failure for one in found] == [True] * answers + [False] * (5 - answers)
    assert "of this run is spent" in found[-1].failure
    assert len(told.seeds) == answers


def test_a_run_that_resumes_counts_what_was_spent_before(context):
    proposer = LanguageModel([(Told("told"), 1.0)], limits=Limits(tokens=100))
    proposer.spending.count(
        {"prompt_tokens": 90, "completion_tokens": 10, "cost": float("nan"), "seconds": "long"}
    )
    assert proposer.spending.spent == {"questions": 1, "tokens": 100, "cost": 0.0, "seconds": 0.0}
    assert proposer.propose(context, np.random.default_rng(0)).failure


def test_a_question_that_was_asked_when_a_run_was_stopped_counts_when_it_goes_on(context, tmp_path):
    class Stopped(Told):
        def complete(self, *args, **settings):
            raise KeyboardInterrupt

    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        for _ in range(2):
            proposer = LanguageModel([(Stopped("told"), 1.0)], limits=Limits(questions=3))
            proposer.begin(store, tmp_path)
            with pytest.raises(KeyboardInterrupt):
                proposer.propose(context, np.random.default_rng(0))
        resumed = LanguageModel([(Told("told"), 1.0)], limits=Limits(questions=3))
        resumed.begin(store, tmp_path)
        assert resumed.spending.questions_left == 1
        assert not resumed.propose(context, np.random.default_rng(0)).failure
        assert "of this run is spent" in resumed.propose(context, np.random.default_rng(0)).failure


def test_requests_that_a_question_took_when_a_run_was_stopped_count_when_it_goes_on(
    context, tmp_path, monkeypatch
):
    pauses = iter((False, False, True))

    def pause(_seconds: float) -> None:
        if next(pauses):
            raise KeyboardInterrupt

    monkeypatch.setattr("ibrid_search.chat.chat_server.time.sleep", pause)
    with (
        scripted(*[refuses(500, "busy")] * 3) as script,
        Store.create(tmp_path / "archive.sqlite", {}) as store,
    ):
        stopped = LanguageModel(
            [(ChatServer("small", script.url), 1.0)], limits=Limits(questions=5)
        )
        stopped.begin(store, tmp_path)
        with pytest.raises(KeyboardInterrupt):
            stopped.propose(context, np.random.default_rng(0))
        resumed = LanguageModel([(Told("told"), 1.0)], limits=Limits(questions=5))
        resumed.begin(store, tmp_path)
        assert len(script.requests) == 3
        assert resumed.spending.questions_left == 2


def test_proposers_that_ask_models_share_what_a_run_may_spend():
    asked = ["small@http://127.0.0.1:1/v1"]
    chosen = Proposers(
        "llm:0.5,agent:0.5,rules", models=asked, limits=Limits(questions=3)
    ).weighted()
    (llm, _), (agent, _), _ = chosen
    llm.count({"questions": 2})
    assert agent.spending.questions_left == 1


def test_an_answer_of_empty_lines_is_read_at_once():
    lines = "\n" * 300_000
    assert not _TAKE.search(lines)
    assert not _EDIT_STEP.search(lines)


def test_what_may_be_spent_is_said_with_what_that_comes_to():
    chat = ChatServer("small", "http://127.0.0.1:1/v1", max_tokens=1000)
    terms = LanguageModel([(chat, 1.0)], limits=Limits(questions=20, cost=2.5), asked="paper").terms
    assert (
        "at most 20 questions (--questions), any number of tokens (--model-tokens) and a cost of "
        "2.5" in terms
    )
    assert "a question and its answer take up to about 17,000 tokens, all of them 340,000" in terms
    assert "at most 200 questions" in LanguageModel([(Told("told"), 1.0)]).terms


@pytest.mark.slow
def test_a_prompt_that_does_not_fit_is_a_failure(context):
    proposer = LanguageModel([(Told("told"), 1.0)], prompt_tokens=300)
    assert "the limit is 300" in proposer.propose(context, np.random.default_rng(0)).failure


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (f"CHANGE: more damping\n{EDIT}", "more damping"),
        (f"**Change:** more damping\n{EDIT}", "more damping"),
        (f"The error is at 1 kHz.\nSo I add a filter.\n```\n{EDIT}", "So I add a filter."),
        (EDIT, ""),
        ("CHANGE: `\x1b[31m`" + "x" * 500 + f"\n{EDIT}", " [31m " + "x" * 93 + "..."),
    ],
)
def test_the_note_is_what_the_model_says_it_changes(text, note):
    assert read_answer(text, {}, "small").note.strip() == note.strip()


def test_models_are_named_on_a_command_line(monkeypatch):
    monkeypatch.setenv("OTHER_KEY", "sk-other")
    chat, weight = model_of(
        "vendor/gpt-x:8b@http://127.0.0.1:8123/v1?key=OTHER_KEY*0.7", timeout=9.0
    )
    assert chat == ChatServer(
        "vendor/gpt-x:8b", "http://127.0.0.1:8123/v1", "OTHER_KEY", timeout=9.0
    )
    assert weight == 0.7
    assert model_of("gpt-x") == (ChatServer("gpt-x"), 1.0)
    assert model_of("/models/small@http://127.0.0.1:1/v1")[0] == ChatServer(
        "/models/small", "http://127.0.0.1:1/v1"
    )
    proposer = LanguageModel.from_options(["a*3", "b@https://host/v1"], limits=Limits(tokens=5))
    assert proposer.weights.tolist() == [0.75, 0.25]
    assert [one.name for one in proposer.models] == ["a", "b"]


@each_of(
    ("models", "says_why"),
    [
        ([], "at least one model"),
        (["a*0"], "at least one model"),
        ([""], "is written MODEL"),
        (["http://127.0.0.1:8123/v1"], "is written MODEL"),
        (["@http://127.0.0.1:8123/v1"], "is written MODEL"),
        (["a*-1"], "the weight of a language model"),
        (["a*1e999"], "the weight of a language model"),
        (["a*1.2.3"], "the weight of a language model"),
        (["a@http://me:secret@host/v1"], "must not hold a password"),
        (["a@http:///v1"], "a base URL looks like"),
        (["./no/such/folder"], "holds no model"),
        (["~/no-such-folder*2"], "holds no model"),
    ],
)
def test_a_name_that_says_nothing_is_refused(models, says_why):
    with pytest.raises(IbridError, match=says_why) as found:
        LanguageModel.from_options(models)
    assert "secret" not in str(found.value)


def test_a_folder_without_a_model_is_refused(tmp_path):
    with pytest.raises(IbridError, match=r"holds no model; give a folder with config.json"):
        LocalModel(tmp_path)


@pytest.mark.parametrize(
    "limits", [{"tokens": 0}, {"cost": -1.0}, {"seconds": float("nan")}, {"questions": 0}]
)
def test_limits_without_a_meaning_are_refused(limits):
    with pytest.raises(IbridError, match="must be above zero"):
        Limits(**limits)


def test_a_package_that_is_not_installed_is_named(monkeypatch, tmp_path):
    import ibrid_search.proposers.model_names as names

    monkeypatch.setattr(names, "find_spec", lambda name: None)
    with pytest.raises(IbridError, match=r"needs the package openai; pip install 'ibrid\[llm\]'"):
        model_of("gpt-x")
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "model.safetensors").write_bytes(b"")
    with pytest.raises(
        IbridError, match=r"needs the package torch; pip install 'ibrid\[local-llm\]'"
    ):
        model_of(str(tmp_path))
