"""Windows of estimators against closed forms, the voltage before them, and the noise behind
them.
"""

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.estimators.correlation import correlated, correlation, noise_of_frames
from ibrid.measurement.estimators.rebuilt import found_window, rebuilt
from ibrid.measurement.estimators.window import Window, window_of

FINE = np.arange(-0.6, 2.6, 1e-4)


def seen(window: Window, wave: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Tags and what a window shows of a wave at `FINE`."""
    tags = np.arange(0.0, 2.0, 1.0 / rate)
    return tags, window.matrix(tags, FINE) @ wave


@pytest.mark.parametrize(
    ("said", "f0_hz", "bandwidth"),
    [  # published responses of the reference filters, computed apart from these weights
        ("c37.118-P:50", 50.0, 16.0),
        ("c37.118-P:60", 60.0, 19.2),
        ("c37.118-M:10", 50.0, 3.2),
        ("c37.118-M:25", 50.0, 7.8),
        ("c37.118-M:50", 50.0, 13.2),
        ("c37.118-M:100", 50.0, 23.3),
        ("c37.118-M:30", 60.0, 8.8),
        ("c37.118-M:60", 60.0, 14.0),
        ("c37.118-M:120", 60.0, 27.0),
        ("dft:1", 50.0, 22.1),
        ("dft:0.5", 60.0, 53.1),
        ("first_order:0.02", 50.0, 1.0 / (2.0 * np.pi * 0.02)),
    ],
)
def test_windows_pass_what_their_definitions_say(said: str, f0_hz: float, bandwidth: float):
    assert window_of(said, f0_hz).bandwidth_hz == pytest.approx(bandwidth, rel=0.012)


def test_a_fourier_window_of_a_cycle_removes_the_frequency_itself_and_its_multiples():
    window = window_of("dft:1", 50.0)
    assert np.abs(window.response(np.array([50.0, 100.0, -50.0, 500.0]))).max() < 1e-12
    assert abs(window.response(np.array([10.0]))[0]) == pytest.approx(
        np.sinc(0.2), abs=2e-4
    )  # 64 parts for an integral


def test_a_frequency_beside_the_nominal_one_turns_a_phasor_that_class_p_weighs_by_its_gain():
    window, turns = window_of("c37.118-P:50", 50.0), 2.0
    tags, phasor = seen(window, np.exp(2j * np.pi * turns * FINE), 50.0)
    gain = window.response(np.array([turns]))[0]
    np.testing.assert_allclose(phasor, gain * np.exp(2j * np.pi * turns * tags), atol=3e-5)
    k = np.arange(-14, 15)
    triangle = 1.0 - 2.0 * np.abs(k) / 30.0
    closed = (triangle * np.cos(2.0 * np.pi * turns * k / 750.0)).sum() / triangle.sum()
    assert gain == pytest.approx(closed, abs=1e-12)
    magnitude = abs(gain) / np.sin(np.pi * (50.0 + 1.625 * turns) / 100.0)
    assert magnitude == pytest.approx(1.0, abs=1e-4)  # what the standard divides by makes up for it


def test_a_modulated_phasor_keeps_the_part_that_the_window_passes():
    for said, rate in (
        ("c37.118-P:50", 50.0),
        ("c37.118-M:50", 50.0),
        ("dft:1", 200.0),
        ("first_order:0.05", 200.0),
    ):
        window = window_of(said, 50.0)
        tags, phasor = seen(window, 1.0 + 0.1 * np.cos(2.0 * np.pi * 3.0 * FINE), rate)
        passed = window.response(np.array([3.0]))[0]
        expected = 1.0 + 0.1 * np.real(passed * np.exp(6j * np.pi * tags))
        np.testing.assert_allclose(phasor[20:-20], expected[20:-20], atol=1e-4, err_msg=said)


def test_a_step_passes_half_at_the_tag_of_a_centred_window():
    for said in ("c37.118-P:50", "c37.118-M:25"):
        assert window_of(said, 50.0).step_response(np.array([0.0]))[0] == pytest.approx(
            0.5, abs=1e-12
        )
    times = np.array([-1e-3, 0.0, 0.005, 0.01, 0.02])
    np.testing.assert_allclose(
        window_of("dft:1", 50.0).step_response(times), [0, 0, 0.25, 0.5, 1], atol=1e-12
    )
    decay = 1.0 - np.exp(-times[1:] / 0.02)
    np.testing.assert_allclose(
        window_of("first_order:0.02", 50.0).step_response(times)[1:], decay, atol=5e-4
    )
    triangle = window_of("c37.118-P:60", 60.0).step_response(np.array([-0.0165, 0.0165]))
    np.testing.assert_allclose(triangle, [0, 1], atol=1e-12)  # of a span of two cycles in all


@pytest.mark.parametrize(
    "said", ["c37.118-P:100", "c37.118-M:50", "dft:1", "dft:2", "first_order:0.02"]
)
def test_the_voltage_before_a_window_has_its_jumps_and_what_is_smooth_beside_them(said: str):
    window = window_of(said, 50.0)
    dip = np.where((FINE > 0.5033) & (FINE < 0.6533), 0.5, 1.0) + 0.01 * np.sin(2.0 * np.pi * FINE)
    tags, shown = seen(window, dip.astype(complex), 100.0)
    before = rebuilt(tags, shown, window, 0.0, 50.0)
    largest = np.sort(before.jumps.times[np.argsort(-np.abs(before.jumps.sizes))[:2]])
    np.testing.assert_allclose(
        largest, [0.5033, 0.6533], atol=1e-3
    )  # samples of the estimator are 1.3 ms apart
    inside = ~before.masked
    assert inside.sum() > len(tags) - 14
    assert np.abs(before.matrix @ before.v - shown)[inside].max() < 3e-3
    still = (before.time > 0.1) & (before.time < 1.8) & (np.abs(before.time - 0.5783) > 0.1)
    assert np.abs(before.v - np.interp(before.time, FINE, dip))[still].max() < 3e-3


def test_frames_whose_window_no_jump_explains_are_left_out():
    window, rng = window_of("c37.118-P:50", 50.0), np.random.default_rng(0)
    bursts = 1.0 + np.where(
        (FINE > 0.5) & (FINE < 0.8), np.sign(np.sin(2.0 * np.pi * 23.0 * FINE)), 0.0
    )
    tags, shown = seen(window, bursts.astype(complex), 50.0)
    before = rebuilt(tags, shown + 1e-6 * rng.standard_normal(len(tags)), window, 1e-6, 50.0)
    assert before.masked[(tags > 0.55) & (tags < 0.75)].mean() > 0.5
    assert not before.masked[tags < 0.3].any()


@pytest.mark.parametrize(
    ("said", "seconds"), [("dft:1", 0.02), ("dft:2", 0.04), ("c37.118-P:100", 0.04)]
)
def test_the_length_of_a_window_that_is_not_known_is_told_by_the_jump(said: str, seconds: float):
    dip = np.where((FINE > 0.5033) & (FINE < 0.7033), 0.5, 1.0).astype(complex)
    tags, shown = seen(window_of(said, 50.0), dip, 100.0)
    assert found_window(tags, shown, 0.0)[1] == pytest.approx(seconds, rel=0.1)


def test_a_voltage_without_a_jump_leaves_an_unknown_window_open():
    tags, shown = seen(window_of("dft:1", 50.0), 1.0 + 0.01 * np.sin(2.0 * np.pi * FINE), 100.0)
    window, length = found_window(tags, shown, 0.0)
    assert (window.smears, length) == (False, 0.0)


def test_white_noise_behind_a_window_has_the_correlations_that_are_said_of_it():
    window, rng = window_of("c37.118-M:50", 50.0), np.random.default_rng(1)
    tags = np.arange(0.0, 4000.0) / 50.0
    grid = np.arange(-200, 64400) / 800.0  # the estimator's own samples
    noise = window.matrix(tags, grid) @ rng.standard_normal(len(grid))
    measured = [np.mean(noise[k:] * noise[: len(noise) - k]) / np.var(noise) for k in range(6)]
    np.testing.assert_allclose(
        measured, correlation(window, np.arange(6) / 50.0), atol=0.06
    )  # 3 of 1 / sqrt(4000 / 6)


def test_whitened_noise_is_independent_and_of_one_variance():
    window, rng = window_of("c37.118-P:100", 50.0), np.random.default_rng(2)
    tags = np.arange(0.0, 3000.0) / 100.0
    kept = np.ones(len(tags), dtype=bool)
    grid = np.arange(-200, 22800) / 750.0
    seen_noise = window.matrix(tags, grid) @ rng.standard_normal((len(grid), 2))
    own = np.sqrt(0.1) * rng.standard_normal(seen_noise.shape)  # the part that is each frame's own
    noise = np.sqrt(0.9) * seen_noise / seen_noise.std() + own
    white = correlated(tags, window, kept).whitened(noise[None])[0]
    assert white.std() == pytest.approx(1.0, abs=0.05)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.05


def test_frames_that_are_not_judged_weigh_nothing():
    tags, kept = np.arange(30.0) / 100.0, np.ones(30, dtype=bool)
    kept[10:14] = False
    error = np.ones((2, 30, 2))
    white = correlated(tags, window_of("dft:1", 50.0), kept).whitened(error)
    assert not white[:, ~kept].any()
    assert white[:, kept].any()


def test_noise_at_rest_is_told_in_spite_of_its_correlation():
    window, rng = window_of("c37.118-P:50", 50.0), np.random.default_rng(3)
    grid = np.arange(-100, 1000) / 750.0
    tags = np.arange(50.0) / 50.0
    weights = window.matrix(tags, grid)
    noises = [weights @ rng.standard_normal((len(grid), 2)) for _ in range(200)]
    size = float(np.sqrt(np.mean([one**2 for one in noises])))
    told = [noise_of_frames(tags, one, 1.0, window)[0] for one in noises]
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(size, rel=0.02)


def test_a_window_that_is_not_known_is_refused_in_a_sentence():
    for said, words in (
        ("dtf:1", "found 'dtf:1'"),
        ("dft:0", "with a positive number"),
        ("dft", "is written dft:CYCLES"),
        ("c37.118-M:33", "those of 10, 25, 50, 100 frames per s are known"),
        ("first_order:1e9", "from 0.0001 to 100 s"),
        ("dft:1000", "at most 100 cycles"),
    ):
        with pytest.raises(SweepError, match=words):
            window_of(said, 50.0)
