"""The nominal frequency by the highest frequencies: read where a filter is seen, doubted where all
points show another.
"""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from constant_current import GRID, constant_current_sweep
from ibrid_bench.recipes import recipes
from scipy.io import savemat

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement import OperatingPoint, PointSweep, Sweep, check_conventions
from ibrid.measurement.conventions.frequency_base import (
    frequency_readings,
    other_frequency,
    possible_frequencies,
)
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.importing.importing import import_files
from ibrid.plants.sweeping import sweep as sweep_of

EYE, J = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])


@pytest.mark.slow
@each_of("noise_db", [None, 60, 50])
@each_of("f0", [50.0, 60.0])
def test_a_wrong_nominal_frequency_is_named_before_anything_is_fitted(f0, noise_db):
    sweep = constant_current_sweep(f0, 110.0 - f0, noise_db)
    readings = frequency_readings(sweep)
    assert all(abs(one.hertz - f0) < 3 * one.doubt for one in readings)
    assert possible_frequencies(readings, sweep.f0_hz) == (f0,)
    (sentence,) = check_conventions(sweep).warnings
    assert f"write # f0_hz: {f0:g}" in sentence
    assert check_conventions(replace(sweep, f0_hz=f0)).warnings == ()


def test_what_cancels_a_part_of_the_reactance_is_told_as_the_twin_of_a_frequency():
    (sentence,) = check_conventions(
        constant_current_sweep(60.0, 60.0, decoupling=0.15 / 6)
    ).warnings
    assert "a decoupling of 17% of its inductance without delay would look alike" in sentence


@pytest.mark.nightly
@each_of("noise_db", [None, 50])
def test_the_declared_frequency_of_every_inverter_is_never_doubted_and_another_often(noise_db):
    told, sweeps = 0, 0
    for benchmark in recipes():
        sweep = sweep_of(benchmark.plant, None, np.geomspace(5, 5000, 24), noise_db=noise_db)
        readings = frequency_readings(sweep)
        assert other_frequency(readings, sweep.f0_hz) is None, benchmark.name
        other = 110.0 - sweep.f0_hz
        found = other_frequency(readings, other)
        assert found is None or found[0] == sweep.f0_hz, benchmark.name
        told, sweeps = told + (found is not None), sweeps + 1
    assert told >= (12), f"{told} of {sweeps}"


def test_the_reading_is_that_of_an_inductance_whatever_the_current_axes_and_base():
    z = (0.01 + 2j * np.pi * GRID[:, None, None] * 0.2 / (2 * np.pi * 400)) * EYE + 0.2 * J
    y = -np.linalg.inv(z)
    for changed in (y, -y, 3 * y, J @ y @ J.T, y[:, ::-1, ::-1]):
        sweep = Sweep((PointSweep(OperatingPoint("a", 1, 0), GRID, changed),))
        (reading,) = frequency_readings(sweep)
        assert reading.hertz == pytest.approx(400, rel=1e-6)


def test_a_sweep_that_ends_too_low_or_is_decoupled_tells_nothing():
    low = constant_current_sweep(50.0, 60.0)
    points = tuple(point.at(point.frequency < 900) for point in low.points)
    assert frequency_readings(replace(low, points=points)) == [None, None]
    decoupled = frequency_readings(constant_current_sweep(50.0, 60.0, decoupling=0.15))
    assert other_frequency(decoupled, 60.0) is None
    assert possible_frequencies(decoupled, 60.0) == (50.0,)


@pytest.mark.slow
def test_import_asks_for_f0_with_what_the_data_read_and_where_they_contradict(tmp_path):
    """Nothing said: the reading stands in the question. 60 beside the table: both are offered. The
    user's word stays, doubted.
    """
    sweep = constant_current_sweep(50.0, 60.0)
    write_sweep(sweep, tmp_path / "wrong.csv")
    text = (tmp_path / "wrong.csv").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    (tmp_path / "silent.csv").write_text("\n".join(lines))
    (tmp_path / "told.csv").write_text("\n".join(["# f0 = 60 Hz", *lines]))
    said = {"unit": "pu", "current": "out", "q_axis": "leads", "power_node": "pcc"}
    assert (
        "(the highest frequencies read 49.7 Hz +- 0.5)"
        in import_files([tmp_path / "silent.csv"], **said).asked
    )
    asked = import_files([tmp_path / "told.csv"], **said).asked
    assert "60 Hz stands there, the highest frequencies read" in asked
    assert "--f0-hz 50 or --f0-hz 60" in asked
    kept = import_files([tmp_path / "told.csv"], **said, f0_hz=60.0)
    assert kept.answered().f0_hz == 60.0
    assert any("the highest frequencies read" in one for one in kept.remarks)
    (tmp_path / "right.csv").write_text("\n".join(["# f0 = 50 Hz", *lines]))
    assert import_files([tmp_path / "right.csv"], **said).answered().f0_hz == 50.0
    for hertz in (0.5, 5000.0):
        with pytest.raises(SweepError, match="f0_hz must be 10 to 1000 Hz"):
            import_files([tmp_path / "right.csv"], **said, f0_hz=hertz)


@pytest.mark.slow
def test_a_mat_file_with_f0_for_f0_hz_is_refused(tmp_path):
    held = {"frequency": [1.0, 2.0], "Y": np.ones((2, 2, 2)), "p": 0.5, "q": 0.0}
    savemat(tmp_path / "a.mat", held | {"f0": 50.0})
    with pytest.raises(SweepError, match=r"variable f0 is not a key, .*f0_hz"):
        ibrid.read_sweep(tmp_path / "a.mat")
    savemat(tmp_path / "b.mat", held | {"f0_hz": 50.0, "L_filter": 0.1})
    assert ibrid.read_sweep(tmp_path / "b.mat").f0_hz == 50.0
