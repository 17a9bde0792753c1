"""Operating points that lie in groups of one file, in HDF5, MAT and JSON, are read as such."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import ibrid
from ibrid import cli
from ibrid.measurement import Sweep
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep

SAID = (
    *("--unit", "pu", "--f0-hz", "60", "--power-node", "capacitor"),
    *("--voltage-axis", "d", "--current", "out", "--q-axis", "leads"),
)


@pytest.fixture(scope="module")
def truth() -> Sweep:
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def in_groups_of_hdf5(truth: Sweep, path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, point in zip(("full", "other"), truth.points, strict=True):
            group = file.create_group(name)
            group.attrs["P_pu"], group.attrs["Q_pu"] = point.op.p, point.op.q
            group.create_dataset("freq", data=point.frequency).attrs["units"] = "Hz"
            group.create_dataset("Y", data=point.admittance)


def in_structures_of_matlab(truth: Sweep, path: Path) -> None:
    held = {
        name: {
            "P": point.op.p,
            "Q": point.op.q,
            "f": point.frequency,
            "Y": np.moveaxis(point.admittance, 0, -1),
        }
        for name, point in zip(("full", "other"), truth.points, strict=True)
    }
    savemat(path, {"ops": held})


def of_json(point: PointSweep) -> dict[str, object]:
    entries = {}
    for entry, place in ENTRIES.items():
        value = point.admittance[(slice(None), *place)]
        entries[f"Y{entry}"] = {"re": value.real.tolist(), "im": value.imag.tolist()}
    return {"p": point.op.p, "q": point.op.q, "freq_hz": point.frequency.tolist(), **entries}


def in_objects_of_json(truth: Sweep, path: Path) -> None:
    first, second = map(of_json, truth.points)
    held = {"meta": {"f0_hz": 60, "tool": "scan"}, "full": first, "other": second}
    path.write_text(json.dumps(held))


def in_a_list_of_json(truth: Sweep, path: Path) -> None:
    named = [
        {"name": name, **of_json(point)}
        for name, point in zip(("full", "other"), truth.points, strict=True)
    ]
    path.write_text(json.dumps({"points": named}))


WRITERS = {
    "scan.h5": in_groups_of_hdf5,
    "scan.mat": in_structures_of_matlab,
    "objects.json": in_objects_of_json,
    "list.json": in_a_list_of_json,
}


def test_groups_of_one_file_are_its_operating_points(truth, tmp_path):
    wrong = []
    for name, write in WRITERS.items():
        write(truth, tmp_path / name)
        out = tmp_path / f"{name}.csv"
        code = cli.main(["import", str(tmp_path / name), *SAID, "--out", str(out)])
        read = ibrid.read_sweep(out) if code == 0 else None
        same = read is not None and all(
            np.allclose(one.admittance, true.admittance, rtol=1e-9)
            and np.allclose(one.op.pqv, true.op.pqv)
            and word in one.op.name
            for one, true, word in zip(read.points, truth.points, ("full", "other"), strict=True)
        )
        wrong += [] if same else [name]
    assert wrong == []


def test_one_operating_point_in_an_object_of_parts_is_read_and_its_notes_count(truth, tmp_path):
    point = truth.points[0]
    held = {"meta": {"f0": 60, "unit": "pu"}, **of_json(point)}
    (tmp_path / "one.json").write_text(json.dumps(held))
    said = SAID[SAID.index("--power-node") :]
    out = tmp_path / "one.csv"
    assert cli.main(["import", str(tmp_path / "one.json"), *said, "--out", str(out)]) == 0
    assert ibrid.read_sweep(out).f0_hz == 60
    assert np.allclose(ibrid.read_sweep(out).points[0].admittance, point.admittance, rtol=1e-9)


def test_json_that_mixes_tables_and_lists_says_what_stands_beside_them(truth, tmp_path, capsys):
    held = {"full": of_json(truth.points[0]), "freq_hz": [1.0, 2.0]}
    (tmp_path / "mixed.json").write_text(json.dumps(held))
    assert cli.main(["import", str(tmp_path / "mixed.json"), "--out", str(tmp_path / "o.csv")]) == 2
    assert "table of its own" in capsys.readouterr().err


def test_powers_beside_matrices_per_unit_of_another_base_are_of_that_base(truth, tmp_path, capsys):
    point = truth.points[0]
    (tmp_path / "scan.json").write_text(json.dumps(of_json(point) | {"p": 1.0, "q": 0.3}))
    command = ["import", str(tmp_path / "scan.json"), "--unit", "pu:100MVA,33kV", *SAID[2:]]
    assert cli.main([*command, "--base", "10kVA,400V", "--out", str(tmp_path / "o.csv")]) == 2
    said = capsys.readouterr().err
    assert "p must be per unit of the base of --unit, 100MVA,33kV" in said
    assert "write p 0.0001" in said
