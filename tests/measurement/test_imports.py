"""Models of other tools come in as measurements: python-control systems, and state spaces that were
exported.
"""

import json
import re
from pathlib import Path

import control
import numpy as np
import pytest
from fitted import benchmark, evaluated

import ibrid
from ibrid import cli
from ibrid.errors import SweepError
from ibrid.export import export
from ibrid.measurement.formats.frd import MODEL_GRID, from_frd, from_system
from ibrid.plants.sweeping import frequency_grid

OP = "p=1,q=0.3"
POINT = {"p": 1.0, "q": 0.3, "op": OP}
FREQUENCY = np.geomspace(5.0, 5000.0, 16)


@pytest.fixture(scope="module")
def system() -> control.StateSpace:
    """The benchmark's device as a state space."""
    return evaluated("gfl_pll_filter_exact").state_space(OP)


def test_a_spreadsheet_is_read_as_the_command_reads_it(tmp_path: Path):
    scan = str(ibrid.examples()["scan.xlsx"])
    with pytest.raises(SweepError, match='add base="S_VA,V_LL"'):
        ibrid.read_sweep(scan)
    said = {"base": "50kVA,690V", "f0_hz": 60, "voltage_axis": "d"}
    sweep = ibrid.read_sweep(scan, **said)
    out = str(tmp_path / "sweep.csv")
    options = [f"--{key.replace('_', '-')}={value}" for key, value in said.items()]
    assert cli.main(["import", scan, *options, "--out", out]) == 0
    np.testing.assert_allclose(sweep.points[0].Y, ibrid.read_sweep(out).points[0].Y, rtol=1e-12)
    assert "mind: current: out, as the highest frequencies show" in sweep.notes


def test_records_read_as_a_sweep_name_the_function_that_reads_them():
    with pytest.raises(SweepError, match=r"read them with ibrid\.read_events"):
        ibrid.read_sweep(ibrid.examples()["fault.csv"])


def test_a_state_space_is_the_measurement_that_it_would_give(system: control.StateSpace):
    truth = benchmark().point(OP)
    (point,) = from_system(system, truth.frequency, **POINT).points
    # a fit of clean data, and rounding in a 13-state solve
    np.testing.assert_allclose(point.admittance, truth.admittance, rtol=0, atol=1e-6)
    assert point.op == truth.op


def test_a_transfer_function_and_an_frd_give_the_same(system: control.StateSpace):
    s = control.tf("s")
    entries = [[1 / (s + 10), 2 / (s + 20)], [-2 / (s + 20), 1 / (s + 10)]]
    function = control.combine_tf(entries)
    first = from_system(function, FREQUENCY, **POINT).points[0]
    jw = 2j * np.pi * FREQUENCY
    np.testing.assert_allclose(first.admittance[:, 0, 1], 2 / (jw + 20), rtol=1e-12)
    data = control.frd(system, 2 * np.pi * FREQUENCY)
    expected = from_system(system, FREQUENCY, **POINT).points[0].admittance
    for sweep in (from_frd(data, **POINT), from_system(data, **POINT)):
        np.testing.assert_allclose(sweep.points[0].admittance, expected, rtol=1e-12)


def test_a_sampled_model_is_read_up_to_half_its_rate():
    period = 1e-4
    lag = control.ss([[0.9]], [[0.1]], [[1.0]], [[0.0]], period)
    both = control.append(lag, lag)
    (point,) = from_system(both, FREQUENCY, **POINT).points
    z = np.exp(2j * np.pi * FREQUENCY * period)
    np.testing.assert_allclose(point.admittance[:, 0, 0], 0.1 / (z - 0.9), rtol=1e-12)
    with pytest.raises(SweepError, match="sampled at 10000 Hz"):
        from_system(both, [6000.0], **POINT)
    with pytest.raises(SweepError, match="sampling period"):
        from_system(
            control.append(*[control.ss([[0.9]], [[0.1]], [[1.0]], [[0.0]], True)] * 2),
            FREQUENCY,
            **POINT,
        )


def test_conventions_of_a_model_can_be_stated(system: control.StateSpace):
    ours = from_system(system, FREQUENCY, **POINT).points[0].admittance
    into = from_system(-1 * system, FREQUENCY, current="in", **POINT).points[0].admittance
    np.testing.assert_allclose(into, ours, rtol=1e-12)


def test_an_imported_model_is_identified(system: control.StateSpace):
    record = ibrid.evaluate(
        ibrid.textbook("gfl_pll_filter_exact"), from_system(system, FREQUENCY, **POINT)
    )
    assert record.nrmse < 1e-9  # the same structure, no noise


@pytest.mark.parametrize(
    ("made", "options", "sentence"),
    [
        (lambda: 3, {}, "python-control model; found int"),
        (lambda: control.tf([1], [1, 1]), {}, "two inputs and two outputs; found 1 and 1"),
        (
            lambda: control.append(*[control.tf([1], [1, 1])] * 2),
            {"frequency": [-1.0]},
            "must be positive",
        ),
        (
            lambda: control.append(*[control.tf([1], [1, 1])] * 2),
            {"op_name": "x"},
            "op_name is not something",
        ),
        (
            lambda: control.frd(np.ones((2, 2, 3)), [1, 2, 3]),
            {"frequency": [1.0]},
            "its own frequencies",
        ),
    ],
)
def test_what_is_no_model_is_refused_in_a_sentence(made, options, sentence: str):
    with pytest.raises(SweepError, match=sentence):
        from_system(made(), **{**POINT, **options})


def test_a_model_without_a_finite_response_is_refused():
    resonant = control.ss(
        [[0, 2 * np.pi * 50], [-2 * np.pi * 50, 0]], np.eye(2), np.eye(2), np.zeros((2, 2))
    )
    with pytest.raises(SweepError, match="finite"):
        from_system(resonant, [50.0], **POINT)


def test_from_frd_points_to_from_system(system: control.StateSpace):
    with pytest.raises(SweepError, match="try from_system"):
        from_frd(system, p=1, q=0)


def test_an_exported_state_space_is_read_as_a_sweep(tmp_path: Path):
    record = evaluated("gfl_pll_filter_exact")
    export(record, tmp_path / "model.json", "control-json", OP)
    sweep = ibrid.read_sweep(tmp_path / "model.json")
    (point,) = sweep.points
    np.testing.assert_array_equal(point.frequency, MODEL_GRID)
    np.testing.assert_allclose(point.admittance, record.response(OP, MODEL_GRID), rtol=0, atol=1e-9)
    assert (point.op.name, point.op.p, point.op.q, sweep.power_node, sweep.f0_hz) == (
        OP,
        1.0,
        0.3,
        "capacitor",
        60.0,
    )


@pytest.mark.slow
def test_commands_take_an_exported_state_space(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    export(evaluated("gfl_pll_filter_exact"), tmp_path / "model.json", "control-json", OP)
    assert (
        cli.main(
            ["evaluate", "gfl_pll_filter_exact", str(tmp_path / "model.json"), "--restarts", "0"]
        )
        == 0
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(r"model\.json: a state space of order 13, poles from .* sampled at", line)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "JSON that cannot be read"),
        ('{"A": 1, "p": 2, "A": 3}', "the name 'A' stands twice in one object"),
        ("[1]", "must have the schema"),
        ('{"schema": "ibrid.record/1"}', "found a record"),
        ('{"schema": "ibrid.state-space/1"}', "must fit together"),
        (
            '{"schema": "ibrid.state-space/1", "A": [[1]], "B": [[1, 1]], "C": [[1]], "D": [[1]]}',
            "must fit together",
        ),
    ],
)
def test_a_json_file_that_is_no_model_is_refused_in_a_sentence(
    tmp_path: Path, text: str, sentence: str
):
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(SweepError, match=sentence):
        ibrid.read_sweep(tmp_path / "model.json")


MODEL = {
    "schema": "ibrid.state-space/1",
    "A": [[-100.0, 0], [0, -300]],
    "B": [[100, 0], [0, 100]],
    "C": [[-1, 0], [0, -1]],
    "D": [[0, 0], [0, 0]],
    "f0_hz": 60,
    "operating_point": {"name": "x", "p": 0.5, "q": 0.1, "v": 1, "power_node": "pcc"},
}


def model_with(key: str, value: object) -> dict[str, object]:
    point = MODEL["operating_point"]
    return (
        {**MODEL, "operating_point": {**point, key: value}}
        if key in point
        else {**MODEL, key: value}
    )


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("A", [-100, -300], "A must be 2 x 2 numbers; found a list of 2 numbers, export again"),
        (
            "A",
            [[True, False], [False, True]],
            "A must be 2 x 2 numbers; found something else than finite numbers",
        ),
        ("B", [["100", "0"], ["0", "100"]], "B must be 2 x 2 numbers; found something else"),
        ("B", [[1, 2], [3]], "B must be 2 x 2 numbers; found something else"),
        ("C", [[-1, 0]], "C must be 2 x 2 numbers; found 1 x 2"),
        ("D", 5, "D must be 2 x 2 numbers; found one number"),
        ("D", None, "D must be 2 x 2 numbers; found something else"),
        ("A", [[float("nan"), 0], [0, 1]], "something else than finite numbers"),
        ("f0_hz", "60", "f0_hz must be one number; found something else"),
        ("name", [], "name of operating_point must be a text or a list of texts"),
        ("name", {}, "name of operating_point must be a text"),
        ("name", ["a", "b"], "A must be 2 x 2 x 2 numbers; found 2 x 2 numbers"),
        ("p", [0.5, 0.6], "p must be one number; found a list of 2 numbers"),
        ("power_node", [], "power_node of operating_point must be a text"),
        ("operating_point", [], "operating_point must hold name, p, q, v and power_node"),
    ],
)
def test_a_model_whose_parts_do_not_fit_is_refused_by_name(
    tmp_path: Path, key: str, value: object, sentence: str
):
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    assert ibrid.read_sweep(tmp_path / "model.json").names == ("x",)
    changed = {**MODEL, key: value} if key == "operating_point" else model_with(key, value)
    (tmp_path / "model.json").write_text(json.dumps(changed))
    with pytest.raises(SweepError, match=sentence):
        ibrid.read_sweep(tmp_path / "model.json")


def test_the_grid_of_models_is_that_of_the_command_line():
    np.testing.assert_array_equal(MODEL_GRID, frequency_grid("5:5000:60"))
