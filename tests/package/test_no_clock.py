"""What is written does not depend on a clock: with one that jumps an hour at each reading, every file has the same bytes."""

import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

import ibrid
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.program import program_text

JUMPING = Path(__file__).parents[1] / "helpers" / "jumping_clock"
#: Columns and texts of an archive that say when and how long, for whoever watches a run; everything else is the same too.
TIMES = {"seconds", "started", "refits"}
#: The tools of agents, called as a client would, their answers printed.
TOOLS = """
import json, sys
import ibrid
from ibrid.fit.settings import fit_settings
from ibrid.study import Study
from ibrid_search.logbook import Logbook
from ibrid_search.tool import call_by_name
from ibrid_search.workbench import Workbench

study = Study(ibrid.read_sweep(sys.argv[1]))
bench = Workbench(Logbook(study, fit=fit_settings("low")))
naive = ibrid.program_text(ibrid.textbook("naive"))
for name, arguments in (
    ("show_data", {}), ("list_diagrams", {}), ("evaluate_program", {"program": naive}), ("diagnose", {"step": 0}),
    ("try_programs", {"programs": [naive]}), ("check_grammar", {"program": naive}), ("show_residuals", {"step": 0}),
):
    print(json.dumps(call_by_name(bench.all, name, arguments)))
"""


def few_frequencies(folder: Path) -> Path:
    """A small sweep: what is asked is whether a clock matters, not how well anything fits."""
    lines = benchmarks()["paper_like"].read_text(encoding="utf-8").splitlines()
    heads = [line for line in lines if line.startswith(("#", "op,"))]
    rows = [line for line in lines if line not in heads]
    file = folder / "few.csv"
    file.write_text("\n".join(heads + rows[::3]) + "\n", encoding="utf-8")
    return file


def command(name: str, folder: Path) -> list[str]:
    """The command of that name on small data in the folder."""
    sweep = str(few_frequencies(folder))
    if name == "mcp":
        return [sys.executable, "-c", TOOLS, sweep]
    (folder / "devices").mkdir()
    (folder / "devices" / "one.csv").write_bytes(Path(sweep).read_bytes())
    (folder / "model.py").write_text(program_text(ibrid.textbook("gfl_exact")), encoding="utf-8")
    words = {
        "start": ["start", "few.csv", "--effort", "low", "--out", "out"],
        "gap": ["gap", "model.py", "few.csv", "--effort", "low", "--out", "out"],
        "search": ["search", "few.csv", "--workers", "1", "--budget", "4", "--effort", "low", "--out", "out"],
        "fleet": ["fleet", "devices", "--workers", "1", "--effort", "low", "--out", "out"],
    }
    return [sys.executable, "-m", "ibrid", *words[name]]


def written(name: str, folder: Path, path: list[Path]) -> dict[str, object]:
    """Every file that the command writes, as bytes; of an archive its rows."""
    folder.mkdir()
    asked = command(name, folder)
    where = os.pathsep.join(map(str, [*path, *filter(None, sys.path)]))
    done = subprocess.run(asked, cwd=folder, env={**os.environ, "PYTHONPATH": where}, capture_output=True, check=False)
    assert done.returncode in (0, 3), done.stderr.decode()
    files: dict[str, object] = {"tools": done.stdout} if name == "mcp" else {}
    for file in sorted((folder / "out").glob("*")):
        files[file.name] = rows(file) if file.suffix == ".sqlite" else file.read_bytes()
    return files


def rows(archive: Path) -> list[tuple]:
    with sqlite3.connect(archive) as connection:
        connection.row_factory = sqlite3.Row
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        held = [(table, dict(row)) for table in tables for row in connection.execute(f'SELECT * FROM "{table}"')]
    connection.close()
    return [
        (table, {name: value for name, value in row.items() if name not in TIMES})
        for table, row in held
        if not TIMES & set(map(str, row.values()))
    ]


def test_a_clock_that_jumps_changes_no_byte_of_a_first_answer(tmp_path: Path):
    assert_same_bytes("start", tmp_path)


@pytest.mark.parametrize("name", ["gap", "search", "fleet", "mcp"])
def test_a_clock_that_jumps_changes_no_byte(name: str, tmp_path: Path):
    assert_same_bytes(name, tmp_path)


def assert_same_bytes(name: str, tmp_path: Path) -> None:
    expected = written(name, tmp_path / "steady", [])
    found = written(name, tmp_path / "jumping", [JUMPING])
    assert expected
    assert found.keys() == expected.keys()
    for file, content in expected.items():
        assert found[file] == content, file


def test_the_clock_of_these_tests_jumps():
    read = "import time; a = time.monotonic(); print(time.monotonic() - a)"
    where = os.pathsep.join([str(JUMPING)])
    done = subprocess.run(
        [sys.executable, "-c", read], env={**os.environ, "PYTHONPATH": where}, capture_output=True, check=True
    )
    assert float(done.stdout) >= 3600
