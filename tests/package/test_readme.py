"""The README keeps its word: its Python runs, its commands exist, no blank was left."""

import re
from pathlib import Path

import pytest

from ibrid.cli import main

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_there_is_python_and_no_blank_was_left():
    assert len(BLOCKS) >= 2
    assert "@@" not in README


def test_a_reader_can_read_it_to_the_end():
    assert len(README.splitlines()) <= 130


@pytest.mark.parametrize(
    "block", [BLOCKS[0], *(pytest.param(one, marks=pytest.mark.nightly) for one in BLOCKS[1:])]
)
def test_its_python_runs(block: str, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a run is a folder where the reader works
    exec(compile(block, "README.md", "exec"), {})


@pytest.mark.parametrize(
    "command", sorted(set(re.findall(r"^    ibrid (\w+)", README, re.MULTILINE)))
)
def test_its_commands_exist(command: str, capsys):
    assert main([command, "--help"]) == 0
    assert command in capsys.readouterr().out
