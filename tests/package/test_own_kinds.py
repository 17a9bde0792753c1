"""`--kinds FILE.py`: the user's own kinds on the command line, and what a file that fails is
told.
"""

import json
from pathlib import Path

import pytest
from collecting import collecting

from ibrid.cli import main
from ibrid.structure import textbook_text

KIND = """
from ibrid import ModuleKind, Range, Signal


def lag(tau):
    return [[-1 / tau]], [[1 / tau]], [[1]], [[0]]


LAG = ModuleKind(
    name="OwnLag", family="dynamic control", law="out = in_ / (1 + tau s)", inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR}, states=("lagged",), state_space=lag, dc_gain=1.0, reference="one's own",
    parameters={"tau": Range(1e-6, 1.0, 1e-3, "s", "time constant", divides=True)},
)
"""
#: What is wrong with a file, and what is said of it.
WRONG = {
    "fails.py": ("x = 1\n1 / 0\n", "fails.py, line 2: it failed with ZeroDivisionError"),
    "leaves.py": ("raise SystemExit(3)\n", "it failed with SystemExit"),
    "empty_of_kinds.py": ("x = 1\n", "no ModuleKind is made in it"),
    "taken.py": (KIND.replace("OwnLag", "LPF1"), "there is a kind LPF1 already"),
    "unsteady.py": (
        KIND.replace("[[1]], [[0]]", "[[float(1)]], [[0 * tau]]").replace("1 / tau", "1"),
        "tau must change",
    ),
    "json.py": (KIND, "a module is called json already"),
}


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "program.py"
    path.write_text(
        textbook_text("gfl_pll_filter_exact").replace('"LPF1"', '"OwnLag"'), encoding="utf-8"
    )
    return str(path)


def test_a_file_of_kinds_is_executed_and_said_so(
    tmp_path: Path, program: str, capsys: pytest.CaptureFixture[str]
):
    for command in (["check", program], ["modules", "OwnLag"]):
        assert main(command) == 2
        assert "has no kind 'OwnLag'" in (told := capsys.readouterr().err)
        assert "one of your own comes with --kinds FILE.py; there are " in told
    file = tmp_path / "own_lag_of_a_test.py"
    file.write_text(KIND, encoding="utf-8")
    assert main(["check", program, "--kinds", str(file)]) == 0
    told = capsys.readouterr()
    assert "legal: 13 modules" in told.out
    assert f"executed {file}, which brings OwnLag" in told.err


@pytest.mark.slow
def test_a_record_with_a_kind_of_ones_own_is_the_model_of_a_gap(tmp_path: Path, program: str):
    kinds, fit = tmp_path / "own_lag_in_a_record.py", tmp_path / "fit.json"
    kinds.write_text(KIND, encoding="utf-8")
    assert (
        main(
            [
                "evaluate",
                program,
                "paper_like",
                "--kinds",
                str(kinds),
                "--restarts",
                "0",
                "--json",
                str(fit),
            ]
        )
        == 0
    )
    assert (
        main(["gap", str(fit), "paper_like", "--kinds", str(kinds), "--out", str(tmp_path / "gap")])
        == 0
    )
    assert (
        json.loads((tmp_path / "gap" / "gap.json").read_text(encoding="utf-8"))["verdict"]
        == "no-gap"
    )


@pytest.mark.slow
def test_a_file_that_fails_gets_one_sentence(
    tmp_path: Path, program: str, capsys: pytest.CaptureFixture[str]
):
    with collecting() as failures:
        for name, (text, sentence) in WRONG.items():
            file = tmp_path / name
            file.write_text(text, encoding="utf-8")
            with failures.case(name):
                assert main(["check", program, "--kinds", str(file)]) == 2
                told = capsys.readouterr().err.strip()
                assert sentence in told
                assert len(told.splitlines()) == 1
                assert "Traceback" not in told


def test_a_client_of_the_tools_brings_no_kinds(capsys: pytest.CaptureFixture[str]):
    assert main(["mcp", "paper_like", "--kinds", "mine.py"]) == 2
    assert "unrecognized arguments: --kinds" in capsys.readouterr().err
