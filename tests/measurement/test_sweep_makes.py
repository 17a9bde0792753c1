"""Further makes of sweeps: bundles, models, network forms, long tables; what is wrong on purpose is
caught.
"""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from sweep_makes import MODEL, MODELS, SPOILT, SWEEPS, Z_BASE, first_point, model_response

import ibrid
from ibrid import cli
from ibrid.measurement.importing.table_files import read_tables


@pytest.fixture(scope="module")
def truth():
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def test_further_makes_become_the_sweep_that_they_were_written_from(truth, tmp_path, capsys):
    wrong = []
    for number, make in enumerate(SWEEPS):
        folder = tmp_path / str(number)
        folder.mkdir()
        out = folder / "sweep.out.csv"
        if cli.main(
            ["import", *map(str, make.write(truth, folder)), *make.options, "--out", str(out)]
        ):
            wrong.append((make.make, capsys.readouterr().err))
            continue
        point, true = ibrid.read_sweep(out).points[0], truth.points[0]
        error = np.abs(point.admittance - true.admittance).max() / np.abs(true.admittance).max()
        powers = np.abs(np.subtract([point.op.p, point.op.q], [true.op.p, true.op.q])).max()
        if error > make.digits or powers > 1e-9:
            wrong.append((make.make, error, powers))
    assert wrong == []


def test_state_spaces_of_every_make_are_the_response_that_they_have(truth, tmp_path, capsys):
    """Law: Y = C (j omega I - A)^-1 B + D, here -1 / (R + j omega L + omega_0 L J)."""
    wrong = []
    for number, make in enumerate(MODELS):
        folder = tmp_path / str(number)
        folder.mkdir()
        out = folder / "sweep.out.csv"
        status = cli.main(
            ["import", *map(str, make.write(truth, folder)), *make.options, "--out", str(out)]
        )
        said = capsys.readouterr().err
        if status or "a state space of order 2" not in said:
            wrong.append((make.make, said))
            continue
        (point,) = ibrid.read_sweep(out).points
        if np.abs(point.admittance - model_response(point.frequency)).max() > 1e-9:
            wrong.append((make.make, "another response"))
    assert wrong == []


def test_sweeps_that_are_wrong_on_purpose_are_caught(truth, tmp_path, capsys):
    silent = []
    for number, (make, sentence) in enumerate(SPOILT):
        folder = tmp_path / str(number)
        folder.mkdir()
        cli.main(
            [
                "import",
                *map(str, make.write(truth, folder)),
                *make.options,
                "--out",
                str(folder / "sweep.out.csv"),
            ]
        )
        if sentence not in (said := capsys.readouterr().err):
            silent.append((make.make, said))
    assert silent == []


def test_our_own_exports_are_data_again(tmp_path):
    """One model in three formats is one sweep."""
    linear = {
        "A": [[-10.0, 1.0], [-1.0, -10.0]],
        "B": [[-1.0, 0.0], [0.0, -1.0]],
        "C": [[1.0, 0.0], [0.0, 1.0]],
        "D": [[0.0, 0.0], [0.0, 0.0]],
        "p": 0.8,
        "q": 0.1,
        "v": 1.0,
        "f0_hz": 50.0,
        "op": "full",
        "power_node": "pcc",
        "units": "per unit on the inverter's base, time in s",
    }
    from scipy.io import savemat

    savemat(tmp_path / "model.mat", linear)
    np.savez(tmp_path / "model.npz", **{name: np.asarray(value) for name, value in linear.items()})
    point = {"name": "full", "p": 0.8, "q": 0.1, "v": 1.0, "power_node": "pcc"}
    exported = {"schema": "ibrid.state-space/1", **linear, "operating_point": point}
    (tmp_path / "model.json").write_text(json.dumps(exported))
    first, *others = [
        ibrid.read_sweep(tmp_path / f"model.{suffix}") for suffix in ("json", "mat", "npz")
    ]
    for other in others:
        assert (other.names, other.f0_hz, other.power_node) == (
            first.names,
            first.f0_hz,
            first.power_node,
        )
        assert np.allclose(other.points[0].admittance, first.points[0].admittance, rtol=1e-12)


def test_frames_of_several_levels_and_networks_are_read_in_python(truth):
    import pandas

    frequency, matrix, _ = first_point(truth)
    said = {
        "unit": "pu",
        "f0_hz": 60,
        "current": "out",
        "q_axis": "leads",
        "voltage_axis": "d",
        "p": 1,
        "q": 0.3,
    }
    entries = dict(zip(("dd", "dq", "qd", "qq"), matrix.reshape(-1, 4).T, strict=True))
    plain = pandas.DataFrame(
        {f"Y{entry}": value for entry, value in entries.items()}, index=frequency
    )
    plain.index.name = "f"
    levels = {
        (f"Y{entry}", part): getattr(value, part)
        for entry, value in entries.items()
        for part in ("real", "imag")
    }
    deep = pandas.DataFrame({("f", ""): frequency, **levels})
    for frame in (plain, deep):
        assert np.array_equal(ibrid.read_sweep(frame, **said).points[0].admittance, matrix)
    with pytest.raises(ibrid.IbridError, match=r'add unit="pu" or unit="S", base='):
        ibrid.read_sweep(plain, p=1, q=0.3)
    rf = pytest.importorskip("skrf")
    said = {"p": 1, "q": 0.3, "s_base_va": 10e3, "v_base_v": 400.0}
    for ohm, unit in ((50.0, Z_BASE), (1.0, 1.0)):  # S; ports of 1 ohm do not say their unit
        network = rf.Network(f=frequency, f_unit="Hz", s=rf.network.y2s(matrix / unit, ohm), z0=ohm)
        read = ibrid.read_sweep(network, **said)
        np.testing.assert_allclose(read.points[0].admittance, matrix, rtol=1e-9)
    with pytest.raises(ibrid.IbridError, match="s_base_va"):
        ibrid.read_sweep(
            rf.Network(f=frequency, f_unit="Hz", s=rf.network.y2s(matrix, 50.0), z0=50.0),
            p=1,
            q=0.3,
        )
    with pytest.raises(ibrid.IbridError, match="two ports, d and q"):
        ibrid.read_sweep(network.s11, p=1, q=0.3)
    network.port_names = ["d", "q"]
    assert ibrid.read_sweep(network, **said).points[0].op.p == 1
    network.port_names = ["q", "d"]
    with pytest.raises(ibrid.IbridError, match="port_names of the Network must name d before q"):
        ibrid.read_sweep(network, **said)


def test_what_an_xarray_gives_as_a_frame_is_read_as_that_frame(truth):
    import pandas

    frequency, matrix, _ = first_point(truth)
    entries = {
        f"Y{e}": y for e, y in zip(("dd", "dq", "qd", "qq"), matrix.reshape(-1, 4).T, strict=True)
    }

    class Dataset:
        def to_dataframe(self):
            return pandas.DataFrame(entries, index=pandas.Index(frequency, name="f"))

    said = {
        "unit": "pu",
        "f0_hz": 60,
        "current": "out",
        "q_axis": "leads",
        "voltage_axis": "d",
        "p": 1,
        "q": 0.3,
    }
    assert np.array_equal(ibrid.read_sweep(Dataset(), **said).points[0].admittance, matrix)


@pytest.mark.parametrize(
    ("inputs", "outputs", "order"),
    [
        ("q d", "q d", (1, 0)),
        ("Vgrid_q Vgrid_d", "grid_iq grid_id", (1, 0)),
        ("v_q v_dc v_d", "iq idc id", (1, 2, 0)),
        ("vd_pcc vq_pcc x", "id iq p", (0, 1, 2)),
    ],
)
def test_inputs_and_outputs_of_a_model_are_those_that_their_names_say(
    tmp_path, inputs, outputs, order
):
    """order : of each signal, 0 for d, 1 for q, 2 for another one."""
    a, b, c, _ = MODEL
    b, c = np.column_stack([b, [7.0, 7.0]])[:, order], np.vstack([c, [7.0, 7.0]])[[*order]]
    names = {"input_names": np.array(inputs.split()), "output_names": np.array(outputs.split())}
    np.savez(tmp_path / "model.npz", A=a, B=b, C=c, D=np.zeros((len(order), len(order))), **names)
    (table,) = read_tables(tmp_path / "model.npz")
    response = np.moveaxis([[table.columns[f"Y({r},{c})"] for c in (1, 2)] for r in (1, 2)], -1, 0)
    np.testing.assert_allclose(response, model_response(table.columns["f_dq"]), atol=1e-12)


def test_a_sampled_model_that_does_not_say_its_period_is_refused(tmp_path):
    np.savez(tmp_path / "model.npz", **dict(zip("ABCD", MODEL, strict=True)), Ts=-1.0)
    with pytest.raises(ibrid.IbridError, match=r"must know its sampling period; found Ts = -1"):
        read_tables(tmp_path / "model.npz")


def test_inspect_takes_a_file_in_an_archive(truth, tmp_path, capsys):
    make = SWEEPS[2]
    (archive,) = make.write(truth, tmp_path)
    with zipfile.ZipFile(archive) as held:
        first = held.namelist()[0]
    assert cli.main(["inspect", str(archive / first), *make.options, "--voltage-axis", "d"]) == 0
    assert "conventions" in capsys.readouterr().out


def test_inspect_takes_what_import_takes(truth, tmp_path, capsys):
    make = SWEEPS[0]
    (path,) = make.write(truth, tmp_path)
    assert cli.main(["inspect", str(path), *make.options]) == 0
    assert "conventions" in capsys.readouterr().out
    assert cli.main(["inspect", str(path)]) == 2
    assert "add --unit pu" in capsys.readouterr().err


def test_an_import_explains_its_reading_and_what_excludes_others(truth, tmp_path, capsys):
    make = SWEEPS[0]
    (path,) = make.write(truth, tmp_path)
    picture = tmp_path / "read.svg"
    assert (
        cli.main(["import", str(path), *make.options, "--explain", "--picture", str(picture)]) == 0
    )
    told = capsys.readouterr().out
    assert "the current counted the other way" in told
    assert "excluded: the highest frequencies fall like an inductance" in told
    assert picture.read_text().startswith("<?xml")
    again = ["import", str(path), *make.options, "--explain", "--picture", str(picture)]
    assert cli.main(again) == 0
    assert cli.main(["import", str(path), *make.options]) == 2
    assert "--out names the file to write" in capsys.readouterr().err


def test_each_make_on_the_page_is_held_by_a_test_that_exists():
    root = Path(__file__).resolve().parents[1]
    page = (root.parent / "docs" / "own_data.md").read_text(encoding="utf-8")
    named = re.findall(r"`(test_\w+)`", page)
    there = "".join(path.read_text(encoding="utf-8") for path in root.rglob("test_*.py"))
    assert len(named) >= 10
    assert [name for name in named if f"def {name}(" not in there] == []


def test_what_a_frame_lacks_is_noted_with_its_sweep(truth):
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame(
        {
            "f_hz": [10.0, 20.0, 40.0, 80.0],
            "p_mw": 8.0,
            "q_mvar": 1.0,
            **{
                f"Y{entry}_{part}": 0.5
                for entry in ("dd", "dq", "qd", "qq")
                for part in ("re", "im")
            },
        }
    )
    frame.loc[1, "Ydd_re"] = np.nan
    said = {"current": "out", "q_axis": "leads", "voltage_axis": "d", "f0_hz": 50.0}
    sweep = ibrid.read_sweep(frame, unit="pu", base="10MVA,20kV", **said)
    assert (sweep.points[0].op.p, sweep.points[0].op.q) == pytest.approx((0.8, 0.1))
    assert len(sweep.points[0].frequency) == 3
    assert any("left out" in note for note in sweep.notes)
