"""The example files of the README are read with the options that it names, and are what the script
beside them writes.
"""

import runpy
from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid import cli
from ibrid.plants.sweeping import plant_named, sweep

DATA = Path(__file__).parents[2] / "data"
EXAMPLES = DATA / "examples"
BASE = ("--base", "50kVA,690V", "--f0-hz", "60")


def test_the_scan_of_a_workbook_is_that_of_its_device(tmp_path):
    pytest.importorskip("openpyxl", reason="workbooks need openpyxl; pip install 'ibrid[tables]'")
    out = tmp_path / "sweep.csv"
    words = ("import", str(EXAMPLES / "scan.xlsx"), *BASE, "--voltage-axis", "d")
    assert cli.main([*words, "--out", str(out)]) == 0
    measured = ibrid.read_sweep(out)
    clean = sweep(plant_named("feng_50kva"), None, measured.points[0].frequency)
    for point, true in zip(measured.points, clean.points, strict=True):
        error = np.linalg.norm(point.admittance - true.admittance)
        assert error < 0.005 * np.linalg.norm(true.admittance)  # 50 dB


def test_the_recordings_begin_at_the_point_of_the_device():
    point = plant_named("feng_50kva").operating_points[0]
    for name in ("fault.csv", "pmu.csv"):
        read = ibrid.read_events(EXAMPLES / name, base="50kVA,690V", f0_hz=60.0)
        rest = read.records[0].rest
        assert [rest.p, rest.q, rest.v] == pytest.approx([point.p, point.q, point.v], abs=0.06)


@pytest.mark.slow
def test_the_example_files_are_what_their_script_writes(tmp_path):
    pytest.importorskip("openpyxl", reason="workbooks need openpyxl; pip install 'ibrid[tables]'")
    written = runpy.run_path(str(DATA / "make_examples.py"))
    for name in ("fault.csv", "pmu.csv"):
        written[f"write_{name.removesuffix('.csv')}"](tmp_path / name)
        made, shipped = (
            np.genfromtxt(folder / name, delimiter=",", skip_header=1)
            for folder in (tmp_path, EXAMPLES)
        )
        assert np.abs(made - shipped).max() < 1e-4 * np.abs(shipped).max(axis=0).max()


@pytest.mark.slow
def test_the_cases_of_the_notebooks_are_what_their_script_writes(tmp_path):
    written = runpy.run_path(str(DATA / "make_cases.py"))
    for name in written["HIDDEN"]:
        written["write_hidden"](name, tmp_path)
    written["write_bench_stand_in"](tmp_path / "bench_stand_in.csv")
    written["write_unmeasured_point"](tmp_path / "random_05_half_power.csv")
    sweeps = sorted(tmp_path.rglob("*.csv"))
    assert len(sweeps) == len(written["HIDDEN"]) + 2
    for made in sweeps:
        shipped = ibrid.read_sweep(EXAMPLES / made.relative_to(tmp_path))
        for ours, theirs in zip(ibrid.read_sweep(made).points, shipped.points, strict=True):
            np.testing.assert_allclose(ours.admittance, theirs.admittance, rtol=1e-6, atol=1e-9)


def test_every_example_is_found_by_its_name():
    assert set(ibrid.examples()) == {path.name for path in EXAMPLES.iterdir()}
    assert ibrid.read_sweep(ibrid.examples()["hidden_loop"] / "sweep.csv").names
