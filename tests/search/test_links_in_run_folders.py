"""A run folder of others is worked on within it: what its links lead to is neither read nor
written.
"""

import ast
from pathlib import Path

import pytest
from ibrid_search.report.page import write_run_page
from ibrid_search.run.database import Database
from ibrid_search.run.run_folder import (
    ARCHIVE,
    BESIDE_ARCHIVE,
    BEST_PROGRAM,
    BEST_RECORD,
    PAGE,
    RUN_TOML,
    SELECTION,
    TRAJECTORY,
)
from made_run import a_run, meta

import ibrid
from ibrid import cli
from ibrid.gap.results.files import FILES

ROOT = Path(__file__).resolve().parents[2]
NAMES = (
    ARCHIVE,
    RUN_TOML,
    BEST_PROGRAM,
    BEST_RECORD,
    TRAJECTORY,
    SELECTION,
    PAGE,
    *BESIDE_ARCHIVE,
    "archive.sqlite-journal",
    "archive.lock-journal",
)
#: Those that a search is run again for.
LONG = (RUN_TOML, BEST_PROGRAM, BEST_RECORD, TRAJECTORY, SELECTION, PAGE)
#: Where files of run and gap folders are named.
OWNERS = (
    "search/ibrid_search/run/run_folder.py",
    "search/ibrid_search/running.py",
    "search/ibrid_search/report/page.py",
    "search/ibrid_search/report/run_data.py",
    "ibrid/gap/results/files.py",
    "ibrid/commands/gap.py",
    "ibrid/commands/results.py",
    "search/policy/ibrid_policy/learning/learner.py",
    "search/policy/ibrid_policy/learning/choose.py",
)
PRECIOUS = b"precious"


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    path = tmp_path / "precious"
    path.write_bytes(PRECIOUS)
    return path


def said(words: list[str], capsys: pytest.CaptureFixture) -> str:
    """What a command that is refused says."""
    capsys.readouterr()
    assert cli.main(words) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    return text


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=pytest.mark.nightly if one in LONG else ()) for one in NAMES]
)
def test_no_file_of_a_run_is_a_way_out(
    name: str, tmp_path: Path, precious: Path, capsys: pytest.CaptureFixture
):
    folder = a_run(tmp_path / "run", meta())
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(precious)
    search = [
        "search",
        "paper_like",
        "--out",
        str(folder),
        "--budget",
        "1",
        "--workers",
        "1",
        "--proposer",
        "rules",
    ]
    assert "found a link" in said([*search, "--resume"], capsys)
    said(search, capsys)
    if name in (ARCHIVE, PAGE, *BESIDE_ARCHIVE):
        assert "found a link" in said(["report", str(folder)], capsys)
    assert precious.read_bytes() == PRECIOUS


@pytest.mark.parametrize("name", FILES)
def test_no_file_of_a_gap_folder_is_a_way_out(
    name: str, tmp_path: Path, precious: Path, capsys: pytest.CaptureFixture
):
    (tmp_path / "gap").mkdir()
    (tmp_path / "gap" / name).symlink_to(precious)
    assert "found a link" in said(
        ["gap", "naive", "paper_like", "--out", str(tmp_path / "gap")], capsys
    )
    assert precious.read_bytes() == PRECIOUS


@pytest.mark.slow
def test_a_folder_and_a_page_of_the_user_may_be_links(tmp_path: Path):
    a_run(tmp_path / "run", meta())
    (tmp_path / "link").symlink_to(tmp_path / "run")
    (tmp_path / "page").symlink_to(tmp_path / "there.html")
    write_run_page(tmp_path / "link", tmp_path / "page")
    assert (tmp_path / "page").is_symlink()
    assert (tmp_path / "there.html").is_file()


def test_a_journal_that_names_a_file_elsewhere_deletes_nothing(tmp_path: Path, precious: Path):
    folder = a_run(tmp_path / "run", meta())
    name = str(precious).encode()
    # https://www.sqlite.org/fileformat.html#the_rollback_journal, the end of a journal with a
    # super-journal
    (folder / "archive.sqlite-journal").write_bytes(
        b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
        + bytes(504)
        + bytes(4)
        + name
        + len(name).to_bytes(4, "big")
        + sum(name).to_bytes(4, "big")
        + b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
    )
    with pytest.raises(ibrid.IbridError, match="names a file elsewhere"):
        Database.open(folder / ARCHIVE, 1, read_only=False)
    assert precious.exists()


@pytest.mark.parametrize("name", ["archive.sqlite-journal", "archive.lock-journal"])
def test_a_file_that_sqlite_would_take_for_its_journal_is_not_deleted(tmp_path: Path, name: str):
    folder = a_run(tmp_path / "run", meta())
    (folder / name).write_text("my own words")
    with pytest.raises(ibrid.IbridError, match="is no journal of a run"):
        Database.open(folder / ARCHIVE, 1, read_only=False)
    assert (folder / name).read_text() == "my own words"


def test_every_file_of_such_a_folder_is_named_in_one_way():
    for name in OWNERS:
        for node in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                text = ast.unparse(node)
                shown_or_removed = text in ("folder / name", "folder / PROGRAM")
                where = f"{name} line {node.lineno}: {text}; say inside(...) of ibrid.writing"
                assert shown_or_removed or not text.startswith(
                    ("folder /", "run /", "path.parent /")
                ), where


def test_sqlite_keeps_to_the_names_that_are_looked_at(tmp_path: Path):
    path = tmp_path / "archive.sqlite"
    with Database.create(path, 1, [("CREATE TABLE t (x)", ())]).transaction():
        there = {file.name for file in tmp_path.iterdir()}
    assert there == {"archive.sqlite", *BESIDE_ARCHIVE, "archive.lock-journal"}
