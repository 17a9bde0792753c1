"""The commands of ibrid as a tool over one folder: what it runs, and what it does not reach."""

import json
from pathlib import Path

import pytest
from ibrid_search.agents.logbook import Logbook
from ibrid_search.agents.study_folder import StudyFolder

import ibrid
from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.own_files import ONLY_BELOW
from ibrid.structure.diagrams.library import textbook_text
from ibrid.study import Study

DEVICE = 'kind = "reference"\nfile = "gfl_l_filter"\n'


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "scan.csv").write_bytes(ibrid.benchmarks()["gfl_l_filter"].read_bytes())
    (tmp_path / "secret.csv").write_bytes((folder / "scan.csv").read_bytes())
    return folder


@pytest.fixture(scope="module")
def logbook() -> Logbook:
    kept = Logbook(Study(ibrid.as_sweep("gfl_l_filter")))
    kept.submit(textbook_text("gfl_l_filter"), note="the start")
    return kept


def test_a_study_goes_from_a_file_to_a_report(place: Path, logbook: Logbook):
    with StudyFolder(place, logbook) as study:
        assert study.run_ibrid(["inspect", "scan.csv"])["status"] == 0
        assert study.save_step(0, "step0.json")["file"] == "step0.json"
        answer = study.run_ibrid(["stability", "step0.json", "--scr", "2:5:3", "--json", "s.json"])
        assert answer["status"] == 0
        assert json.loads((place / "s.json").read_text())["points"]
        assert study.run_ibrid(["report", "step0.json", "--out", "fit.html"])["status"] == 0
        names = {one["file"] for one in study.list_files()["files"]}
        assert {"scan.csv", "step0.json", "fit.html"} <= names
        assert study.list_files("fit.html")["begins"].startswith("<!DOCTYPE html>")


def test_nothing_outside_of_the_folder_is_read_or_written(place: Path, logbook: Logbook):
    (place / "link.csv").symlink_to(place.parent / "secret.csv")
    record = place / "elsewhere.json"
    logbook.record(0).write(record)
    content = json.loads(record.read_text())
    content["settings"]["data"] = str(place.parent / "secret.csv")
    record.write_text(json.dumps(content))
    reached = []
    with StudyFolder(place, logbook) as study:
        for words in (
            ["inspect", "../secret.csv"],
            ["inspect", str(place.parent / "secret.csv")],
            ["inspect", "link.csv"],
            ["import", "scan.csv", "--out", "../out.csv"],
            ["evaluate", "gfl_l_filter", "scan.csv", "--json", str(place.parent / "fit.json")],
            ["compare", "scan.csv", "../secret.csv"],
            ["report", "elsewhere.json", "--out", "page.html"],
        ):
            answer = study.run_ibrid(words)
            if answer["status"] == 0 or "lies outside of" not in answer["told"]:
                reached.append((words, answer))
        for file in ("../secret.csv", "/etc/passwd", "."):
            with pytest.raises(IbridError, match=r"below the folder|no file"):
                study.list_files(file)
        with pytest.raises(IbridError, match="below the folder"):
            study.save_step(0, "../step.json")
    assert reached == []
    assert sorted(path.name for path in place.parent.iterdir()) == ["secret.csv", "study"]


def test_what_runs_code_of_others_needs_the_users_word(place: Path, logbook: Logbook):
    (place / "DEVICE.toml").write_text(DEVICE)
    words = ["measure", "DEVICE.toml", "--op", "p=0.5,q=0", "--freq", "10:100:4", "--out", "m.csv"]
    with StudyFolder(place, logbook) as study:
        for refused in (words, ["open", "DEVICE.toml"], ["search", "scan.csv"], ["watch", "x"], []):
            with pytest.raises(IbridError):
                study.run_ibrid(refused)
        with pytest.raises(IbridError, match="executes a Python file"):
            study.run_ibrid(["evaluate", "gfl", "scan.csv", "--kinds", "own.py"])
    with StudyFolder(place, logbook, allow_devices=True) as study:
        assert study.run_ibrid(words)["status"] == 0
        assert (place / "m.csv").is_file()


def test_a_long_command_answers_in_slices_and_can_be_stopped(place: Path, logbook: Logbook):
    words = ["start", "scan.csv", "--out", "first"]
    with StudyFolder(place, logbook, answer_within=0.5) as study:
        assert study.run_ibrid(words)["running"]
        with pytest.raises(IbridError, match="still running"):
            study.run_ibrid(["inspect", "scan.csv"])
        assert study.run_ibrid(words, stop=True) == {
            "stopped": True,
            "next": "run_ibrid with another command",
        }
        answer = study.run_ibrid(words)
        for _ in range(600):
            if "running" not in answer:
                break
            answer = study.run_ibrid(words)
        assert answer["status"] == 0
        assert (place / "first" / "report.html").is_file()


def test_a_command_kept_below_a_folder_may_read_what_ships(place: Path, monkeypatch, capsys):
    monkeypatch.chdir(place)
    monkeypatch.setenv(ONLY_BELOW, str(place))
    assert main(["inspect", "paper_like"]) == 0
    assert main(["inspect", "../secret.csv"]) == 2
    assert "lies outside of" in capsys.readouterr().err
