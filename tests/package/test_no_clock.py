"""What is written does not depend on a clock: with one that jumps an hour at each reading, every
file has the same bytes.
"""

import os
import signal
import sqlite3
import subprocess
import sys
from hashlib import sha256
from math import inf
from pathlib import Path

import pytest
from signalled import signalled
from small_commands import command

from ibrid.own_files import LIST

JUMPING = Path(__file__).parents[1] / "helpers" / "jumping_clock"
#: Columns and texts of an archive that say when and how long, for whoever watches a run; everything
#: else is the same too.
TIMES = {"seconds", "started", "refits"}


def written(
    name: str, folder: Path, path: list[Path], *, paused_after: float = inf
) -> dict[str, object]:
    """Every file that the command writes, as bytes; of an archive its rows.

    paused_after : so many processor seconds.
    """
    folder.mkdir()
    where = os.pathsep.join(map(str, [*path, *filter(None, sys.path)]))
    done = signalled(
        command(name, folder), folder, after=paused_after, number=signal.SIGSTOP, path=where
    )
    assert done.status in (0, 3), done.err
    files: dict[str, object] = {"tools": done.out} if name == "mcp" else {}
    listed = (
        (folder / "out" / LIST).read_text(encoding="utf-8")
        if (folder / "out" / LIST).is_file()
        else ""
    )
    for file in sorted((folder / "out").glob("*")):
        if (
            file.name == LIST
        ):  # answers so far stand in it too, which a clock asks for; what is left there stands in it always
            continue
        if listed and not file.name.startswith("archive"):
            assert sha256(file.read_bytes()).hexdigest() in listed, file.name
        files[file.name] = rows(file) if file.suffix == ".sqlite" else file.read_bytes()
    return files


def rows(archive: Path) -> list[tuple]:
    with sqlite3.connect(archive) as connection:
        connection.row_factory = sqlite3.Row
        tables = [
            name
            for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        ]
        held = [
            (table, dict(row))
            for table in tables
            for row in connection.execute(f'SELECT * FROM "{table}"')
        ]
    connection.close()
    return [
        (table, {name: value for name, value in row.items() if name not in TIMES})
        for table, row in held
        if not TIMES & set(map(str, row.values()))
    ]


@pytest.mark.nightly
def test_a_clock_that_jumps_changes_no_byte_of_a_first_answer(tmp_path: Path):
    assert_same_bytes("start", tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["gap", "search", "fleet", "mcp"])
def test_a_clock_that_jumps_changes_no_byte(name: str, tmp_path: Path):
    assert_same_bytes(name, tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["start", "gap", "search", "fleet"])
def test_a_pause_changes_no_byte(name: str, tmp_path: Path):
    expected = written(name, tmp_path / "steady", [])
    assert_same(written(name, tmp_path / "paused", [], paused_after=3.0), expected)


def assert_same_bytes(name: str, tmp_path: Path) -> None:
    expected = written(name, tmp_path / "steady", [])
    assert_same(written(name, tmp_path / "jumping", [JUMPING]), expected)


def assert_same(found: dict[str, object], expected: dict[str, object]) -> None:
    assert expected
    assert found.keys() == expected.keys()
    for file, content in expected.items():
        assert found[file] == content, file


def test_the_clock_of_these_tests_jumps():
    read = "import time; a = time.monotonic(); print(time.monotonic() - a)"
    where = os.pathsep.join([str(JUMPING)])
    done = subprocess.run(
        [sys.executable, "-c", read],
        env={**os.environ, "PYTHONPATH": where},
        capture_output=True,
        check=True,
    )
    assert float(done.stdout) >= 3600
