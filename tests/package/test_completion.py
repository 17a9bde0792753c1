"""`ibrid --completion SHELL`: a shell that sources it completes commands, options and files."""

import shutil
import subprocess
from pathlib import Path

import pytest

from ibrid.cli import main

#: Words before the cursor, and what is offered.
OFFERED = {
    "st": "start stability",
    "search --bud": "--budget",
    "search --effort ": "low normal high",
    "inspect sca": "scan.csv",
}


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes_commands_options_values_and_files(tmp_path: Path, capsys):
    assert main(["--completion", "bash"]) == 0
    (tmp_path / "completion").write_text(capsys.readouterr().out)
    (tmp_path / "scan.csv").touch()
    for typed, offered in OFFERED.items():
        words = ["ibrid", *typed.split(" ")]
        line = " ".join(f"'{word}'" for word in words)
        script = (
            f"source completion; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
            '_shtab_ibrid; echo "${COMPREPLY[@]}"'
        )
        told = subprocess.run(
            ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        assert told.stdout.strip() == offered, (typed, told.stderr)


def test_other_shells_are_served_or_refused(capsys):
    assert main(["--completion", "zsh"]) == 0
    assert capsys.readouterr().out.startswith("#compdef ibrid")
    assert main(["--completion", "fish"]) == 2
    assert "choose from 'bash', 'zsh', 'tcsh'" in capsys.readouterr().err
