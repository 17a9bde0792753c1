"""An exported FMU opens in an independent FMU runner and steps exactly as the state space does."""

import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fitted import evaluated
from scipy.linalg import expm

from ibrid import cli
from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.errors import IbridError
from ibrid.export import compiling
from ibrid.export.fmu import fmu

OP = "p=1,q=0.3"
HAS_COMPILER = any(shutil.which(name) for name in compiling.COMPILERS)
needs_compiler = pytest.mark.skipif(
    not HAS_COMPILER, reason="no C compiler (apt-get install gcc libc6-dev)"
)


@pytest.fixture(scope="module")
def model() -> LinearModel:
    return linear_model(evaluated("gfl_pll_filter_exact", restarts=0), OP)


@pytest.fixture(scope="module")
def path(model: LinearModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "model.fmu"
    path.write_bytes(fmu(model))
    return path


def steps(model: LinearModel, v: np.ndarray, h: float) -> np.ndarray:
    """(K, 2 + n) currents and states at the start of each step of length h with v (K, 2) held; the
    last v is after them.
    """
    n = len(model.A)
    both = expm(h * np.block([[model.A, model.B], [np.zeros((2, n + 2))]]))
    x, found = np.zeros(n), []
    for now in v:
        found.append([*(model.C @ x + model.D @ now), *x])
        x = both[:n, :n] @ x + both[:n, n:] @ now
    return np.array(found)


@pytest.mark.slow
@needs_compiler
def test_the_description_is_valid_and_names_the_variables(model: LinearModel, path: Path):
    validation = pytest.importorskip(
        "fmpy.validation", reason="FMPy is not installed (pip install fmpy)"
    )
    assert validation.validate_fmu(str(path)) == []
    root = ElementTree.fromstring(zipfile.ZipFile(path).read("modelDescription.xml"))
    names = [variable.get("name") for variable in root.iter("ScalarVariable")]
    assert names[:4] == ["v_D", "v_Q", "i_D", "i_Q"]
    assert tuple(names[4 : 4 + len(model.states)]) == model.states


@needs_compiler
def test_held_steps_in_fmpy_are_those_of_the_state_space(model: LinearModel, path: Path):
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed (pip install fmpy)")
    h, count = 1e-3, 60
    time = np.arange(count) * h
    v = np.random.default_rng(2).normal(scale=1e-2, size=(count, 2))
    # each value is written twice, so that the runner, which interpolates, holds it during the step
    rows = [(t, *one) for start, one in zip(time, v, strict=True) for t in (start, start + h)]
    held = np.array(rows, dtype=[("time", float), ("v_D", float), ("v_Q", float)])
    answer = fmpy.simulate_fmu(
        str(path),
        fmi_type="CoSimulation",
        stop_time=float(time[-1]),
        step_size=h,
        output_interval=h,
        input=held,
        output=["i_D", "i_Q", *model.states],
    )
    found = np.array([list(row)[1:] for row in answer])
    expected = steps(model, v, h)
    # the voltage jumps at the samples, so that currents there depend on the side; the states do not
    scale = np.abs(expected[:, 2:]).max(axis=0)
    assert (np.abs(found[:, 2:] - expected[:, 2:]) / scale).max() <= 1e-9


@needs_compiler
def test_the_functions_of_the_binary_give_the_matrices_and_the_steps(
    model: LinearModel, path: Path, tmp_path: Path
):
    fmi2 = pytest.importorskip("fmpy.fmi2", reason="FMPy is not installed (pip install fmpy)")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    guid = str(ElementTree.parse(tmp_path / "modelDescription.xml").getroot().get("guid"))
    one = fmi2.FMU2Slave(
        guid=guid, unzipDirectory=str(tmp_path), modelIdentifier="inverter", instanceName="one"
    )
    one.instantiate()
    one.setupExperiment(startTime=0.0)
    one.enterInitializationMode()
    one.exitInitializationMode()
    n = len(model.states)
    inputs, outputs = [0, 1], [2, 3]
    states, rates = list(range(4, 4 + n)), list(range(4 + n, 4 + 2 * n))

    columns = [
        one.getDirectionalDerivative([*rates, *outputs], [known], [1.0])
        for known in (*states, *inputs)
    ]
    np.testing.assert_array_equal(
        np.array(columns).T, np.block([[model.A, model.B], [model.C, model.D]])
    )

    v, h = np.array([0.01, -0.03]), 2e-4
    expected = steps(model, np.tile(v, (11, 1)), h)
    one.setReal(inputs, v)
    saved = one.getFMUState()
    for _ in range(2):  # the second time from the saved state
        one.setFMUState(saved)
        for k in range(10):
            one.doStep(k * h, h)
        found = np.array(one.getReal([*outputs, *states]))
        np.testing.assert_allclose(found, expected[-1], rtol=1e-9, atol=1e-12)
    one.freeFMUState(saved)

    one.reset()  # a ramp given by its slope: ten steps of it are one long one
    one.setReal(inputs, [0.0, 0.0])
    for k in range(10):
        one.setRealInputDerivatives(inputs, [1, 1], [1.0, -2.0])
        one.doStep(k * h, h)
    ten = np.array(one.getReal([*inputs, *states]))
    one.reset()
    one.setRealInputDerivatives(inputs, [1, 1], [1.0, -2.0])
    one.doStep(0.0, 10 * h)
    np.testing.assert_allclose(ten, one.getReal([*inputs, *states]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ten[:2], [10 * h, -20 * h], rtol=1e-12)
    with pytest.raises(Exception, match="fmi2DoStep"):
        one.doStep(0.0, -1.0)
    one.terminate()
    one.freeInstance()


@needs_compiler
def test_model_exchange_in_fmpy_gives_the_step_response(model: LinearModel, path: Path):
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed (pip install fmpy)")
    jump = np.array(
        [(0.0, 0.01, 0.0), (1.0, 0.01, 0.0)],
        dtype=[("time", float), ("v_D", float), ("v_Q", float)],
    )
    answer = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=0.02,
        output_interval=2e-3,
        relative_tolerance=1e-10,
        input=jump,
        output=["i_D", "i_Q"],
        set_input_derivatives=False,
    )
    found = np.array([list(row)[1:] for row in answer])
    expected = steps(model, np.tile([0.01, 0.0], (11, 1)), 2e-3)[:, :2]
    # FMPy integrates with CVODE at the asked tolerance, absolute per state, so the outputs agree
    # less closely
    assert np.abs(found[-1] - expected[-1]).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.slow
@needs_compiler
def test_the_zip_carries_its_sources_and_no_date(model: LinearModel, path: Path):
    archive = zipfile.ZipFile(path)
    assert {"modelDescription.xml", "sources/fmi2.c", "sources/inverter.c"} <= set(
        archive.namelist()
    )
    assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert fmu(model) == path.read_bytes()


@pytest.mark.slow
@needs_compiler
def test_the_sources_compile_without_a_warning_also_with_a_prefix(path: Path, tmp_path: Path):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    compiler = next(filter(None, map(shutil.which, compiling.COMPILERS)))
    for more in ([], ["-DFMI2_FUNCTION_PREFIX=inverter_"]):
        command = [
            compiler,
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-pedantic",
            *more,
            "-c",
            "fmi2.c",
            "-o",
            "fmi2.o",
        ]
        done = subprocess.run(command, cwd=tmp_path / "sources", capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


def test_without_a_compiler_the_answer_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(compiling.shutil, "which", lambda name: None)
    evaluated("gfl_pll_filter_exact", restarts=0).write(tmp_path / "fit.json")
    words = [
        "export",
        str(tmp_path / "fit.json"),
        "--op",
        OP,
        "--format",
        "fmu",
        "--out",
        str(tmp_path / "m.fmu"),
    ]
    assert cli.main(words) == 2
    assert "needs a C compiler" in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["fit.json"]


@needs_compiler
def test_sources_that_do_not_compile_are_one_sentence():
    with pytest.raises(IbridError, match="must compile the exported model; it says"):
        compiling.shared_library({"main.c": b"int main(void) { return nothing; }"}, "main.c")


def test_a_platform_without_a_name_in_fmi_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compiling.platform, "machine", lambda: "riscv64")
    monkeypatch.setattr(compiling.sys, "platform", "linux")
    with pytest.raises(IbridError, match="linux on riscv64"):
        compiling.fmi_platform()
