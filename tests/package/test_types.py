"""What a user's type checker knows of the public names, which are imported lazily."""

import ast
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import ibrid_search
import pytest

import ibrid

#: A user's script: every public name, with the type that it must be seen to have.
SCRIPT = """\
from collections.abc import Mapping
from pathlib import Path
from typing import Any, assert_type

import numpy as np

import ibrid
import ibrid_search
from ibrid import FitSettings, IbridError, LargeSignal, ModuleKind, Range, Record, Signal, Sweep
from ibrid.analysis.grids.power_jacobian import PowerJacobian
from ibrid.analysis.models.prediction import Prediction
from ibrid.analysis.models.residuals import Residuals
from ibrid.analysis.grids.stability import Stability
from ibrid.export import NonlinearModel
from ibrid.gap.results.gap import Gap, NamedEffect
from ibrid.generic.answer import GenericAnswer
from ibrid.measurement import Inspection
from ibrid.structure.comparison.compare import Comparison
from ibrid.structure.grammar_rules.violation import Violation

assert_type(ibrid.benchmarks(), Mapping[str, Path])
assert_type(ibrid.examples(), Mapping[str, Path])
data = assert_type(ibrid.read_sweep("file.csv"), Sweep)
assert_type(ibrid.sweep("gfl", None, np.array([50.0])), Sweep)
assert_type(ibrid.measure("DEVICE.toml", ["p=1,q=0"], [50.0]), Sweep)
assert_type(ibrid.add_noise(data, 60.0, rng=np.random.default_rng(0)), Sweep)
assert_type(ibrid.from_frd(object(), p=1.0, q=0.0), Sweep)
assert_type(ibrid.from_system(object(), [50.0], p=1.0, q=0.0), Sweep)
ibrid.write_sweep(data, "file.csv")
ibrid.write_events(assert_type(ibrid.read_events("dip.csv"), ibrid.Events), "dip.csv")
assert_type(ibrid.inspect(data), Inspection)
assert_type(data.names, tuple[str, ...])
assert_type(ibrid.Study.of(data, seed=1), ibrid.Study)

assert_type(ibrid.VOCABULARY + ibrid.PAPER_VOCABULARY, tuple[ModuleKind, ...])
assert_type(ibrid.VOCABULARY[0].parameters, Mapping[str, Range])
assert_type(ibrid.VOCABULARY[0].inputs, Mapping[str, Signal])
assert_type(ibrid.VOCABULARY[0].large_signal, LargeSignal | None)

assert_type(ibrid.textbook_names(), tuple[str, ...])
diagram = assert_type(ibrid.textbook("gfl"), ibrid.Diagram)
assert_type(ibrid.parse_program("..."), ibrid.Diagram)
assert_type(ibrid.read_program("model.py"), ibrid.Diagram)
assert_type(ibrid.program_text(diagram), str)
assert_type(ibrid.structure_hash(diagram), str)
assert_type(ibrid.violations(diagram), tuple[Violation, ...])
assert_type(ibrid.as_diagram("gfl"), ibrid.Diagram)
assert_type(ibrid.as_sweep("paper_like"), Sweep)
assert_type(ibrid.as_events("dip.csv"), ibrid.Events)
assert_type(ibrid.as_record("record.json"), Record)
Saved = Sweep | ibrid.Events | Record | ibrid.Diagram | Mapping[str, Any]
assert_type(ibrid.load("record.json"), Saved)
assert_type(ibrid.compare(diagram, diagram).same, bool)
assert_type(ibrid.compare(diagram, diagram), Comparison)

record = assert_type(ibrid.evaluate(diagram, data, settings=FitSettings()), Record)
assert_type(ibrid.read_record("record.json"), Record)
assert_type(record.nrmse, float | None)
assert_type(ibrid.predict(record, "p=1,q=0", np.array([50.0])), Prediction)
assert_type(ibrid.residuals(record), Residuals)
assert_type(ibrid.generic_model(record), GenericAnswer)
ibrid.plot("paper_like", record)
assert_type(ibrid.stability(record, scr=[1.5, 3.0]), Stability)
assert_type(ibrid.power_jacobian(record, "p=1,q=0"), PowerJacobian)
assert_type(ibrid.nonlinear_model(record), NonlinearModel)
assert_type(ibrid.write_report(record, "page.html"), Path)

assert_type(ibrid.evaluate_events(diagram, ibrid.read_events("dip.csv"), data), Record)
gap = assert_type(ibrid.find_gap(diagram, data), Gap)
assert_type(gap.effects, tuple[NamedEffect, ...])
run = assert_type(ibrid.search(data, "run", settings=ibrid_search.SearchSettings()), ibrid_search.Run)
who = ibrid_search.Proposers("llm", ["m@http://localhost/v1"], limits=ibrid_search.Limits(cost=1.0))
goal, where = ibrid_search.Goal(300, target=0.01), ibrid_search.Workers(2, ray="auto")
assert_type(ibrid.search(ibrid.Study(data), "run", proposer=who, budget=goal, workers=where, seed=1), ibrid_search.Run)
assert_type(run.best, Record | None)
assert issubclass(IbridError, Exception)
"""
#: In the same script, so that a checker that sees no types at all cannot pass.
WRONG = "ibrid.find_gap(data, diagram)\nibrid.nothing\n"
CHECKERS = {
    "pyright": ("--pythonpath", sys.executable),
    "mypy": ("--python-executable", sys.executable, "--cache-dir", "cache", "--no-error-summary"),
}


@pytest.mark.parametrize("package", [ibrid, ibrid_search], ids=lambda package: package.__name__)
def test_checkers_and_python_find_the_same_names(package: ModuleType):
    source = ast.parse(Path(str(package.__file__)).read_text(encoding="utf-8"))
    block = next(node for node in source.body if isinstance(node, ast.If))
    imports = (node for node in block.body if isinstance(node, ast.ImportFrom))
    seen_by_checkers = {alias.name: node.module for node in imports for alias in node.names}
    assert seen_by_checkers == package.HOMES
    assert sorted(package.__all__) == sorted(package.HOMES)
    assert (Path(str(package.__file__)).parent / "py.typed").is_file()


def test_the_script_has_every_public_name():
    for package in (ibrid, ibrid_search):
        lacking = [
            name
            for name in package.__all__
            if not re.search(rf"\b{package.__name__}\.{name}\b|[ ,]{name}\b", SCRIPT)
        ]
        assert not lacking


@pytest.mark.nightly
@pytest.mark.parametrize("checker", CHECKERS)
def test_a_users_script_has_its_types(checker: str, tmp_path: Path):
    """From a folder outside the repository, with the package as it is installed."""
    if find_spec(checker) is None:
        pytest.skip(f"{checker} is not installed: pip install {checker}")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + WRONG, encoding="utf-8")
    command = [sys.executable, "-m", checker, *CHECKERS[checker], script.name]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False
    )
    complaints = [
        line for line in done.stdout.splitlines() if re.search(r"script\.py:\d+:.* error: ", line)
    ]
    last = len((SCRIPT + WRONG).splitlines())
    lines = {int(re.findall(r"script\.py:(\d+)", line)[0]) for line in complaints}
    assert lines == {last - 1, last}, done.stdout + done.stderr
