"""The commands of ibrid as a tool over one folder: what it runs, and what it does not reach."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
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


def test_what_ships_is_read_and_not_written(place: Path, logbook: Logbook):
    shipped = ibrid.benchmarks()["gfl_l_filter"]
    before = {path: path.read_bytes() for path in shipped.parent.glob("*.csv")}
    refused = []
    with StudyFolder(place, logbook) as study:
        for words in (
            ["compare", "gfl", "gfl", f"--json={shipped.parent / 'new.json'}"],
            ["import", "scan.csv", "--out", str(shipped)],
            ["start", "scan.csv", "--effort", "low", "--out", str(shipped.parent / "first")],
        ):
            answer = study.run_ibrid(words)
            refused.append(answer["status"] == 2 and "lies outside of" in answer["told"])
    assert all(refused)
    assert {path: path.read_bytes() for path in shipped.parent.glob("*.csv")} == before
    assert not (shipped.parent / "new.json").exists()


def test_no_command_asks_a_server_that_the_agent_chose(place: Path, logbook: Logbook):
    words = ["gap", "gfl", "scan.csv", "--out", "g", "--suggest", "llm"]
    with StudyFolder(place, logbook) as study:
        for server in (["--model", "m@http://127.0.0.1:9/v1"], ["--model=m@http://[::1]/v1"], []):
            with pytest.raises(IbridError, match="language model"):
                study.run_ibrid([*words, *server])


def test_words_that_no_command_line_can_hold_are_one_sentence(place: Path, logbook: Logbook):
    with StudyFolder(place, logbook) as study:
        for words in (["inspect", "a\0b"], ["inspect", "\ud800"], ["inspect", "x" * 10_000_000]):
            with pytest.raises(IbridError):
                study.run_ibrid(words)
        for file in ("a\0b.json", "\ud800.json", "x" * 300 + ".json", "scan.csv/x.json"):
            with pytest.raises(IbridError):
                study.list_files(file)
            with pytest.raises(IbridError):
                study.save_step(0, file)


def test_a_huge_file_or_a_pipe_is_listed_and_not_read_whole(place: Path, logbook: Logbook):
    with (place / "huge.csv").open("wb") as file:
        file.truncate(1 << 40)  # without that much on the disk
    os.mkfifo(place / "pipe.csv")
    (place / "elsewhere").symlink_to("/etc")
    (place / "hosts.csv").symlink_to("/etc/hosts")
    with StudyFolder(place, logbook) as study:
        assert len(study.list_files("huge.csv")["begins"]) <= 20_000
        assert {one["file"] for one in study.list_files()["files"]} == {"scan.csv", "huge.csv"}
        with pytest.raises(IbridError):
            study.list_files("pipe.csv")


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


SERVER = """
import sys
from pathlib import Path
from ibrid_search.agents.study_folder import StudyFolder
with StudyFolder(Path(sys.argv[1]), None, answer_within=4.0) as study:
    study.run_ibrid(["start", "scan.csv", "--out", "first", "--effort", "high"])
    print("begun", flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has other ways to end a process")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_command_ends_with_a_server_that_is_killed(place: Path, how: signal.Signals):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    pipe = subprocess.PIPE
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(place)], env=environment, stdin=pipe, stdout=pipe
    )
    with server:
        assert server.stdout is not None
        assert server.stdout.readline() == b"begun\n"
        commands = psutil.Process(server.pid).children(recursive=True)
        server.send_signal(how)
    gone, alive = psutil.wait_procs(commands, timeout=30)
    assert alive == []
    assert gone


def test_a_command_kept_below_a_folder_may_read_what_ships(place: Path, monkeypatch, capsys):
    monkeypatch.chdir(place)
    monkeypatch.setenv(ONLY_BELOW, str(place))
    assert main(["inspect", "paper_like"]) == 0
    assert main(["inspect", "../secret.csv"]) == 2
    assert "lies outside of" in capsys.readouterr().err
