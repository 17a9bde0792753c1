"""Exports carry the operating point of the terminals, stack all points on a last axis, and bear the
name that was asked for.
"""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from fitted import benchmark, evaluated

import ibrid
from ibrid import cli
from ibrid.analysis.models.linear_model import linear_model
from ibrid.errors import IbridError
from ibrid.export import FORMAT_NAMES, export, read_control_json
from ibrid.export.names import identifier
from ibrid.schemas import breach

OP = "p=1,q=0.3"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (apt-get install gcc libc6-dev)"
)


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


def test_the_terminals_deliver_what_the_capacitor_does_less_the_loss_of_the_line(
    record: ibrid.Record,
):
    model = linear_model(record, OP)
    r_g, l_g = (record.parameters[OP][f"plant.{name}"] for name in ("R_g", "L_g"))
    size = model.i0[0] ** 2 + model.i0[1] ** 2
    # p and q were measured at the capacitor: R |i|^2 and X |i|^2 are lost on the way
    np.testing.assert_allclose(
        [model.p_pcc, model.q_pcc], [1.0 - r_g * size, 0.3 - l_g * size], rtol=1e-12
    )
    np.testing.assert_allclose(model.v0, [1.0, 0.0])


@pytest.mark.nightly
@pytest.mark.parametrize(
    "name",
    ["gfl_l_filter", "gfl_delay", "gfm_droop", "gfl_trap", "parallel_gfl_gfm", "gfm_regfm_a1"],
)
def test_the_terminals_rest_where_the_nonlinear_model_does(name: str):
    fitted = evaluated(name, restarts=0)
    np.testing.assert_allclose(
        linear_model(fitted, OP).i0, ibrid.nonlinear_model(fitted, OP).i0, rtol=0, atol=1e-12
    )


def test_a_shunt_at_the_pcc_takes_its_current_from_the_terminals(record: ibrid.Record):
    text = record.program + (
        '    g.add("Shunt_RC", "shunt", R=0.1, C=0.2)\n    g.connect("v_DQ", "shunt.v")\n    '
        'g.connect("shunt.i", "i_DQ")\n'
    )
    shunted = linear_model(replace(record, program=text), OP)
    taken = 1 / (0.1 - 1j / 0.2)  # of one at the terminals
    np.testing.assert_allclose(
        np.subtract(linear_model(record, OP).i0, shunted.i0),
        [taken.real, taken.imag],
        rtol=0,
        atol=1e-12,
    )


def test_bases_of_the_measurement_travel_into_every_file(tmp_path: Path):
    sweep = replace(benchmark(), s_base_va=2e6, v_base_v=690.0)
    fitted = ibrid.evaluate(ibrid.textbook("naive"), sweep, restarts=0)
    fitted.write(tmp_path / "fit.json")
    read = ibrid.read_record(tmp_path / "fit.json")
    for format in ("mat", "npz", "control-json"):
        export(read, tmp_path / format, format, OP)
    held = scipy.io.loadmat(tmp_path / "mat", squeeze_me=True)
    arrays, plain = np.load(tmp_path / "npz"), json.loads((tmp_path / "control-json").read_text())
    assert breach(plain, "state-space") is None
    for found in (held, arrays, plain):
        assert (float(found["s_base_va"]), float(found["v_base_v"])) == (2e6, 690.0)
        np.testing.assert_allclose(float(found["omega_0"]), 120 * np.pi)
        np.testing.assert_allclose(found["v0"], [1.0, 0.0])
        np.testing.assert_allclose(
            found["i0"], [1.0, -0.3]
        )  # an L filter: the capacitor is the terminal
        np.testing.assert_allclose([float(found["p_pcc"]), float(found["q_pcc"])], [1.0, 0.3])


def test_without_bases_json_says_null_and_arrays_hold_no_number(
    record: ibrid.Record, tmp_path: Path
):
    export(record, tmp_path / "m.json", "control-json", OP)
    export(record, tmp_path / "m.npz", "npz", OP)
    assert json.loads((tmp_path / "m.json").read_text())["s_base_va"] is None
    assert np.isnan(np.load(tmp_path / "m.npz")["v_base_v"])


@pytest.mark.slow
def test_all_points_stand_on_a_last_axis(
    record: ibrid.Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    record.write(tmp_path / "fit.json")
    files = {
        "mat": tmp_path / "m.mat",
        "npz": tmp_path / "m.npz",
        "control-json": tmp_path / "m.json",
    }
    for format in files:
        words = [
            "export",
            str(tmp_path / "fit.json"),
            "--op",
            "all",
            "--format",
            format,
            "--out",
            str(files[format]),
        ]
        assert cli.main(words) == 0
    assert "p=1,q=0.3; p=1,q=-0.3" in capsys.readouterr().out
    held = scipy.io.loadmat(files["mat"], squeeze_me=True)
    arrays, plain = np.load(files["npz"]), json.loads(files["control-json"].read_text())
    assert breach(plain, "state-space") is None
    assert (
        list(held["op"])
        == list(arrays["op"])
        == plain["operating_point"]["name"]
        == list(record.parameters)
    )
    for k, op in enumerate(record.parameters):
        model = linear_model(record, op)
        for found in (held, arrays, plain):
            for part in (*"ABCD", "v0", "i0", "p_pcc", "q_pcc"):
                np.testing.assert_array_equal(np.asarray(found[part])[..., k], getattr(model, part))
        np.testing.assert_array_equal(read_control_json(files["control-json"], op).A, model.A)
    with pytest.raises(IbridError, match="2 operating points"):
        read_control_json(files["control-json"])
    sweep = ibrid.read_sweep(files["control-json"])
    assert sweep.names == tuple(record.parameters)
    point = sweep.point("p=1,q=-0.3")
    np.testing.assert_allclose(
        point.admittance, record.response("p=1,q=-0.3", point.frequency), rtol=1e-8, atol=1e-12
    )


@pytest.mark.parametrize(
    "format", [one for one in FORMAT_NAMES if one not in ("mat", "npz", "control-json")]
)
def test_formats_of_one_point_refuse_all(record: ibrid.Record, tmp_path: Path, format: str):
    with pytest.raises(IbridError, match="all operating points go into"):
        export(record, tmp_path / "m", format, "all")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@needs_compiler
def test_two_inverters_link_into_one_program_and_answer_as_their_models(
    record: ibrid.Record, tmp_path: Path
):
    models = {}
    for name, op in (("east", OP), ("west", "p=1,q=-0.3")):
        models[name] = export(record, tmp_path / f"{name}.c", "c", op, name=name)
    (tmp_path / "main.c").write_text(
        """
        #include <stdio.h>
        #define EAST_HEADER
        #define WEST_HEADER
        #include "east.c"
        #include "west.c"
        extern const double east_i0_Q, west_i0_Q;
        int main(void)
        {
            static east one;
            static west other;
            const double v[2] = {0.01, -0.02};
            double i[2], j[2];
            if (east_set_step(&one, 1e-3) || west_set_step(&other, 1e-3))
                return 1;
            for (int k = 0; k < 20; k++) {
                east_step(&one, v, v);
                west_step(&other, v, v);
            }
            east_output(&one, v, i);
            west_output(&other, v, j);
            printf("%.17g %.17g %.17g %.17g %.17g %.17g\\n", i[0], i[1], j[0], j[1], east_i0_Q, west_i0_Q);
            return 0;
        }
        """,
        encoding="utf-8",
    )
    warned = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O1"]
    for one in ("east", "west", "main"):
        subprocess.run([str(COMPILER), *warned, "-c", f"{one}.c"], cwd=tmp_path, check=True)
    subprocess.run(
        [str(COMPILER), "east.o", "west.o", "main.o", "-o", "both", "-lm"], cwd=tmp_path, check=True
    )
    said = subprocess.run(
        [str(tmp_path / "both")], capture_output=True, text=True, check=True
    ).stdout.split()
    found = np.array(said, dtype=float)
    v = np.array([0.01, -0.02])
    expected = []
    for model in models.values():
        a, b = np.asarray(model.A), np.asarray(model.B)
        at_end = np.linalg.solve(a, (scipy.linalg.expm(a * 0.02) - np.eye(len(a))) @ b @ v)
        expected += list(model.C @ at_end + model.D @ v)
    expected += [one.i0[1] for one in models.values()]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
@needs_compiler
def test_the_name_is_that_of_the_fmu_and_the_fmu_says_its_operating_point(
    record: ibrid.Record, tmp_path: Path
):
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed (pip install fmpy)")
    model = export(record, tmp_path / "east.fmu", "fmu", OP, name="east_park")
    root = ElementTree.fromstring(ZipFile(tmp_path / "east.fmu").read("modelDescription.xml"))
    assert root.get("modelName") == "east_park"
    answer = fmpy.simulate_fmu(
        str(tmp_path / "east.fmu"), stop_time=0.001, output=["i_D", *model.at_rest()]
    )
    for name, value in model.at_rest().items():
        assert answer[name][-1] == value


def test_the_name_is_that_of_the_modelica_class(record: ibrid.Record, tmp_path: Path):
    parser = pytest.importorskip(
        "pymoca.parser", reason="pymoca is not installed (pip install pymoca)"
    )
    for nonlinear in (False, True):
        model = export(
            record, tmp_path / "m.mo", "modelica", OP, name="EastPark", nonlinear=nonlinear
        )
        found = parser.parse((tmp_path / "m.mo").read_text()).classes["EastPark"]
        assert nonlinear == ("Inverter" in found.classes)
        if not nonlinear:
            assert set(model.at_rest()) <= set(found.symbols)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "7up",
        "a b",
        "x;",
        "evil()",
        "été",
        "a" * 33,
        "_x",
        "while",
        "block",
        "lambda",
        "memcpy",
        "../x",
        "a\n",
    ],
)
def test_a_name_that_is_no_identifier_is_refused_and_leaves_nothing(
    record: ibrid.Record, tmp_path: Path, name: str
):
    with pytest.raises(IbridError, match="name"):
        identifier(name)
    for format in ("c", "fmu", "modelica", "mat"):
        with pytest.raises(IbridError, match="name"):
            export(record, tmp_path / "m", format, OP, name=name)
    assert list(tmp_path.iterdir()) == []
