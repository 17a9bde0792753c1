"""The P-theta / Q-V Jacobian and the NFP are those of machines and controls whose closed form is
known.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import evaluated
from jsonschema import Draft202012Validator

import ibrid
from ibrid import cli
from ibrid.analysis.grids.power_jacobian import jacobian_of
from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.schemas import schema

OP = "p=1,q=0.3"


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


def source_behind_reactance(
    e: float, delta: float, x: float, frequency: np.ndarray
) -> tuple[LinearModel, np.ndarray]:
    """A model and its admittance -1/((s/omega_0 + j) X) in dq: a constant voltage e at the angle
    delta behind X, v = 1.
    """
    i = (e * np.exp(1j * delta) - 1.0) / (1j * x)
    s = 2j * np.pi * np.atleast_1d(frequency) / (120 * np.pi)
    z = x * (s[:, None, None] * np.eye(2) + np.array([[0.0, -1.0], [1.0, 0.0]]))
    model = linear_model(evaluated("naive", restarts=0), OP)
    return replace(model, v0=(1.0, 0.0), i0=(float(i.real), float(i.imag))), -np.linalg.inv(z)


def test_a_voltage_source_behind_a_reactance_has_the_power_angle_curve_at_rest():
    e, delta, x = 1.1, 0.35, 0.2
    model, admittance = source_behind_reactance(e, delta, x, np.array([1e-6]))
    # p = e v sin(delta - theta) / x, q = (e v cos(delta - theta) - v^2) / x
    expected = np.array(
        [
            [-e * np.cos(delta) / x, e * np.sin(delta) / x],
            [e * np.sin(delta) / x, (e * np.cos(delta) - 2.0) / x],
        ]
    )
    np.testing.assert_allclose(jacobian_of(admittance, model)[0], expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        [model.p_pcc, model.q_pcc], [e * np.sin(delta) / x, (e * np.cos(delta) - 1) / x]
    )


def test_the_jacobian_is_the_derivative_of_power_about_the_operating_point(record: ibrid.Record):
    found = ibrid.power_jacobian(record, OP, [7.0])
    model = linear_model(record, OP)
    y = record.response(OP, np.array([7.0]))[0]
    v0, i0, h = np.array(model.v0), np.array(model.i0), 1e-6

    def powers(angle: complex, size: complex) -> np.ndarray:
        turned = (1 + size) * (np.cos(angle) * v0 + np.sin(angle) * np.array([-v0[1], v0[0]]))
        i = i0 + y @ (turned - v0)
        return np.array([turned @ i, turned[1] * i[0] - turned[0] * i[1]])

    columns = [
        (powers(*step) - powers(*(-one for one in step))) / (2 * h) for step in ((h, 0.0), (0.0, h))
    ]
    np.testing.assert_allclose(found.matrix[0], np.array(columns).T, rtol=1e-8)


@pytest.mark.slow
def test_controlled_powers_do_not_move_with_the_grid_at_rest():
    # an L filter: p and q are controlled at the PCC itself
    sweep = ibrid.sweep(
        "gfl_l_filter", [OperatingPoint("half", 0.5, 0.1)], np.geomspace(1, 1000, 20)
    )
    fitted = ibrid.evaluate(ibrid.textbook("gfl_l_filter"), sweep)
    found = ibrid.power_jacobian(fitted, "half", [1e-5])
    assert np.abs(found.matrix).max() < 1e-3


@pytest.mark.slow
def test_the_nfp_of_a_droop_is_the_inverse_of_the_droop_at_low_frequencies():
    point = OperatingPoint("half", 0.5, 0.1)
    sweep = ibrid.sweep("gfm_droop", [point], np.geomspace(1, 1000, 20))
    fitted = ibrid.evaluate(ibrid.textbook("gfm_droop"), sweep)
    found = ibrid.power_jacobian(fitted, None, [1e-4])
    droop = fitted.parameters["half"]["p_droop.k"]  # rad/s per unit of the power at the capacitor
    # at the PCC the loss of the line comes on top, R_g d|i|^2: 1 % here
    np.testing.assert_allclose(found.nfp[0].real, 2 * np.pi * sweep.f0_hz / droop, rtol=0.02)
    assert abs(found.nfp[0].imag) < 0.01 * abs(found.nfp[0].real)


@pytest.mark.slow
def test_the_command_writes_what_the_function_says(
    record: ibrid.Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    record.write(tmp_path / "fit.json")
    words = [
        "nfp",
        str(tmp_path / "fit.json"),
        "--freq",
        "1:100:5",
        "--out",
        str(tmp_path / "nfp.csv"),
    ]
    assert cli.main([*words, "--json", str(tmp_path / "nfp.json")]) == 0
    assert cli.main(words) == 0
    told = capsys.readouterr().out
    assert "at p=1,q=0.3" in told
    assert "at p=1,q=-0.3" in told
    answer = json.loads((tmp_path / "nfp.json").read_text())
    assert [
        error.message for error in Draft202012Validator(schema("nfp")).iter_errors(answer)
    ] == []
    assert [one["op"] for one in answer["points"]] == list(record.parameters)
    found = ibrid.power_jacobian(record, OP, np.geomspace(1, 100, 5))
    lines = [
        line for line in (tmp_path / "nfp.csv").read_text().splitlines() if not line.startswith("#")
    ]
    rows = [row for row in csv.DictReader(lines) if row["op"] == OP]
    np.testing.assert_allclose([float(row["nfp_re"]) for row in rows], found.nfp.real, rtol=1e-9)
    np.testing.assert_allclose(
        np.array(answer["points"][0]["q_v"])[:, 1], found.q_v.imag, rtol=1e-9
    )


def test_frequencies_at_or_below_zero_and_unknown_points_are_refused(record: ibrid.Record):
    with pytest.raises(IbridError, match="above 0 Hz"):
        ibrid.power_jacobian(record, OP, [0.0, 1.0])
    with pytest.raises(IbridError, match="choose one"):
        ibrid.power_jacobian(record)


@pytest.mark.slow
def test_it_is_drawn_as_a_figure_or_on_given_axes(record: ibrid.Record):
    figure = pytest.importorskip("matplotlib.figure")
    found = ibrid.power_jacobian(record, OP)
    assert len(found.plot().axes) == 4
    own = figure.Figure().subplots(2)
    assert found.plot(own) is own
    np.testing.assert_allclose(own[0].lines[0].get_ydata(), 20 * np.log10(np.abs(found.nfp)))
    assert len(repr(found)) <= 200
