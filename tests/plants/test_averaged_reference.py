"""The averaged model of every reference inverter beside its own nonlinear equations, which were
written independently.
"""

import casadi as ca
import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.analysis.models.linear_model import linear_model
from ibrid.evaluation.evaluate import record_at
from ibrid.export import NonlinearModel, nonlinear_model
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.plants.published import BEYOND, PLANTS
from ibrid.plants.sweeping import operating_point

NAMES = [plant.name for plant in BEYOND]
OP, ELSEWHERE = "p=1,q=0.3", "p=0.6,q=-0.1,v=1.03"
GRID = np.linspace(0.002, 0.06, 30)
OPTIONS = {"abstol": 1e-12, "reltol": 1e-10}


def true_record(name: str) -> ibrid.Record:
    """The textbook program at its true parameters."""
    plant = PLANTS[name]
    return record_at(
        ibrid.parse_program(plant.program),
        ibrid.read_sweep(ibrid.benchmarks()[name]),
        plant.diagram_values,
    )


def currents(model: NonlinearModel, v: np.ndarray) -> np.ndarray:
    """i (2, K) after the voltage jumps to v at time zero."""
    move = ca.integrator("move", "cvodes", model.dae(ca.SX(v)), 0.0, GRID, OPTIONS)
    return np.array(model.h(move(x0=model.x0)["xf"], ca.DM(0, 1), v, model.r0))


def reference_currents(name: str, op: str, v: np.ndarray) -> np.ndarray:
    """The same of the reference inverter, its set-points held."""
    plant = PLANTS[name]
    resting = plant.at_rest(operating_point(op))
    x = ca.SX.sym("x", len(resting.x))
    problem = {"x": x, "ode": plant.dynamics.f(x, v, resting.r)}
    move = ca.integrator("other", "cvodes", problem, 0.0, GRID, OPTIONS)
    return np.array(plant.dynamics.g(move(x0=resting.x)["xf"], v))


@pytest.mark.nightly
@each_of("name", NAMES)
@each_of("op", [OP, ELSEWHERE])
def test_it_rests_at_the_operating_point_and_its_linearisation_is_the_record(name: str, op: str):
    record = true_record(name)
    model, linear = nonlinear_model(record, op), linear_model(record, op)
    assert model.states == linear.states
    assert np.abs(np.array(model.f(model.x0, model.z0, model.v0, model.r0))).max() < 1e-9
    for found, wanted in zip(
        model.linearised(), (linear.A, linear.B, linear.C, linear.D), strict=True
    ):
        np.testing.assert_allclose(
            found, wanted, rtol=0, atol=1e-8 * max(np.abs(wanted).max(), 1e-6)
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_voltage_jump_moves_it_as_the_reference_inverter(name: str):
    model, jump = nonlinear_model(true_record(name), OP), np.array([-0.1, 0.05])
    found = currents(model, model.v0 + jump)
    # two integrations at 1e-10
    np.testing.assert_allclose(
        found, reference_currents(name, OP, model.v0 + jump), rtol=0, atol=1e-6
    )
    assert np.abs(found[:, -1] - model.i0).max() > 1e-2


@pytest.mark.slow
def test_two_devices_behind_one_pcc_rest_where_their_shares_put_them():
    record, plant = true_record("parallel_gfl_gfm"), PLANTS["parallel_gfl_gfm"]
    model = nonlinear_model(record, OP)
    np.testing.assert_allclose(model.v0 @ model.i0, 1.0, atol=1e-10)
    held = dict(zip(model.references, model.r0, strict=True))
    share = plant.diagram_values
    # set-points of the grid-following device: its part of p and of q at the PCC
    assert held["gfl_p_loop.in_"] == pytest.approx(share["gfl_share.share_p"] * 1.0, abs=1e-10)
    assert held["gfl_q_loop.in_"] == pytest.approx(-share["gfl_share.share_q"] * 0.3, abs=1e-10)


@pytest.mark.slow
def test_two_devices_are_one_block_of_modelica():
    model, text = nonlinear_modelica(true_record("parallel_gfl_gfm"), OP)
    written = text.decode()
    assert written.count("block Inverter ") == 1
    assert "i_D = gfl_park_i.i_DQ[1] + gfm_park_i.i_DQ[1];" in written
    assert len(model.states) == 23
