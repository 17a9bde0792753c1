"""`ibrid gap` on disk: what it writes and takes away, and wrong inputs, which are one sentence and
leave nothing behind.
"""

import shutil
import subprocess
from pathlib import Path

import pytest
from made_gap import made

from ibrid.cli import main
from ibrid.gap.results.gap import Gap
from ibrid.own_files import LIST
from ibrid.structure.diagrams.library import textbook_text

GIVEN, DATA = "gfl_exact", "paper_like"
FILES = {"gap.json", "model.py", "model.json", "report.html", LIST}


@pytest.fixture
def answers(monkeypatch):
    """Lets the workflow answer at once with a gap of one's own, and counts how often it is
    asked.
    """
    asked: list[str] = []

    def answer(gap: Gap) -> list[str]:
        monkeypatch.setattr(
            "ibrid.gap.workflow.find_gap", lambda *_, **__: asked.append("asked") or gap
        )
        monkeypatch.setattr("ibrid.report.pages.gap_page.gap_page", lambda _: "<html></html>")
        return asked

    return answer


def complaint(capsys, *words: str) -> str:
    """The one sentence of a refused command."""
    assert main(["gap", *words]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("ibrid: ")
    assert told.err.count("\n") == 1
    return told.err


# what is written


def test_a_repair_is_written_as_a_program_and_as_a_difference_that_patch_applies(
    answers, tmp_path, capsys
):
    gap, out = made("named"), tmp_path / "deep" / "out"
    answers(gap)
    assert main(["gap", GIVEN, DATA, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == FILES | {"model.diff"}
    assert "model.diff" in capsys.readouterr().out
    first, second, *rest = (out / "model.diff").read_text(encoding="utf-8").splitlines()
    assert (first, second) == (f"--- {GIVEN}", f"+++ {out / 'model.py'}")
    assert any(line.startswith("+") and "pll_filter" in line for line in rest)
    if shutil.which("patch"):
        (tmp_path / "given.py").write_text(gap.given, encoding="utf-8")
        command = ["patch", str(tmp_path / "given.py"), str(out / "model.diff")]
        subprocess.run(command, check=True, capture_output=True)
        assert (tmp_path / "given.py").read_text(encoding="utf-8") == (out / "model.py").read_text(
            encoding="utf-8"
        )


@pytest.mark.slow
def test_without_a_repair_there_is_no_difference_and_an_older_one_goes(answers, tmp_path, capsys):
    answers(made("named"))
    assert main(["gap", GIVEN, DATA, "--out", str(tmp_path)]) == 0
    answers(made("unexplained"))
    assert main(["gap", GIVEN, DATA, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert "model.diff" not in capsys.readouterr().out.split("unexplained")[-1]


def test_a_page_that_cannot_be_drawn_leaves_nothing_half_written(answers, tmp_path, monkeypatch):
    answers(made("named"))

    def broken(_: Gap) -> str:
        raise ArithmeticError("no page")

    monkeypatch.setattr("ibrid.report.pages.gap_page.gap_page", broken)
    assert main(["gap", GIVEN, DATA, "--out", str(tmp_path / "out")]) == 1
    assert list(tmp_path.iterdir()) == []


# wrong inputs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere.py", DATA], "must be a program file or a textbook diagram"),
        ([GIVEN, "nowhere.csv"], "must be a sweep file"),
        ([GIVEN, DATA, "--values", "nowhere.json"], "cannot be read"),
        ([GIVEN, DATA, "--holdout-op", "p=9"], "no operating point"),
        ([GIVEN, DATA, "--suggest", "oracle"], "there is no proposer 'oracle'"),
        ([GIVEN, DATA, "--model", "a"], "--suggest llm and --suggest agent"),
        (
            [GIVEN, DATA, "--suggest", "rules", "--model", "a"],
            "belongs to the proposers llm and agent, found rules",
        ),
    ],
)
def test_a_wrong_input_leaves_no_folder(words, told, tmp_path, capsys):
    assert told in complaint(capsys, *words, "--out", str(tmp_path / "deep" / "out"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("[" * 200_000, "are no JSON: its nesting is too deep"),
        (
            '{"plant.L_F": 1e9}',
            "plant.L_F must lie in the box of the parameter, 0.0001 to 1 pu, found 1e+09",
        ),
        ('{"power.kP": 0.02, "p_loop.kP": 0.03}', "power.kP and p_loop.kP are one parameter"),
    ],
)
def test_wrong_nominal_values_are_one_sentence(content, told, tmp_path, capsys):
    (tmp_path / "nominal.json").write_text(content, encoding="utf-8")
    words = [
        GIVEN,
        DATA,
        "--values",
        str(tmp_path / "nominal.json"),
        "--out",
        str(tmp_path / "out"),
    ]
    assert told in complaint(capsys, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["nominal.json"]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["file", "file/out", "  ", "x" * 300])
def test_a_place_that_cannot_be_a_folder_is_refused_before_the_work(
    answers, where, tmp_path, monkeypatch, capsys
):
    asked = answers(made("named"))
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("mine", encoding="utf-8")
    assert "--out" in (told := complaint(capsys, GIVEN, DATA, "--out", where)) or where[:9] in told
    assert (asked, [path.name for path in tmp_path.iterdir()]) == ([], ["file"])


@pytest.mark.skipif(
    not Path("/proc/self").is_dir(),
    reason="needs a folder that nobody, root included, can write to",
)
@pytest.mark.parametrize("where", ["/proc/self", "/proc/self/out"])
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(answers, where, capsys):
    asked = answers(made("named"))
    assert "choose another place" in complaint(capsys, GIVEN, DATA, "--out", where)
    assert asked == []


def test_a_file_that_cannot_be_replaced_is_refused_before_the_work(answers, tmp_path, capsys):
    asked = answers(made("named"))
    (tmp_path / "gap.json").mkdir()
    assert "gap.json: is a folder" in complaint(capsys, GIVEN, DATA, "--out", str(tmp_path))
    assert asked == []


def test_the_users_own_program_is_never_replaced(answers, tmp_path, capsys):
    asked = answers(made("named"))
    (tmp_path / "model.py").write_text(textbook_text(GIVEN), encoding="utf-8")
    told = complaint(capsys, str(tmp_path / "model.py"), DATA, "--out", str(tmp_path))
    assert "would overwrite MODEL" in told
    assert (tmp_path / "model.py").read_text(encoding="utf-8") == textbook_text(GIVEN)
    assert asked == []
