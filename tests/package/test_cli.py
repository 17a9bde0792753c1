"""The command line: what each command answers, its exit status, and one sentence for every wrong
input.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid import benchmarks, cli
from ibrid.commands import vocabulary
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.published import PLANTS
from ibrid.plugins import command
from ibrid.structure.diagrams.library import shipped_names

COMMANDS = ("modules", "check", "sweep", "inspect", "evaluate", "compare", "export", "report")
TRUE_STRUCTURE = "gfl_pll_filter_exact"


@pytest.fixture(scope="module")
def record_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("record") / "fitted.json"
    assert cli.main(["evaluate", TRUE_STRUCTURE, "paper_like", "--json", str(path)]) == 0
    return path


@pytest.fixture
def illegal(tmp_path: Path) -> Path:
    path = tmp_path / "illegal.py"
    path.write_text(
        'def build(g):\n    g.add("LFilter", "plant")\n    g.add("PIx", "loop")\n    '
        'g.connect("v_DQ", "plant.v_on")\n',
        encoding="utf-8",
    )
    return path


def process(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """A real `ibrid` process."""
    return subprocess.run(
        [sys.executable, "-m", "ibrid", *words], text=True, stderr=subprocess.PIPE, **options
    )


# --- help


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["--help"]) == 0
    told = capsys.readouterr().out
    assert all(name in told for name in COMMANDS)


def test_ibrid_alone_shows_its_help_and_is_no_error(capsys):
    assert cli.main([]) == 0
    alone = capsys.readouterr().out
    assert cli.main(["--help"]) == 0
    assert capsys.readouterr().out == alone


def test_the_help_of_search_leaves_models_and_learning_to_helps_of_their_own(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main(["search", "--help"]) == 0
    whole = capsys.readouterr().out
    assert len(whole.splitlines()) <= 100  # two screens of 50 lines
    assert cli.main(["search", "--help-models"]) == 0
    models = capsys.readouterr().out
    assert cli.main(["search", "--help-learning"]) == 0
    learning = capsys.readouterr().out
    assert "--model-cost" in models
    assert "--learn-profile" in learning
    assert "--model-cost" not in whole
    assert "--learn-profile" not in whole


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main([command, "--help"]) == 0
    assert f"usage: ibrid {command}" in capsys.readouterr().out


def test_every_command_has_a_function_that_runs_it():
    tables = tomllib.loads((files("ibrid.commands") / "commands.toml").read_text(encoding="utf-8"))
    places = [table["run"] for name, table in tables.items() if name not in ("words", "shared")]
    assert len(places) == 27
    assert all(callable(command(place)) for place in places)


def test_a_command_of_a_package_that_is_not_installed_is_told():
    with pytest.raises(IbridError, match="needs the package nowhere of ibrid"):
        command("nowhere:file.function")


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from ibrid.cli import main; main(['--help']); "
        "sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'casadi', 'control', 'numba', "
        "'matplotlib')))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_version(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"ibrid {ibrid.__version__}\n"


# --- modules


def test_modules_lists_every_kind_and_marks_the_extended_ones(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["modules"]) == 0
    words = capsys.readouterr().out.split()
    for kind in ibrid.VOCABULARY:
        assert kind.name + ("+" if kind.extended else "") in words


@pytest.mark.slow
@pytest.mark.parametrize("kind", ibrid.VOCABULARY, ids=lambda kind: kind.name)
def test_one_kind_is_told_in_full(kind: ibrid.ModuleKind, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["modules", kind.name]) == 0
    told = capsys.readouterr().out
    assert kind.law in told
    assert kind.reference in told
    assert all(
        name in told for name in (*kind.inputs, *kind.outputs, *kind.states, *kind.parameters)
    )
    assert all(
        box.meaning in told and f"{box.typical:g}" in told for box in kind.parameters.values()
    )


# --- check and compare


def test_what_ships_is_listed_by_the_names_that_commands_take(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["list"]) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 110
    assert cli.main(["list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found) == ["textbook_diagrams", "published_controls", "sweeps", "inverters"]
    assert {*found["textbook_diagrams"], *found["published_controls"]} == set(shipped_names())
    assert set(found["sweeps"]) == set(ibrid.benchmarks())
    assert set(found["inverters"]) == set(PLANTS)
    for names in found.values():
        assert all(name in told and words for name, words in names.items())


def test_check_tells_the_size_of_a_legal_program(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["check", TRUE_STRUCTURE]) == 0
    told = capsys.readouterr().out
    assert told.startswith("legal: 13 modules, ")
    assert "order 13" in told


def test_check_tells_warnings_of_a_legal_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    text = ibrid.program_text(ibrid.textbook("naive"))
    path = tmp_path / "unused.py"
    path.write_text(
        text + '    g.add("Integrator", "idle")\n    g.connect("no_frequency.out", "idle.in_")\n'
    )
    assert cli.main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    assert "legal: 4 modules" in told
    assert "warning: line" in told


def test_check_tells_every_violation_with_its_line(
    illegal: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["check", str(illegal)]) == 2
    told = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"ibrid: {illegal}") for line in told)
    assert any("line 3" in line and "PI" in line for line in told)
    assert any("line 4" in line and "v_in" in line for line in told)


def test_a_program_and_its_text_are_the_same_structure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path, out = tmp_path / "copy.py", tmp_path / "compared.json"
    path.write_text(ibrid.program_text(ibrid.textbook("gfl")), encoding="utf-8")
    assert cli.main(["compare", str(path), "gfl", "--json", str(out)]) == 0
    assert capsys.readouterr().out.strip()
    answer = json.loads(out.read_text())
    assert answer["schema"] == "ibrid.compare/1"
    assert answer["same"] is True


def test_compare_prints_json_alone_when_asked(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["compare", "gfl", "naive", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"] is False


# --- sweep and inspect


def test_a_sweep_is_written_and_can_be_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "swept.csv"
    words = [
        "--op",
        "p=1,q=0.3",
        "--op",
        "p=1,q=-0.3",
        "--freq",
        "5:5000:4",
        "--set",
        "plant.L_F=0.14",
    ]
    assert cli.main(["sweep", "paper_like", *words, "--out", str(path)]) == 0
    assert "4 frequencies at p=1,q=0.3; p=1,q=-0.3" in capsys.readouterr().out
    text = path.read_text(encoding="utf-8")
    assert "--set plant.L_F=0.14" in text
    assert "plant.L_F = 0.14" in text
    assert ibrid.read_sweep(path).names == ("p=1,q=0.3", "p=1,q=-0.3")
    assert cli.main(["inspect", str(path), "--sampling-hz", "8000"]) == 0
    assert "above half the sampling rate" in capsys.readouterr().out


def test_the_shipped_benchmark_is_what_sweep_gives(tmp_path: Path):
    path = tmp_path / "again.csv"
    assert cli.main(["sweep", "paper_like", "--out", str(path)]) == 0
    again, shipped = ibrid.read_sweep(path), ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    for one, other in zip(again.points, shipped.points, strict=True):
        np.testing.assert_allclose(
            one.admittance, other.admittance, rtol=1e-9
        )  # another machine's rounding


def test_noise_repeats_and_seed_reach_the_file(tmp_path: Path):
    noisy = ["--noise-db", "40", "--repeats", "3", "--freq", "5:5000:4"]
    written = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        path = tmp_path / f"{name}.csv"
        assert cli.main(["sweep", "paper_like", *noisy, "--seed", seed, "--out", str(path)]) == 0
        written.append(path.read_text())
    assert written[0] == written[1] != written[2]
    assert ibrid.read_sweep(tmp_path / "a.csv").points[0].repeats is not None


def test_inspect_prints_json_when_asked(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["inspect", "paper_like", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "ibrid.inspection/1"


# --- evaluate, export, report


@pytest.mark.slow
def test_evaluate_shows_the_record_and_writes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out, page = tmp_path / "out.json", tmp_path / "out.html"
    words = [
        "naive",
        "paper_like",
        "--restarts",
        "0",
        "--seed",
        "3",
        "--json",
        str(out),
        "--report",
        str(page),
    ]
    assert cli.main(["evaluate", *words]) == 0
    assert "plant.L_F" in capsys.readouterr().out
    record = ibrid.read_record(out)
    assert record.outcome == "ok"
    assert record.settings["seed"] == 3
    assert page.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html>")


def test_evaluate_prints_only_json_when_asked(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["evaluate", "naive", "paper_like", "--restarts", "0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "ibrid.record/1"


@pytest.mark.slow
def test_the_paper_setting_is_reached_by_options(capsys: pytest.CaptureFixture[str]):
    paper = [
        "--parameters",
        "per-op",
        "--equilibrium",
        "paper",
        "--vocabulary",
        "paper",
        "--restarts",
        "0",
    ]
    assert (
        cli.main(["evaluate", "naive", "paper_like", *paper, "--objective", "relative", "--json"])
        == 0
    )
    settings = json.loads(capsys.readouterr().out)["settings"]
    assert [
        settings[name] for name in ("parameters", "equilibrium", "vocabulary", "objective")
    ] == [
        "per-op",
        "paper",
        "paper",
        "relative",
    ]


def test_a_held_out_point_is_predicted(capsys: pytest.CaptureFixture[str]):
    assert (
        cli.main(
            [
                "evaluate",
                "naive",
                "paper_like",
                "--restarts",
                "0",
                "--holdout-op",
                "p=1,q=-0.3",
                "--json",
            ]
        )
        == 0
    )
    assert list(json.loads(capsys.readouterr().out)["holdout"]) == ["p=1,q=-0.3"]


def test_an_illegal_program_is_a_wrong_input_and_its_record_is_written(
    illegal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out.json"
    assert cli.main(["evaluate", str(illegal), "paper_like", "--json", str(out)]) == 2
    assert all(
        line.startswith(f"ibrid: {illegal}") for line in capsys.readouterr().err.splitlines()
    )
    assert json.loads(out.read_text())["outcome"] == "invalid"


def test_a_gap_whose_effort_is_spent_ends_with_its_own_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ibrid.gap.budget.EXPERIMENTS", {"low": 1})
    out = tmp_path / "gap"
    assert cli.main(["gap", "gfl", "paper_like", "--effort", "low", "--out", str(out)]) == 3
    assert "go on with a higher effort" in " ".join(capsys.readouterr().out.split())
    assert json.loads((out / "gap.json").read_text())["complete"] is False


def test_an_operating_point_that_cannot_exist_is_no_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Of a file it is a wrong input; of a sweep made in Python an answer that failed."""
    frequency = np.array([10.0, 100.0, 1000.0])
    point = PointSweep(
        OperatingPoint("much", 1e6, 0.0), frequency, np.ones((3, 2, 2)) * (1 + 1j) * np.eye(2)
    )
    ibrid.write_sweep(Sweep(points=(point,)), tmp_path / "much.csv")
    assert cli.main(["evaluate", "gfl", str(tmp_path / "much.csv"), "--restarts", "0"]) == 2
    assert "p and q are probably in kW or W" in capsys.readouterr().err
    record = ibrid.evaluate(ibrid.textbook("gfl"), Sweep(points=(point,)), restarts=0)
    assert record.outcome == "failed"
    assert any("check p, q, v and their per-unit base" in reason for reason in record.reasons)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["control-json", "mat", "npz"])
def test_a_record_is_exported(
    record_file: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "model"
    assert (
        cli.main(
            ["export", str(record_file), "--op", "p=1,q=0.3", "--format", name, "--out", str(path)]
        )
        == 0
    )
    assert "13 states at p=1,q=0.3" in capsys.readouterr().out
    assert path.stat().st_size > 1000


@pytest.mark.slow
def test_a_report_is_written_beside_the_record(
    record_file: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["report", str(record_file)]) == 0
    page = record_file.with_suffix(".html")
    assert capsys.readouterr().out.strip() == str(page)
    assert "<svg" in page.read_text(encoding="utf-8") or "data:image" in page.read_text(
        encoding="utf-8"
    )


@pytest.mark.slow
def test_a_folder_with_a_record_gets_its_report(
    record_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "best.json").write_bytes(record_file.read_bytes())
    assert cli.main(["report", str(tmp_path)]) == 0
    assert (tmp_path / "report.html").is_file()


@pytest.mark.slow
def test_a_report_without_its_data_says_so(
    record_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    moved = json.loads(record_file.read_text())
    moved["settings"]["data"] = str(tmp_path / "gone.csv")
    path = tmp_path / "moved.json"
    path.write_text(json.dumps(moved), encoding="utf-8")
    assert cli.main(["report", str(path)]) == 0
    assert "--data" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text there")
def test_a_report_finds_data_whose_name_is_no_text(
    record_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    data = tmp_path / os.fsdecode(b"m\xfcller.csv")
    shutil.copy(benchmarks()["paper_like"], data)
    said = json.loads(record_file.read_text())
    said["settings"]["data"] = f"{tmp_path}/m\\xfcller.csv"  # as a record writes it
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(said), encoding="utf-8")
    assert cli.main(["report", str(path)]) == 0
    assert capsys.readouterr().err == ""
    assert cli.main(["report", str(path), "--data", "paper_like"]) == 0
    assert capsys.readouterr().err == ""


# --- wrong inputs


WRONG = [
    (["evaluat"], "did you mean evaluate"),
    (["--nonsense"], "--nonsense"),
    (["modules", "PIx"], "did you mean PI"),
    (
        ["record", "paper_like", "--event", "dip:1e308", "--out", "FOLDER/x.csv"],
        "must be 0 to 10 of the voltage at rest",
    ),
    (
        ["record", "paper_like", "--event", "dip:0.6", "--rate", "1e308", "--out", "FOLDER/x.csv"],
        "2e+07 samples",
    ),
    (
        ["record", "paper_like", "--event", "dip:0.6", "--angle", "1e308", "--out", "FOLDER/x.csv"],
        "degrees",
    ),
    (["stability", "RECORD", "--scr", "2", "--xr", "1e308"], "(--xr) must be 1e-06 to 1e+09"),
    (["modules", "PI", "LCL"], "LCL"),
    (["check"], "PROGRAM"),
    (["check", "gfll"], "did you mean gfl"),
    (["evaluate", "zzzz", "paper_like"], "for instance gfl"),
    (["check", "FOLDER"], "cannot be read"),
    (["check", "FOLDER/no.py"], "found nothing there"),
    (["check", "FOLDER/none/no.py"], "there is no folder"),
    (["check", "BINARY"], "not UTF-8"),
    (["check", "IMPORTS"], "line 1"),
    (["check", "gfl", "--vocabulary", "papr"], "did you mean paper"),
    (["check", "gfl", "--equilibrium", "exakt"], "did you mean exact"),
    (["check", "x" * 5000], "a program file or a textbook diagram"),
    (["check", "a\0b"], "a program file or a textbook diagram"),
    (["compare", "gfl"], "PROGRAM"),
    (["compare", "gfl", "naive", "--json", "FOLDER"], "is a folder"),
    (["compare", "gfl", "naive", "--json", "FOLDER/none/x.json"], "there is no folder"),
    (["inspect", "paper_lik"], "did you mean paper_like"),
    (["inspect", "FOLDER"], "folder"),
    (["inspect", "BINARY"], "UTF-8"),
    (["inspect", "NAN"], "line 3"),
    (["inspect", "paper_like", "--sampling-hz", "-5"], "must be a positive number"),
    (["sweep", "paper_lik", "--out", "FOLDER/x.csv"], "did you mean paper_like"),
    (["sweep", "paper_like"], "--out"),
    (["sweep", "paper_like", "--out", "FOLDER"], "is a folder"),
    (["sweep", "paper_like", "--out", "FOLDER/none/x.csv"], "there is no folder"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--op", "p=1"], "with both p and q"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--op", "p=9,q=0"], "p=9,q=0"),
    (
        ["sweep", "paper_like", "--out", "FOLDER/x.csv", "--op", "p=1,q=0", "--op", "p=1,q=0"],
        "p=1,q=0",
    ),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--freq", "5:1:3"], "A below B"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--freq", "five"], "A:B:N"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--freq", "-5:100:3"], "both positive"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--set", "plant.L_F"], "name=value"),
    (
        ["sweep", "paper_like", "--out", "FOLDER/x.csv", "--set", "plant.L=0.1"],
        "did you mean plant.L",
    ),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--set", "plant.L_F=-1"], "must be positive"),
    (
        ["sweep", "paper_like", "--out", "FOLDER/x.csv", "--noise-db", "nan"],
        "must be a finite number",
    ),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--repeats", "3"], "noise_db"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--method", "magic"], "linear or time"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--seed", "-1"], "must be a whole number"),
    (["evaluate", "gfl", "paper_like", "--seed", "1_0"], "must be a whole number"),
    (["evaluate", "gfl", "paper_like", "--seed", "１０"], "must be a whole number"),
    (["evaluate", "gfl", "paper_like", "--seed", "1" * 20], "of at most 18 digits"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--set", "plant.L_F=0.1_0"], "a number"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--freq", "1_0:100:9"], "written A:B:N"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--freq", "5:100:٩"], "written A:B:N"),
    (["sweep", "paper_like", "--out", "FOLDER/x.csv", "--op", "p=1_0,q=0"], "is not a number"),
    (["generic", "paper_like", "--out", "g", "--bus", "9" * 20], "must be a bus, 1 to 999999"),
    (["evaluate", "gfl"], "DATA"),
    (["evaluate", "gfl", "paper_like", "--parameters", "sharde"], "did you mean shared"),
    (["evaluate", "gfl", "paper_like", "--equilibrium", "papr"], "did you mean paper"),
    (["evaluate", "gfl", "paper_like", "--vocabulary", "papr"], "did you mean paper"),
    (["evaluate", "gfl", "paper_like", "--objective", "nrsme"], "did you mean nrmse"),
    (["evaluate", "gfl", "paper_like", "--objective", "sigma"], "noise"),
    (["evaluate", "gfl", "paper_like", "--restarts", "-1"], "must be a whole number"),
    (["evaluate", "gfl", "paper_like", "--seconds", "9"], "say --effort low, normal or high"),
    (["gap", "gfl", "paper_like", "--out", "g", "--effort", "much"], "invalid choice: 'much'"),
    (["evaluate", "gfl", "paper_like", "--holdout-op", "p=1"], "did you mean p=1"),
    (["evaluate", "gfl", "paper_like", "--json", "FOLDER/none/x.json"], "there is no folder"),
    (["evaluate", "gfl", "paper_like", "--report", "FOLDER"], "is a folder"),
    (["evaluate", "gfl", "paper_like", "--nonsense"], "see ibrid evaluate --help"),
    (
        ["evaluate", "gfl", "paper_like", "--json", "FOLDER/x", "--report", "FOLDER/../folder/x"],
        "must be two files",
    ),
    (["evaluate", "IMPORTS", "paper_like", "--json", "IMPORTS"], "would overwrite PROGRAM"),
    (["evaluate", "gfl", "NAN", "--report", "NAN"], "would overwrite DATA"),
    (["compare", "gfl", "IMPORTS", "--json", "IMPORTS"], "would overwrite PROGRAM"),
    (["compare", "IMPORTS", "gfl", "--json", "IMPORTS"], "would overwrite PROGRAM"),
    (["compare", "gfl", "gfl", "--json", ""], "give a file name"),
    (["inspect", "NAN", "--json", "NAN"], "would overwrite DATA"),
    (
        ["export", "RECORD", "--op", "p=1,q=0.3", "--format", "mat", "--out", "RECORD"],
        "would overwrite RECORD",
    ),
    (["report", "RECORD", "--out", "RECORD"], "would overwrite RECORD"),
    (["report", "RECORD", "--data", "NAN", "--out", "NAN"], "would overwrite --data"),
    (["export", "RECORD", "--format", "mat", "--out", "FOLDER/m"], "choose one"),
    (
        ["export", "RECORD", "--op", "p=1,q=0.4x", "--format", "mat", "--out", "FOLDER/m"],
        "not a number",
    ),
    (
        ["export", "RECORD", "--op", "p=9,q=0", "--format", "mat", "--out", "FOLDER/m"],
        "no real operating point",
    ),
    (
        ["export", "RECORD", "--op", "p=1,q=0.3", "--format", "matt", "--out", "FOLDER/m"],
        "did you mean mat",
    ),
    (
        ["export", "RECORD", "--op", "p=1,q=0.3", "--format", "mat", "--out", "FOLDER"],
        "is a folder",
    ),
    (["export", "NAN", "--op", "p=1,q=0.3", "--format", "mat", "--out", "FOLDER/m"], "is not JSON"),
    (["export", "FOLDER/none.json", "--format", "mat", "--out", "FOLDER/m"], "cannot be read"),
    (["report", "FOLDER/empty"], "must hold a record"),
    (["report", "FOLDER/none.json"], "cannot be read"),
    (["report", "RECORD", "--out", "FOLDER"], "is a folder"),
    (["report", "RECORD", "--data", "published_feng_50kv"], "did you mean published_feng_50kva"),
]


@pytest.mark.slow
@each_of(
    "words",
    [
        "stability RECORD --scr 2 --json SWEEP",
        "predict RECORD --op p=0.5,q=0 --out SWEEP",
        "report RECORD --out SWEEP",
        "predict RECORD --op p=0.5,q=0 --json SWEEP",
        "next RECORD --json SWEEP",
        "export RECORD --op p=1,q=0.3 --format csv --out SWEEP",
    ],
)
def test_what_a_record_was_made_from_is_never_replaced(words: str):
    with tempfile.TemporaryDirectory() as folder:
        measured, record = Path(folder) / "measured.csv", Path(folder) / "fit.json"
        shutil.copy(benchmarks()["paper_like"], measured)
        before = measured.read_bytes()
        assert (
            cli.main(["evaluate", "naive", str(measured), "--json", str(record), "--restarts", "0"])
            == 0
        )
        named = {"RECORD": str(record), "SWEEP": str(measured)}
        assert cli.main([named.get(word, word) for word in words.split()]) == 2, words
        assert measured.read_bytes() == before


def assert_one_sentence(capsys: pytest.CaptureFixture[str]) -> str:
    told = capsys.readouterr().err
    assert told.startswith("ibrid: ")
    assert told.count("\n") == 1
    assert "Traceback" not in told
    return told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "sentence"), WRONG, ids=[" ".join(words)[:70] for words, _ in WRONG]
)
def test_a_wrong_input_gets_one_sentence(
    words: list[str],
    sentence: str,
    record_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    folder = tmp_path / "folder"
    (folder / "empty").mkdir(parents=True)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "imports.py").write_text("import os\n")
    (tmp_path / "nan.csv").write_text(
        "op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im\n"
        "a,1,0,5,1,0,0,0,0,0,1,0\na,1,0,50,nan,0,0,0,0,0,1,0\n"
    )
    places = {"FOLDER": folder, "BINARY": tmp_path / "binary", "IMPORTS": tmp_path / "imports.py"}
    places |= {"NAN": tmp_path / "nan.csv", "RECORD": record_file}
    real = [
        word
        if (name := word.split("/")[0]) not in places
        else word.replace(name, str(places[name]))
        for word in words
    ]
    capsys.readouterr()
    assert cli.main(real) == 2
    assert sentence in assert_one_sentence(capsys)
    assert [entry.name for entry in folder.iterdir()] == ["empty"], (
        "a refused command writes nothing"
    )


def test_one_measured_frequency_or_point_is_no_obstacle_to_looking(tmp_path: Path):
    path = tmp_path / "one.csv"
    assert (
        cli.main(
            ["sweep", "paper_like", "--op", "p=1,q=0.3", "--freq", "50:50:1", "--out", str(path)]
        )
        == 0
    )
    assert cli.main(["inspect", str(path)]) == 0


@pytest.mark.slow
def test_an_input_is_never_overwritten_through_a_link(record_file: Path, tmp_path: Path):
    link, before = tmp_path / "link.html", record_file.read_bytes()
    link.symlink_to(record_file)
    assert cli.main(["report", str(record_file), "--out", str(link)]) == 2
    assert record_file.read_bytes() == before


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="this system has no /proc")
def test_a_folder_that_refuses_files_is_found_before_the_fit(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["evaluate", "none.py", "paper_like", "--report", "/proc/x.html"]) == 2
    assert "/proc/x.html" in assert_one_sentence(capsys)


@pytest.mark.slow
@pytest.mark.parametrize("value", ["small", None, float("nan"), float("inf"), 10**400], ids=str)
def test_a_record_with_a_damaged_value_is_neither_shown_nor_exported(
    value: object, record_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    damaged, path = json.loads(record_file.read_text()), tmp_path / "damaged.json"
    damaged["parameters"]["p=1,q=0.3"]["plant.L_F"] = value
    path.write_text(json.dumps(damaged), encoding="utf-8")
    export = [
        "export",
        str(path),
        "--op",
        "p=1,q=0.3",
        "--format",
        "mat",
        "--out",
        str(tmp_path / "m"),
    ]
    for words in (["report", str(path)], export):
        capsys.readouterr()
        assert cli.main(words) == 2
        told = assert_one_sentence(capsys)
        assert (
            f"{path}: the record has parameters, p=1,q=0.3, plant.L_F that must be a finite number"
            in told
        )


def test_a_list_of_choices_is_told_once(capsys: pytest.CaptureFixture[str]):
    for option, known in (("--objective", "relative"), ("--parameters", "per-op")):
        assert cli.main(["evaluate", "gfl", "paper_like", option, "zzz"]) == 2
        assert assert_one_sentence(capsys).count(known) == 1


# --- what is not the user's fault, and how a process ends


def test_an_unforeseen_error_is_one_sentence_and_a_traceback_on_demand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def broken(_: object) -> str:
        raise ZeroDivisionError("nothing\nto divide by")

    monkeypatch.setattr(vocabulary, "vocabulary_table", broken)
    monkeypatch.delenv("IBRID_DEBUG", raising=False)
    assert cli.main(["modules"]) == 1
    assert "IBRID_DEBUG=1" in assert_one_sentence(capsys)
    monkeypatch.setenv("IBRID_DEBUG", "1")
    assert cli.main(["modules"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_the_keyboard_stops_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def stopped(_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(vocabulary, "vocabulary_table", stopped)
    assert cli.main(["modules"]) == 130
    assert "stopped" in assert_one_sentence(capsys)


@pytest.mark.slow
def test_a_reader_that_leaves_early_is_no_error():
    reader, writer = os.pipe()
    os.close(reader)
    done = process("modules", stdout=writer)
    os.close(writer)
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs a shell that closes standard output")
@pytest.mark.parametrize("words", ["modules", "--help", "compare gfl gfl --json", "modules PIx"])
def test_a_closed_output_leaves_at_most_one_sentence(words: str):
    command = f'"{sys.executable}" -m ibrid {words} >&-'
    done = subprocess.run(["sh", "-c", command], text=True, stderr=subprocess.PIPE)
    assert "Traceback" not in done.stderr
    assert done.returncode == (2 if words == "modules PIx" else 0)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="this system has no /dev/full")
def test_a_full_disk_is_one_sentence():
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = process("modules", stdout=full)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    done = process("compare", "gfl", "gfl", "--json", "/dev/full", stdout=subprocess.DEVNULL)
    assert done.returncode == 2
    assert "No space left" in done.stderr
    assert Path("/dev/full").is_char_device()


def test_a_working_folder_that_was_deleted_is_one_sentence(
    tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    (gone := tmp_path / "gone").mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert cli.main(["evaluate", "gfl", "paper_like", "--json", "fit.json"]) == 2
    assert (
        "the working folder does not exist any more; change to another one"
        in capsys.readouterr().err
    )


def test_a_device_is_written_to_and_not_replaced(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["compare", "gfl", "gfl", "--json", os.devnull]) == 0
    assert not Path(os.devnull).is_file()
    assert cli.main(["sweep", "paper_like", "--out", os.devnull]) == 2
    assert not Path(os.devnull).is_file()


def test_an_existing_answer_is_replaced_whole_and_nothing_through_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    target.write_text("old")
    link.symlink_to(target)
    assert cli.main(["compare", "gfl", "gfl", "--json", str(link)]) == 2
    assert "found a link" in assert_one_sentence(capsys)
    assert target.read_text() == "old"
    assert cli.main(["compare", "gfl", "gfl", "--json", str(target)]) == 0
    assert json.loads(target.read_text())["same"] is True
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["link.json", "target.json"]


@pytest.mark.parametrize(
    "words",
    [
        ["report", "a" * 300],
        ["watch", "a" * 300],
        ["search", "gfl_l_filter", "--out", "a" * 300],
        ["inspect", "a" * 300],
        ["next", "a" * 300],
        ["fleet", "a" * 300, "--out", "o"],
        ["sweep", "gfl_l_filter", "--out=--"],
        ["search", "gfl_l_filter", "--target=--"],
        ["watch", ".", "--port", "65536"],
        ["watch", ".", "--port", "9" * 400],
        ["record", "gfl_l_filter", "--event", "dip:0.8", "--noise-db=-7000", "--out", "r.csv"],
    ],
)
def test_names_that_no_file_can_have_and_numbers_that_nothing_can_be_are_one_sentence(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == 2
    sentence = assert_one_sentence(capsys)
    assert "Error" not in sentence
    assert not list(tmp_path.iterdir())
