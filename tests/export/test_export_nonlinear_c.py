"""The nonlinear model as C, FMU and library of the IEEE/CIGRE interface moves as an independent
integrator says.
"""

import ctypes
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import casadi
import numpy as np
import pytest
from fitted import benchmark, evaluated

import ibrid
from ibrid import cli
from ibrid.analysis.models.linear_model import linear_model
from ibrid.errors import IbridError
from ibrid.export import export
from ibrid.export.formats import files_of_cigre
from ibrid.export.nonlinear_c import nonlinear_c
from ibrid.export.nonlinear_model import NonlinearModel, nonlinear_model

OP = "p=1,q=0.3"
HOST = Path(__file__).resolve().parents[1] / "helpers" / "tb958_host.c"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (apt-get install gcc libc6-dev)"
)
needs_dlopen = pytest.mark.skipif(
    sys.platform == "win32", reason="the host of the tests loads libraries with dlopen"
)


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


def compiled(source: bytes, folder: Path, name: str = "inverter") -> ctypes.CDLL:
    (folder / "model.c").write_bytes(source)
    command = [
        str(COMPILER),
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "-O1",
        "-fPIC",
        "-shared",
    ]
    subprocess.run([*command, "model.c", "-o", f"{name}.so", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / f"{name}.so"))


def currents(model: NonlinearModel, since: np.ndarray, sag: float) -> np.ndarray:
    """(K, 2) i_D, i_Q at times since v_D fell from its rest to `sag` of it, by CVODES."""
    v = np.array([model.v0[0] * sag, 0.0])
    tight = {"abstol": 1e-12, "reltol": 1e-11}
    first = 1e-9 if since[0] == 0 else 0.0  # at once: the states are where they were
    move = casadi.integrator(
        "move", "cvodes", model.dae(casadi.SX(v)), 0.0, list(since + first), tight
    )
    states = np.array(move(x0=model.x0)["xf"]).T
    return np.array([np.array(model.h(x, [], v, model.r0)).ravel() for x in states])


@pytest.mark.nightly
@needs_compiler
@pytest.mark.parametrize("name", ["gfl_pll_filter_exact", "gfm_droop", "gfl_dc_link", "gfl_delay"])
def test_compiled_steps_after_a_sag_are_those_of_cvodes(name: str, tmp_path: Path):
    fitted = evaluated(name, restarts=0)
    model, moving = linear_model(fitted, OP), nonlinear_model(fitted, OP)
    library = compiled(nonlinear_c(model, moving, "east"), tmp_path)
    memory = (ctypes.c_double * (len(model.states) + len(moving.references) + 4))()
    current, pair = (ctypes.c_double * 2)(), ctypes.c_double * 2
    library.east_reset(memory)
    library.east_output(memory, pair(*moving.v0), current)
    np.testing.assert_allclose(
        current[:], model.i0, rtol=0, atol=1e-12
    )  # rest is the terminals' operating point
    assert library.east_set_step(memory, ctypes.c_double(5e-4)) == 0
    assert [
        library.east_set_step(memory, ctypes.c_double(one))
        for one in (0.0, -1.0, float("nan"), 1e9)
    ] == [-1] * 4
    found, v = [], pair(0.9 * moving.v0[0], 0.0)
    for _ in range(41):
        library.east_output(memory, v, current)
        found.append(current[:])
        library.east_step(memory, v, v)
    expected = currents(moving, np.arange(41) * 5e-4, 0.9)
    # Runge-Kutta in parts of an eighth of the fastest mode
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5 * np.abs(expected).max())


@needs_compiler
def test_the_tangent_of_the_compiled_model_is_the_linear_model(
    record: ibrid.Record, tmp_path: Path
):
    model, moving = linear_model(record, OP), nonlinear_model(record, OP)
    library = compiled(nonlinear_c(model, moving), tmp_path)
    n = len(model.states)
    memory = (ctypes.c_double * (n + len(moving.references) + 4))()
    library.inverter_reset(memory)
    columns = []
    for k in range(n + 2):
        seed = np.eye(n + 2)[k]
        dx, di = (ctypes.c_double * n)(), (ctypes.c_double * 2)()
        x_seed, v_seed = (ctypes.c_double * n)(*seed[:n]), (ctypes.c_double * 2)(*seed[n:])
        library.inverter_tangent(memory, (ctypes.c_double * 2)(*moving.v0), x_seed, v_seed, dx, di)
        columns.append([*dx, *di])
    expected = np.block([[model.A, model.B], [model.C, model.D]])
    np.testing.assert_allclose(
        np.array(columns).T, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.nightly
@needs_compiler
def test_nonlinear_models_of_other_families_compile_without_a_warning(tmp_path: Path):
    for name in ("gfm_dvoc", "gfl_trap", "gfl_l_filter_delay"):
        fitted = evaluated(name, restarts=0)
        (tmp_path / f"{name}.c").write_bytes(
            nonlinear_c(linear_model(fitted, OP), nonlinear_model(fitted, OP), name)
        )
        command = [
            str(COMPILER),
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-pedantic",
            "-Werror",
            "-c",
            f"{name}.c",
        ]
        subprocess.run(command, cwd=tmp_path, check=True)


@pytest.mark.slow
@needs_compiler
def test_a_nonlinear_fmu_in_fmpy_rests_and_then_follows_a_sag(record: ibrid.Record, tmp_path: Path):
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed (pip install fmpy)")
    validation = pytest.importorskip("fmpy.validation")
    path = tmp_path / "n.fmu"
    model = export(record, path, "fmu", OP, name="east", nonlinear=True)
    assert validation.validate_fmu(str(path)) == []
    jump = np.array(
        [(0.0, 1.0, 0.0), (0.01, 1.0, 0.0), (0.01, 0.9, 0.0), (1.0, 0.9, 0.0)],
        dtype=[("time", float), ("v_D", float), ("v_Q", float)],
    )
    answer = fmpy.simulate_fmu(
        str(path),
        fmi_type="CoSimulation",
        stop_time=0.02,
        step_size=5e-4,
        output_interval=5e-4,
        input=jump,
        output=["i_D", "i_Q"],
    )
    np.testing.assert_allclose([answer["i_D"][3], answer["i_Q"][3]], model.i0, rtol=0, atol=1e-9)
    expected = currents(nonlinear_model(record, OP), np.array([0.01]), 0.9)
    assert (
        abs(answer["i_D"][-1] - expected[-1, 0]) < 1e-3 * np.abs(expected).max()
    )  # FMPy ramps the jump within a step


def host(folder: Path) -> Path:
    """The small EMT program, compiled."""
    command = [
        str(COMPILER),
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-O1",
        str(HOST),
        "-o",
        "host",
        "-lm",
        "-ldl",
    ]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "host"


def abc(dq: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(K, 3) phases of (K, 2) by the inverse Park transform, amplitude-invariant, q leading."""
    turned = (dq[:, 0] + 1j * dq[:, 1]) * np.exp(1j * theta)
    return np.stack([(turned * np.exp(-2j * np.pi * k / 3)).real for k in range(3)], axis=1)


@pytest.mark.slow
@needs_compiler
@needs_dlopen
def test_a_host_of_the_brochure_sees_the_sag_in_the_three_phases(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    sweep = replace(benchmark(), s_base_va=2e6, v_base_v=690.0)
    fitted = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep, restarts=0)
    fitted.write(tmp_path / "fit.json")
    words = [
        "export",
        str(tmp_path / "fit.json"),
        "--op",
        OP,
        "--format",
        "cigre",
        "--name",
        "east",
    ]
    assert cli.main([*words, "--out", str(tmp_path / "east.so")]) == 0
    assert "nonlinear" in capsys.readouterr().out
    assert (tmp_path / "east.c").is_file()
    step, theta = 2e-5, 0.4
    ran = [str(host(tmp_path)), str(tmp_path / "east.so"), "1000", str(step), "0.9", str(theta)]
    first, *lines = subprocess.run(
        ran, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert first.split() == ["east", "3", "3", "1", "1e-05", "kV", "kA"]
    found = np.array([line.split() for line in lines], dtype=float)
    base, times = 2e6 / (1.5 * 690.0 * np.sqrt(2 / 3)) / 1e3, np.arange(1001) * step
    moving, every = nonlinear_model(fitted, OP), slice(500, None, 25)
    at_rest = abc(np.tile(moving.i0, (500, 1)), 120 * np.pi * times[:500] + theta)
    np.testing.assert_allclose(found[:500], base * at_rest, rtol=0, atol=1e-9 * base)
    # a straight line within the one step in which the host's voltage jumps is a jump in its middle,
    # to second order
    after = currents(moving, times[every] - times[500] + step / 2, 0.9)
    expected = base * abc(after, 120 * np.pi * times[every] + theta)
    assert np.abs(found[every] - expected)[1:].max() < 2e-4 * np.abs(expected).max()


@pytest.mark.slow
@needs_compiler
@needs_dlopen
def test_a_host_with_impossible_parameters_is_told_so(record: ibrid.Record, tmp_path: Path):
    export(record, tmp_path / "m.c", "cigre", OP)
    ran = [str(host(tmp_path)), str(tmp_path / "m.so"), "1", "1e-5", "1", "nan"]
    done = subprocess.run(ran, capture_output=True, text=True)
    assert done.returncode == 2
    assert "must be above 0" in done.stderr


def test_source_and_library_lie_beside_each_other():
    found = [
        [str(one) for one in files_of_cigre(Path(name), ".so")]
        for name in ("a.c", "a.so", "a.dll", "a")
    ]
    assert found == [["a.c", "a.so"], ["a.c", "a.so"], ["a.c", "a.dll"], ["a.c", "a"]]


@pytest.mark.slow
def test_a_library_for_windows_needs_ziglang_and_says_so(
    record: ibrid.Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ibrid.export.compiling.find_spec", lambda name: None)
    monkeypatch.setattr("ibrid.export.compiling.sys.platform", "linux")
    for format in ("fmu", "cigre"):
        with pytest.raises(IbridError, match="pip install ziglang"):
            export(record, tmp_path / "m", format, OP, windows=True)
    with pytest.raises(IbridError, match="leave --windows out"):
        export(record, tmp_path / "m", "c", OP, windows=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("ziglang") is None,
    reason="ziglang, which compiles for Windows, is not installed (pip install 'ibrid[consumers]')",
)
def test_fmu_and_library_for_windows_are_dlls(record: ibrid.Record, tmp_path: Path):
    export(record, tmp_path / "m.fmu", "fmu", OP, windows=True)
    export(record, tmp_path / "m.dll", "cigre", OP)
    inside = ZipFile(tmp_path / "m.fmu")
    assert "binaries/linux64/inverter.so" in inside.namelist() or sys.platform != "linux"
    for content in (inside.read("binaries/win64/inverter.dll"), (tmp_path / "m.dll").read_bytes()):
        assert content[:2] == b"MZ"
        assert b"fmi2DoStep" in content or b"Model_Outputs" in content
