"""Whatever a name says, what every exporter writes is compiled, loaded and read as if it had said
"noon".
"""

import ast
import ctypes
import json
import re
import shutil
import subprocess
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_bench.attack.names import payloads, reachable
from ibrid_search.run.run_folder import read_run_toml, run_toml
from page_reader import self_contained

from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.evaluation.record import Record
from ibrid.export import formats
from ibrid.export.c_source import c_source
from ibrid.export.fmu import fmu
from ibrid.export.modelica import INPUT, OUTPUT, modelica
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.measurement.formats.touchstone import write_touchstone
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.pages.page import report_html

ROOT = Path(__file__).resolve().parents[2]
OP = "p=1,q=0.3"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (apt-get install gcc libc6-dev)"
)


@pytest.fixture(scope="module")
def record() -> Record:
    return evaluated("naive", restarts=0)


@pytest.fixture(scope="module")
def model(record: Record) -> LinearModel:
    return linear_model(record, OP)


def named(model: LinearModel, name: str, others: list[str]) -> LinearModel:
    """The model with hostile names everywhere that a record of others may have them."""
    return replace(
        model,
        name=name,
        op=name,
        power_node=name,
        states=tuple(f"{name}{number}" for number in range(len(model.states))),
        parameters={other: float(number) for number, other in enumerate(others)},
        pade_orders={name: 3},
    )


def renamed(record: Record, name: str) -> Record:
    """The record with its first operating point under another name."""
    data = json.dumps(record.to_json()).replace(json.dumps(OP)[1:-1], json.dumps(name)[1:-1])
    return Record.from_json(json.loads(data))


@pytest.mark.slow
@needs_compiler
def test_no_name_runs_in_a_compiled_c_source(model: LinearModel, tmp_path: Path):
    names = payloads("RAN")
    for number in range(0, len(names), 8):
        name, *others = names[number : number + 8]
        (tmp_path / "model.c").write_bytes(c_source(named(model, name, others)))
        library = tmp_path / f"model{number}.so"
        command = [
            str(COMPILER),
            "-std=c99",
            "-trigraphs",
            "-w",
            "-fPIC",
            "-shared",
            "model.c",
            "-o",
            library.name,
            "-lm",
        ]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, (name, others, done.stderr)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            ctypes.CDLL(str(library))
        assert not (tmp_path / "RAN").exists(), f"code ran: {name!r}, {others}"


@pytest.mark.slow
@needs_compiler
def test_no_name_runs_in_an_fmu_and_its_description_stays_whole(model: LinearModel, tmp_path: Path):
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed (pip install lxml)")
    names = payloads("RAN", seed=1)
    for number in range(0, len(names), 40):
        path = tmp_path / f"model{number}.fmu"
        path.write_bytes(fmu(named(model, names[number], names[number : number + 40])))
        with zipfile.ZipFile(path) as archive:
            archive.extractall(tmp_path / path.stem)
            tree = etree.fromstring(archive.read("modelDescription.xml"))
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            for library in (tmp_path / path.stem / "binaries").rglob("inverter.*"):
                ctypes.CDLL(str(library))
        assert not (tmp_path / "RAN").exists(), names[number : number + 40]
        assert len(tree.findall(".//ScalarVariable")) == 4 + 2 * len(model.states) + len(
            model.at_rest()
        )
        assert not tree.findall(".//script")


@pytest.mark.slow
def test_modelica_with_any_name_is_one_block(model: LinearModel, record: Record):
    parser = pytest.importorskip(
        "pymoca.parser", reason="pymoca is not installed (pip install pymoca)"
    )
    names = payloads("RAN", seed=2)
    for number, name in enumerate(names):
        text = modelica(named(model, name, names[number : number + 3])).decode()
        strings = [line.count('"') % 2 for line in text.splitlines()]
        assert not any(strings), name
        assert set(re.findall(r"</?(\w*)", text.split("info = ")[1])) == {"html", "p"}, name
        if number % 10 == 0:
            block = parser.parse(text).classes["LinearInverter"]
            assert set(block.classes) == {INPUT, OUTPUT}
            assert {one for one in block.symbols if not one.startswith("_")} >= {
                "v_D",
                "v_Q",
                "i_D",
                "i_Q",
            }
    for name in filter(reachable, names[:40:4]):
        text = nonlinear_modelica(renamed(record, name), name)[1].decode()
        assert "Inverter" in parser.parse(text).classes["NonlinearInverter"].classes, name


@pytest.mark.slow
def test_text_and_binary_files_give_every_reachable_name_back(record: Record, tmp_path: Path):
    scipy_io = pytest.importorskip("scipy.io")
    sweep = benchmark()
    for name in filter(reachable, payloads("RAN", seed=3)):
        point = replace(sweep.points[0], op=replace(sweep.points[0].op, name=name))
        written: Sweep = replace(
            sweep, points=(point,), notes=(name, f"# current: in {name}", "current: in")
        )
        path = tmp_path / "sweep.csv"
        path.write_text(sweep_csv(written, header=(name,)), encoding="utf-8")
        read = read_sweep(path)
        assert (read.names, len(read.points)) == ((name,), 1)
        np.testing.assert_array_equal(read.points[0].admittance, point.admittance)
        write_touchstone(written, tmp_path / "sweep.s2p", name)
        assert read_sweep(tmp_path / "sweep.s2p").points[0].op.p == point.op.p
        told = replace(linear_model(record, OP), op=name)
        assert json.loads(formats.FORMATS["control-json"](told))["operating_point"]["name"] == name
        (tmp_path / "model.mat").write_bytes(formats.FORMATS["mat"](told))
        assert scipy_io.loadmat(tmp_path / "model.mat")["op"].item() == name
        (tmp_path / "model.npz").write_bytes(formats.FORMATS["npz"](told))
        assert np.load(tmp_path / "model.npz", allow_pickle=False)["op"].item() == name


@pytest.mark.slow
def test_options_of_a_run_are_read_back_whatever_they_are_called():
    for name in payloads("RAN", seed=4)[::5]:
        told = name.encode(errors="replace").decode()
        read = read_run_toml(
            run_toml({"data": name, name: 1, "prices": {name: [name, 2.0]}}), "run.toml"
        )
        del read["versions"]
        assert read == {"data": told, told: 1, "prices": {told: [told, 2.0]}}


@pytest.mark.slow
def test_pages_have_the_same_elements_whatever_an_operating_point_is_called(record: Record):
    wanted = Counter(tag for tag, _ in self_contained(report_html(renamed(record, "noon"))).tags)
    for name in filter(reachable, payloads("RAN", seed=5)[:100:30]):
        page = self_contained(report_html(renamed(record, name)))
        # a long name takes more lines in a drawing
        changed = {
            tag
            for tag in wanted | Counter(t for t, _ in page.tags)
            if tag not in ("path", "g", "use", "defs", "tspan", "text")
        }
        found = Counter(tag for tag, _ in page.tags)
        assert {tag: found[tag] for tag in changed} == {tag: wanted[tag] for tag in changed}, name


def test_every_function_that_writes_source_from_a_model_sees_the_names_of_its_language():
    by_library = {"control_json", "mat_file", "npz_file", "fmu", "admittance"}
    bare = []
    for path in sorted((ROOT / "ibrid" / "export").glob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not isinstance(node, ast.FunctionDef) or node.name in by_library:
                continue
            takes_model = any(
                "LinearModel" in ast.dump(one.annotation)
                for one in node.args.args
                if one.annotation
            )
            gives_bytes = node.returns is not None and ast.unparse(node.returns) == "bytes"
            worded = any(ast.unparse(one).startswith("written_in(") for one in node.decorator_list)
            if takes_model and gives_bytes and not worded:
                bare.append(f"{path.name}: {node.name}")
    assert not bare, f"decorate with written_in (ibrid/export/names.py): {bare}"
