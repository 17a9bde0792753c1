"""Exported models are the record's model: the same response, names and operating point in every
format.
"""

import io
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.signal

import ibrid
from ibrid import cli
from ibrid.errors import IbridError, OperatingPointError
from ibrid.export import FORMAT_NAMES, FORMATS, export, linear_model, read_control_json
from ibrid.export.compiling import COMPILERS

OP = "p=1,q=0.3"
FREQUENCY = np.geomspace(1.0, 5000.0, 40)


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    return ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep)


def response(a, b, c, d, frequency: np.ndarray) -> np.ndarray:
    """C (j omega I - A)^-1 B + D, (K, 2, 2)."""
    s = 2j * np.pi * frequency[:, None, None]
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d


def largest_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Relative to the norm at each frequency."""
    return float(
        (np.linalg.norm(one - other, axis=(1, 2)) / np.linalg.norm(other, axis=(1, 2))).max()
    )


def test_control_json_comes_back_as_the_same_system(record: ibrid.Record, tmp_path: Path):
    path = tmp_path / "model.json"
    model = export(record, path, "control-json", OP)
    system, original = read_control_json(path), record.state_space(OP)
    for part in "ABCD":
        np.testing.assert_array_equal(getattr(system, part), getattr(original, part))
    assert system.state_labels == original.state_labels == list(model.states)
    assert system.input_labels == ["v_D", "v_Q"]
    assert system.output_labels == ["i_D", "i_Q"]
    assert "pll.angle" in system.state_labels
    assert system.name == original.name


def test_mat_holds_matrices_names_and_operating_point(record: ibrid.Record, tmp_path: Path):
    path = tmp_path / "model.mat"
    model = export(record, path, "mat", "p=1,q=-0.3")
    held = scipy.io.loadmat(path, squeeze_me=True)
    np.testing.assert_array_equal(held["A"], model.A)
    assert [str(name) for name in held["state_names"]] == list(model.states)
    assert [str(name) for name in held["input_names"]] == ["v_D", "v_Q"]
    assert (float(held["p"]), float(held["q"]), float(held["v"]), float(held["f0_hz"])) == (
        1.0,
        -0.3,
        1.0,
        60.0,
    )
    assert str(held["op"]) == "p=1,q=-0.3"


def test_npz_opens_without_pickle(record: ibrid.Record, tmp_path: Path):
    path = tmp_path / "model.npz"
    model = export(record, path, "npz", OP)
    with np.load(path, allow_pickle=False) as held:
        found = response(held["A"], held["B"], held["C"], held["D"], FREQUENCY)
        assert tuple(held["state_names"]) == model.states
        assert (
            dict(zip(held["parameter_names"], held["parameter_values"], strict=True))
            == record.parameters[OP]
        )
    # two ways to the same numbers; rounding in a 13-state solve
    assert largest_difference(found, record.response(OP, FREQUENCY)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_the_same_model_gives_the_same_bytes(record: ibrid.Record, name: str):
    if name == "fmu" and not any(map(shutil.which, COMPILERS)):
        pytest.skip("no C compiler (apt-get install gcc libc6-dev)")
    model = linear_model(record, OP)
    assert FORMATS[name](model) == FORMATS[name](model)


def test_octave_gives_the_same_frequency_and_time_response(record: ibrid.Record, tmp_path: Path):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("GNU Octave is not installed (apt-get install octave octave-control)")
    export(record, tmp_path / "model.mat", "mat", OP)
    np.savetxt(tmp_path / "omega.txt", 2 * np.pi * FREQUENCY, fmt="%.17g")
    v = np.random.default_rng(3).normal(scale=1e-2, size=(200, 2))
    np.savetxt(tmp_path / "v.txt", v, fmt="%.17g")
    script = """
    pkg load control
    load model.mat
    omega = load("omega.txt");
    sys = ss(A, B, C, D, "stname", state_names, "inname", input_names, "outname", output_names);
    H = freqresp(sys, omega);
    names = get(sys, "stname");
    v = load("v.txt");
    y = lsim(c2d(sys, 1e-4, "zoh"), v);
    save("-v6", "answer.mat", "H", "names", "y");
    """
    (tmp_path / "check.m").write_text(script, encoding="utf-8")
    answer = subprocess.run(
        [octave, "--no-gui", "--norc", "--quiet", "check.m"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    if "package" in answer.stderr and not (tmp_path / "answer.mat").exists():
        pytest.skip("Octave's control package is not installed (apt-get install octave-control)")
    assert (tmp_path / "answer.mat").exists(), answer.stderr
    held = scipy.io.loadmat(tmp_path / "answer.mat", squeeze_me=True)
    found = np.moveaxis(held["H"], 2, 0)
    assert (
        largest_difference(found, record.response(OP, FREQUENCY)) < 1e-9
    )  # rounding in a 13-state solve
    model = linear_model(record, OP)
    assert [str(name) for name in held["names"]] == list(model.states)
    sampled = scipy.signal.cont2discrete((model.A, model.B, model.C, model.D), 1e-4)
    expected = scipy.signal.dlsim(sampled, v)[1]
    np.testing.assert_allclose(held["y"], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("format", "name"), [("csv", "y.csv"), ("touchstone", "y.y2p"), ("touchstone", "y.s2p")]
)
def test_an_exported_admittance_is_read_as_a_sweep(
    record: ibrid.Record, tmp_path: Path, format: str, name: str
):
    op = "p=0.9,q=0,v=1.01"
    export(record, tmp_path / name, format, op, frequency=FREQUENCY)
    sweep = ibrid.read_sweep(tmp_path / name)
    (point,) = sweep.points
    assert (point.op.name, point.op.p, point.op.q, point.op.v) == (op, 0.9, 0.0, 1.01)
    assert (sweep.power_node, sweep.f0_hz) == ("capacitor", 60.0)
    truth = ibrid.sweep("paper_like", [ibrid_point(op)], FREQUENCY).points[0]
    np.testing.assert_array_equal(point.frequency, FREQUENCY)
    # the fit of clean data is exact to about 1e-9 in the parameters that matter
    assert largest_difference(point.admittance, truth.admittance) < 1e-6


@pytest.mark.slow
def test_an_exported_admittance_has_exact_delays_on_the_default_grid(tmp_path: Path):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    delayed = ibrid.evaluate(ibrid.textbook("gfl_delay"), sweep, restarts=0)
    export(delayed, tmp_path / "y.csv", "csv", OP)
    (point,) = ibrid.read_sweep(tmp_path / "y.csv").points
    assert (len(point.frequency), point.frequency[0], point.frequency[-1]) == (60, 5.0, 5000.0)
    np.testing.assert_array_equal(point.admittance, delayed.response(OP, point.frequency))


def test_an_exported_admittance_fits_like_a_measurement(record: ibrid.Record, tmp_path: Path):
    export(record, tmp_path / "y.csv", "csv", OP, frequency=np.geomspace(5.0, 5000.0, 16))
    again = ibrid.evaluate(
        ibrid.textbook("gfl_pll_filter_exact"), ibrid.read_sweep(tmp_path / "y.csv")
    )
    assert again.nrmse < 1e-9  # the same structure, no noise


def test_frequencies_are_for_admittances_alone(record: ibrid.Record, tmp_path: Path):
    with pytest.raises(IbridError, match="csv and touchstone"):
        export(record, tmp_path / "m.mat", "mat", OP, frequency=FREQUENCY)
    with pytest.raises(IbridError, match="ascending"):
        export(record, tmp_path / "y.csv", "csv", OP, frequency=FREQUENCY[::-1])
    assert list(tmp_path.iterdir()) == []


def test_the_help_names_every_format(capsys: pytest.CaptureFixture[str]):
    cli.main(["export", "--help"])
    (words,) = re.findall(
        r"--format FORMAT ([^\[].*?) --freq", " ".join(capsys.readouterr().out.split())
    )
    assert set(words.split(" | ")) == set(FORMAT_NAMES)


def test_a_point_that_was_not_measured_is_exported_from_shared_parameters(
    record: ibrid.Record, tmp_path: Path
):
    model = export(record, tmp_path / "model.npz", "npz", "p=0.9,q=0,v=1.01")
    plant = "paper_like"
    sweep = ibrid.sweep(plant, [ibrid_point("p=0.9,q=0,v=1.01")], FREQUENCY)
    found = response(model.A, model.B, model.C, model.D, FREQUENCY)
    # the fit of clean data is exact to about 1e-9 in the parameters that matter
    assert largest_difference(found, sweep.points[0].admittance) < 1e-6
    assert (model.p, model.q, model.v) == (0.9, 0.0, 1.01)


def ibrid_point(text: str):
    """An operating point from its text."""
    from ibrid.plants.sweeping import operating_point

    return operating_point(text)


def test_a_point_written_otherwise_is_the_point_of_the_record(record: ibrid.Record):
    assert linear_model(record, "q=0.30, p=1.0").op == OP


def test_without_a_point_the_only_one_is_taken(record: ibrid.Record):
    one = replace(record, parameters={OP: record.parameters[OP]})
    assert linear_model(one).op == OP
    with pytest.raises(OperatingPointError, match="2 operating points; choose one"):
        linear_model(record)


@pytest.mark.parametrize(
    ("op", "sentence"),
    [
        ("p=9,q=0", "no real operating point"),
        ("p=1", "with both p and q"),
        ("noon", "no operating point 'noon'"),
        ("p=x,q=0", "not a number"),
    ],
)
def test_a_point_that_does_not_exist_is_refused(record: ibrid.Record, op: str, sentence: str):
    with pytest.raises(OperatingPointError, match=sentence):
        linear_model(record, op)


def test_per_op_records_answer_only_where_they_were_fitted(record: ibrid.Record):
    per_op = replace(record, settings={**record.settings, "parameters": "per-op"})
    assert linear_model(per_op, OP).op == OP
    with pytest.raises(IbridError, match="shared parameters"):
        linear_model(per_op, "p=0.5,q=0")


def test_a_record_without_a_fit_is_refused(record: ibrid.Record):
    with pytest.raises(IbridError, match="has no fit"):
        linear_model(replace(record, outcome="failed", parameters={}), OP)


@pytest.mark.parametrize("format", FORMAT_NAMES)
@pytest.mark.parametrize("nonlinear", [False, True])
def test_a_record_without_a_fit_leaves_no_file(
    record: ibrid.Record, tmp_path: Path, format: str, nonlinear: bool
):
    with pytest.raises(IbridError):
        export(
            replace(record, outcome="failed", parameters={}),
            tmp_path / "m",
            format,
            OP,
            nonlinear=nonlinear,
        )
    assert list(tmp_path.iterdir()) == []


def test_a_nonlinear_model_is_exported_from_the_command_line(
    record: ibrid.Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    record.write(tmp_path / "fit.json")
    words = [
        "export",
        str(tmp_path / "fit.json"),
        "--op",
        "p=0.5,q=0",
        "--format",
        "modelica",
        "--nonlinear",
    ]
    assert cli.main([*words, "--out", str(tmp_path / "n.mo")]) == 0
    assert "13 states at p=0.5,q=0, nonlinear" in capsys.readouterr().out
    assert "block PQ_calc" in (tmp_path / "n.mo").read_text()


def test_frequencies_are_chosen_on_the_command_line(record: ibrid.Record, tmp_path: Path):
    record.write(tmp_path / "fit.json")
    words = [
        "export",
        str(tmp_path / "fit.json"),
        "--op",
        OP,
        "--format",
        "csv",
        "--out",
        str(tmp_path / "y.csv"),
    ]
    assert cli.main([*words, "--freq", "10:1000:5"]) == 0
    np.testing.assert_allclose(
        ibrid.read_sweep(tmp_path / "y.csv").points[0].frequency,
        np.geomspace(10, 1000, 5),
        rtol=1e-11,
    )
    (tmp_path / "y.csv").unlink()
    assert cli.main([*words, "--freq", "10:1:5"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]


def test_an_export_says_what_a_prediction_would_warn_of(
    record: ibrid.Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    record.write(tmp_path / "fit.json")
    words = [
        "export",
        str(tmp_path / "fit.json"),
        "--format",
        "csv",
        "--out",
        str(tmp_path / "y.csv"),
    ]
    assert cli.main([*words, "--op", OP, "--freq", "10:1000:5"]) == 0
    assert capsys.readouterr().err == ""
    assert cli.main([*words, "--op", "p=9,q=9", "--freq", "1:1e6:5"]) == 0
    told = capsys.readouterr().err
    for words_of in (
        "is unstable at p=9,q=9",
        "outside the measured range",
        "5 to 5000 Hz measured",
    ):
        assert words_of in told
    assert (tmp_path / "y.csv").exists()


def test_a_damaged_record_is_refused_in_a_sentence(record: ibrid.Record):
    with pytest.raises(IbridError, match="incomplete or damaged"):
        linear_model(replace(record, settings={}), OP)


def test_unknown_formats_and_places_are_refused_and_leave_nothing(
    record: ibrid.Record, tmp_path: Path
):
    with pytest.raises(IbridError, match="did you mean mat"):
        export(record, tmp_path / "model", "matt", OP)
    with pytest.raises(IbridError, match="there is no folder"):
        export(record, tmp_path / "nowhere" / "model.mat", "mat", OP)
    with pytest.raises(IbridError, match="is a folder"):
        export(record, tmp_path, "mat", OP)
    with pytest.raises(IbridError, match="must be a file"):
        export(record, "-", "csv", OP)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "JSON that cannot be read"),
        ("[]", "must have the schema"),
        ('{"schema": "ibrid.state-space/1"}', "lacks 'states'"),
        (
            '{"schema": "ibrid.state-space/1", "name": "x", "states": ["a"], "inputs": ["u"], '
            '"outputs": ["y"], '
            '"A": [[1, 2]], "B": [[1]], "C": [[1]], "D": [[0]]}',
            "do not fit together",
        ),
    ],
)
def test_a_file_that_is_no_model_is_refused_in_a_sentence(tmp_path: Path, text: str, sentence: str):
    path = tmp_path / "model.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(IbridError, match=sentence):
        read_control_json(path)


@pytest.mark.slow
def test_delays_leave_as_pade_forms_of_the_recorded_order(record: ibrid.Record):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    delayed = ibrid.evaluate(ibrid.textbook("gfl_delay"), sweep, restarts=0)
    model = linear_model(delayed, OP)
    (order,) = model.pade_orders.values()
    lags = [name for name in model.states if name.split(".")[0] in model.pade_orders]
    assert len(lags) == 2 * order
    assert len(model.states) == delayed.order
    held = scipy.io.loadmat(io.BytesIO(FORMATS["mat"](model)))
    assert held["A"].shape == model.A.shape
