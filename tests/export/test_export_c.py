"""The exported C source compiles without a warning and moves exactly as the state space does."""

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from fitted import evaluated

from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.export.c_source import c_source

OP = "p=1,q=0.3"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (apt-get install gcc libc6-dev)"
)


class CompiledModel:
    """The functions of an exported C source, through ctypes."""

    def __init__(self, model: LinearModel, folder: Path) -> None:
        (folder / "model.c").write_bytes(c_source(model))
        command = [
            str(COMPILER),
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-pedantic",
            "-Wconversion",
            "-O2",
            "-fPIC",
            "-shared",
        ]
        done = subprocess.run(
            [*command, "model.c", "-o", "model.so", "-lm"],
            cwd=folder,
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stderr) == (0, "")
        self.library = ctypes.CDLL(str(folder / "model.so"))
        n = len(model.states)
        self.memory = (ctypes.c_double * (n + 1 + n * n + 4 * n))()
        self.states = n

    def set_step(self, step: float) -> int:
        return self.library.inverter_set_step(self.memory, ctypes.c_double(step))

    def output(self, v: np.ndarray) -> np.ndarray:
        current = (ctypes.c_double * 2)()
        self.library.inverter_output(self.memory, (ctypes.c_double * 2)(*v), current)
        return np.array(current[:])

    def step(self, before: np.ndarray, after: np.ndarray) -> None:
        self.library.inverter_step(
            self.memory, (ctypes.c_double * 2)(*before), (ctypes.c_double * 2)(*after)
        )

    def run(self, v: np.ndarray) -> np.ndarray:
        """i (K, 2) at each sample of v (K, 2), straight lines between them."""
        currents = []
        for k, now in enumerate(v):
            currents.append(self.output(now))
            self.step(now, v[min(k + 1, len(v) - 1)])
        return np.array(currents)


@pytest.fixture(params=["gfl_pll_filter_exact", "gfl_delay"])
def model(request: pytest.FixtureRequest) -> LinearModel:
    return linear_model(evaluated(request.param, restarts=0), OP)


def voltage(count: int) -> np.ndarray:
    """(K, 2) a rough voltage with both axes."""
    return np.random.default_rng(1).normal(scale=1e-2, size=(count, 2))


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("step", [1e-5, 1e-3])
def test_the_compiled_model_moves_as_the_state_space_does(
    model: LinearModel, step: float, tmp_path: Path
):
    compiled, v = CompiledModel(model, tmp_path), voltage(200)
    assert compiled.set_step(step) == 0
    system = control.StateSpace(model.A, model.B, model.C, model.D)
    # forced_response takes straight lines between the samples too, by a matrix exponential of its
    # own
    expected = control.forced_response(system, np.arange(200) * step, v.T).outputs.T
    np.testing.assert_allclose(
        compiled.run(v), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.slow
@needs_compiler
def test_two_half_steps_are_one_step(model: LinearModel, tmp_path: Path):
    compiled, held = CompiledModel(model, tmp_path), np.array([0.01, -0.02])
    found = []
    for step, count in ((2e-3, 5), (1e-3, 10)):
        assert compiled.set_step(step) == 0
        compiled.library.inverter_reset(compiled.memory)
        for _ in range(count):
            compiled.step(held, held)
        found.append(compiled.output(held))
    np.testing.assert_allclose(*found, rtol=1e-9)


@pytest.mark.slow
@needs_compiler
def test_a_step_that_is_none_is_refused(model: LinearModel, tmp_path: Path):
    compiled = CompiledModel(model, tmp_path)
    assert [compiled.set_step(step) for step in (0.0, -1e-3, float("nan"), float("inf"))] == [
        -1,
        -1,
        -1,
        -1,
    ]


@pytest.mark.slow
@needs_compiler
def test_a_step_in_which_an_unstable_model_overflows_is_refused(model: LinearModel, tmp_path: Path):
    growing = replace(model, A=model.A + 1e4 * np.eye(len(model.A)))
    assert CompiledModel(growing, tmp_path).set_step(1.0) == -1


@pytest.mark.slow
def test_the_source_names_states_units_and_operating_point(model: LinearModel):
    text = c_source(model).decode()
    assert all(f'"{state}"' in text for state in model.states)
    assert "per unit" in text
    assert "p = 1.0, q = 0.3 at the capacitor" in text
    assert max(len(line) for line in text.split("*/")[0].splitlines()) <= 120


@pytest.mark.slow
def test_text_in_comments_cannot_end_them(model: LinearModel):
    text = c_source(replace(model, op="p=1 */ int evil; /* ??/")).decode()
    assert "*/ int evil" not in text
    assert "??" not in text
