"""The live page of a search: read-only, for this machine alone, and whole in a real browser."""

import http.client
import json
import os
import re
import shutil
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import ibrid_search
import pytest
from browser import _NAMES, _OPTIONS
from browser import asked as answers_of
from fitted import benchmark, changed, evaluated
from ibrid_search.run.store import Store
from ibrid_search.watching import WatchServer
from ibrid_search.watching.run_state import run_names, run_state, run_summary
from ibrid_search.watching.server import ADDRESS
from made_run import a_run, meta

from ibrid import cli
from ibrid.errors import IbridError
from ibrid.measurement.formats.csv_file import sweep_csv


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return a_run(tmp_path_factory.mktemp("watched") / "run", meta(best="5"))


@pytest.fixture(scope="module")
def server(run: Path) -> Iterator[WatchServer]:
    made = WatchServer(run)
    thread = threading.Thread(
        target=made.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
    )
    thread.start()
    yield made
    made.shutdown()
    made.server_close()
    thread.join()


def asked(
    server: WatchServer, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, str]:
    """Status and text of an answer; `headers` : with _ for -."""
    line = http.client.HTTPConnection(ADDRESS, server.server_address[1], timeout=300)
    line.request(
        method, path, body, {name.replace("_", "-"): value for name, value in headers.items()}
    )
    answer = line.getresponse()
    text = answer.read().decode()
    line.close()
    return answer.status, text


@pytest.mark.slow
def test_the_state_has_every_fitted_candidate_under_its_parent(run: Path, server: WatchServer):
    status, text = asked(server, "/state")
    state = json.loads(text)
    assert status == 200
    assert state == run_state(run)
    assert {one["step"]: one["parent"] for one in state["nodes"]} == {0: None, 1: 0, 3: 1, 5: 3}
    assert state["best"] == 5
    assert state["nodes"][0]["nrmse"] == evaluated("naive", restarts=0).nrmse
    assert [one[3] for one in state["points"]] == [0, 1, 3, 5]


@pytest.mark.slow
def test_a_candidate_is_shown_with_diagram_fit_and_difference(server: WatchServer):
    status, page = asked(server, "/step/5")
    assert status == 200
    assert "low-pass before the PLL" in page
    assert '<svg class="diagram' in page
    assert re.search(r'<span class="added">\+.*pll_filter', page)
    assert "data-axes" in page  # figures of the fit, with measured dots from the run's own data


def test_what_is_not_there_is_a_sentence(server: WatchServer):
    for path, words in (
        ("/step/99", "there is no step 99"),
        ("/step/2", "no record"),
        ("/../etc/passwd", "nothing here"),
    ):
        status, text = asked(server, path)
        assert status == 404
        assert words in json.loads(text)["error"]


def test_other_names_for_this_machine_and_other_pages_are_refused(server: WatchServer):
    port = server.server_address[1]
    for host in (
        "evil.example",
        f"evil.example:{port}",
        "127.0.0.1.evil.example",
        "",
        f"192.168.0.1:{port}",
    ):
        assert asked(server, "/state", Host=host)[0] == 403, host
    for host in (f"localhost:{port}", f"[::1]:{port}", "127.0.0.1"):
        assert asked(server, "/state", Host=host)[0] == 200, host
    assert asked(server, "/state", Origin="http://evil.example")[0] == 403
    assert asked(server, "/start", "POST", b"x", Origin="null")[0] == 403
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    ("request_line", "headers", "status"),
    [
        ("GET http://[::1 HTTP/1.0", "", 400),
        ("POST /start HTTP/1.0", "Origin: http://[x\r\n", 400),
        ("POST /start HTTP/1.0", "Content-Length: 500\r\n", 400),
        ("POST /start HTTP/1.0", "Content-Length: \xb2\r\n", 413),
        ("POST /start HTTP/1.0", f"Content-Length: {'9' * 5000}\r\n", 413),
    ],
)
def test_what_is_no_address_or_no_length_is_a_sentence(
    request_line, headers, status, server: WatchServer, capsys
):
    with socket.create_connection(server.server_address[:2], timeout=60) as line:
        line.sendall(f"{request_line}\r\nHost: 127.0.0.1\r\n{headers}\r\n".encode("latin-1"))
        line.shutdown(socket.SHUT_WR)
        answer = line.makefile("rb").read()
    assert answer.split()[1] == str(status).encode()
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_a_trial_says_what_it_changed_and_what_was_fitted(run: Path, server: WatchServer):
    status, text = asked(server, "/trials")
    assert status == 200
    table = json.loads(text)
    assert [row["step"] for row in table["rows"]] == [5, 3, 1, 0]
    best, *_, start = table["rows"]
    assert start["difference"] == []
    assert '+ g.add("LPF1", "pll_filter")' in best["difference"]
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    for name, (low, high) in best["parameters"].items():
        values = [point[name] for point in record.parameters.values()]
        assert (low, high) == (min(values), max(values))
    assert table["units"]["pll.kP_pll"] == "rad/s/pu"
    assert table["left_out"] == 0


@pytest.mark.slow
def test_what_is_left_follows_from_the_pace_so_far(tmp_path: Path):
    folder = a_run(tmp_path / "run", meta(seconds="20"))
    assert (run_state(folder)["running"], run_state(folder)["seconds_left"]) == (False, None)
    with Store.open(folder / "archive.sqlite"):  # as a search does
        state = run_state(folder)
    assert (state["running"], state["seconds"]) == (True, 20.0)
    assert state["seconds_left"] == pytest.approx(20.0 / 4 * (40 - 4))


@pytest.mark.slow
def test_several_runs_are_compared(run: Path, tmp_path: Path):
    second = a_run(tmp_path / "second", meta(ending="the budget is spent"), until=3)
    server = WatchServer([run, second])
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        runs = json.loads(asked(server, "/runs")[1])
        assert runs == [run_summary(run), run_summary(second)]
        assert [one["evaluations"] for one in runs] == [4, 3]
        assert runs[1]["best_nrmse"] == evaluated("gfl", restarts=0).nrmse
        assert [evaluation for evaluation, _ in runs[0]["curve"]] == [1, 2, 3, 4]
        assert json.loads(asked(server, "/state?run=1")[1]) == run_state(second)
        for path in ("/state?run=2", "/state?run=-1", "/trials?run=x", f"/state?run={'9' * 500}"):
            assert asked(server, path)[0] == 404, path
        assert 'id="runs"' in asked(server, "/")[1]
    finally:
        server.shutdown()
        server.server_close()


def test_runs_of_one_name_are_told_apart_by_the_folders_above(tmp_path: Path):
    folders = [tmp_path / "dll" / "search", tmp_path / "other" / "search", tmp_path / "third"]
    assert run_names(folders) == ("dll/search", "other/search", "third")
    assert run_names(folders[:1]) == ("search",)
    for folder in folders[:2]:
        folder.parent.mkdir()
    runs = [a_run(folder, meta(), until=2) for folder in folders[:2]]
    server = WatchServer(runs)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        assert [one["name"] for one in json.loads(asked(server, "/runs")[1])] == [
            "dll/search",
            "other/search",
        ]
        assert json.loads(asked(server, "/state?run=1")[1])["name"] == "other/search"
    finally:
        server.shutdown()
        server.server_close()


def test_only_the_page_that_was_served_stops_a_search(tmp_path: Path):
    folder = a_run(tmp_path / "run", meta(), until=-1)
    server = WatchServer(folder)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    own = f"http://127.0.0.1:{server.server_address[1]}"
    (token,) = re.findall(r'name="ibrid-token" content="([^"]+)"', asked(server, "/")[1])
    try:
        with Store.open(folder / "archive.sqlite"):
            for refused in (
                {},
                {"Origin": own},
                {"X_Ibrid_Token": token},
                {"Origin": own, "X_Ibrid_Token": token[:-1]},
                {"Origin": own, "X_Ibrid_Token": "\xe9"},
                {"Origin": "http://evil.example", "X_Ibrid_Token": token},
                {"Origin": "null", "X_Ibrid_Token": token},
            ):
                assert asked(server, "/stop", "POST", **refused)[0] == 403, refused
                assert not run_state(folder)["stopping"]
            assert asked(server, "/stop", Origin=own, X_Ibrid_Token=token)[0] == 404  # a GET
            for _ in range(2):
                assert asked(server, "/stop", "POST", Origin=own, X_Ibrid_Token=token)[0] == 200
            assert run_state(folder)["stopping"]
            assert [path.name for path in folder.iterdir() if "stop" in path.name] == [
                "archive.stop"
            ]
        status, text = asked(server, "/stop", "POST", Origin=own, X_Ibrid_Token=token)
        assert (status, "no search is writing this run" in text) == (409, True)
    finally:
        server.shutdown()
        server.server_close()


#: A page with the table alone, as the live page has it.
TABLE_PAGE = """<!DOCTYPE html><select id="parameter"></select><input id="find">
<span id="counted"></span>
<table id="trials"><thead></thead><tbody></tbody></table><script>%s
window.table = new TrialTable(() => 0);
table.evaluations = new Map([[0, 1], [1, 2], [3, 3]]);
table.show(%s);</script>"""


def test_trials_are_sorted_by_any_column_and_found_by_words(tmp_path: Path):
    base = {"status": "ok", "reason": "", "stable": True, "order": 3, "free": 2, "seconds": 1.0}
    rows = [
        base | {"step": 0, "nrmse": 0.9, "note": "", "proposer": "", "difference": []},
        base
        | {"step": 1, "nrmse": 0.1, "note": "a PLL", "proposer": "rules", "difference": ["+ g"]},
        base | {"step": 3, "nrmse": None, "note": "a limit", "proposer": "llm", "difference": []},
    ]
    values = ({"pll.kP": [60, 60]}, {"pll.kP": [5, 7]}, {})
    rows = [row | {"parameters": known} for row, known in zip(rows, values, strict=True)]
    given = json.dumps({"rows": rows, "units": {"pll.kP": "rad/s/pu"}, "left_out": 2})
    script = (Path(ibrid_search.__file__).parent / "templates" / "watch_table.js").read_text()
    question = """
    const rows = () => [...document.querySelectorAll("tbody tr")];
    const order = () => rows().map((one) => +one.dataset.step), found = [order()];
    const click = (name) => document.querySelector(`button[data-column="${name}"]`).click();
    click("nrmse"); found.push(order());
    click("evaluation"); found.push(order());
    const own = document.getElementById("parameter"), find = document.getElementById("find");
    own.value = "pll.kP"; own.dispatchEvent(new Event("change")); found.push(order());
    found.push(rows()[0].textContent.includes("5 to 7"));
    find.value = "pll a"; find.dispatchEvent(new Event("input")); found.push(order());
    found.push(document.getElementById("counted").textContent);
    return found;
    """
    (found,), console = answers_of([TABLE_PAGE % (script, given)], question, tmp_path)
    assert found[:4] == [[1, 0, 3], [0, 1, 3], [0, 1, 3], [1, 0, 3]]  # without a value: last
    assert found[4:] == [True, [1], "1 of 3 trials; 2 of larger error are not listed"]
    assert not console


@pytest.mark.slow
def test_a_shipped_diagram_that_the_search_began_with_has_no_parent(tmp_path: Path):
    state = run_state(a_run(tmp_path / "run", meta(), shipped=(1,)))
    assert {one["step"]: one["parent"] for one in state["nodes"]} == {0: None, 1: None, 3: 1, 5: 3}


@pytest.mark.slow
def test_nothing_is_written_into_the_run(run: Path, server: WatchServer):
    before = {path: path.read_bytes() for path in run.rglob("*")}
    for path in ("/", "/watch.js", "/watch_table.js", "/state", "/runs", "/trials", "/step/3"):
        assert asked(server, path)[0] == 200
    for method in ("POST", "PUT", "DELETE"):
        assert asked(server, "/state", method, b"x")[0] in (404, 501)
    assert {path: path.read_bytes() for path in run.rglob("*")} == before


@pytest.mark.nightly
def test_a_dropped_file_gets_a_first_answer_and_rubbish_a_sentence(server: WatchServer):
    few = changed(benchmark().without(["p=1,q=-0.3"]), kept=lambda number: slice(None, None, 3))
    status, text = asked(
        server, "/start?name=../../my%20sweep.csv", "POST", sweep_csv(few).encode()
    )
    assert status == 200, text
    told = json.loads(text)
    status, page = asked(server, told["page"])
    assert status == 200
    assert "First answer about my_sweep.csv" in page
    assert not list(Path(server.dropped.name).parent.glob("my*sweep.csv"))
    status, text = asked(server, "/start?name=a.csv", "POST", b"rubbish")
    assert status == 422
    assert "ibrid" in json.loads(text)["error"]
    assert asked(server, "/start?name=a.csv", "POST", b"")[0] == 413


@pytest.mark.slow
@pytest.mark.parametrize("name", ["json.py", "ibrid.py", "sitecustomize.py"])
def test_a_dropped_file_is_never_executed(
    server: WatchServer, tmp_path: Path, monkeypatch, name: str
):
    monkeypatch.setenv(
        "PYTHONPATH", os.environ.get("PYTHONPATH", "") + os.pathsep
    )  # its empty entry is the working folder
    code = f"open({str(tmp_path / 'executed')!r}, 'w')\n"
    status, answer = asked(server, f"/start?name={name}", "POST", code.encode())
    assert (status, f"{name} must be a sweep" in answer) == (422, True)
    assert not (tmp_path / "executed").exists()


def test_a_real_browser_draws_curve_tree_and_the_best_candidate(
    server: WatchServer, tmp_path: Path
):
    browser = next(filter(None, map(shutil.which, _NAMES)), None)
    if browser is None:
        pytest.skip(
            "chromium is not installed, so no page is opened in it; apt-get install chromium"
        )
    options = [
        *_OPTIONS,
        f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=6000",
        "--dump-dom",
    ]
    done = subprocess.run(
        [browser, *options, server.url], capture_output=True, text=True, timeout=600, check=True
    )
    assert done.stdout.count("<circle") == 8  # four in the curve, four in the tree
    assert done.stdout.count('class="edge way"') == 3
    assert "Best so far: evaluation 4" in done.stdout
    assert 'src="/step/5?run=0"' in done.stdout
    assert {"evaluation", "NRMSE"} == set(re.findall(r'class="axis-name"[^>]*>(\w+)<', done.stdout))
    trials = re.findall(r'<tr data-step="(\d+)"', done.stdout)
    assert trials == ["5", "3", "1", "0"]  # the lowest error first
    assert "13 values" in done.stdout
    (height,) = re.findall(r'<iframe[^>]*style="height: (\d+)', done.stdout)
    assert int(height) > 1500  # as tall as the page in it
    assert not [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.slow
def test_ctrl_c_ends_the_command_and_what_is_no_run_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["watch", str(tmp_path)]) == 2
    assert "archive.sqlite" in capsys.readouterr().err
    with pytest.raises(IbridError):
        WatchServer(tmp_path)
    started = subprocess.Popen(
        [sys.executable, "-m", "ibrid", "watch", str(run)], stdout=subprocess.PIPE, text=True
    )
    assert started.stdout is not None
    port = int(re.findall(r"http://127\.0\.0\.1:(\d+)/", started.stdout.readline())[0])
    line = http.client.HTTPConnection(ADDRESS, port, timeout=300)
    line.request("GET", "/")
    assert line.getresponse().status == 200  # it serves, so Ctrl-C finds it serving
    line.close()
    started.send_signal(signal.SIGINT)
    assert started.wait(timeout=300) == 130
    with pytest.raises(ConnectionError):
        http.client.HTTPConnection(ADDRESS, port, timeout=2).request("GET", "/")


# who leaves


def test_a_browser_that_closes_a_connection_is_no_word_on_the_terminal(server: WatchServer, capsys):
    others = threading.active_count()
    for _ in range(5):
        line = socket.create_connection((ADDRESS, server.server_address[1]))
        line.setsockopt(
            socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
        )  # it is reset, not ended
        line.sendall(b"GET /step/5 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        line.close()
    assert asked(server, "/state")[0] == 200
    while threading.active_count() > others:
        time.sleep(0.01)
    assert capsys.readouterr().err == ""


def test_an_answer_that_breaks_off_is_one_sentence(server: WatchServer, capsys):
    try:
        raise ValueError("an odd number")
    except ValueError:
        server.handle_error(None, ("127.0.0.1", 1))
    told = capsys.readouterr().err
    assert told.startswith("ibrid: an answer broke off with ValueError: an odd number")
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    "damage",
    [
        "INSERT OR REPLACE INTO meta VALUES ('best', '\u00b2')",
        "INSERT OR REPLACE INTO meta VALUES ('best', '" + "9" * 5000 + "')",
        "UPDATE meta SET value = replace(value, 'budget = ', 'budget = inf # ') WHERE key = "
        "'settings'",
        "UPDATE meta SET value = replace(value, 'budget = ', 'budget = 1979-05-27 # ') WHERE key = "
        "'settings'",
        "UPDATE steps SET nrmse = 9e999 WHERE nrmse IS NOT NULL",
        'UPDATE steps SET usage = \'{"questions": ' + "9" * 400 + "}'",
    ],
)
def test_numbers_that_no_run_writes_leave_the_page_alive(damage: str, run: Path, tmp_path: Path):
    shutil.copytree(run, tmp_path / "run")
    with closing(sqlite3.connect(tmp_path / "run" / "archive.sqlite")) as archive, archive:
        archive.execute(damage)
    server = WatchServer(tmp_path / "run")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        assert json.loads(asked(server, "/state")[1])["name"] == "run"
    finally:
        server.shutdown()
        server.server_close()
