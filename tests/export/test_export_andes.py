"""The module for ANDES 2 is plain Python, and in ANDES an inverter at an infinite bus has the poles
of our own algebra.
"""

import ast
import json
import os
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from fitted import evaluated
from ibrid_bench.attack.names import payloads

import ibrid
from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.export import export
from ibrid.export.andes import andes

OP = "p=1,q=0.3"
GRID = (0.02, 0.2)  # r, x of the line, per unit on 100 MVA

#: Runs in a process of its own: ANDES keeps its generated code in the home folder and logs to the
#: screen.
SCRIPT = """
import json, andes, east
andes.config_logger(50)
system = andes.System(default_config=True, no_output=True)
east.add_to(system)
for number in (1, 2):
    system.add("Bus", dict(idx=number, name=str(number), Vn=20))
system.add("Line", dict(idx="L", bus1=1, bus2=2, r={r}, x={x}, Vn1=20, Vn2=20))
system.add("Slack", dict(idx="S", bus=1, v0={v_grid}, a0=0.0, Vn=20))
system.add("PV", dict(idx="G", bus=2, p0=east.P_PCC * {rating} / 100, v0=east.V0_D, Vn=20))
system.add("east", dict(idx="E", bus=2, gen="G", Sn={rating}))
system.setup()
assert system.PFlow.run()
q = float(system.PV.q.v[0])
system.TDS.config.no_tqdm = 1
system.TDS.init()
assert system.TDS.initialized
assert system.EIG.run()
mu = system.EIG.mu
json.dump({{"q": q, "mu": [[float(one.real), float(one.imag)] for one in mu]}}, open("answer.json", "w"))
"""


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


def quasi_static_poles(model: LinearModel, rating: float) -> np.ndarray:
    """Poles behind v = v_grid + (r + j x) i, all on the rating: (A + B (I - Z D)^-1 Z C)."""
    r, x = (one * rating / 100 for one in GRID)
    z = np.array([[r, -x], [x, r]])
    return np.linalg.eigvals(
        model.A + model.B @ np.linalg.solve(np.eye(2) - z @ model.D, z @ model.C)
    )


@pytest.mark.nightly
def test_in_andes_the_poles_at_an_infinite_bus_are_those_of_the_matrices(
    record: ibrid.Record, tmp_path: Path
):
    if find_spec("andes") is None:
        pytest.skip("ANDES is not installed (pip install 'ibrid[consumers]')")
    rating = 50.0
    model = export(record, tmp_path / "east.py", "andes", OP, name="east")
    i = complex(*model.i0) * rating / 100
    v_grid = abs(complex(*model.v0) - complex(*GRID) * i)
    text = SCRIPT.format(r=GRID[0], x=GRID[1], v_grid=v_grid, rating=rating)
    (tmp_path / "run.py").write_text(text, encoding="utf-8")
    (tmp_path / "home").mkdir()
    home = {**os.environ, "HOME": str(tmp_path / "home")}
    done = subprocess.run(
        [sys.executable, "run.py"], cwd=tmp_path, env=home, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert answer["q"] == pytest.approx(
        model.q_pcc * rating / 100, abs=1e-6
    )  # the load flow finds our operating point
    found = np.array([complex(*one) for one in answer["mu"]])
    expected = quasi_static_poles(model, rating)
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-5 * abs(pole)  # load flow to 1e-6
    assert len(found) == len(expected)


def test_the_module_is_python_whatever_its_names_say(record: ibrid.Record):
    model = linear_model(record, OP)
    for name in payloads("RAN", seed=7)[::9]:
        hostile = replace(
            model,
            name=name,
            op=name,
            power_node=name,
            states=tuple(f"{name}{k}" for k in range(13)),
        )
        tree = ast.parse(andes(hostile))
        kinds = [type(one).__name__ for one in tree.body]
        assert kinds == [type(one).__name__ for one in ast.parse(andes(model)).body], name
        assert not [one for one in ast.walk(tree) if isinstance(one, ast.Import)], name


def test_the_module_says_where_the_terminals_rest(record: ibrid.Record, tmp_path: Path):
    model = export(record, tmp_path / "m.py", "andes", OP, name="east")
    tree = ast.parse((tmp_path / "m.py").read_text(encoding="utf-8"))
    told = {
        one.targets[0].id: ast.literal_eval(one.value)
        for one in tree.body
        if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name)
    }
    assert {name.upper(): value for name, value in model.at_rest().items()}.items() <= told.items()
    assert len(told["STATES"]) == len(told["RATES"]) == len(model.states)
    assert {one.name for one in tree.body if isinstance(one, ast.ClassDef)} == {"eastData", "east"}
