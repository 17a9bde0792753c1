"""The exported Modelica block is read by independent tools as the same state space."""

# pyright: reportOptionalIterable=false

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from fitted import evaluated
from modelica_readers import without_connectors
from scipy.linalg import expm

from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.export.modelica import INPUT, OUTPUT, identifiers, modelica
from ibrid.export.nonlinear_modelica import nonlinear_modelica

OP = "p=1,q=0.3"


@pytest.fixture(scope="module")
def model() -> LinearModel:
    return linear_model(evaluated("gfl_pll_filter_exact", restarts=0), OP)


@pytest.mark.slow
def test_pymoca_reads_the_matrices(model: LinearModel, tmp_path: Path):
    api = pytest.importorskip(
        "pymoca.backends.casadi.api", reason="pymoca is not installed (pip install pymoca)"
    )
    (tmp_path / "LinearInverter.mo").write_text(without_connectors(modelica(model).decode()))
    read = api.transfer_model(str(tmp_path), "LinearInverter", {"cache": False})
    unknown = [*(one.symbol for one in read.der_states), *(one.symbol for one in read.alg_states)]
    known = [*(one.symbol for one in read.states), *(one.symbol for one in read.inputs)]
    assert [one.symbol.name() for one in read.states] == list(identifiers(model.states))
    assert [one.name() for one in known[-2:]] == ["v_D", "v_Q"]
    equations = ca.vertcat(*read.equations)
    left, right = (
        np.array(ca.DM(ca.evalf(ca.jacobian(equations, ca.vertcat(*some)))))
        for some in (unknown, known)
    )
    found = -np.linalg.solve(left, right)
    np.testing.assert_array_equal(found, np.block([[model.A, model.B], [model.C, model.D]]))


def test_openmodelica_simulates_the_step_response(model: LinearModel, tmp_path: Path):
    omc = shutil.which("omc")
    if omc is None:
        pytest.skip("OpenModelica is not installed (https://openmodelica.org)")
    (tmp_path / "LinearInverter.mo").write_bytes(modelica(model))
    (tmp_path / "Step.mo").write_text(
        "model Step LinearInverter i; equation i.v_D = 0.01; i.v_Q = 0; end Step;"
    )
    (tmp_path / "run.mos").write_text(
        'loadFile("LinearInverter.mo"); loadFile("Step.mo");\n'
        "simulate(Step, stopTime=0.05, numberOfIntervals=50, tolerance=1e-10, "
        'outputFormat="csv");\n'
        "getErrorString();\n"
    )
    done = subprocess.run(
        [omc, "run.mos"], cwd=tmp_path, capture_output=True, text=True, timeout=600
    )
    results = tmp_path / "Step_res.csv"
    assert results.is_file(), done.stdout
    held = np.genfromtxt(results, delimiter=",", names=True, deletechars="")
    v = np.array([0.01, 0.0])
    n = len(model.A)
    both = expm(held["time"][-1] * np.block([[model.A, model.B], [np.zeros((2, n + 2))]]))
    expected = model.C @ both[:n, n:] @ v + model.D @ v
    found = [held[name][-1] for name in held.dtype.names if name in ("i.i_D", "i.i_Q")]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_every_state_is_declared_and_has_one_equation(model: LinearModel):
    text = modelica(model).decode()
    declared = re.findall(r"^  Real (\w+)\(start = 0, fixed = true\)", text, re.MULTILINE)
    derivatives = re.findall(r"^  der\((\w+)\) =", text, re.MULTILINE)
    assert declared == derivatives == list(identifiers(model.states))
    assert text.count(f"  {INPUT} ") == text.count(f"  {OUTPUT} ") == 2


def test_the_files_name_no_library(model: LinearModel):
    texts = [
        modelica(model),
        nonlinear_modelica(evaluated("gfl_pll_filter_exact", restarts=0), OP)[1],
    ]
    for text in (one.decode() for one in texts):
        assert (
            text.count(f"  connector {INPUT} = input Real;")
            == text.count(f"  connector {OUTPUT} = output Real;")
            == 1
        )
        code = re.sub(r'"[^"]*"', '""', text)  # without the texts
        assert "Modelica" not in code
    assert identifiers([INPUT, OUTPUT]) == (f"{INPUT}_", f"{OUTPUT}_")  # no instance hides them


def test_names_become_identifiers_that_differ():
    names = ["pll.angle", "a.b_c", "a_b.c", "der", "1x"]
    assert identifiers(names) == ("pll_angle", "a_b_c", "a_b_c_", "der_", "_1x")


def test_a_name_cannot_end_the_string_it_stands_in(model: LinearModel):
    text = modelica(replace(model, op='noon"; Real evil; "')).decode()
    assert '"inverter at noon_; Real evil; _, written by ibrid"' in text
