"""The first look: the numbers are right, the warnings fire where they should, and the text can be
read.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.measurement import (
    OperatingPoint,
    PointSweep,
    Sweep,
    add_noise,
    format_inspection,
    hardware_sweeps,
    read_sweep,
)
from ibrid.measurement.quality.coverage import harmonic_lines, outliers, resonances
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.passivity import bands_of, passivity
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.quantities import band, counted, hertz, percent, span

DATA = Path(__file__).resolve().parents[2] / "data"
GRID = np.geomspace(1, 10000, 241)


def point(
    values: np.ndarray, frequency: np.ndarray = GRID, name: str = "a", p: float = 1.0, **more
) -> PointSweep:
    return PointSweep(OperatingPoint(name, p, 0.3), frequency, values, **more)


def diagonal(d: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.array([[d, 0 * d], [0 * q, q]], complex).transpose(2, 0, 1)


def smooth(frequency: np.ndarray = GRID) -> np.ndarray:
    first = 1 / (1 + 1j * frequency / 100)
    return diagonal(-0.2 - first, -0.5 - 0.3 * first)


def peak(frequency: np.ndarray, quality: float) -> np.ndarray:
    x = 1j * frequency / 500
    high = 1 / (1 + x / quality + x**2)
    return diagonal(-high, -high)


def test_passivity_is_that_of_the_load_admittance():
    real = np.where(GRID < 100, -0.5, 0.2)
    found = passivity(point(diagonal(real + 1j, -1.0 + 0j * GRID)), estimate_point(point(smooth())))
    np.testing.assert_allclose(found.smallest, np.where(GRID < 100, 0.5, -0.2))
    assert found.bands == ((GRID[GRID >= 100][0], GRID[-1]),)


def test_activity_within_the_noise_is_not_claimed():
    values = diagonal(1e-3 + 0j * GRID, -1.0 + 0j * GRID)
    sure = point(values, sigma=np.full((len(GRID), 2, 2), 1e-4))
    unsure = point(values, sigma=np.full((len(GRID), 2, 2), 1e-3))
    assert passivity(sure, estimate_point(sure)).bands == ((1.0, 10000.0),)
    assert passivity(unsure, estimate_point(unsure)).bands == ()


def test_bands_are_runs_of_neighbours():
    flags = np.array([True, False, True, True, False])
    assert bands_of(flags, np.arange(1.0, 6.0)) == ((1.0, 1.0), (3.0, 4.0))
    assert bands_of(~flags & False, np.arange(1.0, 6.0)) == ()


@pytest.mark.parametrize(
    ("quality", "count", "thin"), [(20.0, 16, True), (20.0, 400, False), (3.0, 100, False)]
)
def test_a_sharp_peak_on_a_coarse_grid_is_called_undersampled(quality, count, thin):
    frequency = np.geomspace(5, 5000, count)
    measured = point(peak(frequency, quality), frequency)
    found = resonances(measured, estimate_point(measured))
    assert len(found) == 1
    assert found[0].frequency == pytest.approx(500, rel=0.3)
    assert (found[0].points < 3) == thin


def test_a_smooth_response_has_no_peak():
    assert resonances(point(smooth()), estimate_point(point(smooth()))) == ()


def test_points_on_multiples_of_f0_and_those_that_stick_out_are_found():
    frequency = np.sort(np.append(GRID, [60.0, 300.0]))
    values = smooth(frequency)
    values[np.flatnonzero(frequency == 300.0)] *= 1.2
    noisy = add_noise(
        Sweep((point(values, frequency),)), 60, rng=np.random.default_rng(0), record_sigma=False
    ).points[0]
    lines = {line.order: line.outlying for line in harmonic_lines(noisy, 60.0, tolerance=1e-6)}
    assert lines == {1: False, 5: True}
    assert frequency[outliers(noisy)].tolist() == [300.0]


def test_noise_alone_has_few_outliers():
    noisy = add_noise(
        Sweep((point(smooth()),)), 30, rng=np.random.default_rng(1), record_sigma=False
    ).points[0]
    assert outliers(noisy).sum() <= 1


def test_a_coarse_grid_leaves_outliers_open():
    frequency = np.geomspace(5, 5000, 16)
    assert outliers(point(smooth(frequency), frequency)) is None


def test_numbers_of_an_operating_point():
    frequency = np.array([5.0, 50.0, 500.0, 5000.0])
    values = diagonal(np.array([-1.0, -2.0, -4.0, -8.0]), np.full(4, -1.0))
    found = inspect(Sweep((point(values, frequency),), sampling_hz=8000)).points[0]
    assert (found.points, found.lowest, found.highest, found.repeats) == (4, 5, 5000, 1)
    assert found.points_per_decade == pytest.approx(1)
    assert (found.condition, found.condition_at) == (pytest.approx(8), 5000)
    assert (found.smallest_eigenvalue, found.active_bands) == (pytest.approx(1), ())
    assert [loop.points for loop in found.loops] == [1, 2, 1, 1]
    assert found.above_half_sampling == 1
    assert (found.noise_source, found.noise, found.noise_db) == ("unknown", None, None)


def said(sweep: Sweep, **options) -> str:
    return " ".join(inspect(sweep, **options).warnings)


def test_warnings_name_what_is_missing():
    few = np.array([50.0, 60.0, 70.0])
    text = said(Sweep((point(smooth(few), few),)), sampling_hz=130)
    for words in (
        "one operating point",
        "fewer than 8 frequencies (a)",
        "noise unknown (a)",
        "no point below 50 Hz, where outer power loops usually act",
        "no point above 70 Hz, where current loop usually acts",
        "1 point lies above half the sampling rate",
        "points on f0 times 1",
    ):
        assert words in text
    twice = Sweep((point(smooth(), name="a"), point(smooth(), name="b")))
    assert "a and b have the same p, q, v" in said(twice)
    assert "noisy: " in said(add_noise(twice, 20, rng=np.random.default_rng(0)))
    singular = diagonal(np.full(len(GRID), -1.0), np.full(len(GRID), -1e-5))
    assert "nearly singular" in said(Sweep((point(singular),)))


def test_zero_matrices_at_single_frequencies_are_survived():
    values = smooth()
    values[3] = 0
    values[-1] = 0
    found = inspect(Sweep((point(values),)))
    assert found.points[0].condition == np.inf
    assert (
        json.loads(json.dumps(found.to_json(), allow_nan=False))["points"][0]["condition"] is None
    )
    assert "inf" in format_inspection(found)


@pytest.mark.slow
@each_of("path", sorted(DATA.glob("*.csv")), ids=lambda path: path.stem)
def test_shipped_sweeps_are_inspected(path):
    found = inspect(read_sweep(path))
    text = format_inspection(found)
    assert max(map(len, text.splitlines())) <= 120
    result = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert result["schema"] == "ibrid.inspection/1"
    assert result["points"][0]["loops"][-1]["high"] is None
    assert {entry["op"]["name"] for entry in result["points"]} == {"p=1,q=0.3", "p=1,q=-0.3"}


def test_the_benchmark_is_seen_to_undersample_its_resonance():
    found = inspect(read_sweep(DATA / "paper_like.csv"))
    assert any("spanned by fewer than three points" in warning for warning in found.warnings)
    assert all(entry.active_bands[0][0] == 5 for entry in found.points)


@pytest.mark.slow
def test_many_operating_points_are_shown_in_blocks():
    points = tuple(point(smooth(), name=f"p={k / 10:g}", p=k / 10) for k in range(7))
    text = format_inspection(inspect(Sweep(points, s_base_va=1e3, v_base_v=400, source="scan.csv")))
    assert text.count("condition number of Y") == 3
    assert "base 1000 VA, 400 V" in text
    assert max(map(len, text.splitlines())) <= 120


@pytest.mark.parametrize("path", hardware_sweeps().values(), ids=lambda path: path.stem)
def test_hardware_is_seen_as_it_is(path):
    found = inspect(read_sweep(path), sampling_hz=20e3)
    assert all(entry.noise_source == "smoothness" for entry in found.points)
    assert all(0.02 < entry.noise < 0.12 for entry in found.points)
    assert all(entry.above_half_sampling == 1 for entry in found.points)
    assert found.conventions.status == "agree"
    # below the PLL bandwidth the q axis is a negative resistance
    assert all(entry.active_bands[0][0] == 40 for entry in found.points)
    assert any("no point below 40 Hz" in warning for warning in found.warnings)


def test_numbers_are_short():
    assert [hertz(value) for value in (0.0512, 49.999, 999.7, 1234.5)] == [
        "0.0512 Hz",
        "50 Hz",
        "1 kHz",
        "1.23 kHz",
    ]
    assert [band(1, 20), band(50, 2000), band(1500, 2000), band(7, 7)] == [
        "1-20 Hz",
        "50 Hz - 2 kHz",
        "1.5-2 kHz",
        "7 Hz",
    ]
    assert [span(5, 5000), span(50, 500), span(19.9, 19.9), span(19.94, 19.91)] == [
        "5 Hz to 5 kHz",
        "50 Hz to 500 Hz",
        "19.9 Hz",
        "19.9 Hz",
    ]
    assert percent(0.03456) == "3.5 %"
    assert [counted(number, "free parameter") for number in (0, 1, 2)] == [
        "0 free parameters",
        "1 free parameter",
        "2 free parameters",
    ]


def test_a_simulated_device_has_no_background_harmonics():
    frequency = np.array([7.0, 11.0, 23.0, 37.0, 60.0, 83.0, 120.0, 170.0, 250.0, 410.0])
    measured = ibrid.sweep("gfl_l_filter", None, frequency)
    simulated = replace(measured, notes=("simulated by ibrid measure: multisines that reach 0.01",))
    warned = [
        any("background harmonics" in one for one in inspect(sweep).warnings)
        for sweep in (measured, simulated)
    ]
    assert warned == [True, False]
