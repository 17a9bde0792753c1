"""`ibrid search`, `ibrid report RUN` and `ibrid mcp`: what they answer, their exit status, one
sentence for what is wrong.
"""

import shutil
from pathlib import Path

import pytest
from ibrid_search.evaluation import assess
from ibrid_search.evaluation.assess import EFFORTS
from ibrid_search.run.run_folder import read_run_toml
from ibrid_search.run.store import Store
from scripted_search import NAIVE, QUICK, steps_of
from scripted_server import says, scripted

import ibrid
from ibrid import cli
from ibrid.writing import write_whole

DATA = "paper_like"


def make_quick(patched: pytest.MonkeyPatch) -> None:
    """Pages take seconds and fits some; neither is asked for here."""
    patched.setattr(
        "ibrid_search.running.write_run_page", lambda store, path, **_: write_whole(path, "a page")
    )
    patched.setattr(assess, "EFFORTS", dict.fromkeys(EFFORTS, (QUICK, QUICK, QUICK)))


#: The plainest search: its steps cost least.
BASELINE = ("--start", "naive", "--proposer", "rules", "--workers", "1")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch):
    make_quick(monkeypatch)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run."""
    path = tmp_path_factory.mktemp("commands") / "run"
    with pytest.MonkeyPatch.context() as patched:
        make_quick(patched)
        assert cli.main(["search", DATA, "--out", str(path), "--budget", "3", *BASELINE]) == 0
    return path


def complaint(capsys: pytest.CaptureFixture[str], *words: str, status: int = 2) -> str:
    """What the command says on the error stream: one sentence."""
    capsys.readouterr()
    assert cli.main(["search", *words]) == status
    told = capsys.readouterr().err.strip()
    assert told.startswith("ibrid: ")
    assert "\n" not in told
    assert "Traceback" not in told
    return told


# an answer


@pytest.mark.slow
def test_a_search_tells_its_course_and_its_answer(tmp_path, capsys):
    out = tmp_path / "run"
    words = ["search", DATA, "--out", str(out), "--budget", "4", *BASELINE, "--truth", "gfl_exact"]
    assert cli.main(words) == 0
    told = capsys.readouterr().out
    assert "what changed" in told  # the milestone table
    assert "the start" in told
    assert "4 evaluations in" in told
    assert "the budget is spent" in told
    assert "connections" in told  # the comparison with the truth
    assert f"{out}: best.py, best.json" in told


@pytest.mark.slow
def test_the_options_reach_the_run(tmp_path):
    out = tmp_path / "run"
    words = (
        f"search {DATA} --out {out} --budget 1 --workers 1 --start naive --seed 7 --vocabulary "
        "paper --equilibrium paper"
    )
    words += (
        " --parameters per-op --proposer rules:0.7,random:0.3 --history 2 --require stable "
        "--choose frequencies"
    )
    assert cli.main(words.split()) == 0
    text = (out / "run.toml").read_text(encoding="utf-8")
    for line in (
        "seed = 7",
        'vocabulary = "paper"',
        'equilibrium = "paper"',
        'parameters = "per-op"',
        'require = "stable"',
        'proposer = "rules:0.7,random:0.3"',
        "history = 2",
        'choose = "frequencies"',
    ):
        assert line in text


@pytest.mark.slow
def test_priced_tokens_are_counted_told_and_limited_also_when_the_run_goes_on(
    tmp_path, capsys, monkeypatch
):
    pytest.importorskip(
        "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
    )
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-0123456789")
    out = tmp_path / "run"
    usage = {"prompt_tokens": 100_000, "completion_tokens": 50_000}
    with scripted(says("no edit today", usage)) as script:
        words = (
            f"search {DATA} --out {out} --budget 40 --workers 1 --start naive --proposer llm "
            f"--model small@{script.url}"
        )
        assert cli.main([*words.split(), "--model-price", "1,4", "--model-cost", "1"]) == 0
        # an answer costs 0.1 + 0.2, a step asks twice; each question is asked unless the limit of 1
        # is spent
        assert len(script.requests) == 4
        told = capsys.readouterr()
        assert "Language models took 600,000 tokens, cost 1.2." in told.out
        assert "600,000 tokens, cost 1.2" in told.err  # the progress
        assert "the limits of the language models are spent." in told.out
        costs = [
            step.usage["cost"]
            for step in steps_of(out / "archive.sqlite")
            if step.proposer == "llm"
        ]
        assert costs == pytest.approx([0.6, 0.6])
        assert read_run_toml((out / "run.toml").read_text(encoding="utf-8"), "run.toml")[
            "prices"
        ] == [[1.0, 4.0]]
        words += " --resume --model-price 0,8 --model-cost 2"
        assert cli.main(words.split()) == 0
        assert len(script.requests) == 6  # from 1.2 on, by 0.4 an answer
        assert "Language models took 900,000 tokens, cost 2." in capsys.readouterr().out


@pytest.mark.slow
def test_a_run_goes_on_and_can_then_be_exported_and_compared(folder, tmp_path, capsys):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    assert (
        cli.main(["search", DATA, "--out", str(out), "--budget", "5", *BASELINE, "--resume"]) == 0
    )
    assert "5 evaluations" in capsys.readouterr().out
    assert cli.main(["check", str(out / "best.py")]) == 0
    assert cli.main(["compare", str(out / "best.py"), "naive"]) == 0
    model = tmp_path / "model.json"
    words = [
        "export",
        str(out / "best.json"),
        "--op",
        "p=1,q=0.3",
        "--format",
        "control-json",
        "--out",
        str(model),
    ]
    assert cli.main(words) == 0
    assert model.exists()


@pytest.mark.slow
def test_a_budget_that_is_spent_already_is_said(folder, tmp_path, capsys):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    assert (
        cli.main(["search", DATA, "--out", str(out), "--budget", "2", *BASELINE, "--resume"]) == 0
    )
    told = capsys.readouterr()
    assert "3 evaluations in" in told.out
    assert "the budget of 2 was spent already, a larger one goes on" in told.out
    assert "3/2" not in told.out + told.err


def test_without_a_valid_candidate_the_status_is_one(tmp_path, capsys):
    # the fitted gain of the naive start is a little above 1: it feeds the grid's voltage back too
    # strongly
    words = ["search", DATA, "--out", str(tmp_path / "run"), "--budget", "1", *BASELINE]
    assert cli.main([*words, "--require", "passive:5-5000"]) == 1
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .startswith("ibrid: no candidate was valid and stable")
    )


# wrong inputs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--proposer ruels", "did you mean rules"),
        ("--proposer oracle", "known are: diagnosis, rules, random, llm, policy, agent"),
        ("--model a", "--model belongs to the proposers llm and agent, found diagnosis alone"),
        (
            "--proposer rules,random --model-cost 2",
            "--model-cost belongs to the proposers llm and agent",
        ),
        ("--model-price 1,2", "--model-price belongs to"),
        ("--model-tokens 100 --model-seconds 5", "--model-tokens belongs to"),
        ("--resume", "no run to go on with"),
        ("--proposer rules:heavy", "a weight is a number above zero"),
        ("--proposer llm", "--model"),
        ("--proposer llm --model-price 0.5", "must be two prices IN,OUT"),
        ("--proposer llm --model-price 1,-2", "must be two prices IN,OUT"),
        ("--proposer llm --model-price 1,inf", "must be two prices IN,OUT"),
        ("--proposer llm --model a --model-cost 2", "give --model-price IN,OUT"),
        (
            "--proposer agent --model a --model-cost 2 --model-price 0,0",
            "give --model-price IN,OUT",
        ),
        (
            "--proposer llm --model a --model b --model c --model-price 1,2 --model-price 1,2",
            "one price for all or one for each",
        ),
        ("--proposer llm --model m@http://127.0.0.1:1/v1 --questions 0", "must be above zero"),
        ("--budget 0", "budget must be 1 evaluation or more"),
        ("--budget many", "must be a whole number"),
        ("--prompt paper", "--prompt belongs to the proposer llm, found diagnosis alone"),
        ("--require passive:1e5-1e6", "asks beyond the data; choose a band in 5-5000 Hz"),
        ("--target -1", "must be a positive number"),
        ("--target low", "must be a positive number"),
        ("--holdout-op p=9", "no operating point"),
        ("--holdout-op p=1,q=0.3 --holdout-op p=1,q=-0.3", "operating point"),
        ("--start nowhere.py", "must be a program file or a textbook diagram"),
        ("--truth nowhere.py", "must be a program file or a textbook diagram"),
        ("--require lively", "--require takes stable and passive:LO-HI"),
        ("--choose luck", "chosen by plausible, error, frequencies, op"),
        ("--choose op", "--holdout-op"),
        ("--vocabulary papr", "did you mean paper"),
        ("--equilibrium rough", "equilibrium must be"),
        ("--parameters own", "parameters must be"),
        ("--workers 0", "workers must be a whole number from 1 to 1000"),
        ("--history few", "must be a whole number"),
        ("--learn", "--learn needs a proposer that learns"),
        ("--resumee", "unrecognized arguments"),
    ],
)
def test_a_wrong_option_is_one_sentence_and_no_folder(tmp_path, capsys, words, told):
    assert told in complaint(
        capsys,
        DATA,
        "--out",
        str(tmp_path / "run"),
        "--workers",
        "1",
        "--start",
        "naive",
        *words.split(),
    )
    assert not (tmp_path / "run").exists()


def test_an_unknown_proposer_is_told_the_known_ones_once(tmp_path, capsys):
    for name in ("ruels", "telepathy"):
        assert (
            complaint(capsys, DATA, "--out", str(tmp_path / "run"), "--proposer", name).count(
                "known are"
            )
            == 1
        )


def test_missing_data_and_a_missing_folder_are_one_sentence(tmp_path, capsys):
    assert "must be a sweep file" in complaint(
        capsys, "nowhere.csv", "--out", str(tmp_path / "run")
    )
    assert "--out" in complaint(capsys, DATA)
    assert "needs a folder" in complaint(capsys, DATA, "--out", "")
    assert list(tmp_path.iterdir()) == []


def test_damaged_data_are_one_sentence(tmp_path, capsys):
    path = tmp_path / "data.csv"
    path.write_text("op,p,q,freq_hz\n1,2\n", encoding="utf-8")
    assert str(path) in complaint(capsys, str(path), "--out", str(tmp_path / "run"))


def test_an_illegal_start_is_one_sentence_with_its_remedy(tmp_path, capsys):
    path = tmp_path / "start.py"
    path.write_text(NAIVE.replace('    g.connect("gain.out", "plant.u_r")\n', ""), encoding="utf-8")
    told = complaint(capsys, DATA, "--out", str(tmp_path / "run"), "--start", str(path))
    assert "plant.u_r" in told
    assert "connect" in told


@pytest.mark.nightly
def test_a_place_that_cannot_hold_a_run_is_one_sentence(tmp_path, capsys):
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    assert "is not a folder" in complaint(capsys, DATA, "--out", str(tmp_path / "file"))
    assert "cannot be made" in complaint(capsys, DATA, "--out", str(tmp_path / "file" / "run"))
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


@pytest.mark.nightly
@pytest.mark.skipif(
    not Path("/proc/self").is_dir(),
    reason="needs a folder that nobody, root included, can write to",
)
def test_an_unwritable_folder_is_one_sentence(capsys):
    assert "choose another place" in complaint(capsys, DATA, "--out", "/proc/self")


def test_a_run_is_not_begun_twice(folder, capsys):
    assert "--resume" in complaint(capsys, DATA, "--out", str(folder), *BASELINE)


def test_a_run_does_not_go_on_with_another_seed(folder, capsys):
    told = complaint(capsys, DATA, "--out", str(folder), *BASELINE, "--seed", "5", "--resume")
    assert "seed = 0, now it is 5" in told


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["no database", "cut", "holes", "a record"])
def test_a_damaged_archive_is_one_sentence(folder, tmp_path, capsys, damage):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    archive = out / "archive.sqlite"
    content = archive.read_bytes()
    if damage == "no database":
        archive.write_bytes(b"something else " * 100)
    elif damage == "cut":
        archive.write_bytes(content[: len(content) // 2])
    elif damage == "holes":
        archive.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    else:
        with Store.open(archive) as store:
            store._database.run("UPDATE evaluations SET record = x'00' WHERE number = 0")
    told = complaint(capsys, DATA, "--out", str(out), *BASELINE, "--budget", "6", "--resume")
    assert "archive.sqlite" in told
    assert "damaged" in told


def test_two_processes_do_not_write_one_run(folder, tmp_path, capsys):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    with Store.open(out / "archive.sqlite"):
        told = complaint(capsys, DATA, "--out", str(out), *BASELINE, "--budget", "6", "--resume")
    assert "another live run is writing it" in told


# the page and the tools


@pytest.mark.slow
def test_the_page_of_a_run_is_written_anew(folder, tmp_path, capsys):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    (out / "report.html").unlink()
    assert cli.main(["report", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out / "report.html")
    text = (out / "report.html").read_text(encoding="utf-8")
    assert text.rstrip().endswith("</html>")
    assert len(steps_of(out / "archive.sqlite")) >= 3


@pytest.mark.slow
def test_what_a_run_was_made_from_is_never_replaced(folder, tmp_path, capsys):
    out, measured = tmp_path / "run", tmp_path / "measured.csv"
    shutil.copytree(folder, out)
    shutil.copy(ibrid.benchmarks()["paper_like"], measured)
    before = measured.read_bytes()
    with Store.open(out / "archive.sqlite") as store:
        store.set_meta("data", str(measured))
    for words in (["report", str(out), "--out"], ["next", str(out), "--json"]):
        assert cli.main([*words, str(measured)]) == 2
        assert "would overwrite the run's data" in capsys.readouterr().err
    assert measured.read_bytes() == before


@pytest.mark.slow
def test_a_run_whose_archive_was_emptied_is_not_begun_anew_over_its_answers(
    folder, tmp_path, capsys
):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    (out / "archive.sqlite").write_bytes(b"")
    answer = (out / "best.json").read_bytes()
    assert cli.main(["search", "paper_like", "--out", str(out), "--resume", "--workers", "1"]) == 2
    assert (
        "archive.sqlite is missing or empty, while best.json of the run lies beside it"
        in capsys.readouterr().err
    )
    assert (out / "best.json").read_bytes() == answer


def test_the_page_of_a_damaged_run_is_one_sentence(folder, tmp_path, capsys):
    out = tmp_path / "run"
    shutil.copytree(folder, out)
    (out / "archive.sqlite").write_bytes(b"nothing of the kind")
    assert cli.main(["report", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("ibrid: ")
    assert told.count("\n") == 1


@pytest.mark.parametrize("command", ["search", "mcp"])
def test_the_commands_have_help_with_all_their_options(command, capsys):
    assert cli.main([command, "--help"]) == 0
    told = capsys.readouterr().out
    assert f"usage: ibrid {command}" in told
    shared = (
        "--out",
        "--start",
        "--vocabulary",
        "--equilibrium",
        "--parameters",
        "--holdout-op",
        "--seed",
    )
    own = (
        "--proposer",
        "--budget",
        "--target",
        "--workers",
        "--ray",
        "--history",
        "--require",
        "--truth",
        "--resume",
    )
    for option in (*shared, *(own if command == "search" else ())):
        assert option in told


def test_the_tools_need_data(capsys):
    assert cli.main(["mcp", "nowhere.csv"]) == 2
    assert "must be a sweep file" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_and_the_function_give_the_same_run(folder, tmp_path):

    sweep = ibrid.read_sweep(ibrid.benchmarks()[DATA])
    ibrid.search(sweep, tmp_path / "run", start=ibrid.textbook("naive"), proposer="rules", budget=3)
    assert steps_of(tmp_path / "run" / "archive.sqlite") == steps_of(folder / "archive.sqlite")


def test_a_search_that_asks_no_language_model_says_so(tmp_path, capsys):
    pytest.importorskip(
        "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
    )
    with scripted(says("no edit today", {})) as script:
        words = (
            f"search {DATA} --out {tmp_path / 'run'} --budget 1 --workers 1 --start naive "
            f"--proposer llm --model small@{script.url}"
        )
        assert cli.main(words.split()) == 0
        assert script.requests == []
    assert "No language model was asked" in capsys.readouterr().out
