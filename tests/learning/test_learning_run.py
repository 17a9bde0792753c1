"""`ibrid search --learn` as its user meets it: a whole run, its page, what is refused, and that
nothing else needs torch.
"""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import ibrid_search
import pytest
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, Update, read_updates, updates_json
from ibrid_policy.proposer import PolicyProposer
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.first_look import LOOKS
from ibrid_search.report.page import write_run_page
from ibrid_search.run.store import Store
from page_reader import Reader
from toy_policy import ToyPolicy

import ibrid
from ibrid import cli
from ibrid.errors import IbridError

TORCH = all(importlib.util.find_spec(one) is not None for one in ("torch", "transformers"))
needs_torch = pytest.mark.skipif(
    not TORCH, reason="learning needs torch and transformers; make setup-llm"
)
pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own


def stiffer(program: str, number: int) -> str:
    """Other fixed gains of the naive diagram."""
    head, _, rest = program.partition('"gain"')
    return f'{head}"gain", k={(len(program) % 7 + number + 1) / 10:g}){rest.partition(")")[2]}'


def learnt(folder: Path, proposer: PolicyProposer | None = None, **options) -> ibrid_search.Run:
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    given = {"learn": LearningSettings(contexts=2, group=4, rate=0.02), "budget": 12, **options}
    proposer = proposer or PolicyProposer(policy=ToyPolicy(stiffer, 40))
    proposers = Proposers(proposer, learn=given.pop("learn"))
    return ibrid.search(
        sweep,
        folder,
        start=given.pop("start", ibrid.textbook("naive")),
        proposer=proposers,
        **given,
    )


@needs_torch
def test_a_proposer_that_learnt_is_as_it_was_and_the_same_search_with_it_is_the_same(tmp_path):
    proposer = PolicyProposer(policy=ToyPolicy(stiffer, 40))
    first, again = (learnt(tmp_path / name, proposer) for name in ("first", "again"))
    assert first.trajectory == again.trajectory
    assert learnt(tmp_path / "first", proposer, budget=16, resume=True).evaluations == 16


@needs_torch
def test_a_run_that_learns_keeps_its_weights_its_updates_and_a_page(tmp_path):
    folder = tmp_path / "run"
    found = learnt(folder)
    assert found.evaluations == 12
    assert (folder / "learning.pt").is_file()
    text = (folder / "run.toml").read_text()
    assert "[learning]\ncontexts = 2\ngroup = 4\n" in text
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        updates = read_updates(store.meta[META])
        steps = [step for step in store.steps() if "learning" in step.usage]
    assert len(updates) == len(steps) // 8 >= 1
    page = (folder / "report.html").read_text()
    assert "What the proposer learnt" in page
    # goes on, and only with the same settings
    with pytest.raises(IbridError, match=r"made with learning\.contexts = 2, now it is 4"):
        learnt(
            folder, budget=20, resume=True, learn=LearningSettings(contexts=4, group=4, rate=0.02)
        )
    with pytest.raises(
        IbridError, match=r"made with learning\.advantages = mean, now it is nothing"
    ):
        learnt(folder, budget=20, resume=True, learn=False)
    assert learnt(folder, budget=20, resume=True).evaluations == 20


UPDATES = tuple(
    Update(
        number,
        8 * number - 7,
        8 * number,
        reward=0.1 * number,
        best_reward=0.5,
        valid=0.5,
        unchanged=0.125,
        duplicates=0.125,
        siblings=0.25,
        refused=0.25,
        failed=0.0,
        lost=1,
        dropped=number % 2,
        tokens=31.5,
        entropy=1.2,
        divergence=0.01,
        weight=1.0,
        largest_weight=1.25,
        clipped=0.0,
        drift=1e-7,
        gradient=0.4,
        probe=2e-7,
        updated=True,
        seconds_sampling=3.0,
        seconds_update=1.5,
        remark="" if number < 3 else "served & trained <policy> differ",
    )
    for number in (1, 2, 3)
)


def test_updates_survive_the_store_and_what_cannot_be_read_is_none():
    assert read_updates(updates_json(UPDATES)) == UPDATES
    assert (
        read_updates("")
        == read_updates("{")
        == read_updates("[1]")
        == read_updates('[{"number": 1}]')
        == ()
    )
    assert (
        read_updates(updates_json(UPDATES).replace('"lost":', '"new in a later version":0,"lost":'))
        == UPDATES
    )


@pytest.mark.parametrize("number", [1, 3])
def test_the_page_shows_every_update_and_what_was_wrong(tmp_path, number):
    from made_run import a_run, meta

    folder = a_run(tmp_path / "run", meta(**{META: updates_json(UPDATES[:number])}))
    text = write_run_page(folder).read_text()
    page = Reader(text)
    assert not page.open
    assert text.count('<th scope="row" class="n">') >= 2 * number
    assert ("served &amp; trained &lt;policy&gt; differ" in text) == (number == 3)
    assert ('aria-label="Reward, shares of answers' in text) == (number > 1)
    assert "12 %" in text
    without = write_run_page(a_run(tmp_path / "other", meta())).read_text()
    assert "What the proposer learnt" not in without
    damaged = a_run(tmp_path / "damaged", meta(**{META: "[{]"}))
    assert "What the proposer learnt" not in write_run_page(damaged).read_text()


# what is refused


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["--learn"],
            "--learn needs a proposer that learns, and one alone: found 0 among diagnosis",
        ),
        (["--learn", "--proposer", "random:0.5,rules"], "found 0 among random, rules"),
        (
            ["--learn", "--proposer", "llm", "--model", "m@http://127.0.0.1:9/v1"],
            "a model of a server",
        ),
        (
            ["--learn", "--proposer", "agent", "--model", "m@http://127.0.0.1:9/v1"],
            "found 0 among agent",
        ),
        (["--learn", "--learn-group", "1"], "a group needs 2 answers or more"),
        (
            ["--learn", "--learn-profile", "tiny"],
            "there is no profile of learning called 'tiny'; known are paper and small",
        ),
        (["--learn-profile", "small"], "--learn-profile says how a proposer learns; add --learn"),
        (
            ["--learn", "--learn-profile", "small", "--learn-group", "1"],
            "a group needs 2 answers or more",
        ),
        (["--learn", "--learn-judge", "chance"], "judge must be fit or look, found chance"),
        (["--learn-group", "4"], "--learn-group says how a proposer learns; add --learn"),
        (["--learn", "--learn-rate", "-1"], "--learn-rate"),
        (["--learn-constrained"], "--learn-constrained says how a proposer learns; add --learn"),
        (["--learn", "--learn-longest", "40"], "an answer needs 90 tokens or more, found 40"),
        (
            [
                "--learn",
                "--learn-constrained",
                "--proposer",
                "llm",
                "--model",
                "m@http://127.0.0.1:9/v1",
            ],
            "a model of a server alone, or one of several, cannot be trained",
        ),
    ],
)
def test_what_cannot_learn_is_refused_in_a_sentence(tmp_path, capsys, words, sentence):
    folder = tmp_path / "run"
    try:
        code = cli.main(["search", "paper_like", "--out", str(folder), *words])
    except SystemExit as end:  # of the parser
        code = end.code
    assert code == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert "Traceback" not in told
    assert not folder.exists()


@needs_torch
def test_a_profile_is_given_by_its_name(tmp_path):
    learnt(tmp_path / "run", learn="small", budget=14)
    told = (tmp_path / "run" / "run.toml").read_text()
    for line in (
        "contexts = 1",
        "group = 8",
        'judge = "look"',
        'baseline = "group"',
        'optimizer = "sgd"',
        'advantages = "entropic"',
    ):
        assert f"\n{line}\n" in told
    assert "gain, mean" in (tmp_path / "run" / "report.html").read_text()
    with Store.open(tmp_path / "run" / "archive.sqlite", read_only=True) as store:
        steps = [step for step in store.steps() if step.number > 0]
    mine = [step for step in steps if step.proposer == "toy"]
    assert len(mine) > 4
    assert all(len(step.usage["learning"]["answers"]) == 8 for step in mine)
    assert any(LOOKS in step.usage for step in mine)
    with pytest.raises(
        IbridError, match=r"no profile of learning called 'large'; known are paper and small"
    ):
        learnt(tmp_path / "other", learn="large")


@needs_torch
@pytest.mark.parametrize(
    "words", [["--learn-constrained"], ["--learn-longest", "200"], ["--learn-question", "900"]]
)
def test_what_belongs_to_a_language_model_is_refused_for_the_policy(tmp_path, capsys, words):
    folder = tmp_path / "run"
    assert (
        cli.main(
            [
                "search",
                "paper_like",
                "--out",
                str(folder),
                "--proposer",
                "policy",
                "--learn",
                *words,
            ]
        )
        == 2
    )
    assert f"{words[0]} belongs to a language model" in capsys.readouterr().err
    assert not folder.exists()


@needs_torch
def test_two_that_could_learn_are_refused_in_a_sentence(tmp_path):
    two = [
        (PolicyProposer(policy=ToyPolicy(stiffer, 4)), 1.0),
        (PolicyProposer(policy=ToyPolicy(stiffer, 4)), 1.0),
    ]
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    with pytest.raises(
        IbridError, match="a proposer that learns, and one alone: found 2 among policy, policy"
    ):
        ibrid.search(sweep, tmp_path / "run", proposer=Proposers(two, learn=True))
    assert replace(LearningSettings(), contexts=4).batch == 64


# nobody else needs torch


NO_TORCH = """
import sys
from ibrid import cli
assert cli.main({words!r}) == 0
found = sorted({{"torch", "transformers", "peft"}} & sys.modules.keys())
assert not found, found
"""


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "naive", "paper_like"],
        ["gap", "gfl_pll_filter_exact", "paper_like", "--out", "gap"],
        [
            "search",
            "paper_like",
            "--out",
            "run",
            "--proposer",
            "rules",
            "--budget",
            "6",
            "--workers",
            "1",
        ],
        ["report", "run"],
    ],
    ids=lambda words: words[0],
)
def test_a_command_without_a_model_imports_no_torch(tmp_path, words):
    if words[0] == "report":
        from made_run import a_run, meta

        a_run(tmp_path / "run", meta())
    done = subprocess.run(
        [sys.executable, "-c", NO_TORCH.format(words=words)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
