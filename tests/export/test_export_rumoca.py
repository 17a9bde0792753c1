"""rumoca, a Modelica compiler, takes the exported files as they are and finds in them what the
record says.
"""

import re
from pathlib import Path

import casadi
import numpy as np
import pytest
from given_records import NAMES, given_record

from ibrid.analysis.models.linear_model import without_dust
from ibrid.export import LinearModel, export, nonlinear_model

rumoca = pytest.importorskip(
    "rumoca",
    reason="rumoca, a Modelica compiler, is not installed (pip install 'ibrid[consumers]')",
)

OP = "p=1,q=0.3"


def matrices(text: str, model: LinearModel) -> list[np.ndarray]:
    """A, B, C, D as rumoca evaluates them: copies of the block, each with one state or one input at
    1.
    """
    states = re.findall(r"^  der\((\w+)\) =", text, re.MULTILINE)
    unit = [f"{one}(start = 1), v_D = 0, v_Q = 0" for one in states] + [
        "v_D = 1, v_Q = 0",
        "v_D = 0, v_Q = 1",
    ]
    copies = [f"  LinearInverter c{k}({changes});" for k, changes in enumerate(unit)]
    rates = [f"  Real c{k}_{one} = der(c{k}.{one});" for k in range(len(unit)) for one in states]
    text += "\n".join(["model Unit", *copies, *rates, "equation", "end Unit;", ""])
    answer = rumoca.Session().loads(text, model="Unit").simulate(t=(0.0, 1e-9), dt=1e-9)
    rows = [[answer[f"c{k}_{one}"][0] for k in range(len(unit))] for one in states]
    rows += [[answer[f"c{k}.{one}"][0] for k in range(len(unit))] for one in model.outputs]
    upper, lower = np.split(np.array(rows), [len(states)])
    return [part for row in (upper, lower) for part in np.split(row, [len(states)], axis=1)]


@pytest.mark.slow
def test_rumoca_compiles_the_block_with_the_matrices_of_the_record(tmp_path: Path):
    record = given_record("paper_like")
    model = export(record, tmp_path / "Inv_A.mo", "modelica", OP)
    read = rumoca.Session().load(str(tmp_path / "Inv_A.mo"))
    assert (read.inputs.names, read.outputs.names) == (["v_D", "v_Q"], ["i_D", "i_Q"])
    assert [one.description for one in read.states] == [
        f"{name}, deviation" for name in model.states
    ]
    assert {one.name: one.value for one in read.parameters} == model.at_rest()
    system = record.state_space(OP)
    for part, found in zip(
        "ABCD", matrices((tmp_path / "Inv_A.mo").read_text(), model), strict=True
    ):
        np.testing.assert_array_equal(
            found, getattr(without_dust(model), part)
        )  # numbers carry all their digits
        largest = np.abs(getattr(system, part)).max()
        np.testing.assert_allclose(
            found, getattr(system, part), rtol=0, atol=1e-14 * largest
        )  # rounding is left out


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_in_rumoca_a_nonlinear_model_rests_and_then_follows_a_sag(name: str, tmp_path: Path):
    record = given_record(name)
    export(record, tmp_path / "Inv_A.mo", "modelica", OP, nonlinear=True)
    read = rumoca.Session().load(str(tmp_path / "Inv_A.mo"), model="NonlinearInverter.Inverter")
    assert (read.inputs.names, read.outputs.names[:2]) == (["v_D", "v_Q"], ["i_D", "i_Q"])
    moving, tight = (
        nonlinear_model(record, OP),
        rumoca.SimConfig(rtol=1e-10, atol=1e-12, solver="bdf"),
    )

    def currents(v_d: float) -> np.ndarray:
        text = (
            f"model Held NonlinearInverter.Inverter inverter(v_D = {float(v_d)!r}, v_Q = 0); end "
            "Held;"
        )
        held = rumoca.Session().loads((tmp_path / "Inv_A.mo").read_text() + text, model="Held")
        answer = held.simulate(t=(0.0, 0.02), dt=1e-3, config=tight)
        return np.column_stack([answer["inverter.i_D"], answer["inverter.i_Q"]])

    # the values at rest have all their digits, and there is nothing to integrate
    np.testing.assert_allclose(
        currents(moving.v0[0]), np.tile(moving.i0, (21, 1)), rtol=0, atol=1e-10
    )
    v = np.array([0.9 * moving.v0[0], 0.0])
    move = casadi.integrator(
        "move", "idas", moving.dae(casadi.SX(v)), 0, 0.02, {"abstol": 1e-12, "reltol": 1e-10}
    )
    end = move(x0=moving.x0, z0=moving.z0)
    expected = np.array(moving.h(end["xf"], end["zf"], v, moving.r0)).ravel()
    # both integrate with a relative tolerance of 1e-10 a step
    np.testing.assert_allclose(currents(v[0])[-1], expected, rtol=0, atol=1e-7)
    assert np.abs(expected - moving.i0).max() > 1e-2
