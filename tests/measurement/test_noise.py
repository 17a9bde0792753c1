"""Noise: what is added is what was asked for, and what is estimated is what was added."""

from pathlib import Path

import numpy as np
import pytest
from collecting import each_of

from ibrid.errors import SweepError
from ibrid.measurement import (
    OperatingPoint,
    PointSweep,
    Sweep,
    add_noise,
    estimate_noise,
    hardware_sweeps,
    read_sweep,
)
from ibrid.measurement.sweeps.noise import points_per_decade, roughness, sigma_of_mean, with_sigma
from ibrid.measurement.sweeps.vector_fit import vector_fit

PAPER_LIKE = Path(__file__).resolve().parents[2] / "data" / "paper_like.csv"


def rational(frequency: np.ndarray) -> np.ndarray:
    """A smooth response with a resonance of Q = 10 at 800 Hz and a slow mode."""
    x = 1j * frequency / 800
    peak, slow = x / (x**2 + x / 10 + 1), 1 / (1 + 1j * frequency / 12)
    return np.array([[slow + peak, 0.3 * peak], [-0.2 * slow, peak - 0.7]]).transpose(2, 0, 1)


def clean(per_decade: int = 30) -> Sweep:
    frequency = np.geomspace(5, 5000, 3 * per_decade + 1)
    return Sweep((PointSweep(OperatingPoint("a", 1, 0.3), frequency, rational(frequency)),))


@pytest.mark.parametrize("noise_db", [60, 40, 20])
def test_added_noise_has_the_asked_ratio_to_the_whole_matrix(noise_db):
    sweep = clean(300)
    noisy = add_noise(sweep, noise_db, rng=np.random.default_rng(0))
    error = noisy.points[0].admittance - sweep.points[0].admittance
    ratio = np.linalg.norm(error, axis=(1, 2)) / np.linalg.norm(
        sweep.points[0].admittance, axis=(1, 2)
    )
    # 900 matrices of 8 numbers: 0.8 %
    assert -20 * np.log10(np.sqrt(np.mean(ratio**2))) == pytest.approx(noise_db, abs=0.2)
    whitened = error / noisy.points[0].sigma
    assert np.std([whitened.real, whitened.imag]) == pytest.approx(1, abs=0.03)
    assert estimate_noise(noisy)["a"].level == pytest.approx(10 ** (-noise_db / 20), rel=0.02)


def test_same_generator_gives_the_same_noise():
    first, second = (
        add_noise(clean(), 40, rng=np.random.default_rng(7), repeats=3) for _ in range(2)
    )
    np.testing.assert_array_equal(first.points[0].repeats, second.points[0].repeats)


def test_repeats_lower_the_noise_of_the_mean():
    noisy = add_noise(clean(300), 40, rng=np.random.default_rng(0), repeats=16)
    assert noisy.points[0].repeats.shape == (16, 901, 2, 2)
    error = (noisy.points[0].admittance - clean(300).points[0].admittance) / noisy.points[0].sigma
    assert np.std([error.real, error.imag]) == pytest.approx(1, abs=0.03)
    assert estimate_noise(noisy)["a"].level == pytest.approx(0.0025, rel=0.05)


def test_impossible_requests_are_refused():
    with pytest.raises(SweepError, match="repeats must be 1 to 10000 runs; found 0"):
        add_noise(clean(), 40, rng=np.random.default_rng(0), repeats=0)
    with pytest.raises(SweepError, match=r"noise_db must be .* dB; found nan"):
        add_noise(clean(), float("nan"), rng=np.random.default_rng(0))


def source(sweep: Sweep) -> str:
    return estimate_noise(sweep)["a"].source


def test_sigma_comes_first_then_repeats_then_smoothness_then_vector_fits():
    rng = np.random.default_rng(0)
    assert source(add_noise(clean(), 40, rng=rng)) == "sigma"
    assert source(add_noise(clean(), 40, rng=rng, repeats=3)) == "sigma"
    assert source(add_noise(clean(), 40, rng=rng, repeats=2, record_sigma=False)) == "repeats"
    assert source(add_noise(clean(), 40, rng=rng, record_sigma=False)) == "smoothness"
    assert source(add_noise(clean(14), 40, rng=rng, record_sigma=False)) == "vector-fit"
    assert source(add_noise(clean(3), 40, rng=rng, record_sigma=False)) == "unknown"


def test_sigma_from_the_scatter_of_a_file_counts_as_repeats(tmp_path):
    from ibrid.measurement import write_sweep

    write_sweep(
        add_noise(clean(), 40, rng=np.random.default_rng(0), repeats=4, record_sigma=False),
        tmp_path / "a.csv",
    )
    again = read_sweep(tmp_path / "a.csv")
    assert again.points[0].sigma is not None
    assert source(again) == "repeats"


@each_of("repeats", [2, 3, 5, 20])
@each_of("noise_db", [60, 30])
def test_scatter_of_repeats_estimates_the_noise_of_their_mean(repeats, noise_db):
    noisy = add_noise(
        clean(), noise_db, rng=np.random.default_rng(1), repeats=repeats, record_sigma=False
    )
    true = 10 ** (-noise_db / 20) / np.sqrt(repeats)
    assert estimate_noise(noisy)["a"].level == pytest.approx(true, rel=0.1)


@pytest.mark.slow
@each_of("per_decade", [20, 40, 100])
@each_of("noise_db", [50, 40, 20])
def test_roughness_estimates_the_noise_of_a_single_run(per_decade, noise_db):
    noisy = add_noise(clean(per_decade), noise_db, rng=np.random.default_rng(2), record_sigma=False)
    assert estimate_noise(noisy)["a"].level == pytest.approx(10 ** (-noise_db / 20), rel=0.2)


@pytest.mark.slow
@each_of("per_decade", [5, 14])
@each_of("noise_db", [60, 50, 40])
def test_vector_fits_of_a_sparse_sweep_leave_its_noise_and_not_much_more(per_decade, noise_db):
    # 16 to 46 points of a response with seven poles leave 80 and more degrees of freedom: 8 % and
    # one deviation of caution
    for seed in range(5):
        noisy = add_noise(
            clean(per_decade), noise_db, rng=np.random.default_rng(seed), record_sigma=False
        )
        assert 0.85 < estimate_noise(noisy)["a"].level / 10 ** (-noise_db / 20) < 1.7


def test_vector_fits_of_clean_data_do_not_invent_a_noise():
    assert source(clean(5)) == "unknown"


def test_a_noise_that_vector_fits_tell_is_told_of_a_study_too():
    noisy = add_noise(clean(5), 40, rng=np.random.default_rng(0), record_sigma=False)
    filled = with_sigma(noisy)
    assert source(filled) == "vector-fit"
    assert estimate_noise(filled)["a"].level == pytest.approx(estimate_noise(noisy)["a"].level)


@each_of("order", [1, 2, 5, 8])
def test_a_vector_fit_returns_a_rational_function_of_its_order(order):
    frequency, rng = np.geomspace(1, 1e3, 24), np.random.default_rng(order)
    s = 2j * np.pi * frequency
    poles = 2 * np.pi * np.geomspace(3, 300, order // 2) * (-0.3 + 1j)
    truth = np.tile(rng.standard_normal((2, 2)), (24, 1, 1)).astype(complex)
    for pole in (*poles, *([-2 * np.pi * 40.0] if order % 2 else [])):
        residue = abs(pole) * rng.standard_normal((2, 2, 2)) @ np.array([1, 1j])
        residue = residue if np.imag(pole) else residue.real
        both = 1 / (s - pole)[:, None, None] * residue
        truth = (
            truth
            + both
            + (1 / (s - np.conj(pole))[:, None, None] * residue.conj() if np.imag(pole) else 0)
        )
    found = vector_fit(frequency, truth, order, np.ones(24))
    np.testing.assert_allclose(found, truth, atol=1e-6 * np.abs(truth).max())


@pytest.mark.slow
@each_of("row", range(16))
def test_a_row_times_ten_drives_no_pole_onto_the_imaginary_axis(row):
    # a pole at the frequency of a wrong row takes the whole row, and without damping is infinite
    # there
    frequency = np.geomspace(5, 5000, 16)
    slipped = (
        np.tile(np.array([[0.2, -1.0], [1.0, 0.2]], dtype=complex), (16, 1, 1))
        / (1 + 1j * frequency / 300)[:, None, None]
    )
    slipped[row] *= 10
    with np.errstate(all="raise", under="ignore"):
        for order in range(2, 15):
            assert np.isfinite(
                vector_fit(frequency, slipped, order, 1 / np.linalg.norm(slipped, axis=(1, 2)))
            ).all()


@pytest.mark.slow
def test_roughness_is_unbiased_on_white_noise_and_follows_its_level():
    rng = np.random.default_rng(0)
    frequency = np.geomspace(1, 1e4, 2000)
    level = np.array([[1e-3, 1e-4], [3e-4, 2e-3]])
    noise = level * (rng.standard_normal((2000, 2, 2)) + 1j * rng.standard_normal((2000, 2, 2)))
    found = roughness(frequency, 1.0 + noise)
    np.testing.assert_allclose(np.sqrt((found**2).mean(axis=0)), level, rtol=0.1)


def test_single_spikes_do_not_raise_the_roughness():
    noisy = add_noise(clean(60), 40, rng=np.random.default_rng(3), record_sigma=False)
    values = noisy.points[0].admittance.copy()
    before = roughness(noisy.points[0].frequency, values)
    values[90] *= 1.5
    after = roughness(noisy.points[0].frequency, values)
    # seven windows of nine in the median see the spike where they overlap it, none beyond
    assert np.median(after / before) == 1
    assert (after[[80, 100]] / before[[80, 100]] < 1.5).all()


def test_clean_data_look_far_cleaner_than_noisy_ones():
    assert estimate_noise(clean(60))["a"].level < 1e-3
    assert estimate_noise(clean(200))["a"].level < 1e-5


def test_equal_repeats_say_nothing():
    point = clean().points[0]
    assert sigma_of_mean(np.array([point.admittance] * 3)) is None


def test_the_shipped_benchmark_has_unknown_noise():
    assert {noise.source for noise in estimate_noise(read_sweep(PAPER_LIKE)).values()} == {
        "unknown"
    }


def test_density_of_a_grid():
    assert points_per_decade(np.geomspace(5, 5000, 16)) == pytest.approx(5)
    assert points_per_decade(np.array([50.0])) == 0


@pytest.mark.skipif(not hardware_sweeps(), reason="the hardware sweeps are not on this machine")
def test_hardware_noise_is_a_few_percent():
    levels = {
        name: noise.level
        for name, noise in estimate_noise(read_sweep(hardware_sweeps()["gti_pq"])).items()
    }
    # single raw runs; measured 0.034 and 0.033
    assert levels == pytest.approx({"absorbing": 0.034, "delivering": 0.033}, abs=0.01)
